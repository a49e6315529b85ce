//! What the `mcap` Python package makes of a recording. Skipped by name where there is no Python with
//! it: the program in `SELVEDGE_PYTHON`, else `python3`.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use std::ffi::OsString;
use std::process::Command as Process;

use selvedge_math::{Command, DQuat, DVec3, Jaw, Pose};
use selvedge_view::{GripperState, Recording, Rest, Sheet};

const READER: &str = r#"
import json, sys
from mcap.reader import make_reader
messages = {}
with open(sys.argv[1], "rb") as file:
    for schema, channel, message in make_reader(file).iter_messages():
        assert schema.encoding == "jsonschema" and channel.message_encoding == "json"
        assert json.loads(schema.data)["title"] == schema.name
        found = messages.setdefault(channel.topic, {"schema": schema.name, "log": [], "data": []})
        found["log"].append(message.log_time)
        found["data"].append(json.loads(message.data))
json.dump(messages, sys.stdout)
"#;

fn recording() -> Recording {
    let points: Vec<DVec3> = (0..6)
        .map(|k| DVec3::new(0.21 * f64::from(k % 3), 0.3 * f64::from(k / 3), 0.0))
        .collect();
    let sheet = Sheet {
        quads: vec![[0, 1, 4, 3], [1, 2, 5, 4]],
        triangles: vec![],
        rest: Rest::Positions(points.clone()),
    };
    let volume = r#"{"type":"box","size_m":[0.03,0.03,0.03]}"#;
    let meta = format!(r#"{{"grippers":[{volume},{volume}]}}"#);
    let mut recording = Recording::new(sheet, 2, meta).unwrap();
    for k in 0..4_u8 {
        let t = f64::from(k);
        let moved: Vec<DVec3> = points.iter().map(|p| *p + t / 7.0 * DVec3::Z).collect();
        let state = |g: f64, jaw| GripperState {
            command: Command {
                pose: Pose::new(DVec3::new(g, t, 0.1), DQuat::from_rotation_x(0.3 * t)).unwrap(),
                jaw,
            },
            alpha: 0.25 * t,
        };
        let jaw = if k > 1 { Jaw::Closed } else { Jaw::Open };
        let held = if k > 1 { [0, 0, 2, 0, 0, 2] } else { [0; 6] };
        let states = [state(1.0, Jaw::Open), state(2.0, jaw)];
        recording.push(t / 60.0, &moved, &states, &held).unwrap();
    }
    recording
}

#[test]
fn python_reads_positions_poses_and_held_nodes() {
    let python = std::env::var_os("SELVEDGE_PYTHON").unwrap_or_else(|| OsString::from("python3"));
    let has_mcap = Process::new(&python).args(["-c", "import mcap"]).output();
    if !has_mcap.is_ok_and(|output| output.status.success()) {
        eprintln!(
            "python_reads_positions_poses_and_held_nodes: skipped, {} has no mcap",
            python.display()
        );
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    let recording = recording();
    recording.write_mcap(&path).unwrap();
    let first = std::fs::read(&path).unwrap();
    recording.write_mcap(&path).unwrap();
    assert_eq!(first, std::fs::read(&path).unwrap(), "the same bytes again");
    let output = Process::new(&python)
        .args(["-c", READER])
        .arg(&path)
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();

    let schemas = [
        ("/cloth", "foxglove.SceneUpdate", 4),
        ("/gripper1", "foxglove.PoseInFrame", 4),
        ("/gripper2", "foxglove.PoseInFrame", 4),
        ("/tf", "foxglove.FrameTransform", 8),
        ("/jaws", "selvedge.Jaws", 4),
    ];
    for (topic, schema, count) in schemas {
        assert_eq!(found[topic]["schema"], schema);
        assert_eq!(
            found[topic]["data"].as_array().unwrap().len(),
            count,
            "{topic}"
        );
    }
    assert_eq!(found.as_object().unwrap().len(), schemas.len());
    let near = |value: &serde_json::Value, expected: DVec3| {
        let read = |axis: &str| value[axis].as_f64().unwrap();
        let point = DVec3::new(read("x"), read("y"), read("z"));
        assert!(
            point.distance(expected) < 1e-9,
            "{point} instead of {expected}"
        );
    };
    for frame in 0..4 {
        let nanoseconds = (recording.times()[frame] * 1e9).round() as u64;
        assert_eq!(found["/cloth"]["log"][frame], nanoseconds);
        let entities = &found["/cloth"]["data"][frame]["entities"];
        let cloth = &entities[0]["triangles"][0];
        for (node, position) in recording.positions(frame).iter().enumerate() {
            near(&cloth["points"][node], *position);
        }
        assert_eq!(cloth["indices"].as_array().unwrap().len(), 12);
        for (number, topic) in ["/gripper1", "/gripper2"].iter().enumerate() {
            let pose = recording.grippers(frame)[number].command.pose;
            near(
                &found[topic]["data"][frame]["pose"]["position"],
                pose.position(),
            );
            let transform = &found["/tf"]["data"][2 * frame + number];
            near(&transform["translation"], pose.position());
            assert_eq!(transform["rotation"]["w"], pose.rotation().w);
            assert_eq!(
                entities[1 + number]["frame_id"],
                transform["child_frame_id"]
            );
        }
        let held = &found["/jaws"]["data"][frame]["grippers"][1]["held"];
        let expected = if frame > 1 { vec![2, 5] } else { vec![] };
        assert_eq!(held, &serde_json::json!(expected));
        let red = cloth["colors"][2]["r"].as_f64().unwrap() > 0.5;
        assert_eq!(red, frame > 1);
    }
}

#[test]
fn a_time_before_the_epoch_is_named() {
    let sheet = recording().sheet().clone();
    let mut early = Recording::new(sheet, 0, "{}".into()).unwrap();
    early.push(-1.0, &[DVec3::ZERO; 6], &[], &[0; 6]).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let error = early
        .write_mcap(folder.path().join("a.mcap"))
        .unwrap_err()
        .to_string();
    assert!(error.contains("frame 0 is -1 s"), "{error}");
}
