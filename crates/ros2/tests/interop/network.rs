//! Names, and who sees what of our node.

use selvedge_ros2::names::Names;
use selvedge_ros2::network::Mapping;
use selvedge_ros2::state::State;
use serde_json::{Value, json};

use crate::run::Job;

#[test]
fn namespaces_and_remaps_change_the_names_on_the_wire() {
    let name = "namespaces_and_remaps_change_the_names_on_the_wire";
    let mut job = Job::new(name, "cartesian", "gripper-command");
    let arguments = ["--ros-args", "-r", "__ns:=/left", "-r", "jaws:=/gripper"];
    job.names = Names::from_arguments(arguments.map(String::from))
        .unwrap()
        .0;
    job.choice.gripper_name = Some("jaws".into());
    let Some(played) = job.told(json!({"prefix": "/left"})).play() else {
        return;
    };
    assert_eq!(played.end, State::Finished);
    assert_eq!(played.goals().len(), 3);
}

/// Topics that the peer sees somebody read.
fn read(mapping: Mapping) -> Option<Vec<String>> {
    let mut job = Job::new(
        "parameters_are_served_where_somebody_understands_it",
        "cartesian",
        "none",
    );
    job.mapping = mapping;
    job.stop_after = Some(0.1);
    let played = job.told(json!({"discover": true})).play()?;
    let topics = played.got["topics"].as_array().unwrap().iter();
    Some(
        topics
            .map(|topic: &Value| topic.as_str().unwrap().to_owned())
            .collect(),
    )
}

#[test]
fn parameters_are_served_where_somebody_understands_it() {
    let Some(enhanced) = read(Mapping::Enhanced) else {
        return;
    };
    let service = "rq/selvedge_play/get_parametersRequest".to_owned();
    assert!(enhanced.contains(&service), "{enhanced:?}");
    let cyclone = read(Mapping::Cyclone).unwrap();
    assert!(!cyclone.contains(&service), "{cyclone:?}");
    // No command is taken from the network: what we read tells about the robot.
    for topic in cyclone.iter().filter(|topic| topic.starts_with("rt/")) {
        assert!(
            ["rt/joint_states", "rt/clock", "rt/parameter_events"].contains(&topic.as_str()),
            "{topic}"
        );
    }
}
