//! Scenario files that cannot be run, each with what its error must name.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use std::path::Path;

use selvedge_folding::{Scenario, Solver};

fn scenario_file(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures/scenarios");
    std::fs::read_to_string(folder.join(name)).unwrap()
}

/// The message for the paper's scenario with one text replaced by another.
fn refusal(old: &str, new: &str) -> String {
    let text = scenario_file("corner_fold.toml");
    assert!(text.contains(old), "{old:?} is not in the scenario");
    let changed = text.replacen(old, new, 1);
    let error = Scenario::parse(&changed, "corner_fold", "fold.toml").expect_err(new);
    let message = error.to_string();
    assert!(message.starts_with("fold.toml: "), "{message}");
    message
}

#[test]
fn the_kept_scenarios_load() {
    for name in ["corner_fold.toml", "franka_fold.toml"] {
        Scenario::parse(&scenario_file(name), "name", name).unwrap();
    }
    let scenario = Scenario::parse(&scenario_file("corner_fold.toml"), "name", "file").unwrap();
    assert_eq!(scenario.steps, 661);
    assert_eq!(
        (scenario.time(60), scenario.time(300), scenario.time(660)),
        (1.0, 5.0, 11.0)
    );
}

// (replaced, by, what the message names: key, value, bound)
const VALUES: &[(&str, &str, &[&str])] = &[
    ("schema = 1", "schema = 2", &["schema", "2", "1"]),
    (
        "sides_m = [0.42, 0.59]",
        "sides_m = [-0.42, 0.59]",
        &["cloth.sides_m", "-0.42", "above 0"],
    ),
    (
        "sides_m = [0.42, 0.59]",
        "sides_m = [420.0, 590.0]",
        &["cloth.sides_m", "420", "100"],
    ),
    (
        "sides_m = [0.42, 0.59]",
        "sides_m = [nan, 0.59]",
        &["cloth.sides_m", "NaN", "above 0"],
    ),
    (
        "nodes = [23, 28]",
        "nodes = [1, 28]",
        &["cloth.nodes", "[1, 28]", "at least 2"],
    ),
    (
        "nodes = [23, 28]",
        "nodes = [10000, 28000]",
        &["cloth.nodes", "28000", "100000"],
    ),
    (
        "friction_table = 0.2",
        "friction_table = -0.2",
        &["cloth.friction_table", "-0.2", "from 0"],
    ),
    (
        "bending_n_m = 2.5e-5",
        "bending_n_m = inf",
        &["cloth.bending_n_m", "inf", "from 0"],
    ),
    (
        "density_kg_per_m2 = 0.3046",
        "density_kg_per_m2 = 0",
        &["cloth.density_kg_per_m2", "0"],
    ),
    (
        "bending_n_m = 2.5e-5",
        "bending_n_m = 2.5e-5\nshear_n_per_m = -1.0",
        &["cloth.shear_n_per_m", "-1", "from 0"],
    ),
    (
        "bending_n_m = 2.5e-5",
        "bending_n_m = 2.5e-5\ninternal_damping_s = 2.0",
        &["cloth.internal_damping_s", "2", "from 0 to 1"],
    ),
    (
        "[solver.published]",
        "[solver.default]\nsubstep_s = 0.0\n[solver.published]",
        &["solver.default.substep_s", "0", "above 0 and at most 1"],
    ),
    (
        "[solver.published]",
        "[solver.default]\nsubstep_s = 1e-7\n[solver.published]",
        &[
            "solver.default.substep_s",
            "0.0000001",
            "at least frame_s / 10000",
        ],
    ),
    (
        "[solver.published]",
        "[solver.default]\ntolerance = nan\n[solver.published]",
        &["solver.default.tolerance", "NaN", "above 0 and at most 1"],
    ),
    (
        "[solver.published]",
        "[solver.default]\niterations = 0\n[solver.published]",
        &["solver.default.iterations", "0", "from 1 to 10000"],
    ),
    (
        "substeps = 6",
        "substeps = 0",
        &["solver.published", "substeps", "0", "from 1"],
    ),
    (
        "tolerance = 0.0075",
        "tolerance = 0.0",
        &["solver.published", "tolerance", "positive"],
    ),
    (
        "close_s = 1.0",
        "close_s = -1.0",
        &["time.close_s", "-1", "not before 0, the start"],
    ),
    (
        "move_s = 2.0",
        "move_s = 0.5",
        &["time.move_s", "0.5", "not before close_s (1 s)"],
    ),
    (
        "open_s = 5.0",
        "open_s = 2.0",
        &["time.open_s", "2", "after move_s"],
    ),
    (
        "end_s = 11.0",
        "end_s = inf",
        &["time.end_s", "inf", "finite"],
    ),
    (
        "end_s = 11.0",
        "end_s = 1e9",
        &["time.end_s", "1000000000", "steps"],
    ),
    (
        "frame_s = 0.016666666666666666",
        "frame_s = 0.0",
        &["time.frame_s", "0", "above 0"],
    ),
    (
        "mid_m = [0.21, 0.295, 0.18]",
        "mid_m = [0.21, 0.295, 180.0]",
        &["mid_m", "180", "metres"],
    ),
    (
        "mid_m = [0.21, 0.295, 0.18]",
        "mid_m = [0.21, nan, 0.18]",
        &["path.mid_m", "NaN", "finite"],
    ),
    (
        "end_m = [0.21, -0.295, 0.04]",
        "end_m = [0.21, -3.0, 0.04]",
        &["end_m", "-3", "diagonal"],
    ),
    (
        "amount = 0.5",
        "amount = 1.5",
        &["squeeze.amount", "1.5", "from 0 to 1"],
    ),
    (
        "lift_m = 2e-4",
        "lift_m = -1.0",
        &["squeeze.lift_m", "-1", "from 0"],
    ),
    (
        "steps = 10",
        "steps = 0",
        &["squeeze.steps", "0", "at least 1"],
    ),
    (
        "side_m = 0.03",
        "side_m = 0.0",
        &["C1", "volume", "side", "0", "positive"],
    ),
    (
        "height_m = -0.015",
        "height_m = 0.0",
        &["C1", "volume", "height", "0", "not zero"],
    ),
    (
        "[0.03, 0.03, 0.03]",
        "[0.03, 0.0, 0.03]",
        &["C2", "volume.size_m", "0", "positive"],
    ),
    (
        "start_node = 643",
        "start_node = 644",
        &["C1", "start_node", "644", "node count 644"],
    ),
    (
        "start_offset_m = [0.0, 0.0, 0.01]",
        "start_offset_m = [0.0, 0.0, 10.0]",
        &["C1", "start_offset_m", "10"],
    ),
    (
        "start_xyzw = [0.0, 0.0, -0.7071067811865475, 0.7071067811865476]",
        "start_xyzw = [0.0, 0.0, 0.0, 0.0]",
        &["C1", "start_xyzw", "0.0", "not zero"],
    ),
    (
        "reference = \"C8\"",
        "reference = \"C9\"",
        &["C1", "reference", "C9"],
    ),
    (
        "name = \"C2\"",
        "name = \"C1\"",
        &["case.name", "C1", "one case only"],
    ),
    (
        "name = \"C2\"",
        "name = \"../C2\"",
        &["case.name", "../C2", "letters"],
    ),
];

