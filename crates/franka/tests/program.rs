//! The program selvedge-reach: exit codes, messages and files.
#![cfg(feature = "program")]
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use std::path::{Path, PathBuf};
use std::process::Command;

use selvedge_math::{Command as Told, DVec3, Jaw, Pose};
use selvedge_trajectory::log::{self, Log, Sample};

/// A folder for one test, emptied.
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    std::fs::remove_dir_all(&folder).ok();
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// Grasp, 0.59 m sideways with the fingers down, release; the tip at height `z` at both ends.
fn write_log(path: &Path, z: f64) {
    let mut log = Log::new("a test");
    for k in 0..=240 {
        let t = f64::from(k) / 60.0;
        let u = ((t - 0.5) / 3.0).clamp(0.0, 1.0);
        let s = u * u * u * (10.0 - u * (15.0 - 6.0 * u));
        let p = DVec3::new(0.21, 0.295 - 0.59 * s, z + 0.4 * s * (1.0 - s));
        let jaw = match (0.25..3.75).contains(&t) {
            true => Jaw::Closed,
            false => Jaw::Open,
        };
        let pose = Pose::from_translation(p);
        let command = Told { pose, jaw };
        log.samples.push(Sample { time: t, command });
    }
    log::write(&mut std::fs::File::create(path).unwrap(), &log).unwrap();
}

/// Exit code, output and errors.
fn run(arguments: &[&str]) -> (i32, String, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_selvedge-reach"))
        .args(arguments)
        .output()
        .unwrap();
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    (
        output.status.code().unwrap(),
        text(&output.stdout),
        text(&output.stderr),
    )
}

#[test]
fn a_log_within_reach_gives_files_that_read_back() {
    let folder = folder("reach-feasible");
    let log_path = folder.join("run.csv");
    write_log(&log_path, 0.02);
    let out = folder.join("out");
    let log_name = log_path.to_str().unwrap();
    let out_name = out.to_str().unwrap();
    let (code, text, errors) = run(&[log_name, "--robot", "fr3", "--out", out_name]);
    assert_eq!(code, 0, "{text}{errors}");
    for words in [
        "241 rows, 4.000 s; robot fr3",
        "bases look possible",
        "FEASIBLE",
        "keeps every bound",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
    let document: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(out.join("reach.json")).unwrap()).unwrap();
    assert_eq!(document["feasible"], true);
    assert_eq!(document["rows"].as_array().unwrap().len(), 241);
    assert_eq!(document["map"].as_array().unwrap().len(), 286);
    for (name, words) in [
        ("bases.svg", "Where the base may stand"),
        ("margins.svg", "nearest joint limit [rad]"),
        ("reach.html", "elbow acceleration"),
    ] {
        let text = std::fs::read_to_string(out.join(name)).unwrap();
        assert!(text.contains(words), "{name}: {words}");
    }
    let joints = std::fs::read_to_string(out.join("joints.csv")).unwrap();
    let mut lines = joints.lines();
    assert_eq!(lines.next(), Some("t,q1,q2,q3,q4,q5,q6,q7,jaw"));
    let rows: Vec<Vec<f64>> = lines
        .map(|line| line.split(',').map(|x| x.parse().unwrap()).collect())
        .collect();
    assert!(rows.windows(2).all(|pair| pair[1][0] > pair[0][0]));
    assert_eq!(rows.iter().filter(|row| row[8] == 1.0).count(), 210);
    // The new log is one that can be followed as well, in less time, and nothing is moved by it.
    let retimed = out.join("retimed.commands.csv");
    let read = log::read(std::fs::File::open(&retimed).unwrap(), "retimed").unwrap();
    let last = read.samples.last().unwrap();
    assert!(last.time < 3.0 && last.time > 1.0, "{}", last.time);
    assert!(
        read.samples
            .windows(2)
            .all(|pair| (pair[1].time - pair[0].time - 1.0 / 60.0).abs() < 1e-9)
    );
    let again = run(&[log_name, "--robot", "fr3", "--out", out_name]);
    assert_eq!(again.1, text);
    assert_eq!(
        std::fs::read_to_string(out.join("joints.csv")).unwrap(),
        joints
    );
    assert!(std::fs::read_dir(&out).unwrap().count() == 7);
    // The base it found, given by hand.
    let base = &document["place"]["base_xyz_yaw"];
    let base: Vec<String> = base
        .as_array()
        .unwrap()
        .iter()
        .map(ToString::to_string)
        .collect();
    let (code, text, _) = run(&[log_name, "--robot", "fr3", "--base", &base.join(",")]);
    assert_eq!(code, 0, "{text}");
    assert!(!text.contains("search"));
    // The other robots: the built-in one, and a file.
    assert_eq!(run(&[log_name, "--robot", "fer"]).0, 0);
    let urdf = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../fixtures/franka/fr3.urdf"
    );
    assert_eq!(run(&[log_name, "--robot", urdf]).0, 0);
}

