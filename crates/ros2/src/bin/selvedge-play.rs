//! Plays a command log on a robot, or says why not. Without `--execute` nothing is sent.

use std::fs::File;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result};
use clap::Parser;
use selvedge_franka::{Arm, Placement};
use selvedge_ros2::connect::{ARMS, Names, connect};
use selvedge_ros2::error::Error;
use selvedge_ros2::gripper::action::Jaws;
use selvedge_ros2::journal::Journal;
use selvedge_ros2::limits::Limits;
use selvedge_ros2::network::Network;
use selvedge_ros2::plan::{Plan, Request, Workspace};
use selvedge_ros2::play::{Policy, Settings, play};
use selvedge_ros2::state::State;

/// Plays a command log on a robot. Without --execute it only checks the log and prints the plan.
///
/// Status 0: played, or checked; 1: stopped before the end; 2: input or network cannot be used; 3: the
/// arm cannot follow the log, or a bound of speed or place is not kept.
#[derive(Parser)]
struct Arguments {
    /// The command log.
    log: PathBuf,
    /// Move the robot.
    #[arg(long)]
    execute: bool,
    /// Share of the log's speed.
    #[arg(long, default_value_t = 0.1)]
    speed: f64,
    /// Base of the arm in the log's frame: x,y,z,yaw [m, rad].
    #[arg(
        long,
        value_delimiter = ',',
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
    prefix: Option<String>,
    /// cartesian or joints.
    #[arg(long, default_value = "cartesian")]
    arm: String,
    /// Topic of the controller's target, or action of the trajectory controller.
    #[arg(long, default_value = "/target_pose")]
    arm_name: String,
    /// gripper-command, franka or none.
    #[arg(long, default_value = "gripper-command")]
    gripper: String,
    /// Action of the gripper, or node of franka_gripper.
    #[arg(long, default_value = "/franka_gripper/gripper_action")]
    gripper_name: String,
    /// Frame that poses are stamped with.
    #[arg(long, default_value = "fr3_link0")]
    frame: String,
    /// Topic of the joint states.
    #[arg(long, default_value = "/joint_states")]
    joint_states: String,
    /// Poses a second.
    #[arg(long, default_value_t = 250.0)]
    rate: f64,
    /// How late the loop may be, in periods.
    #[arg(long, default_value_t = 3.0)]
    overrun: f64,
    /// Highest velocity, acceleration and jerk of the tip [m/s, m/s^2, m/s^3].
    #[arg(
        long,
        value_delimiter = ',',
        num_args = 1,
        default_value = "0.25,1,100"
    )]
    limits: Vec<f64>,
    /// The same of its rotation [rad/s, rad/s^2, rad/s^3].
    #[arg(long, value_delimiter = ',', num_args = 1, default_value = "0.5,2,200")]
    rotation_limits: Vec<f64>,
    /// Corners of the workspace in the base: x,y,z,x,y,z [m].
    #[arg(long, value_delimiter = ',', num_args = 1, allow_hyphen_values = true)]
    workspace: Option<Vec<f64>>,
    /// What to do when the gripper fails: wait, continue or abort.
    #[arg(long, default_value = "abort")]
    on_gripper: String,
    /// Gap to close to [m].
    #[arg(long, default_value_t = 0.0)]
    closed: f64,
    /// Force of the gripper [N].
    #[arg(long, default_value_t = 20.0)]
    force: f64,
    /// Where to write what was commanded, one JSON object a line.
    #[arg(long, default_value = "selvedge-play.jsonl")]
    journal: PathBuf,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(code) => code,
        Err(error) => {
            eprintln!("selvedge-play: {error:#}");
            let refused = matches!(
                error.downcast_ref(),
                Some(Error::Blocked(_) | Error::Value { .. })
            );
            ExitCode::from(if refused { 3 } else { 2 })
        }
    }
}

fn numbers<const N: usize>(name: &str, values: &[f64]) -> Result<[f64; N]> {
    <[f64; N]>::try_from(values)
        .ok()
        .with_context(|| format!("{name} wants {N} numbers"))
}

