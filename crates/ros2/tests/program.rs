//! The program itself: what it refuses, what it plays, and how a signal stops it.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

mod peer;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command as Process, Output, Stdio};
use std::time::Duration;

use selvedge_folding::Scenario;
use selvedge_franka::{Arm, Placement};
use selvedge_math::{Command, DVec3, Jaw, Pose};
use selvedge_ros2::limits::Limits;
use selvedge_ros2::plan::{Plan, Request, Workspace};
use selvedge_trajectory::log::{self, Log, Sample};
use serde_json::{Value, json};

use peer::{Domain, Peer};

/// The command log of a case, as `cargo xtask experiments` writes it.
fn log_of(scenario: &str, case: &str) -> Log {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../fixtures/scenarios")
        .join(scenario);
    let scenario = Scenario::load(path).unwrap();
    let gripper = &scenario.case(case).unwrap().grippers[0];
    let mut log = Log::new(case);
    log.tip_offset = gripper.tip_offset;
    log.samples = (0..scenario.steps)
        .map(|step| scenario.time(step))
        .map(|time| Sample {
            time,
            command: gripper.commands.command(time),
        })
        .collect();
    log
}

fn written(folder: &Path, log: &Log) -> PathBuf {
    let path = folder.join("commands.csv");
    log::write(&mut std::fs::File::create(&path).unwrap(), log).unwrap();
    path
}

/// The place of the base that docs/REACH.md has for F1.
const BASE: [&str; 2] = ["--base=0.77,0,0,-1.5707963267948966", "--flip"];

fn program(log: &Path, folder: &Path, more: &[&str]) -> Process {
    let mut process = Process::new(env!("CARGO_BIN_EXE_selvedge-play"));
    process
        .arg(log)
        .args(BASE)
        .arg("--journal")
        .arg(folder.join("run.jsonl"))
        .args(more);
    process
        .env_remove("RMW_IMPLEMENTATION")
        .env_remove("ROS_DISTRO");
    process.stdout(Stdio::piped()).stderr(Stdio::piped());
    process
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

#[test]
fn a_dry_run_is_the_default_and_tells_the_plan() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), &log_of("franka_fold.toml", "F1"));
    let output = program(&path, folder.path(), &[]).output().unwrap();
    let text = text(&output);
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.contains("dry run: nothing was sent"), "{text}");
    assert!(text.contains("motion 1: 10.50 s, then closed"), "{text}");
    // Nothing is even written.
    assert!(!folder.path().join("run.jsonl").exists());
}

#[test]
fn what_cannot_be_done_is_refused_with_status_3() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), &log_of("corner_fold.toml", "C8"));
    let output = program(&path, folder.path(), &["--execute"])
        .output()
        .unwrap();
    let said = text(&output);
    assert_eq!(output.status.code(), Some(3), "{said}");
    let cause = "fr3_leftfinger is below the table by 4.9 mm, whatever the posture and the base";
    assert!(said.contains(cause), "{said}");
    // Too fast, for the default limits.
    let path = written(folder.path(), &log_of("franka_fold.toml", "F1"));
    let output = program(&path, folder.path(), &["--execute", "--speed", "1"])
        .output()
        .unwrap();
    let said = text(&output);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(
        said.contains("at most 0.25 m/s; a lower --speed helps"),
        "{said}"
    );
    let output = program(&path, folder.path(), &["--arm", "hand"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output).contains("--arm is `hand`, must be one of cartesian, servo"));
    let mut zenoh = program(&path, folder.path(), &["--execute"]);
    let output = zenoh
        .env("RMW_IMPLEMENTATION", "rmw_zenoh_cpp")
        .output()
        .unwrap();
    assert!(
        text(&output).contains("RMW_IMPLEMENTATION is `rmw_zenoh_cpp`"),
        "{}",
        text(&output)
    );
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn arguments_of_ros_are_options_or_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = written(folder.path(), &log_of("franka_fold.toml", "F1"));
    for (more, status, word) in [
        (
            &["--ros-args", "-p", "speed:=0.5"][..],
            0,
            "motion 1: 2.50 s",
        ),
        // What is on the command line counts more.
        (
            &["--speed=0.2", "--ros-args", "-p", "speed:=0.5"],
            0,
            "motion 1: 5.50 s",
        ),
        (
            &["--ros-args", "-p", "base:=3,0,0,0", "-p", "speed:=0.2"],
            0,
            "motion 1: 5.50 s",
        ),
        (
            &["--ros-args", "-p", "execute:=true"],
            2,
            "parameter execute: only --execute on the command line does that",
        ),
        (&["--ros-args", "-p", "sped:=0.5"], 2, "--sped"),
        (
            &["--ros-args", "--params-file", "a.yaml"],
            2,
            "argument is `--params-file`, must be -r from:=to or -p name:=value",
        ),
        (&["--distro", "foxy"], 2, "--distro is `foxy`"),
    ] {
        let output = program(&path, folder.path(), more).output().unwrap();
        let said = text(&output);
        assert_eq!(output.status.code(), Some(status), "{said}");
        assert!(said.contains(word), "{said}");
    }
}