#[test]
fn a_value_out_of_bounds_is_named_with_its_key_and_bound() {
    for (old, new, words) in VALUES {
        let message = refusal(old, new);
        for word in *words {
            assert!(
                message.contains(word),
                "{new}: {word:?} is not in {message:?}"
            );
        }
    }
}

// (replaced, by, what the message names)
const KEYS: &[(&str, &str, &[&str])] = &[
    // A wrong unit is an unknown key.
    ("sides_m =", "sides_mm =", &["sides_mm", "sides_m", "line"]),
    ("lift_m = 2e-4", "lift_cm = 0.02", &["lift_cm", "lift_m"]),
    (
        "law = \"quintic\"",
        "law = \"septic\"",
        &["septic", "quintic"],
    ),
    (
        "type = \"pyramid\"",
        "type = \"sphere\"",
        &["sphere", "pyramid"],
    ),
    ("substeps = 6", "substeps = 6.5", &["6.5", "u32"]),
    (
        "[solver.published]",
        "[solver.default]\nsubsteps = 2\n[solver.published]",
        &["substeps", "substep_s"],
    ),
    (
        "[solver.published]",
        "[solver.default]\niterations = -2\n[solver.published]",
        &["-2", "u32"],
    ),
    (
        "[solver.published]",
        "[solver.fast]",
        &["fast", "default", "published"],
    ),
    ("substeps = 6", "substep = 6", &["substep", "substeps"]),
    ("close_s = 1.0\n", "", &["close_s", "missing"]),
    ("start_node = 643\n", "", &["case C1", "start_node"]),
    ("keep_x = true", "keep_x = 1", &["keep_x", "1"]),
    ("[time]", "[time", &["line"]),
];

#[test]
fn jaws_that_are_closed_in_no_step_are_refused() {
    let times = "close_s = 1.0\nmove_s = 2.0\nopen_s = 5.0";
    let message = refusal(times, "close_s = 1.001\nmove_s = 1.002\nopen_s = 1.01");
    for word in ["time.close_s", "1.001", "closed in at least one step"] {
        assert!(message.contains(word), "{message}");
    }
}

