//! The command as a user sees it: exit status, messages, and what is left in the folder.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

const XTASK: &str = env!("CARGO_BIN_EXE_xtask");

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../fixtures")
        .join(name)
}

fn experiments(arguments: &[&str], scenario: &Path, out: &Path) -> Output {
    Command::new(XTASK)
        .arg("experiments")
        .args(arguments)
        .arg("--scenario")
        .arg(scenario)
        .arg("--out")
        .arg(out)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Names of the files below a folder.
fn files(folder: &Path) -> Vec<String> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(path) = open.pop() {
        for entry in std::fs::read_dir(path).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                found.push(path.file_name().unwrap().to_string_lossy().into_owned());
            }
        }
    }
    found.sort();
    found
}

#[test]
fn finished_cases_end_with_status_0_and_a_table() {
    let folder = tempfile::tempdir().unwrap();
    let output = experiments(
        &["one", "--solver", "published", "--ensemble", "2"],
        &fixture("tests/small_fold.toml"),
        folder.path(),
    );
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let table = text(&output.stdout);
    assert!(
        table.contains("4 nodes: 47 48 54 55") && table.contains("8 nodes"),
        "{table}"
    );
    let lines = text(&output.stderr);
    assert!(lines.contains("one published done"), "{lines}");
    assert!(
        lines.contains("one published: 2 perturbed starts done"),
        "{lines}"
    );
    assert!(
        !table.contains('\u{1b}'),
        "no colours when the output is piped"
    );
    let quiet = experiments(
        &["one", "--quiet", "--solver", "published"],
        &fixture("tests/small_fold.toml"),
        folder.path(),
    );
    assert!(quiet.stderr.is_empty(), "{}", text(&quiet.stderr));
}

#[test]
fn a_failed_case_ends_with_status_2_and_the_others_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let output = experiments(&[], &fixture("tests/small_fold.toml"), folder.path());
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stdout).contains("closes on nothing at t = 0.1 s"));
    let files = files(folder.path());
    for name in [
        "one.npz",
        "two.png",
        "table.csv",
        "curves.svg",
        "report.html",
    ] {
        assert!(
            files.contains(&name.to_owned()),
            "{name} is not in {files:?}"
        );
    }
}

/// The first two columns of the table, without its header.
fn rows(out: &Path) -> Vec<String> {
    let table = std::fs::read_to_string(out.join("table.csv")).unwrap();
    let start = |line: &str| line.split(',').take(2).collect::<Vec<_>>().join(" ");
    table.lines().skip(1).map(start).collect()
}

#[test]
fn the_solver_is_chosen_and_both_are_the_default() {
    let small = fixture("tests/small_fold.toml");
    let chosen = |arguments: &[&str]| {
        let folder = tempfile::tempdir().unwrap();
        let output = experiments(arguments, &small, folder.path());
        let error = text(&output.stderr);
        // A case that fails on a solver is a row as well.
        assert!(matches!(output.status.code(), Some(0 | 2)), "{error}");
        let folders = ["published", "default"].map(|name| folder.path().join(name).is_dir());
        (rows(folder.path()), folders)
    };
    let both = ["two published", "two default"].map(str::to_owned).to_vec();
    let none = ["two", "--ensemble", "0"];
    assert_eq!(chosen(&none), (both.clone(), [true, true]));
    let solver = |name| chosen(&["two", "--ensemble", "1", "--solver", name]);
    assert_eq!(solver("both"), (both.clone(), [true, true]));
    assert_eq!(solver("published"), (both[..1].to_vec(), [true, false]));
    assert_eq!(solver("default"), (both[1..].to_vec(), [false, true]));
}

#[test]
fn numbers_out_of_bounds_are_refused_with_flag_and_bound() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for (flag, value, bound) in [
        ("--noise", "-1e-9", "from 0 to 0.001 m"),
        ("--noise", "1", "from 0 to 0.001 m"),
        ("--noise", "nan", "from 0 to 0.001 m"),
        ("--ensemble", "1001", "0..=1000"),
    ] {
        let output = experiments(&[flag, value], &fixture("tests/small_fold.toml"), &out);
        assert_eq!(output.status.code(), Some(2));
        let message = text(&output.stderr);
        for word in [flag, value, bound] {
            assert!(message.contains(word), "{word} is not in {message}");
        }
        assert!(!out.exists());
    }
}

