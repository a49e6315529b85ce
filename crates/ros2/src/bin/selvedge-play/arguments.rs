//! The command line, and what it says to the library.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use clap::ArgAction::Set;
use clap::Parser;
use selvedge_franka::{Arm, Placement};
use selvedge_math::Jaw;
use selvedge_ros2::connect::Choice;
use selvedge_ros2::error::Error;
use selvedge_ros2::gripper::jaws::Jaws;
use selvedge_ros2::limits::Limits;
use selvedge_ros2::names::{Names, Parameters};
use selvedge_ros2::network::Distro;
use selvedge_ros2::plan::Workspace;
use selvedge_ros2::play::{Policy, Settings};

/// Plays a command log on a robot. Without --execute it only checks the log and prints the plan.
///
/// Remaps and parameters as in ROS: `--ros-args -r from:=to -r __ns:=/left -p speed:=0.2`; a parameter is
/// an option of the same name, and an option that is given counts more.
///
/// Status 0: played, or checked; 1: stopped before the end; 2: input or network cannot be used; 3: the
/// arm cannot follow the log, or a bound of speed or place is not kept.
#[derive(Debug, Parser)]
#[command(name = "selvedge-play", args_override_self = true)]
pub(crate) struct Arguments {
    /// The command log; none with --live.
    #[arg(required_unless_present = "live", conflicts_with = "live")]
    pub(crate) log: Option<PathBuf>,
    /// Read a log from standard input as it comes, and play each motion when it is complete: at a row
    /// with other jaws, or at an empty line.
    #[arg(long)]
    pub(crate) live: bool,
    /// Move the robot.
    #[arg(long)]
    pub(crate) execute: bool,
    /// Publish the planned path on ~/planned_path until stopped by hand; moves nothing.
    #[arg(long, conflicts_with_all = ["execute", "live"])]
    pub(crate) preview: bool,
    /// Share of the log's speed.
    #[arg(long, default_value_t = 0.1)]
    pub(crate) speed: f64,
    /// Base of the arm in the log's frame: x,y,z,yaw [m, rad].
    #[arg(
        long,
        action = Set, value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true,
        default_value = "0,0,0,0"
    )]
    base: Vec<f64>,
    /// Height of the table in the log's frame [m].
    #[arg(long, default_value_t = 0.0, allow_hyphen_values = true)]
    table: f64,
    /// The hand is turned by half a turn about its approach.
    #[arg(long)]
    flip: bool,
    /// fr3 or fer.
    #[arg(long, default_value = "fr3")]
    robot: String,
    /// First part of the joints' names, when it is not the robot's.
    #[arg(long)]
    pub(crate) prefix: Option<String>,
    /// cartesian, servo, moveit, joints or record; record writes the journal alone, without a robot.
    #[arg(long, default_value = "cartesian")]
    pub(crate) arm: String,
    /// Topic of the controller's target, node of servo, namespace of move_group, or action of the
    /// trajectory controller.
    #[arg(long)]
    arm_name: Option<String>,
    /// gripper-command, franka, parallel, bool, set-bool or none.
    #[arg(long, default_value = "gripper-command")]
    gripper: String,
    /// Action of the gripper, node of franka_gripper, topic or service of a switch.
    #[arg(long)]
    gripper_name: Option<String>,
    /// Joint that a parallel gripper is told.
    #[arg(long, default_value = "fr3_finger_joint1")]
    gripper_joint: String,
    /// Namespace of names that do not begin with a slash.
    #[arg(long)]
    namespace: Option<String>,
    /// humble, jazzy, kilted, lyrical or rolling: whose messages MoveIt has; else that of ROS_DISTRO.
    #[arg(long)]
    distro: Option<String>,
    /// Frame that poses are in: the robot's base link.
    #[arg(long, default_value = "fr3_link0")]
    pub(crate) frame: String,
    /// Frame between the fingers.
    #[arg(long, default_value = "fr3_hand_tcp")]
    tip: String,
    /// Planning group of MoveIt.
    #[arg(long, default_value = "fr3_arm")]
    group: String,
    /// Topic of the joint states.
    #[arg(long, default_value = "joint_states")]
    joint_states: String,
    /// Topic of the tip's pose in the base, to compare with.
    #[arg(long)]
    current_pose: Option<String>,
    /// Compare with /tf too.
    #[arg(long)]
    tf: bool,
    /// Topic of FrankaRobotState, whose mode and errors are reported.
    #[arg(long)]
    franka_state: Option<String>,
    /// Stamp with the time of /clock.
    #[arg(long)]
    use_sim_time: bool,
    /// How long controllers, grippers and the robot's state are waited for [s].
    #[arg(long, default_value_t = 10.0)]
    patience: f64,
    /// Poses a second.
    #[arg(long, default_value_t = 250.0)]
    rate: f64,
    /// How late the loop may be, in periods.
    #[arg(long, default_value_t = 3.0)]
    overrun: f64,
    /// Highest velocity, acceleration and jerk of the tip [m/s, m/s^2, m/s^3].
    #[arg(
        long,
        action = Set, value_delimiter = ',',
        num_args = 1,
        default_value = "0.25,1,100"
    )]
    limits: Vec<f64>,
    /// The same of its rotation [rad/s, rad/s^2, rad/s^3].
    #[arg(long, action = Set, value_delimiter = ',', num_args = 1, default_value = "0.5,2,200")]
    rotation_limits: Vec<f64>,
    /// Corners of the workspace in the base: x,y,z,x,y,z [m].
    #[arg(long, action = Set, value_delimiter = ',', num_args = 1, allow_hyphen_values = true)]
    workspace: Option<Vec<f64>>,
    /// What to do when the gripper fails or is not there: wait, continue or abort.
    #[arg(long, default_value = "abort")]
    on_gripper: String,
    /// Gap to close to [m].
    #[arg(long, default_value_t = 0.0)]
    closed: f64,
    /// Gap to open to [m].
    #[arg(long, default_value_t = 0.08)]
    open: f64,
    /// Force of the gripper [N].
    #[arg(long, default_value_t = 20.0)]
    force: f64,
    /// Have the Franka hand find its ends first: it opens and closes whole.
    #[arg(long)]
    homing: bool,
    /// How long jaws that tell nothing are given [s].
    #[arg(long, default_value_t = 1.5)]
    jaw_time: f64,
    /// Where to write what was commanded, one JSON object a line; the same as MCAP beside it.
    #[arg(long, default_value = "selvedge-play.jsonl")]
    pub(crate) journal: PathBuf,
}

