//! What each gripper is told, and what happens when it fails.

use selvedge_ros2::play::Policy;
use selvedge_ros2::state::State;
use serde_json::{Value, json};

use crate::run::{Job, all, plan};

#[test]
fn every_gripper_is_told_in_its_own_words_and_in_order() {
    let name = "every_gripper_is_told_in_its_own_words_and_in_order";
    let finger = |q: f64| json!([["finger"], [q], [], [20.0]]);
    let cases = [
        (
            "franka",
            json!([
                ["/hand/homing", []],
                ["/hand/move", [0.08, 0.1]],
                ["/hand/grasp", [0.0, 0.005, 0.005, 0.1, 20.0]],
                ["/hand/move", [0.08, 0.1]]
            ]),
        ),
        (
            "parallel",
            json!([
                ["/parallel", finger(0.04)],
                ["/parallel", finger(0.0)],
                ["/parallel", finger(0.04)]
            ]),
        ),
    ];
    let job = |(gripper, _): &(&str, Value)| {
        let mut job = Job::new(name, "joints", gripper);
        job.jaws.homing = *gripper == "franka";
        job
    };
    let played = all(cases.iter().map(job).collect());
    for (played, (gripper, expected)) in played.iter().zip(&cases) {
        assert_eq!(played.end, State::Finished, "{gripper}");
        let told = played.goals().iter();
        let told = told.filter(|goal| goal[0] != "/arm/follow_joint_trajectory");
        let told: Vec<[&Value; 2]> = told.map(|goal| [&goal[0], &goal[1]]).collect();
        assert_eq!(json!(told), *expected);
    }
    let switches = ["bool", "set-bool"].map(|gripper| Job::new(name, "cartesian", gripper));
    for played in all(switches.into()) {
        assert_eq!(played.end, State::Finished);
        let calls = played.got["calls"].as_array().unwrap();
        let told: Vec<&Value> = calls.iter().map(|call| &call[1]).collect();
        assert_eq!(json!(told), json!([false, true, false]));
        // The arm waits for jaws that tell nothing: 0.2 s at rest after each.
        let poses = played.got["poses"].as_array().unwrap();
        let at = calls[1][2].as_u64().unwrap() as usize;
        assert_eq!(poses[at], poses[at + 40]);
    }
}

#[test]
fn jaws_that_stall_on_a_cloth_are_closed_and_jaws_that_stall_when_they_open_are_not() {
    let name = "jaws_that_stall_on_a_cloth_are_closed_and_jaws_that_stall_when_they_open_are_not";
    for gripper in ["gripper-command", "parallel"] {
        let mut job = Job::new(name, "cartesian", gripper);
        // They are open already, so that closing comes first.
        job.settings.jaw = Some(selvedge_math::Jaw::Open);
        let Some(played) = job.told(json!({"gripper": "stall"})).play() else {
            return;
        };
        let cause = played.cause();
        assert!(
            cause.contains("stalled true, reached_goal false"),
            "{cause}"
        );
        // Closed, moved, and stopped when it was to open.
        assert_eq!(played.goals().len(), 2, "{gripper}");
        played.rests();
    }
}

#[test]
fn a_gripper_that_fails_stops_the_arm_with_the_reason() {
    let name = "a_gripper_that_fails_stops_the_arm_with_the_reason";
    let cases = [
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
        // Opening is the first thing the jaws are told.
        (
            "franka",
            "fail",
            "/hand/move ended as Succeeded: nothing between the fingers",
        ),
        ("set-bool", "fail", "/close ended as refused: no air"),
        ("set-bool", "silent", "/close did not answer within 1 s"),
    ];
    let job = |(gripper, how, _): &(&str, &str, &str)| {
        let mut job = Job::new(name, "cartesian", gripper).told(json!({"gripper": how}));
        job.jaws.deadline = 1.0;
        job
    };
    let all = all(cases.iter().map(job).collect());
    for (played, (gripper, how, text)) in all.iter().zip(&cases) {
        let cause = played.cause();
        assert!(cause.starts_with(text), "{how}: {cause}");
        // One goal, however often it was asked for.
        let expected = usize::from(!matches!(*how, "reject" | "silent") && *gripper != "set-bool");
        assert_eq!(played.goals().len(), expected, "{how}");
        played.rests();
    }
}

#[test]
fn a_gripper_that_is_not_there_is_a_matter_of_the_policy() {
    let name = "a_gripper_that_is_not_there_is_a_matter_of_the_policy";
    let mut job = Job::new(name, "cartesian", "gripper-command");
    (job.settings.policy, job.plan) = (Policy::Continue, plan(1.0));
    let Some(played) = job.told(json!({"gripper": "none"})).play() else {
        return;
    };
    assert_eq!(played.end, State::Finished);
    let said = played
        .lines
        .iter()
        .any(|line| line["event"] == "no gripper, going on without");
    assert!(said, "{:?}", played.lines);
}

#[test]
fn a_stop_takes_the_command_back_and_stops_the_hand() {
    let name = "a_stop_takes_the_command_back_and_stops_the_hand";
    let mut job = Job::new(name, "cartesian", "franka");
    // The jaws open for ten seconds, from some 3.5 s on.
    job.stop_after = Some(5.0);
    let Some(played) = job.told(json!({"jaw_seconds": 10.0})).play() else {
        return;
    };
    assert_eq!(
        played.end,
        State::Stopped(selvedge_ros2::error::Cause::Signal)
    );
    assert_eq!(played.got["cancels"], 1);
    let calls = played.got["calls"].as_array().unwrap();
    assert_eq!(calls.len(), 1, "{calls:?}");
    assert_eq!(calls[0][0], "stop");
    // It never closes or opens anything by itself.
    assert_eq!(played.goals().len(), 1);
    played.rests();
}