fn poses(folder: &Path) -> Vec<DVec3> {
    let lines = std::fs::read_to_string(folder.join("run.jsonl")).unwrap();
    let lines = lines
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap());
    let pose = |line: Value| {
        let pose = line.get("pose")?.clone();
        let [x, y, z] = [0, 1, 2].map(|k| pose[k].as_f64().unwrap());
        Some(DVec3::new(x, y, z))
    };
    lines.filter_map(pose).collect()
}

#[test]
fn a_record_is_what_would_be_sent_and_needs_no_robot() {
    let folder = tempfile::tempdir().unwrap();
    let log = log_of("franka_fold.toml", "F1");
    let path = written(folder.path(), &log);
    let output = program(&path, folder.path(), &["--arm=record", "--speed=0.5"])
        .env("RMW_IMPLEMENTATION", "rmw_zenoh_cpp")
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let (sent, plan) = (poses(folder.path()), plan(&log));
    let seconds = 0.004 * sent.len() as f64;
    // Half a second of prelude, one of approach.
    assert!((seconds - plan.duration() - 1.5).abs() < 0.1, "{seconds}");
    // The longest motion is there, sample by sample.
    let moving = &plan.segments[1];
    let count = (moving.law.duration() / 0.004) as usize;
    let at = |k: usize| moving.at(0.004 * k as f64).position();
    let found = (0..sent.len() - count).any(|first| {
        let off = |k: usize| sent[first + k].distance(at(k));
        (0..count).step_by(100).all(|k| off(k) < 1e-9) && (0..count).all(|k| off(k) < 1e-9)
    });
    assert!(found);
    let bag = std::fs::read(folder.path().join("run.mcap")).unwrap();
    assert_eq!(&bag[..5], b"\x89MCAP");
}

/// A log over a table before the arm: 10 cm sideways, closed on the way.
fn sideways() -> Log {
    let mut log = Log::new("sideways");
    for k in 0..=90 {
        let t = f64::from(k) / 60.0;
        let u = (t - 0.25).clamp(0.0, 1.0);
        let s = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
        let pose = Pose::from_translation(DVec3::new(0.0, 0.05 - 0.1 * s, 0.05));
        let closed = t > 0.1 && t < 1.4;
        let jaw = if closed { Jaw::Closed } else { Jaw::Open };
        let command = Command { pose, jaw };
        log.samples.push(Sample { time: t, command });
    }
    log
}