#[test]
fn out_of_reach_is_3_and_says_why() {
    let folder = folder("reach-infeasible");
    let log_path = folder.join("run.csv");
    write_log(&log_path, 0.02);
    let name = log_path.to_str().unwrap();
    let (code, text, errors) = run(&[name, "--robot", "fr3", "--base", "-1.5,0,0,0"]);
    assert_eq!((code, errors.as_str()), (3, ""));
    assert!(
        text.contains("INFEASIBLE  on the way down to the grasp: out of reach by"),
        "{text}"
    );
    // A table that is too high, wherever the base is.
    let (code, text, _) = run(&[
        name,
        "--robot",
        "fr3",
        "--table",
        "0.015",
        "--out",
        folder.to_str().unwrap(),
    ]);
    assert_eq!(code, 3);
    assert!(
        text.contains("finger is below the table by 4.5 mm, whatever"),
        "{text}"
    );
    assert!(text.contains("raise the whole path by 10 mm"), "{text}");
    // A report is written, motions are not.
    assert!(folder.join("reach.json").exists());
    assert!(!folder.join("joints.csv").exists() && !folder.join("reach.html").exists());
}

#[test]
fn bad_input_is_2_and_says_which() {
    let folder = folder("reach-bad");
    let log_path = folder.join("run.csv");
    write_log(&log_path, 0.02);
    let name = log_path.to_str().unwrap();
    let nowhere = folder.join("nowhere.csv");
    let broken = folder.join("broken.csv");
    let text = std::fs::read_to_string(&log_path).unwrap();
    std::fs::write(&broken, text.replacen("0.21,", "NaN,", 1)).unwrap();
    let one = folder.join("one.csv");
    let head: Vec<&str> = text.lines().take(6).collect();
    std::fs::write(&one, head.join("\n") + "\n").unwrap();
    let [nowhere, broken, one] = [&nowhere, &broken, &one].map(|path| path.to_str().unwrap());
    let cases: [(&[&str], &str); 12] = [
        (&[nowhere, "--robot", "fr3"], "cannot open"),
        (
            &[broken, "--robot", "fr3"],
            "broken.csv line 6: px is `NaN`, must be a finite number",
        ),
        (
            &[one, "--robot", "fr3"],
            "one.csv: the log: rows is 1, must be 2 at least",
        ),
        (&[name], "--robot"),
        (
            &[name, "--robot", "ur5"],
            "--robot is ur5, must be fr3, fer or a URDF file",
        ),
        (&[name, "--robot", name], "URDF"),
        (
            &[name, "--robot", "fr3", "--base", "1,2,3"],
            "must be four numbers x,y,z,yaw",
        ),
        (
            &[name, "--robot", "fr3", "--base", "-500,0,0,0"],
            "is it in millimetres?",
        ),
        (
            &[name, "--robot", "fr3", "--base", "0,0,0,180"],
            "is it in degrees?",
        ),
        (
            &[name, "--robot", "fr3", "--base", "NaN,0,0,0"],
            "base: x is NaN",
        ),
        (
            &[name, "--robot", "fr3", "--table", "inf"],
            "table: z is inf",
        ),
        (
            &[name, "--robot", "fr3", "--links", "a,b"],
            "--links is for URDF files",
        ),
    ];
    for (arguments, words) in cases {
        let (code, _, errors) = run(arguments);
        assert_eq!(code, 2, "{arguments:?}: {errors}");
        assert!(errors.contains(words), "{arguments:?}: {errors}");
    }
}
