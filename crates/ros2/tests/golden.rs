//! Every message that is sent or read, byte for byte against the encoder of PyPI's `rosbags`, which gets
//! the definitions from `peer/interfaces.txt`, and bags. Skipped by name where there is no Python with
//! `rosbags` and `mcap`.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

mod peer;

use std::path::Path;
use std::process::Command as Process;

use selvedge_math::{DQuat, DVec3, Pose};
use selvedge_ros2::journal::{Journal, Target};
use selvedge_ros2::messages::{self as m, franka, moveit};
use serde::de::{DeserializeOwned, MapAccess, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::Value;

/// What a message holds: names of fields, empty inside of lists, and values, in order.
#[derive(Debug, PartialEq)]
struct Leaves(Vec<(String, Value)>);

impl<'de> Deserialize<'de> for Leaves {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(Walk)
    }
}

struct Walk;

impl<'de> Visitor<'de> for Walk {
    type Value = Leaves;
    fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("JSON")
    }
    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Leaves, A::Error> {
        let mut all = Vec::new();
        while let Some((key, Leaves(inner))) = map.next_entry::<String, Leaves>()? {
            let scalar = inner.len() == 1 && inner[0].0 == "-";
            let inner = inner.into_iter();
            all.extend(inner.map(|(name, value)| (if scalar { key.clone() } else { name }, value)));
        }
        Ok(Leaves(all))
    }
    fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Leaves, A::Error> {
        let mut all = Vec::new();
        while let Some(Leaves(inner)) = seq.next_element()? {
            let plain = |name: String| if name == "-" { String::new() } else { name };
            all.extend(inner.into_iter().map(|(name, value)| (plain(name), value)));
        }
        Ok(Leaves(all))
    }
    fn visit_bool<E>(self, x: bool) -> Result<Leaves, E> {
        Ok(Leaves(vec![("-".into(), x.into())]))
    }
    fn visit_i64<E>(self, x: i64) -> Result<Leaves, E> {
        Ok(Leaves(vec![("-".into(), x.into())]))
    }
    fn visit_u64<E>(self, x: u64) -> Result<Leaves, E> {
        Ok(Leaves(vec![("-".into(), x.into())]))
    }
    fn visit_f64<E>(self, x: f64) -> Result<Leaves, E> {
        Ok(Leaves(vec![("-".into(), x.into())]))
    }
    fn visit_str<E>(self, x: &str) -> Result<Leaves, E> {
        Ok(Leaves(vec![("-".into(), x.into())]))
    }
}

fn golden(test: &str, distro: &str) -> Option<Value> {
    let python = peer::python(test, "rosbags")?;
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peer/golden.py");
    let output = Process::new(python)
        .arg("-B")
        .arg(script)
        .arg(distro)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    Some(serde_json::from_slice(&output.stdout).unwrap())
}

/// Reads and writes one, and looks at what was read.
fn check<T: Serialize + DeserializeOwned>(golden: &Value, name: &str) {
    let [hex, leaves] = golden["messages"][name].as_array().unwrap().as_slice() else {
        panic!("{name}");
    };
    let hex = hex.as_str().unwrap();
    let bytes: Vec<u8> = (0..hex.len() / 2)
        .map(|k| u8::from_str_radix(&hex[2 * k..2 * k + 2], 16).unwrap())
        .collect();
    let message: T = m::decode(&bytes).unwrap_or_else(|error| panic!("{name}: {error}"));
    let written = m::encode(&message).unwrap();
    let whole = name != "control_msgs/msg/FollowJointTrajectory_Feedback";
    assert!(
        !whole || written.len() == bytes.len(),
        "{name}: {} {}",
        written.len(),
        bytes.len()
    );
    assert_eq!(written, bytes[..written.len()], "{name}");
    let text = serde_json::to_string(&message).unwrap();
    let Leaves(ours) = serde_json::from_str(&text).unwrap();
    let theirs: Vec<(String, Value)> = serde_json::from_value(leaves.clone()).unwrap();
    assert!(!whole || ours.len() == theirs.len(), "{name}");
    for ((name_here, value), (field, expected)) in ours.iter().zip(&theirs) {
        assert_eq!(value, expected, "{name} {field}");
        assert!(
            name_here.is_empty() || name_here == field,
            "{name}: {name_here} is {field}"
        );
    }
}

