//! A small experiment, its files and its failures.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Mutex;

use selvedge_folding::{
    Error, Event, Expected, Experiment, FoldName, Options, Scenario, Solver, experiment,
};
use selvedge_view::Recording;

const SMALL: &str = include_str!("../../../fixtures/tests/small_fold.toml");

/// The cases on the published scheme, one at a time and without ensembles.
fn options(out: &Path, cases: &[&str]) -> Options {
    Options {
        cases: cases.iter().map(|&name| name.to_owned()).collect(),
        solvers: vec![Solver::Published],
        out: out.to_owned(),
        jobs: 1,
        ensemble: 0,
        noise: 1e-9,
        resume: false,
        exports: Vec::new(),
        command: String::new(),
        tables: Vec::new(),
    }
}

/// The small scenario.
fn run_with(options: &Options) -> Result<Experiment, Error> {
    let scenario = Scenario::parse(SMALL, "small", "small.toml")?;
    experiment(&scenario, &Expected::default(), options, &|_| {
        ControlFlow::Continue(())
    })
}

fn run_to(out: &Path, cases: &[&str]) -> Result<Experiment, Error> {
    run_with(&options(out, cases))
}

/// Every file below a folder, by its path in it.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(path) = open.pop() {
        for entry in std::fs::read_dir(path).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                let name = path
                    .strip_prefix(folder)
                    .unwrap()
                    .to_string_lossy()
                    .into_owned();
                found.insert(name, std::fs::read(path).unwrap());
            }
        }
    }
    found
}

#[test]
fn files_are_the_same_bytes_with_any_number_of_jobs() {
    let made = |jobs| {
        let folder = tempfile::tempdir().unwrap();
        let options = Options {
            jobs,
            ensemble: 3,
            noise: 1e-4,
            ..options(folder.path(), &[])
        };
        run_with(&options).unwrap();
        let mut files = files(folder.path());
        for name in ["timings.csv", "report.html"] {
            assert!(files.remove(name).is_some());
        }
        files
    };
    let first = made(1);
    let names: Vec<&str> = first.keys().map(String::as_str).collect();
    assert_eq!(
        names,
        [
            "curves.csv",
            "curves.svg",
            "published/ends.png",
            "published/members/one.1.npz",
            "published/members/one.2.npz",
            "published/members/one.3.npz",
            "published/members/two.1.npz",
            "published/members/two.2.npz",
            "published/members/two.3.npz",
            "published/one.commands.csv",
            "published/one.npz",
            "published/one.png",
            "published/two.gripper1.commands.csv",
            "published/two.gripper2.commands.csv",
            "published/two.npz",
            "published/two.png",
            "table.csv",
            "table.md",
        ]
    );
    for jobs in [1, 2, 3, 8] {
        assert!(made(jobs) == first, "{jobs} jobs wrote other bytes");
    }
}

#[test]
fn an_interrupted_experiment_goes_on_where_it_was() {
    let folder = tempfile::tempdir().unwrap();
    let whole = Options {
        ensemble: 2,
        noise: 1e-4,
        ..options(folder.path(), &[])
    };
    run_with(&whole).unwrap();
    let without_times = || {
        let mut files = files(folder.path());
        files.retain(|name, _| !["timings.csv", "report.html"].contains(&name.as_str()));
        files
    };
    let first = without_times();

    let resumed = |text: &str, options: &Options| {
        let events = Mutex::new((Vec::new(), Vec::new()));
        let scenario = Scenario::parse(text, "small", "small.toml").unwrap();
        let result = experiment(&scenario, &Expected::default(), options, &|event| {
            let mut events = events.lock().unwrap();
            match event {
                Event::Reused { fold } => events.0.push(fold.to_string()),
                Event::Started { fold, .. } => events.1.push(fold.to_string()),
                _ => {}
            }
            ControlFlow::Continue(())
        });
        (result.unwrap(), events.into_inner().unwrap())
    };
    let again = Options {
        resume: true,
        ..whole.clone()
    };
    let (_, (reused, run)) = resumed(SMALL, &again);
    // What failed fails again.
    assert_eq!(reused.len(), 6, "{reused:?}");
    assert!(
        run.iter().all(|fold| fold.starts_with("misses ")),
        "{run:?}"
    );
    assert!(without_times() == first, "resumed runs leave other bytes");

    // What is missing, damaged or of other inputs is run.
    let published = folder.path().join("published");
    std::fs::remove_file(published.join("one.npz")).unwrap();
    std::fs::write(published.join("members/two.1.npz"), "cut short").unwrap();
    let (_, (_, run)) = resumed(SMALL, &again);
    let run: Vec<&String> = run
        .iter()
        .filter(|fold| !fold.starts_with("misses "))
        .collect();
    assert_eq!(run, ["one published", "two published #1"]);
    assert!(without_times() == first, "mended runs leave other bytes");
    let noisier = Options {
        noise: 2e-4,
        ..again.clone()
    };
    let (_, (reused, _)) = resumed(SMALL, &noisier);
    assert_eq!(reused, ["one published", "two published"]);
    let slippery = SMALL.replace("friction_table = 0.2", "friction_table = 0.1");
    let (_, (reused, _)) = resumed(&slippery, &again);
    assert!(reused.is_empty(), "{reused:?}");
}

