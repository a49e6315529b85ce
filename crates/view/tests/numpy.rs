//! What numpy makes of a recording, and a recording of what numpy writes. Skipped by name where
//! there is no Python with numpy: the program in `SELVEDGE_PYTHON`, else `python3`.

use std::ffi::OsString;
use std::path::Path;
use std::process::{Command as Process, Output};

use selvedge_math::{Command, DQuat, DVec3, Jaw, Pose};
use selvedge_view::{GripperState, Recording, Rest, Sheet};

/// The output of a Python program, or nothing when there is no numpy.
fn python(test: &str, program: &str, arguments: &[&Path]) -> Option<Output> {
    let python = std::env::var_os("SELVEDGE_PYTHON").unwrap_or_else(|| OsString::from("python3"));
    let run = |program: &str| {
        let mut process = Process::new(&python);
        process.arg("-c").arg(program).args(arguments).output()
    };
    match run("import numpy") {
        Ok(output) if output.status.success() => {}
        Ok(_) => {
            eprintln!("{test}: skipped, {} has no numpy", python.display());
            return None;
        }
        Err(error) => {
            eprintln!(
                "{test}: skipped, {} does not start: {error}",
                python.display()
            );
            return None;
        }
    }
    let output = run(program).expect("it started before");
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    Some(output)
}

fn recording(grippers: usize) -> Recording {
    let sheet = Sheet {
        quads: vec![[0, 1, 4, 3], [1, 2, 5, 4]],
        triangles: vec![],
        rest: Rest::Grid {
            nodes: [3, 2],
            sides: [0.42, 0.59],
        },
    };
    let meta = r#"{"case": "C4 ✓", "dt": 0.5}"#;
    let mut run = Recording::new(sheet, grippers, meta.into()).expect("a good sheet");
    for k in 0..4 {
        let t = f64::from(k);
        let positions: Vec<DVec3> = (0..6)
            .map(|i| DVec3::new(0.1 * f64::from(i), t / 3.0, -1e-300))
            .collect();
        let states: Vec<GripperState> = (0..grippers)
            .map(|g| GripperState {
                command: Command {
                    pose: Pose::new(DVec3::Z * t, DQuat::from_rotation_x(t + g as f64))
                        .expect("a rotation"),
                    jaw: if k > 1 { Jaw::Closed } else { Jaw::Open },
                },
                alpha: t / 10.0,
            })
            .collect();
        let grasped = [0, 0, 0, 0, 0, if k > 1 { grippers as u8 } else { 0 }];
        run.push(t / 60.0, &positions, &states, &grasped)
            .expect("good values");
    }
    run
}

#[test]
fn numpy_reads_what_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.npz");
    let program = r#"
import json, sys
import numpy as np
z = np.load(sys.argv[1])
for name in z.files:
    a = z[name]
    print(name, a.dtype.str, a.shape)
print(json.loads(bytes(z["meta"]))["case"] == "C4 \u2713")
print(" ".join(repr(float(x)) for name in ("t", "positions", "sides", "pose", "alpha") for x in z[name].flat))
print(" ".join(str(int(x)) for name in ("quads", "grid", "jaw", "grasped") for x in z[name].flat))
"#;
    for (grippers, jaw, pose) in [(1, "(4,)", "(4, 7)"), (2, "(4, 2)", "(4, 2, 7)")] {
        let run = recording(grippers);
        run.write(&path).unwrap();
        let Some(output) = python("numpy_reads_what_is_written", program, &[&path]) else {
            return;
        };
        let text = String::from_utf8(output.stdout).unwrap();
        let (arrays, values) = text.split_once("True\n").unwrap();
        let meta = run.meta().len();
        assert_eq!(
            arrays,
            format!(
                "t <f8 (4,)\npositions <f8 (4, 6, 3)\nquads <u4 (2, 4)\ngrid <u4 (2,)\n\
                 sides <f8 (2,)\njaw |u1 {jaw}\npose <f8 {pose}\ngrasped |u1 (4, 6)\n\
                 alpha <f8 {jaw}\nmeta |u1 ({meta},)\n"
            )
        );
        let (reals, integers) = values.split_once('\n').unwrap();
        let frames = || 0..run.frame_count();
        let states = || frames().flat_map(|k| run.grippers(k));
        let positions = frames()
            .flat_map(|k| run.positions(k))
            .flat_map(DVec3::to_array);
        let poses = states().flat_map(|state| {
            let (p, q) = (state.command.pose.position(), state.command.pose.rotation());
            [p.to_array().to_vec(), q.to_array().to_vec()].concat()
        });
        let expected: Vec<f64> = (run.times().iter().copied())
            .chain(positions)
            .chain([0.42, 0.59])
            .chain(poses)
            .chain(states().map(|state| state.alpha))
            .collect();
        let got: Vec<f64> = reals.split(' ').map(|x| x.parse().unwrap()).collect();
        assert_eq!(got, expected);
        let expected: Vec<u32> = (run.sheet().quads.iter().flatten().copied())
            .chain([3, 2])
            .chain(states().map(|state| state.command.jaw.is_closed().into()))
            .chain(
                frames()
                    .flat_map(|k| run.grasped(k))
                    .map(|&holder| holder.into()),
            )
            .collect();
        let got: Vec<u32> = integers
            .split_whitespace()
            .map(|n| n.parse().unwrap())
            .collect();
        assert_eq!(got, expected);
    }
}

#[test]
fn what_numpy_writes_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let (path, copy) = (
        folder.path().join("run.npz"),
        folder.path().join("copy.npz"),
    );
    for save in ["savez", "savez_compressed"] {
        let run = recording(1);
        run.write(&path).unwrap();
        let program =
            format!("import sys, numpy as np\nnp.{save}(sys.argv[2], **np.load(sys.argv[1]))");
        let Some(_) = python("what_numpy_writes_is_read", &program, &[&path, &copy]) else {
            return;
        };
        assert_eq!(Recording::read(&copy).unwrap(), run);
    }
}