#[test]
fn borders_are_met_with_any_period() {
    let text = scenario_file("corner_fold.toml")
        .replace("frame_s = 0.016666666666666666", "frame_s = 0.03")
        .replace("close_s = 1.0", "close_s = 0.33");
    let scenario = Scenario::parse(&text, "name", "file").unwrap();
    // 11 * 0.03 is less than 0.33 by one digit.
    assert_eq!((scenario.time(10), scenario.time(11)), (10.0 * 0.03, 0.33));
    let jaw = |step| {
        scenario.cases[0].grippers[0]
            .commands
            .jaw(scenario.time(step))
    };
    assert!(!jaw(10).is_closed() && jaw(11).is_closed());
}

#[test]
fn an_unknown_missing_or_mistyped_key_is_named() {
    for (old, new, words) in KEYS {
        let message = refusal(old, new);
        for word in *words {
            assert!(
                message.contains(word),
                "{new}: {word:?} is not in {message:?}"
            );
        }
    }
}

#[test]
fn a_missing_file_is_named() {
    let error = Scenario::load("nowhere/fold.toml").unwrap_err().to_string();
    assert!(error.starts_with("nowhere/fold.toml: "), "{error}");
}

fn hash(text: &str, case: usize, solver: Solver) -> String {
    let scenario = Scenario::parse(text, "name", "file").unwrap();
    scenario.cases[case].input_hash(solver).to_owned()
}

#[test]
fn the_hash_follows_what_a_case_depends_on() {
    let text = scenario_file("corner_fold.toml");
    let commented = text.replace("schema = 1", "# a remark\nschema   = 1");
    let softer = text.replace("bending_n_m = 2.5e-5", "bending_n_m = 2.6e-5");
    let other_case = text.replacen("[0.0, 0.0, 0.01]", "[0.0, 0.0, 0.011]", 1);
    for solver in [Solver::Published, Solver::Default] {
        let hash = |text, case| hash(text, case, solver);
        assert_eq!(hash(&text, 0).len(), 64);
        assert_eq!(hash(&text, 0), hash(&commented, 0));
        assert_ne!(hash(&text, 0), hash(&text, 1));
        assert_ne!(hash(&text, 0), hash(&softer, 0));
        assert_ne!(hash(&text, 0), hash(&other_case, 0));
        assert_eq!(hash(&text, 1), hash(&other_case, 1));
    }
    let [published, default] =
        [Solver::Published, Solver::Default].map(|solver| hash(&text, 0, solver));
    assert_ne!(published, default);
}

#[test]
fn the_hash_of_a_solver_does_not_depend_on_the_other() {
    let text = scenario_file("corner_fold.toml");
    let with = |old: &str, new: &str| {
        assert!(text.contains(old));
        let changed = text.replacen(old, new, 1);
        [Solver::Published, Solver::Default]
            .map(|solver| hash(&changed, 0, solver) != hash(&text, 0, solver))
    };
    let solver = |line: &str| {
        let table = format!("[solver.default]\n{line}\n[solver.published]");
        with("[solver.published]", &table)
    };
    let cloth = |line: &str| with("[cloth]", &format!("[cloth]\n{line}"));
    assert_eq!(with("move_limit = 0.1", "move_limit = 0.2"), [true, false]);
    assert_eq!(solver("substep_s = 0.001"), [false, true]);
    assert_eq!(solver("tolerance = 2e-5"), [false, true]);
    assert_eq!(solver("iterations = 21"), [false, true]);
    assert_eq!(cloth("shear_n_per_m = 41.0"), [false, true]);
    assert_eq!(cloth("internal_damping_s = 0.0"), [false, true]);
    // What is left out has its default value.
    let material = selvedge_cloth::Material::default();
    let shear = format!("shear_n_per_m = {}", material.shear);
    assert_eq!(cloth(&shear), [false, false]);
    assert_eq!(solver(""), [false, false]);
}

#[test]
fn the_keys_of_the_default_solver_arrive_and_are_optional() {
    let text = scenario_file("corner_fold.toml");
    let scenario = Scenario::parse(&text, "name", "file").unwrap();
    assert_eq!(
        scenario.material.shear,
        selvedge_cloth::Material::default().shear
    );
    let standard = selvedge_cloth::Settings::default();
    assert_eq!(scenario.default.tolerance, standard.tolerance);
    assert_eq!(scenario.default.gravity, 9.8);

    let text = text
        .replace("[cloth]", "[cloth]\nshear_n_per_m = 12.0\ninternal_damping_s = 0.25")
        .replace("gravity_m_per_s2 = 9.8", "gravity_m_per_s2 = 1.6")
        .replace(
            "[solver.published]",
            "[solver.default]\nsubstep_s = 0.005\ntolerance = 1e-3\niterations = 7\n[solver.published]",
        );
    let scenario = Scenario::parse(&text, "name", "file").unwrap();
    let (material, settings) = (scenario.material, scenario.default);
    assert_eq!((material.shear, material.internal_damping), (12.0, 0.25));
    assert_eq!((settings.substep, settings.tolerance), (0.005, 1e-3));
    assert_eq!((settings.iterations, settings.gravity), (7, 1.6));
    assert_eq!(scenario.published.gravity, 1.6);
}