#[test]
fn motions_are_played_as_they_come_and_a_bad_one_is_refused_at_rest() {
    let test = "motions_are_played_as_they_come_and_a_bad_one_is_refused_at_rest";
    let (domain, folder) = (Domain::free(false), tempfile::tempdir().unwrap());
    let log = sideways();
    let placement = Placement::new([-0.5, 0.0, 0.0, 0.0], 0.0).unwrap();
    let plan = Plan::new(&Request {
        log: &log,
        placement: &placement,
        arm: Some(&Arm::fr3()),
        speed: 1.0,
        limits: Limits::default(),
        workspace: Workspace::franka(0.0),
    })
    .unwrap();
    let mut rows = Vec::new();
    for segment in &plan.segments {
        for (tau, q) in segment.tau.iter().zip(segment.joints.chunks(7)) {
            let (p, r) = (segment.pose(*tau).position(), segment.pose(*tau).rotation());
            rows.push(json!([[p.x, p.y, p.z, r.x, r.y, r.z, r.w], q]));
        }
    }
    let (joints, names) = (plan.start_joints(), &plan.joint_names);
    let Some(peer) = Peer::start(test, &domain, joints, names, &json!({"follow": rows})) else {
        return;
    };
    let mut child = Process::new(env!("CARGO_BIN_EXE_selvedge-play"))
        .args([
            "--live",
            "--execute",
            "--speed=1",
            "--overrun=500",
            "--base=-0.5,0,0,0",
        ])
        .args(["--gripper-name=/gripper", "--journal"])
        .arg(folder.path().join("run.jsonl"))
        .env("ROS_DOMAIN_ID", domain.id.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
        .env_remove("ROS_DISTRO")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut text_of_log = Vec::new();
    log::write(&mut text_of_log, &log).unwrap();
    let mut input = child.stdin.take().unwrap();
    // All rows, and at the end one that is 10 cm further within a hundredth of a second.
    input.write_all(&text_of_log).unwrap();
    let last = log.samples[log.samples.len() - 1];
    let p = last.command.pose.position();
    writeln!(
        input,
        "\n{},{},{},{},0,0,0,1,0\n",
        last.time + 0.01,
        p.x,
        p.y + 0.1,
        p.z
    )
    .unwrap();
    let output = child.wait_with_output().unwrap();
    drop(input);
    let (said, got) = (text(&output), peer.finish());
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("a lower --speed helps"), "{said}");
    // Each state of the jaws once, though each motion begins with its own.
    let goals = got["goals"].as_array().unwrap();
    let asked: Vec<&Value> = goals.iter().map(|goal| &goal[1][0]).collect();
    assert_eq!(json!(asked), json!([0.04, 0.0, 0.04]));
    let path = positions(&got);
    let (end, goal) = (path[path.len() - 1], plan.segments[2].pose(9.0).position());
    assert!(end.distance(goal) < 1e-9, "{end} {goal}");
    let steps = path.windows(2).map(|pair| pair[1].distance(pair[0]));
    assert!(steps.fold(0.0, f64::max) < 0.25 * 0.004);
}

fn plan(log: &Log) -> Plan {
    let base = [0.77, 0.0, 0.0, -std::f64::consts::FRAC_PI_2];
    let mut placement = Placement::new(base, 0.0).unwrap();
    placement.flip = true;
    Plan::new(&Request {
        log,
        placement: &placement,
        arm: Some(&Arm::fr3()),
        speed: 0.5,
        limits: Limits::default(),
        workspace: Workspace::franka(0.0),
    })
    .unwrap()
}

