//! Who tells where the robot is, and what time it is.

use selvedge_ros2::state::State;
use serde_json::{Value, json};

use crate::run::{Job, seven};

/// What a peer is told that tells its pose on a topic and as frames.
fn telling(job: &Job, frame: &str, more: Value) -> Value {
    let (p, q) = (job.plan.start().position(), job.plan.start().rotation());
    let mut told = json!({"start_pose": [p.x, p.y, p.z, q.x, q.y, q.z, q.w], "frame": frame});
    for (key, value) in more.as_object().unwrap() {
        told[key] = value.clone();
    }
    told
}

fn job(name: &'static str, more: Value) -> Job {
    let mut job = Job::new(name, "cartesian", "none");
    job.choice.current_pose = Some("current_pose".into());
    job.choice.frames = true;
    job.told = telling(&job, "fr3_link0", more);
    job
}

#[test]
fn a_pose_on_a_topic_and_the_frames_are_compared_with_the_joints() {
    let name = "a_pose_on_a_topic_and_the_frames_are_compared_with_the_joints";
    let Some(played) = job(name, json!({})).play() else {
        return;
    };
    assert_eq!(played.end, State::Finished);
    // A tip that is elsewhere: 8 mm higher.
    let mut elsewhere = job(name, json!({}));
    let z = elsewhere.told["start_pose"][2].as_f64().unwrap();
    elsewhere.told["start_pose"][2] = json!(z + 0.008);
    let played = elsewhere.play().unwrap();
    let cause = played.cause();
    let text = "/joint_states and /current_pose differ by 0.0080 in position [m], at most 0.005";
    assert!(cause.starts_with(text), "{cause}");
    assert_eq!(played.got["poses"], json!([]));
    // A robot that does not follow any more.
    let played = job(name, json!({"stuck_after": 300})).play().unwrap();
    let cause = played.cause();
    assert!(
        cause.starts_with("the pose that was sent and /current_pose differ by 0.05"),
        "{cause}"
    );
    assert!(cause.ends_with("the robot does not follow"), "{cause}");
    played.rests();
    // Frames of another base are not ours: nothing comes of them.
    let mut other = job(name, json!({}));
    other.told = telling(&other, "elsewhere", json!({}));
    let cause = other.play().unwrap().cause();
    assert_eq!(cause, "/current_pose is inf s old, at most 3 s");
}

#[test]
fn stamps_are_those_of_the_clock_and_a_clock_that_stands_still_stops_the_arm() {
    let name = "stamps_are_those_of_the_clock_and_a_clock_that_stands_still_stops_the_arm";
    let mut run = Job::new(name, "cartesian", "none");
    run.choice.sim_time = true;
    // It goes for four seconds, then it stands.
    let Some(played) = run.told(json!({"clock": 4.0})).play() else {
        return;
    };
    let cause = played.cause();
    assert!(cause.starts_with("/clock is 0.5"), "{cause}");
    let stamps: Vec<(i64, i64)> = serde_json::from_value(played.got["stamps"].clone()).unwrap();
    assert!(!stamps.is_empty());
    assert!(
        stamps.iter().all(|(sec, _)| (100..105).contains(sec)),
        "{stamps:?}"
    );
    assert!(stamps.is_sorted());
    // What brings the arm to rest is sent all the same.
    played.rests();
    let poses = played.got["poses"].as_array().unwrap();
    assert_eq!(
        seven(&poses[poses.len() - 1]),
        played.sent()[played.sent().len() - 1]
    );
    // Without any clock nothing is sent.
    let mut run = Job::new(name, "cartesian", "none");
    run.choice.sim_time = true;
    let played = run.play().unwrap();
    assert_eq!(played.cause(), "/clock is inf s old, at most 0.5 s");
    assert_eq!(played.got["poses"], json!([]));
}

#[test]
fn what_a_franka_says_of_itself_is_told_and_changes_nothing() {
    let name = "what_a_franka_says_of_itself_is_told_and_changes_nothing";
    let mut job = Job::new(name, "cartesian", "none");
    job.choice.franka_state = Some("franka_robot_state".into());
    let Some(played) = job.told(json!({"franka": true})).play() else {
        return;
    };
    // Whoever stops the robot stops it: we only tell.
    assert_eq!(played.end, State::Finished);
    let told = played.lines.iter().filter(|line| line["event"] == "robot");
    let told: Vec<&str> = told.map(|line| line["detail"].as_str().unwrap()).collect();
    let reflex = "mode reflex, errors: communication_constraints_violation";
    assert_eq!(told, ["mode move", reflex]);
    let last = played.got["diagnostics"]
        .as_array()
        .unwrap()
        .last()
        .unwrap();
    assert_eq!(last[2]["robot"], reflex);
}

#[test]
fn quaternions_stay_on_one_side() {
    let Some(played) = Job::new("quaternions_stay_on_one_side", "cartesian", "none").play() else {
        return;
    };
    let poses = played.got["poses"].as_array().unwrap();
    let q: Vec<[f64; 7]> = poses.iter().map(seven).collect();
    for pair in q.windows(2) {
        let dot: f64 = (3..7).map(|k| pair[0][k] * pair[1][k]).sum();
        assert!(dot > 0.9);
    }
}