#[test]
fn a_step_is_cut_into_the_fewest_substeps_that_are_short_enough() {
    let text = scenario_file("corner_fold.toml");
    let mut scenario = Scenario::parse(&text, "name", "file").unwrap();
    assert_eq!(Solver::Published.substeps(&scenario), 6);
    let steps = [(1.0, 1), (1.0 / 60.0, 1), (1.0 / 120.0, 2), (0.005, 4)];
    for (substep, number) in steps {
        scenario.default.substep = substep;
        assert_eq!(Solver::Default.substeps(&scenario), number, "{substep}");
    }
}

#[test]
fn a_cloth_can_come_from_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fold.toml");
    let grid = scenario_file("corner_fold.toml");
    let lines = ["sides_m = [0.42, 0.59]", "nodes = [23, 28]"];
    assert!(lines.iter().all(|line| grid.contains(line)));
    let meshed = grid.replace(lines[0], "mesh = \"sheets/half.obj\"");
    let meshed = meshed.replacen(lines[1], "", 1);
    let refused = |text: &str| {
        std::fs::write(&path, text).unwrap();
        Scenario::load(&path).unwrap_err().to_string()
    };

    // What cannot be used is told, with the file, the key and the reason.
    let message = refused(&meshed);
    assert!(
        message.contains("fold.toml: cloth.mesh = \"sheets/half.obj\""),
        "{message}"
    );
    assert!(
        message.contains("sheets/half.obj: No such file"),
        "{message}"
    );
    let sheets = folder.path().join("sheets");
    std::fs::create_dir(&sheets).unwrap();
    let obj = sheets.join("half.obj");
    for (text, word) in [
        ("v 0 0 0\nv 1 0 zero\n", "half.obj"),
        ("v 0 0 0\nv 1 0 -1e-6\nv 0 1 0\nf 1 2 3\n", "node 1"),
        ("v 500 0 0\nv 501 0 0\nv 500 1 0\nf 1 2 3\n", "within 100 m"),
    ] {
        std::fs::write(&obj, text).unwrap();
        let message = refused(&meshed);
        assert!(
            message.contains("cloth.mesh") && message.contains(word),
            "{message}"
        );
    }
    let both = grid.replace(
        lines[0],
        "sides_m = [0.42, 0.59]\nmesh = \"sheets/half.obj\"",
    );
    assert!(refused(&both).contains("sides_m and nodes"));
    let neither = grid.replacen(lines[1], "", 1);
    assert!(refused(&neither).contains("cloth.nodes"));

    // The same sheet cut into triangles: node numbers and cases stay.
    let mesh = selvedge_cloth::Mesh::grid([23, 28], [0.42, 0.59]).unwrap();
    let mut text = String::from("# metres\n");
    for p in mesh.rest() {
        text += &format!("v {} {} {}\n", p.x, p.y, p.z);
    }
    for [a, b, c, d] in mesh.quads().iter().map(|quad| quad.map(|node| node + 1)) {
        text += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
    }
    std::fs::write(&obj, &text).unwrap();
    std::fs::write(&path, &meshed).unwrap();
    let scenario = Scenario::load(&path).unwrap();
    assert_eq!(scenario.mesh.node_count(), 644);
    assert_eq!(scenario.mesh.triangles().len(), 2 * 594);
    let case = &scenario.cases[0];
    let run = |steps| {
        selvedge_folding::run(&scenario, case, Solver::Default, |step| {
            match step < steps {
                true => std::ops::ControlFlow::Continue(()),
                false => std::ops::ControlFlow::Break(()),
            }
        })
    };
    // It closes on a node in step 60, or this would be another error.
    assert!(matches!(run(62), Err(selvedge_folding::Error::Stopped)));
    let error = selvedge_folding::run(&scenario, case, Solver::Published, |_| {
        std::ops::ControlFlow::Continue(())
    });
    assert!(error.is_err_and(|error| error.to_string().contains("the published scheme")));

    // A run depends on the content of the file, not on where it is.
    let hash = scenario.cases[0].input_hash(Solver::Default).to_owned();
    std::fs::write(&obj, text.replace("# metres", "# m")).unwrap();
    let changed = Scenario::load(&path).unwrap();
    assert_ne!(changed.cases[0].input_hash(Solver::Default), hash);
}