/// Plays F1 at half speed on a peer; a signal after so many seconds, if any. What the program has
/// said and its status, what the peer has received, and the plan.
fn played(test: &str, signal: Option<f64>) -> Option<(Output, Value, Plan)> {
    let domain = Domain::free(false);
    let folder = tempfile::tempdir().unwrap();
    let log = log_of("franka_fold.toml", "F1");
    let plan = plan(&log);
    let peer = Peer::start(
        test,
        &domain,
        plan.start_joints(),
        &plan.joint_names,
        &json!({}),
    )?;
    let path = written(folder.path(), &log);
    let more = [
        "--execute",
        "--speed=0.5",
        "--gripper-name=/gripper",
        "--overrun=500",
    ];
    let child = program(&path, folder.path(), &more)
        .env("ROS_DOMAIN_ID", domain.id.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
        .spawn()
        .unwrap();
    if let Some(seconds) = signal {
        std::thread::sleep(Duration::from_secs_f64(seconds));
        let id = child.id().to_string();
        assert!(
            Process::new("kill")
                .args(["-TERM", &id])
                .status()
                .unwrap()
                .success()
        );
    }
    let output = child.wait_with_output().unwrap();
    std::thread::sleep(Duration::from_millis(300));
    Some((output, peer.finish(), plan))
}

#[test]
fn a_preview_shows_the_path_and_commands_nothing() {
    let test = "a_preview_shows_the_path_and_commands_nothing";
    let (domain, folder) = (Domain::free(false), tempfile::tempdir().unwrap());
    let log = log_of("franka_fold.toml", "F1");
    let plan = plan(&log);
    let (joints, names) = (plan.start_joints(), &plan.joint_names);
    let Some(peer) = Peer::start(test, &domain, joints, names, &json!({})) else {
        return;
    };
    let path = written(folder.path(), &log);
    let child = program(&path, folder.path(), &["--preview"])
        .env("ROS_DOMAIN_ID", domain.id.to_string())
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .env("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
        .spawn()
        .unwrap();
    std::thread::sleep(Duration::from_secs(4));
    let id = child.id().to_string();
    let killed = Process::new("kill").args(["-TERM", &id]).status().unwrap();
    assert!(killed.success());
    let output = child.wait_with_output().unwrap();
    let (said, got) = (text(&output), peer.finish());
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("1 programs looked at it"), "{said}");
    assert_eq!(got["paths"].as_array().unwrap().len(), 1);
    assert_eq!(got["poses"], json!([]));
    assert_eq!(got["goals"], json!([]));
}

fn positions(got: &Value) -> Vec<DVec3> {
    let pose = |pose: &Value| {
        let [x, y, z] = [0, 1, 2].map(|k| pose[k].as_f64().unwrap());
        DVec3::new(x, y, z)
    };
    got["poses"].as_array().unwrap().iter().map(pose).collect()
}

#[test]
fn a_fold_is_played_from_its_log() {
    let Some((output, got, plan)) = played("a_fold_is_played_from_its_log", None) else {
        return;
    };
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    // Nothing but our own words: the network library has many of its own.
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(said, "");
    let asked: Vec<&Value> = got["goals"]
        .as_array()
        .unwrap()
        .iter()
        .map(|goal| &goal[1][0])
        .collect();
    assert_eq!(json!(asked), json!([0.04, 0.0, 0.04]));
    // The last segment rests and so does the first; the motion between them, sample by sample.
    let path = positions(&got);
    let moving = &plan.segments[1];
    let samples = (moving.law.duration() / 0.004) as usize;
    let at = |k: usize| moving.at(0.004 * k as f64).position();
    // It is found by its first step that is long enough to be no rounding.
    let far = (0..samples)
        .find(|k| at(*k).distance(at(0)) > 1e-3)
        .unwrap();
    let first = path
        .iter()
        .skip(400)
        .position(|p| p.distance(at(0)) > 1e-3)
        .unwrap()
        + 400;
    let first = (first as i64 - far as i64) as usize;
    for k in 0..samples {
        assert!(
            path[first + k].distance(at(k)) < 1e-9,
            "sample {k}: {} {}",
            path[first + k],
            at(k)
        );
    }
}

#[test]
fn a_signal_stops_the_program_on_the_path() {
    // Approach and resting part are over after some 6 s; the jaws close and the motion follows.
    let name = "a_signal_stops_the_program_on_the_path";
    let Some((output, got, plan)) = played(name, Some(10.0)) else {
        return;
    };
    let said = text(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("stopped: Ctrl-C or SIGTERM"), "{said}");
    let path = positions(&got);
    let v: Vec<f64> = path
        .windows(2)
        .map(|p| p[1].distance(p[0]) / 0.004)
        .collect();
    assert!(v[v.len() - 40..].iter().all(|v| *v < 1e-9), "not at rest");
    let end = path[path.len() - 1];
    let goal = plan.segments[1]
        .pose(plan.segments[1].law.length)
        .position();
    assert!(
        end.distance(path[0]) > 0.01 && end.distance(goal) > 0.01,
        "{end}"
    );
    // The jaws are left closed.
    let last = got["goals"].as_array().unwrap().last().unwrap().clone();
    assert_eq!(last[1][0], 0.0);
}