fn run(arguments: &Arguments) -> Result<ExitCode> {
    let name = arguments.log.display().to_string();
    let file = File::open(&arguments.log).with_context(|| format!("{name} cannot be read"))?;
    let log = selvedge_trajectory::log::read(file, &name)?;
    let model = match arguments.robot.as_str() {
        "fr3" => Arm::fr3(),
        "fer" | "panda" => Arm::fer(),
        other => anyhow::bail!("--robot is `{other}`, must be fr3 or fer"),
    };
    let mut placement = Placement::new(numbers("--base", &arguments.base)?, arguments.table)?;
    placement.flip = arguments.flip;
    let mut workspace = Workspace::franka(placement.table_in_base());
    if let Some(corners) = &arguments.workspace {
        let [x, y, z, a, b, c] = numbers("--workspace", corners)?;
        (workspace.low, workspace.high) = ([x, y, z].into(), [a, b, c].into());
    }
    let request = Request {
        log: &log,
        placement: &placement,
        arm: Some(&model),
        speed: arguments.speed,
        limits: Limits {
            translation: numbers("--limits", &arguments.limits)?,
            rotation: numbers("--rotation-limits", &arguments.rotation_limits)?,
        },
        workspace,
    };
    let mut plan = Plan::new(&request)?;
    if let Some(prefix) = &arguments.prefix {
        let numbered = 1..=plan.joint_names.len();
        plan.joint_names = numbered.map(|k| format!("{prefix}_joint{k}")).collect();
    }
    print(&plan);

    let period = 1.0 / arguments.rate;
    if !(period.is_finite() && (5e-4..=0.1).contains(&period)) {
        anyhow::bail!("--rate is {}, must be 10 to 2000", arguments.rate);
    }
    let settings = Settings {
        period,
        overrun: arguments.overrun * period,
        policy: match arguments.on_gripper.as_str() {
            "wait" => Policy::Wait,
            "continue" => Policy::Continue,
            "abort" => Policy::Abort,
            other => anyhow::bail!("--on-gripper is `{other}`, must be wait, continue or abort"),
        },
        ..Settings::default()
    };
    if !ARMS.contains(&arguments.arm.as_str()) {
        anyhow::bail!(
            "--arm is `{}`, must be one of {}; servo and moveit are not there yet",
            arguments.arm,
            ARMS.join(", ")
        );
    }
    if !arguments.execute {
        println!("dry run: nothing was sent; --execute moves the robot");
        return Ok(ExitCode::SUCCESS);
    }
    let network = Network::from_environment(|name| std::env::var(name).ok())?;
    let stop = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&stop);
    ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed))?;
    let (journal, writer) = Journal::create(&arguments.journal)?;
    journal.event(
        0.0,
        "command line",
        std::env::args().collect::<Vec<_>>().join(" "),
    );
    let names = Names {
        arm: arguments.arm.clone(),
        arm_name: arguments.arm_name.clone(),
        gripper: arguments.gripper.clone(),
        gripper_name: arguments.gripper_name.clone(),
        frame: arguments.frame.clone(),
        joint_states: arguments.joint_states.clone(),
    };
    let jaws = Jaws {
        closed: arguments.closed,
        force: arguments.force,
        ..Jaws::default()
    };
    let mut robots = connect(&network, &names, &model, &plan, jaws, &journal)?;
    let end = play(
        &plan,
        &mut *robots.arm,
        &mut *robots.gripper,
        &settings,
        &stop,
        &journal,
    );
    let lost = writer.finish()?;
    if lost > 0 {
        eprintln!("selvedge-play: {lost} records are not in the journal");
    }
    // How the network library goes down is not our outcome.
    match end {
        State::Finished => println!("finished"),
        State::Stopped(cause) => {
            eprintln!("stopped: {cause}");
            return Ok(ExitCode::FAILURE);
        }
        other => anyhow::bail!("ended in state {}", other.name()),
    }
    Ok(ExitCode::SUCCESS)
}

fn print(plan: &Plan) {
    let p = plan.start().position();
    let q = plan.start().rotation();
    println!(
        "start: tip at ({:.4}, {:.4}, {:.4}) m, xyzw ({:.4}, {:.4}, {:.4}, {:.4})",
        p.x, p.y, p.z, q.x, q.y, q.z, q.w
    );
    println!("start: joints {:.4?} rad", plan.start_joints());
    for (k, segment) in plan.segments.iter().enumerate() {
        let jaw = segment.jaw.map_or(String::new(), |jaw| {
            format!(", then {jaw:?}").to_lowercase()
        });
        println!("motion {}: {:.2} s{jaw}", k + 1, segment.law.duration());
    }
    let all = plan
        .peaks
        .0
        .iter()
        .zip([plan.limits.translation, plan.limits.rotation].concat());
    let used: Vec<String> = all
        .map(|(peak, limit)| format!("{peak:.4} of {limit}"))
        .collect();
    println!("tip v, a, jerk, then rotation: {}", used.join(", "));
    println!(
        "joints: {:.0} % of their bounds; a stop takes {:.2} s at most",
        100.0 * plan.joint_usage,
        plan.brake
    );
}