#[test]
fn the_bench_prints_a_row_a_case_and_solver_and_the_totals() {
    let output = Command::new(XTASK)
        .args(["bench-fold", "--repeats", "1", "--scenario"])
        .arg(fixture("tests/small_fold.toml"))
        .output()
        .unwrap();
    // One of the cases grasps nothing.
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    let table = text(&output.stdout);
    for word in [
        "ms/step",
        "Strain, rms",
        "Shear",
        "Gap",
        "Held error",
        "Unconverged",
    ] {
        assert!(table.contains(word), "{word} is not in {table}");
    }
    assert!(table.contains("misses published failed: gripper 1 closes on nothing"));
    assert!(table.contains("x real time over 2 of 3 cases"), "{table}");
    assert!(table.contains("One thread, median of 1") && table.contains("load average"));
    let none = Command::new(XTASK)
        .args(["bench-fold", "--repeats", "0"])
        .output()
        .unwrap();
    assert_eq!(none.status.code(), Some(2));
    assert!(text(&none.stderr).contains("--repeats"));
}

#[test]
fn bad_input_ends_with_status_2_and_writes_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = folder.path().join("bad.toml");
    let good = std::fs::read_to_string(fixture("tests/small_fold.toml")).unwrap();
    std::fs::write(&scenario, good.replace("nodes = [7, 8]", "nodes = [1, 8]")).unwrap();
    let out = folder.path().join("out");
    let output = experiments(&[], &scenario, &out);
    assert_eq!(output.status.code(), Some(2));
    let message = text(&output.stderr);
    assert!(
        message.contains("bad.toml: cloth.nodes = [1, 8], must be at least 2"),
        "{message}"
    );
    assert!(!out.exists());

    let output = experiments(&["C9"], &fixture("tests/small_fold.toml"), &out);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("case C9 is not in small_fold, which has one, two"));
    assert!(!out.exists());

    let output = experiments(
        &["--solver", "magic"],
        &fixture("tests/small_fold.toml"),
        &out,
    );
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn a_folder_in_the_way_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("file");
    std::fs::write(&out, "in the way").unwrap();
    let output = experiments(&[], &fixture("tests/small_fold.toml"), &out);
    assert_eq!(output.status.code(), Some(2));
    let message = text(&output.stderr);
    assert!(
        message.contains("file/published") && message.contains("ot a directory"),
        "{message}"
    );
}

#[test]
fn a_case_follows_a_log() {
    let folder = tempfile::tempdir().unwrap();
    let small = fixture("tests/small_fold.toml");
    let [first, second] = ["first", "second"].map(|name| folder.path().join(name));
    let base = ["one", "--ensemble", "0", "--solver", "default"];
    assert_eq!(experiments(&base, &small, &first).status.code(), Some(0));
    let log = first.join("default/one.commands.csv");
    let log = ["--log", log.to_str().unwrap()];
    let output = experiments(&[&base[..], &log].concat(), &small, &second);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    // Its own commands: the same fold.
    let row = |out: &Path| {
        let table = std::fs::read_to_string(out.join("table.csv")).unwrap();
        table.lines().nth(1).unwrap().to_owned()
    };
    assert_eq!(row(&first), row(&second));
    let output = experiments(&log, &small, &second);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("name the one case"));
}

/// A limit on the size of files stands for a full disk: writing fails half way in the same place.
#[cfg(unix)]
#[test]
fn a_full_disk_is_named_and_leaves_nothing_half_written() {
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new("sh")
        .args([
            "-c",
            "trap '' XFSZ; ulimit -f 16; exec \"$@\"",
            "sh",
            XTASK,
            "experiments",
            "one",
        ])
        .arg("--scenario")
        .arg(fixture("tests/small_fold.toml"))
        .arg("--out")
        .arg(folder.path())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    let message = text(&output.stderr);
    assert!(
        message.contains("one.png cannot be written") && message.contains("large"),
        "{message}"
    );
    // The command logs are small enough; no recording tells that the case is finished.
    let files = files(folder.path());
    assert!(
        files.iter().all(|name| name == "one.commands.csv"),
        "{files:?}"
    );
}

#[cfg(unix)]
#[test]
fn ctrl_c_stops_with_status_130_and_leaves_whole_files_only() {
    let folder = tempfile::tempdir().unwrap();
    let child = Command::new(XTASK)
        .args(["experiments", "--jobs", "1", "--scenario"])
        .arg(fixture("scenarios/corner_fold.toml"))
        .arg("--out")
        .arg(folder.path())
        .stderr(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    // The first case runs for half a second once the folder is there.
    let started = Instant::now();
    while !folder.path().join("published").exists() {
        assert!(
            started.elapsed() < Duration::from_secs(60),
            "the first case never started"
        );
        std::thread::sleep(Duration::from_millis(5));
    }
    std::thread::sleep(Duration::from_millis(100));
    let killed = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status()
        .unwrap();
    assert!(killed.success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("stopped"));
    assert!(files(folder.path()).is_empty());
}