#[test]
fn an_ensemble_is_measured_against_the_unperturbed_reference() {
    let folder = tempfile::tempdir().unwrap();
    let run = |cases: &[&str], ensemble, noise| {
        let options = Options {
            jobs: 2,
            ensemble,
            noise,
            ..options(folder.path(), cases)
        };
        run_with(&options).unwrap().rows
    };
    let rows = run(&[], 5, 1e-4);
    let ensemble = rows[0].0.ensemble().unwrap();
    assert_eq!((ensemble.errors.len(), ensemble.failures), (5, 0));
    let [min, max] = ensemble.range().unwrap();
    let median = ensemble.median().unwrap();
    assert!(min < median && median < max, "{:?}", ensemble.errors);
    // A tenth of a millimetre of noise shows, but it is the same fold.
    let error = rows[0].0.outcome.as_ref().unwrap().error.unwrap();
    assert!((median - error).abs() < 0.02, "{median} instead of {error}");
    let table = std::fs::read_to_string(folder.path().join("table.csv")).unwrap();
    assert!(
        table.contains(&format!(",5,{median},{min},{max},0,")),
        "{table}"
    );

    // A case that fails has no ensemble, and none is asked for with zero members.
    assert!(rows[2].0.ensemble().is_none());
    assert!(run(&["two"], 0, 1e-4)[0].0.ensemble().is_none());
    // The starts belong to the case and the member: fewer cases or members are the same folds.
    let fewer = run(&["one"], 5, 1e-4);
    assert_eq!(fewer[0].0.ensemble(), Some(ensemble));
    let first = run(&["one"], 1, 1e-4)[0].0.ensemble().unwrap().errors[0];
    assert!(ensemble.errors.contains(&first));
    // Less noise, less spread.
    let [low, high] = run(&["one"], 5, 1e-7)[0]
        .0
        .ensemble()
        .unwrap()
        .range()
        .unwrap();
    assert!(high - low < max - min);
}

#[test]
fn the_solvers_of_a_case_are_rows_one_after_the_other() {
    let folder = tempfile::tempdir().unwrap();
    let options = Options {
        solvers: vec![Solver::Published, Solver::Default],
        ..options(folder.path(), &["one"])
    };
    let scenario = Scenario::parse(SMALL, "small", "small.toml").unwrap();
    let expected = Expected {
        source: "a book".to_owned(),
        error: [("one".to_owned(), 0.5)].into(),
    };
    let go_on = |_: Event<'_>| ControlFlow::Continue(());
    let result = experiment(&scenario, &expected, &options, &go_on).unwrap();
    let rows: Vec<_> = result.rows.iter().map(|(row, _)| row).collect();
    let names: Vec<_> = rows
        .iter()
        .map(|row| (row.case.as_str(), row.solver))
        .collect();
    assert_eq!(
        names,
        [
            ("one", Solver::Published),
            ("one", Solver::Default),
            ("two", Solver::Published),
            ("two", Solver::Default),
        ]
    );
    // What the paper prints is compared with its own scheme only.
    assert_eq!((rows[0].published, rows[1].published), (Some(0.5), None));
    assert!(rows[0].difference().is_some() && rows[1].difference().is_none());

    let table = std::fs::read_to_string(folder.path().join("table.csv")).unwrap();
    let starts: Vec<String> = table
        .lines()
        .map(|line| line.splitn(3, ',').take(2).collect::<Vec<_>>().join(","))
        .collect();
    assert_eq!(
        starts,
        [
            "case,solver",
            "one,published",
            "one,default",
            "two,published",
            "two,default"
        ]
    );
    // For people a line a case, both solvers in it.
    let table = std::fs::read_to_string(folder.path().join("table.md")).unwrap();
    let lines: Vec<&str> = table.lines().filter(|line| line.starts_with('|')).collect();
    assert_eq!(lines.len(), 4, "{table}");
    let header: Vec<&str> = lines[0].split('|').map(str::trim).collect();
    assert_eq!(
        header[1..10],
        [
            "Case",
            "Support",
            "Volume",
            "Orientation",
            "Paper",
            "Published",
            "Published - paper",
            "Default",
            "Published: strain",
        ]
    );
    let curves = std::fs::read_to_string(folder.path().join("curves.csv")).unwrap();
    assert!(
        curves.starts_with("t,one published,two published"),
        "{curves}"
    );
}

