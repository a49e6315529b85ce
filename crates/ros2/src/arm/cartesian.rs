//! Poses for a Cartesian controller: FZI `cartesian_motion_controller`, CRISP, or any that takes
//! `geometry_msgs/PoseStamped`.

use selvedge_math::Pose;

use crate::arm::{Measured, Sink};
use crate::dds::Bus;
use crate::error::{Cause, Error};
use crate::limits::angle;
use crate::messages::{Header, Name, PoseStamped};
use crate::outbox::Outbox;
use crate::robot::Robot;

/// How far the tip may be behind the pose that was sent [m], [rad].
const BEHIND: (f64, f64) = (0.05, 0.2);

/// A controller that follows poses on a topic.
pub(crate) struct Cartesian {
    out: Outbox<PoseStamped>,
    robot: Robot,
    /// FZI takes no message whose frame is not its own base link.
    frame: Name,
    sent: Option<Pose>,
}

impl Cartesian {
    pub(crate) fn new(
        bus: &mut Bus,
        topic: &str,
        frame: &str,
        robot: Robot,
    ) -> Result<Self, Error> {
        Ok(Self {
            out: Outbox::new(bus, topic, ("geometry_msgs", "PoseStamped"))?,
            robot,
            frame: Name::new(frame),
            sent: None,
        })
    }
}

impl Sink for Cartesian {
    fn prepare(&mut self) -> Result<(), Cause> {
        self.sent = None;
        self.robot.wait()?;
        self.out.wait()
    }

    fn measured(&mut self) -> Result<Measured, Cause> {
        self.robot.measured()
    }

    fn send(&mut self, pose: &Pose) -> Result<(), Cause> {
        let header = Header {
            stamp: self.robot.clock.last()?,
            frame_id: self.frame.clone(),
        };
        self.out.put(PoseStamped {
            header,
            pose: pose.into(),
        })?;
        self.sent = Some(*pose);
        Ok(())
    }

    fn watch(&mut self) -> Result<(), Cause> {
        self.out.check()?;
        self.robot.clock.now()?;
        let (Some(sent), Some(witness)) = (&self.sent, self.robot.witness()) else {
            return Ok(());
        };
        let here = witness.measured().pose;
        let far = here.position().distance(sent.position());
        for (what, off, bound) in [
            ("position [m]", far, BEHIND.0),
            ("rotation [rad]", angle(&here, sent), BEHIND.1),
        ] {
            if off.is_nan() || off > bound {
                return Err(Cause::Disagree {
                    first: "the pose that was sent".into(),
                    second: witness.name.clone(),
                    what,
                    off,
                    bound,
                    hint: "the robot does not follow",
                });
            }
        }
        Ok(())
    }
}
