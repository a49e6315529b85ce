//! A case from start to end, every step recorded.

use std::ops::ControlFlow;

use selvedge_grasp::{Event, Guard, Overstretch, Rules};
use selvedge_math::{ClothSimulator, Command};
use selvedge_view::{GripperState, Recording, Rest, Sheet};

use crate::fold::{Fold, view};
use crate::resume::outcome;
use crate::timing::time_gripper;
use crate::worst::{Watch, Worst};
use crate::{Case, Error, Scenario, Solver, Timing};

/// Held nodes may be commanded so many times their rest distance apart before it is told.
const SLACK: f64 = 1.01;

/// A finished run of one case.
#[derive(Clone, Debug)]
pub struct Run {
    /// Every step, from the start at rest.
    pub recording: Recording,
    /// What each gripper held, and through which rules, when it last closed.
    pub support: Vec<Vec<(u32, Rules)>>,
    /// How far it strayed from an ideal cloth.
    pub worst: Worst,
    /// Nodes that a gripper closed on while another one held them, ascending.
    pub refused: Vec<u32>,
    /// The first two held nodes that were commanded further apart than the cloth is long, if any.
    pub overstretch: Option<Overstretch>,
    /// Where the time went; none of a run that was read from its file.
    pub timing: Option<Timing>,
}

/// Runs a case from the cloth at rest.
///
/// `observe` is called after each step with its number from 0, and can stop the run.
///
/// # Errors
/// [`Error::Empty`] when jaws close on nothing, [`Error::Gripper`], [`Error::Simulator`],
/// [`Error::View`] when a frame cannot be recorded, [`Error::Stopped`].
pub fn run(
    scenario: &Scenario,
    case: &Case,
    solver: Solver,
    observe: impl FnMut(usize) -> ControlFlow<()>,
) -> Result<Run, Error> {
    let fold = Fold::new(scenario, case, solver)?;
    let mut run = record(scenario, case, fold, solver.substeps(scenario), observe)?;
    let meta = meta(scenario, case, solver, outcome(&run));
    run.recording.set_meta(meta)?;
    Ok(run)
}

/// Runs a case on a simulator from elsewhere, which holds the scenario's cloth at rest; `name` is what
/// the recording calls it. The loop, the recording and the measures are those of [`run`].
///
/// # Errors
/// As [`run`].
pub fn run_on(
    scenario: &Scenario,
    case: &Case,
    name: &str,
    cloth: Box<dyn ClothSimulator + Send>,
    observe: impl FnMut(usize) -> ControlFlow<()>,
) -> Result<Run, Error> {
    let fold = Fold::on(scenario, case, cloth);
    let mut run = record(scenario, case, fold, 1, observe)?;
    let meta = serde_json::json!({
        "scenario": scenario.name,
        "case": case.name,
        "solver": name,
        "version": env!("CARGO_PKG_VERSION"),
        "dt": scenario.frame,
        "material": scenario.material,
        "grippers": case.volumes(),
        "outcome": outcome(&run),
    });
    run.recording.set_meta(meta.to_string())?;
    Ok(run)
}

/// The loop: steps, measures, frames. The recording has no description yet.
fn record(
    scenario: &Scenario,
    case: &Case,
    mut fold: Fold<'_>,
    substeps: u32,
    mut observe: impl FnMut(usize) -> ControlFlow<()>,
) -> Result<Run, Error> {
    let mesh = &scenario.mesh;
    let mut guard = Guard::new(view(scenario, mesh.rest()), SLACK)
        .map_err(|reason| Error::Gripper { time: 0.0, reason })?;
    let mut watch = Watch::new(mesh);
    let mut support = vec![Vec::new(); case.grippers.len()];
    let (mut refused, mut overstretch) = (Vec::new(), None);

    let mut recording = Recording::new(sheet(scenario), case.grippers.len(), "{}".into())?;
    let mut holder = vec![0u8; mesh.node_count()];
    let mut states: Vec<GripperState> = Vec::with_capacity(case.grippers.len());
    let open = |command: &Command| GripperState {
        command: Command {
            jaw: Default::default(),
            ..*command
        },
        alpha: 0.0,
    };
    states.extend(fold.commands.iter().map(open));
    recording.push(0.0, fold.cloth.positions(), &states, &holder)?;

    for step in 0..scenario.steps {
        let time = scenario.time(step);
        let report = fold.step(step)?;
        let (positions, held) = (fold.cloth.positions(), fold.grippers.held());
        watch.see(mesh, time, positions, held, &report);
        let over = guard
            .check(held)
            .map_err(|reason| Error::Gripper { time, reason })?;
        overstretch = overstretch.or(over.first().copied());

        holder.fill(0);
        states.clear();
        let grippers = fold.grippers.grippers().iter().zip(&fold.commands);
        for (number, (gripper, command)) in grippers.enumerate() {
            if gripper.event() == Event::Captured {
                let nodes = gripper.nodes().iter().copied();
                support[number] = nodes.zip(gripper.rules().iter().copied()).collect();
                refused.extend(gripper.refused());
            }
            for &node in gripper.nodes() {
                holder[node as usize] = number as u8 + 1;
            }
            states.push(GripperState {
                command: *command,
                alpha: gripper.alpha(),
            });
        }
        recording.push(scenario.time(step + 1), positions, &states, &holder)?;
        if observe(step).is_break() {
            return Err(Error::Stopped);
        }
    }
    refused.sort_unstable();
    refused.dedup();
    let mut timing = time_gripper(scenario, case, &recording)?;
    let steps = scenario.steps as u32;
    timing.solver_step = fold.spent / steps;
    timing.solver_substep = timing.solver_step / substeps;
    let simulated = scenario.frame * f64::from(steps);
    timing.real_time_factor = simulated / (fold.spent + timing.gripper_step * steps).as_secs_f64();
    Ok(Run {
        recording,
        support,
        worst: watch.worst,
        refused,
        overstretch,
        timing: Some(timing),
    })
}

/// Faces and shape at rest of the scenario's cloth.
pub(crate) fn sheet(scenario: &Scenario) -> Sheet {
    let rest = match scenario.mesh.as_grid() {
        Some(grid) => Rest::Grid {
            nodes: grid.nodes.map(|n| n as u32),
            sides: grid.sides,
        },
        None => Rest::Positions(scenario.mesh.rest().to_vec()),
    };
    Sheet {
        quads: scenario.mesh.quads().to_vec(),
        triangles: scenario.mesh.triangles().to_vec(),
        rest,
    }
}

/// The description of a recording.
fn meta(scenario: &Scenario, case: &Case, solver: Solver, outcome: serde_json::Value) -> String {
    let (settings, tolerance, material) = solver.meta(scenario);
    let meta = serde_json::json!({
        "scenario": scenario.name,
        "case": case.name,
        "solver": solver,
        "version": env!("CARGO_PKG_VERSION"),
        "dt": scenario.frame,
        "tolerance": tolerance,
        "material": material,
        "settings": settings,
        "grippers": case.volumes(),
        "input_sha256": case.input_hash(solver),
        "outcome": outcome,
    });
    meta.to_string()
}