/// Options that say what is done, not how: no parameter may do that.
const BY_HAND: [&str; 3] = ["execute", "live", "preview"];

/// Reads the command line with its ROS arguments.
pub(crate) fn read() -> Result<(Arguments, Names, Parameters)> {
    let (names, rest, parameters) = setting(Names::from_arguments(std::env::args()))?;
    let mut rest = rest.into_iter();
    let mut all: Vec<String> = rest.next().into_iter().collect();
    for (name, value) in &parameters {
        let option = name.replace('_', "-");
        if BY_HAND.contains(&option.as_str()) {
            bail!("parameter {name}: only --{option} on the command line does that");
        }
        match value.as_str() {
            "true" => all.push(format!("--{option}")),
            "false" => {}
            value => all.push(format!("--{option}={value}")),
        }
    }
    all.extend(rest);
    let arguments = Arguments::parse_from(all);
    let names = match &arguments.namespace {
        Some(namespace) => setting(names.within(namespace))?,
        None => names,
    };
    let mut shown = parameters;
    for (name, value) in [
        ("arm", arguments.arm.clone()),
        ("gripper", arguments.gripper.clone()),
        ("speed", arguments.speed.to_string()),
        ("rate", arguments.rate.to_string()),
    ] {
        // A robot's own clock is set by its own rules.
        shown.retain(|(known, _)| known != name && known != "use_sim_time");
        shown.push((name.into(), value));
    }
    Ok((arguments, names, shown))
}

