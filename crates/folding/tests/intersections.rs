//! The eight folds of the default solver, looked at by somebody else's program: the IPC Toolkit finds
//! no triangle that another one cuts, in any frame. Skipped by name where there is no Python with
//! `ipctk`: the program in `SELVEDGE_PYTHON`, else `python3`.

#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use std::ffi::OsString;
use std::ops::ControlFlow;
use std::path::Path;
use std::process::Command;

use selvedge_folding::{Scenario, Solver, run};

const PROGRAM: &str = r"
import sys
import ipctk, numpy
for path in sys.argv[1:]:
    run = numpy.load(path)
    quads = run['quads'].astype(numpy.int32)
    faces = numpy.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    positions = run['positions']
    mesh = ipctk.CollisionMesh(positions[0], ipctk.edges(faces), faces)
    cut = [k for k, x in enumerate(positions) if ipctk.has_intersections(mesh, x)]
    print(path, len(positions), 'frames')
    assert not cut, f'{path}: intersections in frames {cut}'
    # The test itself can fail: two layers exchanged cut the rest of the sheet.
    wrong = positions[-1].copy()
    wrong[: len(wrong) // 2, 2] += 0.003
    assert ipctk.has_intersections(mesh, wrong), 'no intersection seen in a wrong state'
";

#[test]
fn no_face_cuts_another_in_any_frame() {
    let python = std::env::var_os("SELVEDGE_PYTHON").unwrap_or_else(|| OsString::from("python3"));
    let import = Command::new(&python)
        .args(["-c", "import ipctk, numpy"])
        .output();
    if !import.is_ok_and(|output| output.status.success()) {
        eprintln!(
            "no_face_cuts_another_in_any_frame: skipped, {} has no ipctk",
            python.display()
        );
        return;
    }
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fixtures");
    let scenario = Scenario::load(fixtures.join("scenarios/corner_fold.toml")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let mut files = Vec::new();
    for case in &scenario.cases {
        let result = run(&scenario, case, Solver::Default, |_| {
            ControlFlow::Continue(())
        })
        .unwrap();
        let worst = &result.worst;
        assert!(
            worst.strain <= 1e-3 && worst.strain_rms <= 1e-4,
            "{}: {worst:?}",
            case.name
        );
        assert_eq!(worst.unconverged_steps, 0, "{}", case.name);
        let file = folder.path().join(format!("{}.npz", case.name));
        result.recording.write(&file).unwrap();
        files.push(file);
    }
    let output = Command::new(&python)
        .args(["-c", PROGRAM])
        .args(files)
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
}
