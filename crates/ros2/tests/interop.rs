//! Against a robot of another make: `peer/peer.py`, on Cyclone DDS, on 127.0.0.1 only, each test on a domain
//! of its own. Skipped by name where there is no Python with `cyclonedds`: the program in
//! `SELVEDGE_PYTHON`, else `python3`.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

mod peer;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use selvedge_franka::{Arm, Placement};
use selvedge_math::{Command, DVec3, Jaw, Pose};
use selvedge_ros2::connect::{Names, connect};
use selvedge_ros2::error::Cause;
use selvedge_ros2::gripper::action::Jaws;
use selvedge_ros2::journal::Journal;
use selvedge_ros2::limits::Limits;
use selvedge_ros2::network::{Mapping, Network};
use selvedge_ros2::plan::{Plan, Request, Workspace};
use selvedge_ros2::play::{Settings, play};
use selvedge_ros2::state::State;
use selvedge_trajectory::log::{Log, Sample};
use serde_json::{Value, json};

use peer::{ALONE, Peer};

fn plan() -> Plan {
    let mut log = Log::new("sideways");
    for k in 0..=90 {
        let t = f64::from(k) / 60.0;
        let u = (t - 0.25).clamp(0.0, 1.0);
        let s = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
        let pose = Pose::from_translation(DVec3::new(0.0, 0.05 - 0.1 * s, 0.05));
        let jaw = if t > 0.1 && t < 1.4 {
            Jaw::Closed
        } else {
            Jaw::Open
        };
        log.samples.push(Sample {
            time: t,
            command: Command { pose, jaw },
        });
    }
    let placement = Placement::new([-0.5, 0.0, 0.0, 0.0], 0.0).unwrap();
    let arm = Arm::fr3();
    Plan::new(&Request {
        log: &log,
        placement: &placement,
        arm: Some(&arm),
        speed: 0.5,
        limits: Limits::default(),
        workspace: Workspace::franka(0.0),
    })
    .unwrap()
}

struct Played {
    end: State,
    /// What the peer has received.
    got: Value,
    /// The journal.
    lines: Vec<Value>,
}

