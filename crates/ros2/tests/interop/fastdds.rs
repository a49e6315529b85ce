//! The same against Fast DDS, `peer/fast.cpp`, which tells replies apart as `rmw_fastrtps` does. Skipped by
//! name where there is no g++ or no libfastrtps-dev.

use selvedge_ros2::error::Cause;
use selvedge_ros2::network::Mapping;
use selvedge_ros2::state::State;
use serde_json::{Value, json};

use crate::arms::{the_stream_is_the_spline, trajectories};
use crate::run::Job;

fn job(test: &'static str, arm: &str, mut told: Value) -> Job {
    told["dds"] = json!("fast");
    let mut job = Job::new(test, arm, "gripper-command").told(told);
    job.mapping = Mapping::Enhanced;
    job
}

#[test]
fn fast_dds_gets_every_pose_and_the_jaws_in_order() {
    let name = "fast_dds_gets_every_pose_and_the_jaws_in_order";
    let mut job = job(name, "cartesian", json!({}));
    job.timed = true;
    let Some(played) = job.play() else { return };
    assert_eq!(played.end, State::Finished);
    the_stream_is_the_spline(&played, true);
    assert_eq!(played.got["frames"], json!(["fr3_link0"]));
    let stamps: Vec<(i64, i64)> = serde_json::from_value(played.got["stamps"].clone()).unwrap();
    assert!(stamps.is_sorted() && stamps[0] > (0, 0));
    let asked: Vec<&Value> = played.goals().iter().map(|goal| &goal[1]).collect();
    assert_eq!(
        json!(asked),
        json!([[0.04, 20.0], [0.0, 20.0], [0.04, 20.0]])
    );
}

#[test]
fn servo_on_fast_dds_answers_before_the_first_pose() {
    let name = "servo_on_fast_dds_answers_before_the_first_pose";
    let Some(played) = job(name, "servo", json!({})).play() else {
        return;
    };
    assert_eq!(played.end, State::Finished);
    the_stream_is_the_spline(&played, false);
    assert_eq!(
        played.got["calls"],
        json!([["type", 2, 0], ["pause", 0, 0]])
    );
    for (how, text) in [
        ("refuse", "switch_command_type ended as refused"),
        ("silent", "switch_command_type did not answer within 5 s"),
    ] {
        let played = job(name, "servo", json!({"servo": how})).play().unwrap();
        assert!(played.cause().contains(text), "{}", played.cause());
        assert_eq!(played.got["poses"], json!([]));
    }
}

#[test]
fn trajectories_reach_fast_dds_and_end_as_it_says() {
    let name = "trajectories_reach_fast_dds_and_end_as_it_says";
    let action = "/arm/follow_joint_trajectory";
    let Some(played) = job(name, "joints", json!({})).play() else {
        return;
    };
    assert_eq!(played.end, State::Finished);
    trajectories(&played, action, 1e-8);
    for (how, text) in [
        ("abort", "ended as Aborted"),
        ("reject", "rejected the goal"),
    ] {
        let played = job(name, "joints", json!({"arm": how})).play().unwrap();
        let cause = played.cause();
        assert!(cause.starts_with(action) && cause.contains(text), "{cause}");
    }
}

#[test]
fn grippers_on_fast_dds_fail_with_the_reason() {
    let name = "grippers_on_fast_dds_fail_with_the_reason";
    for (how, text) in [
        ("reject", "/gripper rejected the goal"),
        ("abort", "/gripper ended as Aborted"),
        ("stall", "stalled true, reached_goal false"),
        ("silent", "/gripper send_goal did not answer within 2 s"),
        ("never", "/gripper get_result did not answer within 1 s"),
    ] {
        let mut job = job(name, "cartesian", json!({"gripper": how}));
        job.jaws.deadline = 1.0;
        let Some(played) = job.play() else { return };
        let cause = played.cause();
        assert!(cause.contains(text), "{how}: {cause}");
        let expected = usize::from(!matches!(how, "reject" | "silent"));
        assert_eq!(played.goals().len(), expected, "{how}");
        played.rests();
    }
}

#[test]
fn a_stop_cancels_the_goal_on_fast_dds() {
    let name = "a_stop_cancels_the_goal_on_fast_dds";
    let mut job = job(name, "cartesian", json!({"jaw_seconds": 10}));
    job.stop_after = Some(4.0);
    let Some(played) = job.play() else { return };
    assert_eq!(played.end, State::Stopped(Cause::Signal));
    assert_eq!(
        (played.goals().len(), &played.got["cancels"]),
        (1, &json!(1))
    );
    played.rests();
}

#[test]
fn fast_dds_is_not_asked_as_cyclone_would_be() {
    // It would take the header for the goal's id, and what follows for the places.
    let name = "fast_dds_is_not_asked_as_cyclone_would_be";
    let mut job = job(name, "cartesian", json!({}));
    job.mapping = Mapping::Cyclone;
    let Some(played) = job.play() else { return };
    let cause = played.cause();
    assert!(cause.contains("is served by Fast DDS"), "{cause}");
    assert!(
        cause.ends_with("RMW_IMPLEMENTATION must be rmw_fastrtps_cpp"),
        "{cause}"
    );
    assert_eq!(played.goals(), [] as [Value; 0]);
    assert_eq!(played.got["poses"], json!([]));
}

#[test]
fn parameters_are_shown_and_cannot_be_set() {
    let name = "parameters_are_shown_and_cannot_be_set";
    let mut job = job(name, "cartesian", json!({"parameter": "speed"}));
    job.choice.parameters = vec![("speed".into(), "0.25".into())];
    let Some(played) = job.play() else { return };
    assert_eq!(played.end, State::Finished);
    assert_eq!(played.got["parameter"], "0.25");
    let refusal = played.got["refusal"].as_str().unwrap();
    assert!(refusal.starts_with("read only"), "{refusal}");
}
