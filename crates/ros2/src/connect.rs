//! Arms and grippers on the network by the names that a person types.

use selvedge_franka::Arm as Model;

use crate::arm::cartesian::Cartesian;
use crate::arm::joints::{Follow, Trajectories};
use crate::arm::layout::{Humble, Jazzy, Layout};
use crate::arm::moveit::{Group, MoveIt};
use crate::arm::servo::Servo;
use crate::arm::{Arm, Recorded, Sink, Stream};
use crate::clock::Clock;
use crate::dds::Bus;
use crate::error::Error;
use crate::gripper::command::GripperCommand;
use crate::gripper::franka::Franka;
use crate::gripper::jaws::Jaws;
use crate::gripper::parallel::Parallel;
use crate::gripper::switch::Switch;
use crate::gripper::{Gripper, RecordedJaws};
use crate::journal::Journal;
use crate::names::{Names, Parameters};
use crate::network::{Distro, Network};
use crate::plan::Plan;
use crate::report::Report;
use crate::robot::Robot;
use crate::security::only_topics;
use crate::witness::Witness;

/// Arms, and what is led when no name is given.
pub const ARMS: [(&str, &str); 5] = [
    ("cartesian", "target_pose"),
    ("servo", "servo_node"),
    ("moveit", ""),
    ("joints", "fr3_arm_controller/follow_joint_trajectory"),
    ("record", ""),
];
/// Grippers, and what is commanded when no name is given.
pub const GRIPPERS: [(&str, &str); 6] = [
    ("gripper-command", "franka_gripper/gripper_action"),
    ("franka", "franka_gripper"),
    ("parallel", "gripper_controller/gripper_cmd"),
    ("bool", "close_gripper"),
    ("set-bool", "close_gripper"),
    ("none", ""),
];
/// How long `/clock` may stand still [s].
const CLOCK: f64 = 0.5;

/// Which robot, and who tells where it is. Names are as in ROS: without a leading slash they are in
/// the namespace.
#[derive(Clone, Debug)]
pub struct Choice {
    /// One of [`ARMS`].
    pub arm: String,
    /// Topic of the controller's target, node of servo, namespace of `move_group`, or action of the
    /// trajectory controller.
    pub arm_name: Option<String>,
    /// One of [`GRIPPERS`].
    pub gripper: String,
    /// Action of the gripper, node of `franka_gripper`, topic or service of a switch.
    pub gripper_name: Option<String>,
    /// The joint that a parallel gripper is told.
    pub gripper_joint: String,
    /// The frame that poses are in: the robot's base link.
    pub frame: String,
    /// The frame between the fingers.
    pub tip: String,
    /// MoveIt's planning group.
    pub group: String,
    /// Topic of the joint states.
    pub joint_states: String,
    /// Topic of the tip's pose, if somebody tells it.
    pub current_pose: Option<String>,
    /// Whether `/tf` is asked too.
    pub frames: bool,
    /// Topic of FrankaRobotState, to be reported.
    pub franka_state: Option<String>,
    /// Whether `/clock` tells the time.
    pub sim_time: bool,
    /// Whose messages MoveIt has.
    pub distro: Distro,
    /// How long others are waited for [s].
    pub patience: f64,
    /// What is shown as parameters of the node.
    pub parameters: Parameters,
}

impl Choice {
    /// Arm and gripper must be known.
    ///
    /// # Errors
    /// [`Error::Value`] for one that is not.
    pub fn check(&self) -> Result<(), Error> {
        find("--arm", &self.arm, &ARMS)?;
        find("--gripper", &self.gripper, &GRIPPERS)?;
        if !(0.1..=600.0).contains(&self.patience) {
            let value = format!("{} s", self.patience);
            let bound = "0.1 to 600 s";
            return Err(Error::value("the command line", "--patience", value, bound));
        }
        Ok(())
    }

    /// What the arm is led by.
    ///
    /// # Errors
    /// As [`Choice::check`].
    pub fn arm_name(&self) -> Result<String, Error> {
        let default = find("--arm", &self.arm, &ARMS)?;
        Ok(self.arm_name.clone().unwrap_or(default.into()))
    }
}

fn find(
    field: &'static str,
    value: &str,
    known: &[(&str, &'static str)],
) -> Result<&'static str, Error> {
    let found = known.iter().find(|(name, _)| *name == value);
    found.map(|(_, default)| *default).ok_or_else(|| {
        let names: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
        let bound = format!("one of {}", names.join(", "));
        Error::value("the command line", field, format!("`{value}`"), bound)
    })
}

/// A robot on the network, or none.
pub struct Robots {
    /// The arm.
    pub arm: Box<dyn Arm>,
    /// The gripper.
    pub gripper: Box<dyn Gripper>,
    report: Option<Report>,
    // Last, so that it goes last.
    _bus: Option<Bus>,
}

impl std::fmt::Debug for Robots {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Robots")
    }
}

impl Robots {
    /// No robot: what would be sent goes to the journal alone, and nothing to a network.
    pub fn recorded(plan: &Plan, journal: &Journal) -> Self {
        let sink = Recorded::at(plan.start());
        let arm = Stream::new(sink, plan.limits, journal.clone());
        Self {
            arm: Box::new(arm),
            gripper: Box::new(RecordedJaws::default()),
            report: None,
            _bus: None,
        }
    }

    /// Shows the path of another plan.
    ///
    /// # Errors
    /// [`Error::Network`] when it cannot be published.
    pub fn show(&self, plan: &Plan) -> Result<(), Error> {
        self.report
            .as_ref()
            .map_or(Ok(()), |report| report.show(plan))
    }
}