fn run(
    test: &str,
    domain: u16,
    kind: (&str, &str),
    period: f64,
    jaws: Jaws,
    told: Value,
) -> Option<Played> {
    let _alone = ALONE.lock().unwrap_or_else(|e| e.into_inner());
    let plan = plan();
    let stop_after = told["stop_after"].as_f64();
    let peer = Peer::start(test, domain, plan.start_joints(), &plan.joint_names, told)?;
    let (arm, gripper) = kind;
    let names = Names {
        arm: arm.into(),
        arm_name: match arm {
            "joints" => "/arm/follow_joint_trajectory".into(),
            _ => "/target_pose".into(),
        },
        gripper: gripper.into(),
        gripper_name: if gripper == "franka" {
            "/hand".into()
        } else {
            "/gripper".into()
        },
        frame: "fr3_link0".into(),
        joint_states: "/joint_states".into(),
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.jsonl");
    let (journal, writer) = Journal::create(&path).unwrap();
    let network = Network {
        domain,
        loopback: true,
        mapping: Mapping::Cyclone,
    };
    let mut robots = connect(&network, &names, &Arm::fr3(), &plan, jaws, &journal).unwrap();
    // Other programs share the machine: late is fine here, lost is not.
    let settings = Settings {
        period,
        overrun: 2.0,
        ..Settings::default()
    };
    let stop = Arc::new(AtomicBool::new(false));
    if let Some(seconds) = stop_after {
        let stop = Arc::clone(&stop);
        std::thread::spawn(move || {
            std::thread::sleep(std::time::Duration::from_secs_f64(seconds));
            stop.store(true, Ordering::Relaxed);
        });
    }
    let end = play(
        &plan,
        &mut *robots.arm,
        &mut *robots.gripper,
        &settings,
        &stop,
        &journal,
    );
    drop(robots);
    assert_eq!(writer.finish().unwrap(), 0);
    let lines = std::fs::read_to_string(&path).unwrap();
    let lines = lines
        .lines()
        .map(|line| serde_json::from_str(line).unwrap())
        .collect();
    std::thread::sleep(std::time::Duration::from_millis(300));
    Some(Played {
        end,
        got: peer.finish(),
        lines,
    })
}

fn seven(value: &Value) -> [f64; 7] {
    let numbers: Vec<f64> = value
        .as_array()
        .unwrap()
        .iter()
        .map(|x| x.as_f64().unwrap())
        .collect();
    numbers.try_into().unwrap()
}

/// What was received is what was sent, but for the first samples of the prelude, and what was sent in
/// each motion is the spline of the log.
fn the_stream_is_the_spline(played: &Played, period: f64) {
    let sent: Vec<&Value> = played
        .lines
        .iter()
        .filter(|line| line.get("pose").is_some())
        .collect();
    let got = played.got["poses"].as_array().unwrap();
    let lost = sent.len() - got.len();
    assert!(
        (lost as f64) < 0.5 / period,
        "{lost} of {} lost",
        sent.len()
    );
    for (sent, got) in sent[lost..].iter().zip(got) {
        assert_eq!(seven(&sent["pose"]), seven(got));
    }
    let plan = plan();
    let start = plan.start();
    let mut motion: Option<(usize, f64)> = None;
    let mut compared = 0;
    for line in &played.lines {
        if line["event"] == "state" {
            let detail = line["detail"].as_str().unwrap();
            let t = line["t"].as_f64().unwrap();
            motion = detail
                .strip_prefix("moving ")
                .map(|k| (k.parse().unwrap(), t));
        } else if let (Some((k, begin)), true) = (motion, line.get("pose").is_some()) {
            let t = line["t"].as_f64().unwrap() - begin;
            let expected = match k {
                0 => start,
                k => plan.segments[k - 1].at(t),
            };
            let pose = seven(&line["pose"]);
            let p = DVec3::new(pose[0], pose[1], pose[2]);
            assert!(
                p.distance(expected.position()) < 1e-9,
                "motion {k} at {t}: {p}"
            );
            let q = expected.rotation().to_array();
            let dot: f64 = (0..4).map(|i| q[i] * pose[3 + i]).sum();
            assert!(dot.abs() > 1.0 - 1e-12);
            compared += 1;
        }
    }
    let expected = (plan.duration() + 2.5) / period;
    assert!(
        f64::from(compared) > 0.99 * expected,
        "{compared} of {expected}"
    );
    let times: Vec<f64> = sent
        .iter()
        .map(|line| line["sent"].as_f64().unwrap())
        .collect();
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mean = (times[times.len() - 1] - times[0]) / steps.len() as f64;
    steps.sort_by(f64::total_cmp);
    let p99 = steps[steps.len() * 99 / 100];
    println!(
        "{} sent, {lost} before the match, {} received; mean period {:.4} ms, p99 {:.3} ms, longest {:.3} ms",
        sent.len(),
        got.len(),
        1e3 * mean,
        1e3 * p99,
        1e3 * steps[steps.len() - 1]
    );
    assert!((mean / period - 1.0).abs() < 0.01, "{mean}");
}

const CARTESIAN: (&str, &str) = ("cartesian", "gripper-command");

#[test]
fn poses_arrive_at_250_hz_and_the_jaws_act_in_order() {
    let name = "poses_arrive_at_250_hz_and_the_jaws_act_in_order";
    let Some(played) = run(name, 21, CARTESIAN, 0.004, Jaws::default(), json!({})) else {
        return;
    };
    assert_eq!(played.end, State::Finished);
    the_stream_is_the_spline(&played, 0.004);
    assert_eq!(played.got["frames"], json!(["fr3_link0"]));
    // Half the gap, and never without force.
    let goals = played.got["goals"].as_array().unwrap();
    let asked: Vec<&Value> = goals.iter().map(|goal| &goal[1]).collect();
    assert_eq!(
        json!(asked),
        json!([[0.04, 20.0], [0.0, 20.0], [0.04, 20.0]])
    );
    // At rest where the segments end: the poses before and after each goal are the same.
    let poses = played.got["poses"].as_array().unwrap();
    for goal in goals {
        let k = goal[2].as_u64().unwrap() as usize;
        let (before, after) = (seven(&poses[k - 1]), seven(&poses[k]));
        for i in 0..7 {
            assert!((before[i] - after[i]).abs() < 1e-6);
        }
    }
}

#[test]
fn poses_arrive_at_1_khz() {
    let name = "poses_arrive_at_1_khz";
    let hand = ("cartesian", "franka");
    let Some(played) = run(name, 22, hand, 0.001, Jaws::default(), json!({})) else {
        return;
    };
    assert_eq!(played.end, State::Finished);
    the_stream_is_the_spline(&played, 0.001);
    let goals = played.got["goals"].as_array().unwrap();
    let asked: Vec<[&Value; 2]> = goals.iter().map(|goal| [&goal[0], &goal[1]]).collect();
    let expected = json!([
        ["/hand/move", [0.08, 0.1]],
        ["/hand/grasp", [0.0, 0.005, 0.005, 0.1, 20.0]],
        ["/hand/move", [0.08, 0.1]]
    ]);
    assert_eq!(json!(asked), expected);
}

#[test]
fn a_gripper_that_fails_stops_the_arm_with_the_reason() {
    let name = "a_gripper_that_fails_stops_the_arm_with_the_reason";
    let short = Jaws {
        deadline: 1.0,
        ..Jaws::default()
    };
    for (k, (gripper, how, text)) in [
        ("gripper-command", "reject", "/gripper rejected the goal"),
        ("gripper-command", "abort", "/gripper ended as Aborted"),
        (
            "gripper-command",
            "silent",
            "/gripper send_goal did not answer within 2 s",
        ),
        (
            "gripper-command",
            "never",
            "/gripper get_result did not answer within 1 s",
        ),
        (
            "franka",
            "fail",
            "/hand/grasp ended as Succeeded: nothing between the fingers",
        ),
    ]
    .into_iter()
    .enumerate()
    {
        // Opening works with the franka gripper that fails to grasp, but says it does not.
        let told = json!({"gripper": how});
        let domain = 23 + k as u16;
        let Some(played) = run(name, domain, ("cartesian", gripper), 0.004, short, told) else {
            return;
        };
        let State::Stopped(cause) = &played.end else {
            panic!("{how}: {:?}", played.end);
        };
        let text = if how == "fail" {
            "/hand/move ended as Succeeded: nothing"
        } else {
            text
        };
        assert!(cause.to_string().starts_with(text), "{how}: {cause}");
        // One goal, however often it was asked for.
        let goals = played.got["goals"].as_array().unwrap();
        let expected = usize::from(!matches!(how, "reject" | "silent"));
        assert_eq!(goals.len(), expected, "{how}");
    }
}

#[test]
fn a_peer_that_goes_or_intrudes_stops_the_arm_at_rest() {
    let name = "a_peer_that_goes_or_intrudes_stops_the_arm_at_rest";
    for (k, (told, text)) in [
        (
            json!({"second_after": 950}),
            "/target_pose has 1 publishers besides this one",
        ),
        (json!({"mute_after": 6.0}), "the measured state is 0.2"),
        (json!({"kill_after": 950}), "the measured state is 0.2"),
    ]
    .into_iter()
    .enumerate()
    {
        let domain = 30 + k as u16;
        let Some(played) = run(
            name,
            domain,
            CARTESIAN,
            0.004,
            Jaws::default(),
            told.clone(),
        ) else {
            return;
        };
        let State::Stopped(cause) = &played.end else {
            panic!("{told}: {:?}", played.end);
        };
        assert!(cause.to_string().starts_with(text), "{told}: {cause}");
        // The stop is smooth and ends at rest: from what was sent.
        let sent: Vec<DVec3> = played
            .lines
            .iter()
            .filter_map(|line| line.get("pose").map(seven))
            .map(|pose| DVec3::new(pose[0], pose[1], pose[2]))
            .collect();
        let v: Vec<DVec3> = sent.windows(2).map(|p| (p[1] - p[0]) / 0.004).collect();
        let a = v
            .windows(2)
            .map(|v| (v[1] - v[0]).length() / 0.004)
            .fold(0.0, f64::max);
        assert!(a < 1.02, "{told}: {a}");
        assert!(
            v[v.len() - 40..].iter().all(|v| v.length() < 1e-9),
            "{told}"
        );
    }
}

#[test]
fn a_reader_of_another_type_and_nobody_at_all_are_told_apart() {
    let name = "a_reader_of_another_type_and_nobody_at_all_are_told_apart";
    let told = json!({"wrong_type": true});
    let Some(played) = run(name, 34, CARTESIAN, 0.004, Jaws::default(), told) else {
        return;
    };
    let State::Stopped(cause) = &played.end else {
        panic!("{:?}", played.end);
    };
    assert!(matches!(cause, Cause::TypeMismatch { .. }), "{cause}");
    let told = json!({"gripper": "none"});
    let Some(played) = run(name, 35, CARTESIAN, 0.004, Jaws::default(), told) else {
        return;
    };
    let expected = Cause::Absent {
        name: "/gripper".into(),
        seconds: 10.0,
    };
    assert_eq!(played.end, State::Stopped(expected));
    assert_eq!(played.got["poses"], json!([]));
}

#[test]
fn joint_trajectories_are_those_of_the_plan() {
    let name = "joint_trajectories_are_those_of_the_plan";
    let joints = ("joints", "gripper-command");
    let Some(played) = run(name, 36, joints, 0.004, Jaws::default(), json!({})) else {
        return;
    };
    assert_eq!(played.end, State::Finished);
    let plan = plan();
    let goals = played.got["goals"].as_array().unwrap();
    let order: Vec<&str> = goals.iter().map(|goal| goal[0].as_str().unwrap()).collect();
    let (arm, jaw) = ("/arm/follow_joint_trajectory", "/gripper");
    assert_eq!(order, [arm, jaw, arm, jaw, arm, jaw, arm]);
    let model = Arm::fr3();
    let sent = goals.iter().filter(|goal| goal[0] == arm).skip(1);
    for (goal, segment) in sent.zip(&plan.segments) {
        assert_eq!(goal[1][0], json!(plan.joint_names));
        let points = goal[1][1].as_array().unwrap();
        assert_eq!(points.len(), segment.tau.len());
        for point in points {
            let numbers: Vec<f64> = point
                .as_array()
                .unwrap()
                .iter()
                .map(|x| x.as_f64().unwrap())
                .collect();
            let tip = model.forward(&numbers[1..]).position();
            // Times are told to the nanosecond.
            let expected = segment.at(numbers[0]).position();
            assert!(
                tip.distance(expected) < 1e-8,
                "{}: {tip} {expected}",
                numbers[0]
            );
        }
    }
    let told = json!({"arm": "abort"});
    let Some(played) = run(name, 37, joints, 0.004, Jaws::default(), told) else {
        return;
    };
    let State::Stopped(cause) = &played.end else {
        panic!("{:?}", played.end);
    };
    let text = "/arm/follow_joint_trajectory ended as Aborted: code -4: path tolerance";
    assert_eq!(cause.to_string(), text);
}

#[test]
fn a_stop_cancels_the_trajectory_and_waits_for_the_answer() {
    let name = "a_stop_cancels_the_trajectory_and_waits_for_the_answer";
    let joints = ("joints", "gripper-command");
    // In the way to the first pose, which takes 2.5 s after some 1.5 s.
    let told = json!({"stop_after": 3.0});
    let Some(played) = run(name, 38, joints, 0.004, Jaws::default(), told) else {
        return;
    };
    assert_eq!(played.end, State::Stopped(Cause::Signal));
    assert_eq!(played.got["cancels"], 1);
    assert_eq!(played.got["goals"].as_array().unwrap().len(), 1);
    let ended = played
        .lines
        .iter()
        .any(|line| line["event"] == "trajectory ended");
    assert!(ended, "{:?}", played.lines);
}
