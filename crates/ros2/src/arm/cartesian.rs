//! Poses for a Cartesian controller: FZI `cartesian_motion_controller`, CRISP, or any that takes
//! `geometry_msgs/PoseStamped`.

use selvedge_math::Pose;

use crate::arm::{Measured, Sink};
use crate::dds::{Bus, Out};
use crate::error::{Cause, Error};
use crate::messages::{Header, Name, PoseStamped, Time};
use crate::robot::Robot;

/// How long a controller and the robot's state are waited for [s].
pub(crate) const PATIENCE: f64 = 10.0;

/// A controller that follows poses on a topic.
pub(crate) struct Cartesian {
    out: Out<PoseStamped>,
    robot: Robot,
    /// FZI takes no message whose frame is not its own base link.
    frame: Name,
}

impl Cartesian {
    pub(crate) fn new(
        bus: &mut Bus,
        topic: &str,
        frame: &str,
        robot: Robot,
    ) -> Result<Self, Error> {
        let out = bus.publisher(topic, "geometry_msgs", "PoseStamped")?;
        Ok(Self {
            out,
            robot,
            frame: Name::new(frame),
        })
    }
}

impl Sink for Cartesian {
    fn prepare(&mut self) -> Result<(), Cause> {
        self.robot.wait(PATIENCE)?;
        self.out.wait(PATIENCE)
    }

    fn measured(&mut self) -> Result<Measured, Cause> {
        self.robot.measured()
    }

    fn send(&mut self, pose: &Pose) -> Result<(), Cause> {
        let header = Header {
            stamp: Time::now(),
            frame_id: self.frame.clone(),
        };
        self.out.send(PoseStamped {
            header,
            pose: pose.into(),
        })
    }

    fn watch(&mut self) -> Result<(), Cause> {
        self.out.check()
    }
}