/// What is wrong with a setting is no refusal of the log.
pub(crate) fn setting<T>(made: Result<T, Error>) -> Result<T> {
    made.map_err(|error| anyhow::anyhow!("{error}"))
}

fn numbers<const N: usize>(name: &str, values: &[f64]) -> Result<[f64; N]> {
    <[f64; N]>::try_from(values)
        .ok()
        .with_context(|| format!("{name} wants {N} numbers"))
}

impl Arguments {
    pub(crate) fn model(&self) -> Result<Arm> {
        match self.robot.as_str() {
            "fr3" => Ok(Arm::fr3()),
            "fer" | "panda" => Ok(Arm::fer()),
            other => bail!("--robot is `{other}`, must be fr3 or fer"),
        }
    }

    pub(crate) fn placement(&self) -> Result<Placement> {
        let base = numbers("--base", &self.base)?;
        let mut placement = Placement::new(base, self.table)?;
        placement.flip = self.flip;
        Ok(placement)
    }

    pub(crate) fn workspace(&self, placement: &Placement) -> Result<Workspace> {
        let mut workspace = Workspace::franka(placement.table_in_base());
        if let Some(corners) = &self.workspace {
            let [x, y, z, a, b, c] = numbers("--workspace", corners)?;
            (workspace.low, workspace.high) = ([x, y, z].into(), [a, b, c].into());
        }
        Ok(workspace)
    }

    pub(crate) fn limits(&self) -> Result<Limits> {
        Ok(Limits {
            translation: numbers("--limits", &self.limits)?,
            rotation: numbers("--rotation-limits", &self.rotation_limits)?,
        })
    }

    pub(crate) fn settings(&self, jaw: Option<Jaw>) -> Result<Settings> {
        let period = 1.0 / self.rate;
        if !(period.is_finite() && (5e-4..=0.1).contains(&period)) {
            bail!("--rate is {}, must be 10 to 2000", self.rate);
        }
        if !(self.overrun.is_finite() && self.overrun > 0.0) {
            bail!("--overrun is {}, must be above 0", self.overrun);
        }
        Ok(Settings {
            period,
            overrun: self.overrun * period,
            policy: match self.on_gripper.as_str() {
                "wait" => Policy::Wait,
                "continue" => Policy::Continue,
                "abort" => Policy::Abort,
                other => bail!("--on-gripper is `{other}`, must be wait, continue or abort"),
            },
            jaw,
            // Without a robot time is only counted.
            real_time: self.arm != "record",
            ..Settings::default()
        })
    }

    pub(crate) fn jaws(&self) -> Jaws {
        Jaws {
            open: self.open,
            closed: self.closed,
            force: self.force,
            homing: self.homing,
            blind: self.jaw_time,
            ..Jaws::default()
        }
    }

    pub(crate) fn choice(&self, parameters: Parameters) -> Result<Choice> {
        let get = |name: &str| std::env::var(name).ok();
        let choice = Choice {
            arm: self.arm.clone(),
            arm_name: self.arm_name.clone(),
            gripper: self.gripper.clone(),
            gripper_name: self.gripper_name.clone(),
            gripper_joint: self.gripper_joint.clone(),
            frame: self.frame.clone(),
            tip: self.tip.clone(),
            group: self.group.clone(),
            joint_states: self.joint_states.clone(),
            current_pose: self.current_pose.clone(),
            frames: self.tf,
            franka_state: self.franka_state.clone(),
            sim_time: self.use_sim_time,
            distro: setting(Distro::named(self.distro.as_deref(), get))?,
            patience: self.patience,
            parameters,
        };
        setting(choice.check())?;
        Ok(choice)
    }
}
