//! Poses for `moveit_servo` of Jazzy and later, which is put into the mode that follows poses.

use std::sync::{Arc, Mutex};

use selvedge_math::Pose;

use crate::arm::cartesian::Cartesian;
use crate::arm::{Measured, Sink};
use crate::call::Call;
use crate::dds::{Bus, Kept};
use crate::error::{Cause, Error};
use crate::messages::{CommandType, ServoStatus, SetBool, SetBoolReply, Success};
use crate::robot::Robot;

/// The command type of poses.
const POSE: i8 = 2;
/// How long servo may take to change its mode [s].
const ANSWER: f64 = 5.0;

/// Servo, under the name of its node.
pub(crate) struct Servo {
    poses: Cartesian,
    mode: Call<CommandType, Success>,
    pause: Call<SetBool, SetBoolReply>,
    /// The newest status; none may ever come.
    status: Arc<Mutex<Option<ServoStatus>>>,
    node: String,
}

/// The name of a status, and whether servo stands still with it.
fn status(code: i8) -> (&'static str, bool) {
    match code {
        0 => ("NO_WARNING", false),
        1 => ("DECELERATE_FOR_APPROACHING_SINGULARITY", false),
        2 => ("HALT_FOR_SINGULARITY", true),
        3 => ("DECELERATE_FOR_LEAVING_SINGULARITY", false),
        4 => ("DECELERATE_FOR_COLLISION", false),
        5 => ("HALT_FOR_COLLISION", true),
        6 => ("JOINT_BOUND", true),
        -1 => ("INVALID", true),
        _ => ("an unknown status", true),
    }
}

impl Servo {
    /// `node` is that of servo, for example `/servo_node`.
    pub(crate) fn new(bus: &mut Bus, node: &str, frame: &str, robot: Robot) -> Result<Self, Error> {
        let node = &bus.resolve(node)?;
        let newest: Arc<Mutex<Option<ServoStatus>>> = Arc::default();
        let shared = Arc::clone(&newest);
        let take = move |message| {
            *shared.lock().unwrap_or_else(|e| e.into_inner()) = Some(message);
        };
        let topic = format!("{node}/status");
        bus.subscribe(&topic, ("moveit_msgs", "ServoStatus"), Kept::No, take)?;
        let mode = format!("{node}/switch_command_type");
        let pause = format!("{node}/pause_servo");
        Ok(Self {
            poses: Cartesian::new(bus, &format!("{node}/pose_target_cmds"), frame, robot)?,
            mode: Call::new(bus, &mode, ("moveit_msgs", "ServoCommandType"))?,
            pause: Call::new(bus, &pause, ("std_srvs", "SetBool"))?,
            status: newest,
            node: node.clone(),
        })
    }

    fn refused(&self, name: &str, detail: &str) -> Cause {
        Cause::Failed {
            name: name.into(),
            status: "refused".into(),
            detail: detail.into(),
        }
    }
}

impl Sink for Servo {
    fn prepare(&mut self) -> Result<(), Cause> {
        self.poses.prepare()?;
        self.mode.wait()?;
        self.pause.wait()?;
        let pose = CommandType { command_type: POSE };
        if !self.mode.call(pose, ANSWER)?.success {
            return Err(self.refused(self.mode.name(), "servo does not follow poses"));
        }
        let go = self.pause.call(SetBool { data: false }, ANSWER)?;
        if !go.success {
            return Err(self.refused(self.pause.name(), &go.message));
        }
        *self.status.lock().unwrap_or_else(|e| e.into_inner()) = None;
        Ok(())
    }

    fn measured(&mut self) -> Result<Measured, Cause> {
        self.poses.measured()
    }

    fn send(&mut self, pose: &Pose) -> Result<(), Cause> {
        self.poses.send(pose)
    }

    fn watch(&mut self) -> Result<(), Cause> {
        self.poses.watch()?;
        let newest = self.status.lock().unwrap_or_else(|e| e.into_inner());
        let Some(told) = &*newest else {
            return Ok(());
        };
        match status(told.code) {
            (_, false) => Ok(()),
            (name, true) => Err(Cause::Failed {
                name: self.node.clone(),
                status: name.into(),
                detail: told.message.clone(),
            }),
        }
    }
}
