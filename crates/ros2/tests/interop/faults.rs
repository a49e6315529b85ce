//! Faults of the other side, and that each ends at rest with its reason.

use selvedge_ros2::error::Cause;
use selvedge_ros2::network::Mapping;
use selvedge_ros2::state::State;
use serde_json::{Value, json};

use crate::run::{Job, all};

#[test]
fn a_peer_that_goes_or_intrudes_stops_the_arm_at_rest() {
    let name = "a_peer_that_goes_or_intrudes_stops_the_arm_at_rest";
    let cases = [
        (
            json!({"second_after": 700}),
            false,
            "/target_pose has 1 publishers besides this one",
        ),
        (
            json!({"deaf_after": 700}),
            false,
            "nobody reads /target_pose any more",
        ),
        (
            json!({"mute_after": 700}),
            false,
            "the measured state is 0.4",
        ),
        (
            json!({"kill_after": 700}),
            false,
            "the measured state is 0.4",
        ),
        // It comes again, but is another; and one that tells the state besides the first.
        (
            json!({"kill_after": 700}),
            true,
            "somebody new publishes /joint_states",
        ),
        (
            json!({"impostor_after": 700}),
            false,
            "somebody new publishes /joint_states",
        ),
    ];
    let job = |(told, again, _): &(Value, bool, &str)| {
        let mut job = Job::new(name, "cartesian", "gripper-command").told(told.clone());
        job.again = *again;
        if *again {
            job.settings.stale = 5.0;
        }
        job
    };
    let all = all(cases.iter().map(job).collect());
    for (played, (told, _, text)) in all.iter().zip(&cases) {
        let cause = played.cause();
        assert!(cause.starts_with(text), "{told}: {cause}");
        played.rests();
    }
}

#[test]
fn what_is_not_as_it_must_be_is_told_before_anything_is_sent() {
    let name = "what_is_not_as_it_must_be_is_told_before_anything_is_sent";
    let job = Job::new(name, "cartesian", "gripper-command");
    let Some(played) = job.told(json!({"impossible": true})).play() else {
        return;
    };
    assert_eq!(
        played.cause(),
        "fr3_joint1 in /joint_states is impossible: 9 rad"
    );
    // Names of joints that nobody tells.
    let mut job = Job::new(name, "cartesian", "gripper-command");
    for joint in &mut job.plan.joint_names {
        *joint = joint.replace("fr3", "panda");
    }
    let started = job.plan.joint_names.clone();
    let played = job.told(json!({"names": ["other"]})).play().unwrap();
    assert_eq!(started.len(), 7);
    assert_eq!(played.cause(), "/joint_states is inf s old, at most 3 s");
}

#[test]
fn a_reader_of_another_type_and_nobody_at_all_are_told_apart() {
    let name = "a_reader_of_another_type_and_nobody_at_all_are_told_apart";
    let job = Job::new(name, "cartesian", "gripper-command");
    let Some(played) = job.told(json!({"wrong_type": true})).play() else {
        return;
    };
    let State::Stopped(cause) = &played.end else {
        panic!("{:?}", played.end);
    };
    assert!(matches!(cause, Cause::TypeMismatch { .. }), "{cause}");
    // A service of another type: an action's server taken for one of another action.
    let mut job = Job::new(name, "cartesian", "parallel");
    job.choice.gripper_name = Some("/gripper".into());
    let played = job.play().unwrap();
    let cause = played.cause();
    let (found, expected) = ("GripperCommand_SendGoal", "ParallelGripperCommand_SendGoal");
    assert!(cause.contains(found) && cause.contains(expected), "{cause}");
    let job = Job::new(name, "cartesian", "gripper-command");
    let played = job.told(json!({"gripper": "none"})).play().unwrap();
    let expected = "nobody serves or reads /gripper/_action/send_goal within 3 s";
    assert_eq!(played.cause(), expected);
    assert_eq!(played.got["poses"], json!([]));
}

#[test]
fn with_the_wrong_mapping_nothing_is_asked() {
    let name = "with_the_wrong_mapping_nothing_is_asked";
    let mut job = Job::new(name, "cartesian", "gripper-command");
    job.mapping = Mapping::Enhanced;
    let Some(played) = job.play() else { return };
    let cause = played.cause();
    let expected = "/gripper/_action/send_goal is served by Cyclone DDS, which would misread what this \
                    program sends: RMW_IMPLEMENTATION must be rmw_cyclonedds_cpp";
    assert_eq!(cause, expected);
    assert_eq!(played.goals().len(), 0);
    assert_eq!(played.got["poses"], json!([]));
}

#[test]
fn a_robot_that_comes_after_six_seconds_is_found() {
    let name = "a_robot_that_comes_after_six_seconds_is_found";
    let mut job = Job::new(name, "cartesian", "none");
    job.late = 6.5;
    let Some(played) = job.play() else { return };
    assert_eq!(played.end, State::Finished);
    // The path was published before it came, and waits for it.
    assert_eq!(played.got["paths"].as_array().unwrap().len(), 1);
    // No sample of a motion is lost.
    let (sent, got) = (
        played.sent().len(),
        played.got["poses"].as_array().unwrap().len(),
    );
    assert!(sent - got < 75, "{got} of {sent}");
}