#[test]
fn every_message_has_the_bytes_that_another_encoder_gives_it() {
    let test = "every_message_has_the_bytes_that_another_encoder_gives_it";
    let Some(jazzy) = golden(test, "jazzy") else {
        return;
    };
    let g = &jazzy;
    check::<m::Header>(g, "std_msgs/msg/Header");
    check::<m::SetBool>(g, "std_msgs/msg/Bool");
    check::<m::PoseStamped>(g, "geometry_msgs/msg/PoseStamped");
    check::<m::TfMessage>(g, "tf2_msgs/msg/TFMessage");
    check::<m::Clock>(g, "rosgraph_msgs/msg/Clock");
    check::<m::Path>(g, "nav_msgs/msg/Path");
    check::<m::DiagnosticArray>(g, "diagnostic_msgs/msg/DiagnosticArray");
    check::<m::JointState>(g, "sensor_msgs/msg/JointState");
    check::<m::JointTrajectory>(g, "trajectory_msgs/msg/JointTrajectory");
    check::<m::FollowGoal>(g, "control_msgs/msg/FollowJointTrajectory_Goal");
    check::<m::FollowResult>(g, "control_msgs/msg/FollowJointTrajectory_Result");
    check::<m::FollowFeedback>(g, "control_msgs/msg/FollowJointTrajectory_Feedback");
    check::<m::GripperGoal>(g, "control_msgs/msg/GripperCommand_Goal");
    check::<m::GripperState>(g, "control_msgs/msg/GripperCommand_Result");
    check::<m::GripperState>(g, "control_msgs/msg/GripperCommand_Feedback");
    check::<m::ParallelGoal>(g, "control_msgs/msg/ParallelGripperCommand_Goal");
    check::<m::ParallelResult>(g, "control_msgs/msg/ParallelGripperCommand_Result");
    check::<m::ParallelFeedback>(g, "control_msgs/msg/ParallelGripperCommand_Feedback");
    check::<m::SetBool>(g, "std_srvs/msg/SetBool_Request");
    check::<m::SetBoolReply>(g, "std_srvs/msg/SetBool_Response");
    check::<m::Empty>(g, "std_srvs/msg/Trigger_Request");
    check::<m::SetBoolReply>(g, "std_srvs/msg/Trigger_Response");
    check::<franka::GraspGoal>(g, "franka_msgs/msg/Grasp_Goal");
    check::<franka::MoveGoal>(g, "franka_msgs/msg/Move_Goal");
    for action in ["Grasp", "Move"] {
        check::<franka::FrankaResult>(g, &format!("franka_msgs/msg/{action}_Result"));
        check::<franka::FrankaFeedback>(g, &format!("franka_msgs/msg/{action}_Feedback"));
    }
    check::<franka::RobotState>(g, "franka_msgs/msg/FrankaRobotState");
    check::<m::CommandType>(g, "moveit_msgs/msg/ServoCommandType_Request");
    check::<m::Success>(g, "moveit_msgs/msg/ServoCommandType_Response");
    check::<m::ServoStatus>(g, "moveit_msgs/msg/ServoStatus");
    check::<moveit::CartesianPathJazzy>(g, "moveit_msgs/msg/GetCartesianPath_Request");
    check::<moveit::CartesianReplyJazzy>(g, "moveit_msgs/msg/GetCartesianPath_Response");
    check::<moveit::ExecuteJazzy>(g, "moveit_msgs/msg/ExecuteTrajectory_Goal");
    check::<moveit::ExecutedJazzy>(g, "moveit_msgs/msg/ExecuteTrajectory_Result");
    check::<moveit::ExecuteState>(g, "moveit_msgs/msg/ExecuteTrajectory_Feedback");
    let g = &golden(test, "humble").unwrap();
    check::<moveit::CartesianPathHumble>(g, "moveit_msgs/msg/GetCartesianPath_Request");
    check::<moveit::CartesianReplyHumble>(g, "moveit_msgs/msg/GetCartesianPath_Response");
    check::<moveit::ExecuteHumble>(g, "moveit_msgs/msg/ExecuteTrajectory_Goal");
    check::<moveit::ExecutedHumble>(g, "moveit_msgs/msg/ExecuteTrajectory_Result");
    check::<moveit::ExecuteState>(g, "moveit_msgs/msg/ExecuteTrajectory_Feedback");
    // Errors are named in their order.
    let leaves = &jazzy["messages"]["franka_msgs/msg/FrankaRobotState"][1];
    let names: Vec<(String, Value)> = serde_json::from_value(leaves.clone()).unwrap();
    let names: Vec<&str> = names.iter().map(|(name, _)| name.as_str()).collect();
    let errors = names.len() - 2 * franka::ERRORS.len();
    assert_eq!(names[errors..errors + franka::ERRORS.len()], franka::ERRORS);
}