/// Somebody who only shows what would happen.
pub struct Shown {
    report: Report,
    // Last, so that it goes last.
    _bus: Bus,
}

impl std::fmt::Debug for Shown {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Shown")
    }
}

impl Shown {
    /// How many look at the path.
    pub fn readers(&self) -> usize {
        self.report.readers()
    }
}

/// Joins the network and publishes the planned path; nothing that a robot reads is there.
///
/// # Errors
/// [`Error::Network`] when the network cannot be used.
pub fn show(
    network: &Network,
    names: &Names,
    choice: &Choice,
    plan: &Plan,
) -> Result<Shown, Error> {
    let mut bus = Bus::new(network, names, &choice.parameters, choice.patience)?;
    let (clock, journal) = (Clock::day(), Journal::none());
    journal.event(0.0, "state", "preview");
    let report = Report::new(&mut bus, plan, &choice.frame, None, &clock, &journal)?;
    Ok(Shown { report, _bus: bus })
}

/// Joins the network and makes clients for a robot; it need not be there yet.
///
/// # Errors
/// [`Error::Value`] for a backend or a name that there is not, and for `record`, which is
/// [`Robots::recorded`]; [`Error::Network`] when the network cannot be used.
pub fn connect(
    network: &Network,
    names: &Names,
    choice: &Choice,
    model: &Model,
    plan: &Plan,
    jaws: Jaws,
    journal: &Journal,
) -> Result<Robots, Error> {
    choice.check()?;
    jaws.check()?;
    if network.security.is_some() {
        only_topics(choice)?;
    }
    let mut bus = Bus::new(network, names, &choice.parameters, choice.patience)?;
    let robots = robots(&mut bus, choice, model, plan, jaws, journal)?;
    Ok(Robots {
        _bus: Some(bus),
        ..robots
    })
}

fn robots(
    bus: &mut Bus,
    choice: &Choice,
    model: &Model,
    plan: &Plan,
    jaws: Jaws,
    journal: &Journal,
) -> Result<Robots, Error> {
    let frame = choice.frame.as_str();
    let clock = match choice.sim_time {
        true => Clock::simulated(bus, "/clock", CLOCK)?,
        false => Clock::day(),
    };
    let mut witnesses = Vec::new();
    if let Some(topic) = &choice.current_pose {
        witnesses.push(Witness::topic(bus, topic, frame)?);
    }
    if choice.frames {
        witnesses.push(Witness::frames(bus, frame, &choice.tip)?);
    }
    let joint_names = &plan.joint_names;
    let topic = &choice.joint_states;
    let robot = Robot::new(bus, model, joint_names, topic, witnesses, clock.clone())?;
    let name = choice.arm_name()?;
    let name = name.as_str();
    let arm: Box<dyn Arm> = match (choice.arm.as_str(), choice.distro) {
        ("joints", _) => {
            let journal = journal.clone();
            let arm = Trajectories::<Follow>::new(bus, name, joint_names, robot, journal)?;
            Box::new(arm)
        }
        ("moveit", Distro::Humble) => {
            moveit::<Humble>(bus, name, choice, model, plan, robot, journal)?
        }
        ("moveit", Distro::Jazzy) => {
            moveit::<Jazzy>(bus, name, choice, model, plan, robot, journal)?
        }
        ("servo", _) => stream(Servo::new(bus, name, frame, robot)?, plan, journal),
        ("cartesian", _) => stream(Cartesian::new(bus, name, frame, robot)?, plan, journal),
        (other, _) => {
            let bound = "one that is on the network";
            return Err(Error::value("the command line", "--arm", other, bound));
        }
    };
    let default = find("--gripper", &choice.gripper, &GRIPPERS)?;
    let name = choice.gripper_name.as_deref().unwrap_or(default);
    let (own, joint) = (journal.clone(), choice.gripper_joint.as_str());
    let gripper: Box<dyn Gripper> = match choice.gripper.as_str() {
        "franka" => Box::new(Franka::new(bus, name, jaws, own)?),
        "parallel" => Box::new(Parallel::new(bus, name, joint, jaws, own)?),
        "bool" => Box::new(Switch::topic(bus, name, jaws, own)?),
        "set-bool" => Box::new(Switch::service(bus, name, jaws, own)?),
        "none" => Box::new(RecordedJaws::default()),
        _ => Box::new(GripperCommand::new(bus, name, jaws, own)?),
    };
    let state = choice.franka_state.as_deref();
    let report = Report::new(bus, plan, frame, state, &clock, journal)?;
    Ok(Robots {
        arm,
        gripper,
        report: Some(report),
        _bus: None,
    })
}

fn stream(sink: impl Sink + 'static, plan: &Plan, journal: &Journal) -> Box<dyn Arm> {
    let arm = Stream::new(sink, plan.limits, journal.clone());
    Box::new(arm)
}

fn moveit<L: Layout + 'static>(
    bus: &mut Bus,
    root: &str,
    choice: &Choice,
    model: &Model,
    plan: &Plan,
    robot: Robot,
    journal: &Journal,
) -> Result<Box<dyn Arm>, Error> {
    let group = Group {
        name: choice.group.clone(),
        link: choice.tip.clone(),
        frame: choice.frame.clone(),
    };
    let (names, journal) = (&plan.joint_names, journal.clone());
    let arm = MoveIt::<L>::new(bus, root, group, model, names, robot, journal)?;
    Ok(Box::new(arm))
}
