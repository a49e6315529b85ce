//! Arms and grippers on the network by the names that a person types.

use selvedge_franka::Arm as Model;

use crate::arm::cartesian::Cartesian;
use crate::arm::joints::Joints;
use crate::arm::{Arm, Stream};
use crate::dds::Bus;
use crate::error::Error;
use crate::gripper::action::{Franka, GripperCommand, Jaws};
use crate::gripper::{Gripper, RecordedJaws};
use crate::journal::Journal;
use crate::network::Network;
use crate::plan::Plan;
use crate::robot::Robot;

/// Arms that can be commanded.
pub const ARMS: [&str; 2] = ["cartesian", "joints"];
/// Grippers that can be commanded.
pub const GRIPPERS: [&str; 3] = ["gripper-command", "franka", "none"];

/// Which robot.
#[derive(Clone, Debug)]
pub struct Names {
    /// `cartesian` or `joints`.
    pub arm: String,
    /// Topic of the controller's target, or action of the trajectory controller.
    pub arm_name: String,
    /// `gripper-command`, `franka` or `none`.
    pub gripper: String,
    /// Action of the gripper, or node of `franka_gripper`.
    pub gripper_name: String,
    /// The frame that poses are stamped with: the robot's base link.
    pub frame: String,
    /// Topic of the joint states.
    pub joint_states: String,
}

/// A robot on the network.
pub struct Robots {
    /// The arm.
    pub arm: Box<dyn Arm>,
    /// The gripper.
    pub gripper: Box<dyn Gripper>,
    // Last, so that it goes last.
    _bus: Bus,
}

impl std::fmt::Debug for Robots {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Robots")
    }
}

/// Joins the network and makes clients for a robot; it need not be there yet.
///
/// # Errors
/// [`Error::Value`] for a backend that there is not, [`Error::Network`] when the network cannot be
/// used.
pub fn connect(
    network: &Network,
    names: &Names,
    model: &Model,
    plan: &Plan,
    jaws: Jaws,
    journal: &Journal,
) -> Result<Robots, Error> {
    let unknown = |field, value: &str, known: &[&str]| {
        Error::value(
            "the command line",
            field,
            format!("`{value}`"),
            format!("one of {}", known.join(", ")),
        )
    };
    if !ARMS.contains(&names.arm.as_str()) {
        return Err(unknown("--arm", &names.arm, &ARMS));
    }
    if !GRIPPERS.contains(&names.gripper.as_str()) {
        return Err(unknown("--gripper", &names.gripper, &GRIPPERS));
    }
    jaws.check()?;
    let mut bus = Bus::new(network, "selvedge_play")?;
    let robot = Robot::new(&mut bus, model, &plan.joint_names, &names.joint_states)?;
    let name = names.arm_name.as_str();
    let arm: Box<dyn Arm> = match names.arm.as_str() {
        "joints" => Box::new(Joints::new(
            &mut bus,
            name,
            &plan.joint_names,
            robot,
            journal.clone(),
        )?),
        _ => {
            let sink = Cartesian::new(&mut bus, name, &names.frame, robot)?;
            Box::new(Stream::new(sink, plan.limits, plan.brake, journal.clone()))
        }
    };
    let name = names.gripper_name.as_str();
    let gripper: Box<dyn Gripper> = match names.gripper.as_str() {
        "franka" => Box::new(Franka::new(&mut bus, name, jaws)?),
        "none" => Box::new(RecordedJaws::default()),
        _ => Box::new(GripperCommand::new(&mut bus, name, jaws)?),
    };
    Ok(Robots {
        arm,
        gripper,
        _bus: bus,
    })
}