#[test]
fn the_definitions_have_the_hashes_of_jazzy() {
    let test = "the_definitions_have_the_hashes_of_jazzy";
    let Some(golden) = golden(test, "jazzy") else {
        return;
    };
    let (ours, known) = (&golden["ours"], golden["known"].as_object().unwrap());
    assert!(known.len() > 25, "{}", known.len());
    for (name, hash) in known {
        assert_eq!(ours[name], *hash, "{name}");
    }
    // As a participant of Jazzy announces them: these are not in the store of rosbags, or are its best
    // known ones.
    for (name, start, end) in [
        ("geometry_msgs/msg/PoseStamped", "RIHS01_10f3786d", "4cd8"),
        ("sensor_msgs/msg/JointState", "RIHS01_a13ee3a3", "260e"),
        ("tf2_msgs/msg/TFMessage", "RIHS01_e369d0f0", "f087"),
        ("rosgraph_msgs/msg/Clock", "RIHS01_692f7a66", "8564"),
        (
            "trajectory_msgs/msg/JointTrajectory",
            "RIHS01_179b33eb",
            "796e",
        ),
        ("control_msgs/msg/GripperCommand", "RIHS01_57eb8f32", "9890"),
    ] {
        let hash = ours[name].as_str().unwrap();
        assert!(
            hash.starts_with(start) && hash.ends_with(end),
            "{name}: {hash}"
        );
    }
}

#[test]
fn a_bag_is_read_by_the_programs_of_others() {
    let test = "a_bag_is_read_by_the_programs_of_others";
    let packages = peer::python(test, "rosbags").and_then(|_| peer::python(test, "mcap"));
    let Some(python) = packages else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.jsonl");
    let target = Target {
        topic: "/target_pose".into(),
        frame: "base".into(),
    };
    let (journal, writer) = Journal::create(&path, Some(target)).unwrap();
    let turn = DQuat::from_rotation_z(0.5);
    for k in 0..1000 {
        let p = DVec3::new(0.001 * f64::from(k), 0.2, 1.0 / 3.0);
        journal.pose(0.004 * f64::from(k), &Pose::from_unit(p, turn));
    }
    let point = m::JointTrajectoryPoint {
        positions: vec![0.1, 0.2],
        velocities: vec![0.3, 0.4],
        accelerations: vec![],
        effort: vec![],
        time_from_start: m::Duration::from_seconds(1.25),
    };
    let trajectory = m::JointTrajectory {
        header: m::Header::none(),
        joint_names: vec![m::Name::new("a"), m::Name::new("b")],
        points: vec![point],
    };
    journal.trajectory(4.0, "/arm", &trajectory);
    journal.event(4.1, "state", "finished");
    assert_eq!(writer.finish().unwrap(), 0);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peer/bag.py");
    let mut read = Process::new(python);
    let read = read.arg("-B").arg(script).arg(path.with_extension("mcap"));
    let output = read.output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}");
    let all: Vec<Value> = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(all.len(), 1002);
    let pose = &all[999];
    assert_eq!(pose[0], "/target_pose");
    assert_eq!(pose[3]["header"]["frame_id"], "base");
    assert_eq!(pose[3]["pose"]["position"]["x"], 0.999);
    assert_eq!(pose[3]["pose"]["position"]["z"], 1.0 / 3.0);
    assert_eq!(pose[3]["pose"]["orientation"]["w"], turn.w);
    let times: Vec<u64> = all.iter().map(|one| one[2].as_u64().unwrap()).collect();
    assert!(times.is_sorted() && times[0] > 1_700_000_000_000_000_000);
    let way = &all[1000][3];
    assert_eq!(way["joint_names"], serde_json::json!(["a", "b"]));
    assert_eq!(
        way["points"][0]["velocities"],
        serde_json::json!([0.3, 0.4])
    );
    assert_eq!(way["points"][0]["time_from_start"]["nanosec"], 250_000_000);
    let event = all[1001][3]["data"].as_str().unwrap();
    let event: Value = serde_json::from_str(event).unwrap();
    assert_eq!(event["detail"], "finished");
}