#[test]
fn a_recording_says_what_its_solver_was_told_and_no_more() {
    let scenario = Scenario::parse(SMALL, "small", "small.toml").unwrap();
    let folder = tempfile::tempdir().unwrap();
    run_to(folder.path(), &["two"]).unwrap();
    let recording = Recording::read(folder.path().join("published/two.npz")).unwrap();
    let meta: serde_json::Value = serde_json::from_str(recording.meta()).unwrap();
    let case = scenario.case("two").unwrap();
    assert_eq!(meta["solver"], "published");
    assert_eq!(meta["input_sha256"], case.input_hash(Solver::Published));
    assert_eq!(meta["settings"]["substeps"], 6);
    assert_eq!(meta["material"]["bending"], 2.5e-5);
    assert!(meta["material"].get("shear").is_none());
}

#[test]
fn a_case_that_grasps_nothing_is_a_row_with_its_reason() {
    let folder = tempfile::tempdir().unwrap();
    let result = run_to(folder.path(), &[]).unwrap();
    assert!(!result.complete());
    let outcome = |k: usize| &result.rows[k].0.outcome;
    assert_eq!(outcome(0).as_ref().unwrap().support, [47, 48, 54, 55]);
    assert!(outcome(1).is_ok());
    let reason = outcome(2).as_ref().unwrap_err();
    assert!(
        reason.contains("closes on nothing at t = 0.1 s"),
        "{reason}"
    );
    assert!(reason.contains("is 55, 0.0500 m away"), "{reason}");
    let table = std::fs::read_to_string(folder.path().join("table.csv")).unwrap();
    assert!(table.contains("closes on nothing"), "{table}");
}

/// The small scenario with other text.
fn run_text(text: &str, out: &Path, cases: &[&str]) -> Result<Experiment, Error> {
    let scenario = Scenario::parse(text, "small", "small.toml")?;
    experiment(
        &scenario,
        &Expected::default(),
        &options(out, cases),
        &|_| ControlFlow::Continue(()),
    )
}

#[test]
fn a_case_whose_reference_failed_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let text = SMALL.replace("reference = \"two\"", "reference = \"misses\"");
    let result = run_text(&text, folder.path(), &["one"]).unwrap();
    assert_eq!(
        result.rows[0].0.failure().unwrap(),
        "its reference misses failed"
    );
    let table = std::fs::read_to_string(folder.path().join("table.csv")).unwrap();
    assert!(table.contains("its reference misses failed"), "{table}");
}

#[test]
fn references_of_references_run_too() {
    let folder = tempfile::tempdir().unwrap();
    // one -> two -> misses, and back to one.
    let text = SMALL
        .replace("name = \"two\"", "name = \"two\"\nreference = \"misses\"")
        .replace(
            "name = \"misses\"",
            "name = \"misses\"\nreference = \"one\"",
        );
    let result = run_text(&text, folder.path(), &["one"]).unwrap();
    assert_eq!(result.rows.len(), 3);
}

#[test]
fn nothing_of_an_earlier_run_stays() {
    let folder = tempfile::tempdir().unwrap();
    run_to(folder.path(), &["two"]).unwrap();
    assert!(files(folder.path()).contains_key("published/two.npz"));
    // The same cases, but the grippers close 5 cm above the sheet.
    let text = SMALL.replace(
        "start_offset_m = [0.0, 0.0, 0.01]",
        "start_offset_m = [0.0, 0.0, 0.06]",
    );
    run_text(&text, folder.path(), &["two"]).unwrap();
    let files = files(folder.path());
    assert!(
        files.keys().all(|name| !name.starts_with("published/")),
        "{:?}",
        files.keys()
    );
}

