//! Folds that an earlier, interrupted experiment finished.
//!
//! What of a run its frames do not tell stands in the description of its recording, `meta`, as
//! `outcome`; of a member of an ensemble there is the last frame only. Either is taken again when the
//! hash of its inputs, the version and, of a member, the noise are the same.

use std::path::{Path, PathBuf};

use selvedge_grasp::{Overstretch, Rules};
use selvedge_math::DVec3;
use selvedge_view::{Recording, Sheet};
use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::{Case, Error, Run, Solver, Worst};

#[derive(Deserialize)]
struct Outcome {
    /// Node and rules (node, edge, face) of each gripper.
    support: Vec<Vec<(u32, [bool; 3])>>,
    worst: Worst,
    refused: Vec<u32>,
    /// Nodes, distance and bound.
    overstretch: Option<([u32; 2], f64, f64)>,
}

/// A run's outcome for `meta`.
pub(crate) fn outcome(run: &Run) -> Value {
    let gripper = |held: &Vec<(u32, Rules)>| -> Vec<(u32, [bool; 3])> {
        let flags = |rules: &Rules| [rules.node, rules.edge, rules.face];
        held.iter()
            .map(|(node, rules)| (*node, flags(rules)))
            .collect()
    };
    json!({
        "support": run.support.iter().map(gripper).collect::<Vec<_>>(),
        "worst": run.worst,
        "refused": run.refused,
        "overstretch": run.overstretch.map(|o| (o.nodes, o.distance, o.bound)),
    })
}

/// The run that a file holds, if it is there, whole, and of these inputs.
pub(crate) fn finished_run(path: &Path, case: &Case, solver: Solver) -> Option<Run> {
    let recording = Recording::read(path).ok()?;
    let mut meta: Map<String, Value> = serde_json::from_str(recording.meta()).ok()?;
    if !same_inputs(&meta, case, solver) {
        return None;
    }
    let outcome: Outcome = serde_json::from_value(meta.remove("outcome")?).ok()?;
    let rules = |[node, edge, face]: [bool; 3]| Rules { node, edge, face };
    let gripper = |held: Vec<(u32, [bool; 3])>| held.into_iter().map(|(k, r)| (k, rules(r)));
    let support = outcome
        .support
        .into_iter()
        .map(|held| gripper(held).collect());
    let overstretch = outcome
        .overstretch
        .map(|(nodes, distance, bound)| Overstretch {
            nodes,
            distance,
            bound,
        });
    Some(Run {
        recording,
        support: support.collect(),
        worst: outcome.worst,
        refused: outcome.refused,
        overstretch,
        timing: None,
    })
}

fn same_inputs(meta: &Map<String, Value>, case: &Case, solver: Solver) -> bool {
    meta.get("input_sha256") == Some(&json!(case.input_hash(solver)))
        && meta.get("version") == Some(&json!(env!("CARGO_PKG_VERSION")))
}

/// Where the end of a member of an ensemble is kept.
pub(crate) fn member_path(folder: &Path, case: &Case, member: usize) -> PathBuf {
    folder
        .join("members")
        .join(format!("{}.{member}.npz", case.name))
}

/// The end of a member, if it is there, whole, and of these inputs and this noise.
pub(crate) fn finished_member(
    path: &Path,
    case: &Case,
    solver: Solver,
    noise: f64,
) -> Option<Vec<DVec3>> {
    let recording = Recording::read(path).ok()?;
    let meta: Map<String, Value> = serde_json::from_str(recording.meta()).ok()?;
    let same = same_inputs(&meta, case, solver) && meta.get("noise_m") == Some(&json!(noise));
    same.then(|| recording.positions(0).to_vec())
}

/// Keeps the end of a member at `time`.
pub(crate) fn write_member(
    path: &Path,
    sheet: Sheet,
    (case, solver, member): (&Case, Solver, usize),
    noise: f64,
    time: f64,
    end: &[DVec3],
) -> Result<(), Error> {
    let meta = json!({
        "case": case.name,
        "solver": solver,
        "member": member,
        "noise_m": noise,
        "version": env!("CARGO_PKG_VERSION"),
        "input_sha256": case.input_hash(solver),
    });
    let mut recording = Recording::new(sheet, 0, meta.to_string())?;
    recording.push(time, end, &[], &vec![0; end.len()])?;
    Ok(recording.write(path)?)
}
