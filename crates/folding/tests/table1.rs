//! The paper's table, from the scenario file to the written files.
//!
//! The printed errors have eight decimals; `fixtures/published` holds further measurements of the
//! original: held nodes, `E(t)` at every tenth frame and the last frame of each case.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use std::fs::File;
use std::io::Read;
use std::ops::ControlFlow;
use std::path::Path;

use selvedge_folding::{Expected, Options, Scenario, Solver, experiment};
use selvedge_view::Recording;

/// Two implementations that differ in the order of their sums stay within 2e-9 m of each other.
const POSITION_TOLERANCE: f64 = 1e-8;

fn fixture(name: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../fixtures")
        .join(name)
}

/// `positions` (8, 644, 3) of the last frame of C1 to C8, flat.
fn published_ends() -> Vec<f64> {
    let file = File::open(fixture("published/final_positions.npz")).unwrap();
    let mut archive = zip::ZipArchive::new(file).unwrap();
    let mut bytes = Vec::new();
    archive
        .by_name("positions.npy")
        .unwrap()
        .read_to_end(&mut bytes)
        .unwrap();
    npyz::NpyFile::new(&bytes[..]).unwrap().into_vec().unwrap()
}

#[test]
fn all_eight_cases_agree_with_the_paper() {
    let path = fixture("scenarios/corner_fold.toml");
    let scenario = Scenario::load(&path).unwrap();
    let expected = Expected::beside(&scenario, &path).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let options = Options {
        cases: Vec::new(),
        solvers: vec![Solver::Published],
        out: folder.path().to_owned(),
        jobs: 2,
        ensemble: 0,
        noise: 0.0,
        resume: false,
        exports: Vec::new(),
        command: String::new(),
        tables: Vec::new(),
    };
    let result = experiment(&scenario, &expected, &options, &|_| {
        ControlFlow::Continue(())
    })
    .unwrap();
    assert!(result.complete());
    assert_eq!(result.rows.len(), 8);

    let text = std::fs::read_to_string(fixture("published/table1.json")).unwrap();
    let published: serde_json::Value = serde_json::from_str(&text).unwrap();
    let ends = published_ends();
    let mut curves = csv::Reader::from_path(folder.path().join("curves.csv")).unwrap();
    let curves: Vec<csv::StringRecord> = curves.records().map(Result::unwrap).collect();
    for (number, (row, _)) in result.rows.iter().enumerate() {
        let case = &published["cases"][number];
        assert_eq!(case["case"], row.case.as_str());
        let measured = row.outcome.as_ref().unwrap();

        // The printed error, to half of its last digit
        let error = measured.error.unwrap();
        assert!(
            (error - row.published.unwrap()).abs() <= 0.5e-8,
            "{}: {error}",
            row.case
        );

        let support: Vec<u32> = serde_json::from_value(case["grasped"].clone()).unwrap();
        assert_eq!(measured.support, support);
        assert_eq!(measured.worst.unconverged_steps, 0);

        // E(t): published frame f is row f + 1
        let samples: Vec<f64> =
            serde_json::from_value(case["error_every_10_frames"].clone()).unwrap();
        assert_eq!(samples.len(), 67);
        for (k, sample) in samples.iter().enumerate() {
            let ours: f64 = curves[10 * k + 1][number + 1].parse().unwrap();
            assert!(
                (ours - sample).abs() < 1e-8,
                "{} frame {}: {ours}",
                row.case,
                10 * k
            );
        }

        let file = folder.path().join(format!("published/{}.npz", row.case));
        let recording = Recording::read(file).unwrap();
        assert_eq!(recording.frame_count(), 662);
        let end = recording.positions(661).iter().flat_map(|p| p.to_array());
        let off = end
            .zip(&ends[number * 644 * 3..])
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(off < POSITION_TOLERANCE, "{}: off by {off:e} m", row.case);
    }
}