#[test]
fn a_gripper_that_comes_too_late_is_told() {
    let folder = tempfile::tempdir().unwrap();
    // Both grippers at the same corner: a box and a pyramid around node 55.
    let text = SMALL.replace("start_node = 49", "start_node = 55");
    let result = run_text(&text, folder.path(), &["two"]).unwrap();
    let reason = result.rows[0].0.failure().unwrap();
    assert!(reason.contains("gripper 2 closes at t = 0.1 s on nodes that another gripper holds"));
}

#[test]
fn a_lag_behind_the_targets_is_measured_against_what_was_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    // 0.14 m in 0.1 s is faster than the move limit of the published scheme.
    let text = SMALL.replace("open_s = 0.6", "open_s = 0.3");
    let result = run_text(&text, folder.path(), &["one"]).unwrap();
    let lag = result.rows[0].0.outcome.as_ref().unwrap().worst.held_error;
    assert!(lag > 0.05, "{lag}");
}

#[test]
fn a_reference_runs_with_its_case_and_only_then() {
    let folder = tempfile::tempdir().unwrap();
    let names = |cases: &[&str]| {
        let result = run_to(folder.path(), cases).unwrap();
        result
            .rows
            .into_iter()
            .map(|(row, _)| row.case)
            .collect::<Vec<_>>()
    };
    assert_eq!(names(&["one"]), ["one", "two"]);
    assert_eq!(names(&["two"]), ["two"]);
    let error = run_to(folder.path(), &["three"]).unwrap_err().to_string();
    assert_eq!(
        error,
        "case three is not in small, which has one, two, misses"
    );
}

#[test]
fn two_grippers_are_recorded_side_by_side() {
    let folder = tempfile::tempdir().unwrap();
    run_to(folder.path(), &["two"]).unwrap();
    let recording = Recording::read(folder.path().join("published/two.npz")).unwrap();
    assert_eq!(
        (recording.frame_count(), recording.gripper_count()),
        (42, 2)
    );
    // Closed from step 5 (row 6) to step 29 (row 30), each node with the number of its gripper.
    assert!(recording.grasped(5).iter().all(|&holder| holder == 0));
    for row in [6, 30] {
        let held = |number| {
            (0..56)
                .filter(|&k| recording.grasped(row)[k] == number)
                .collect::<Vec<_>>()
        };
        assert_eq!(held(1), [47, 48, 54, 55]);
        assert_eq!(held(2), [42, 43, 49, 50]);
    }
    assert!(recording.grasped(31).iter().all(|&holder| holder == 0));
    assert_eq!(recording.grippers(6)[0].alpha, 0.25);
    assert_eq!(recording.grippers(9)[1].alpha, 1.0);
}

#[test]
fn stopping_leaves_whole_files_only() {
    let scenario = Scenario::parse(SMALL, "small", "small.toml").unwrap();
    let folder = tempfile::tempdir().unwrap();
    let options = options(folder.path(), &[]);
    let stop_in_the_second = |event: Event<'_>| match event {
        Event::Step {
            fold: FoldName { case: "two", .. },
            step: 20,
        } => ControlFlow::Break(()),
        _ => ControlFlow::Continue(()),
    };
    let result = experiment(
        &scenario,
        &Expected::default(),
        &options,
        &stop_in_the_second,
    );
    assert!(matches!(result, Err(Error::Stopped)));
    let files = files(folder.path());
    assert!(files.contains_key("published/one.npz"));
    assert!(!files.contains_key("published/two.npz") && !files.contains_key("table.csv"));
    assert!(files.keys().all(|name| !name.contains("tmp")));
}

#[test]
fn a_folder_that_cannot_be_made_is_named_before_anything_runs() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "in the way").unwrap();
    let error = run_to(&file.join("out"), &[]).unwrap_err();
    assert!(matches!(error, Error::File { .. }));
    assert!(error.to_string().contains("file/out/published"), "{error}");
    assert_eq!(std::fs::read(&file).unwrap(), b"in the way");
}
