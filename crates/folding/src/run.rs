//! The loop that joins grippers and cloth.

use std::hint::black_box;
use std::ops::ControlFlow;
use std::time::{Duration, Instant};

use selvedge_grasp::{ClothView, Event, Grippers, Guard, Options, Overstretch, Rules};
use selvedge_math::{Command, DVec3, Status};
use selvedge_view::{GripperState, Recording, Rest, Sheet};

use crate::metric::edge_strain;
use crate::{Case, Error, Scenario, Solver};

/// Released edges are not counted in the strain for so long [s]: the squeeze shortened them.
const RECOVERY: f64 = 0.5;

/// Held nodes may be commanded so many times their rest distance apart before it is told.
const SLACK: f64 = 1.01;

/// A finished run of one case.
#[derive(Clone, Debug)]
pub struct Run {
    /// Every step, from the start at rest.
    pub recording: Recording,
    /// What each gripper held, and through which rules, when it last closed.
    pub support: Vec<Vec<(u32, Rules)>>,
    /// Largest edge strain at the end of any step. Edges with both ends held do not count, nor do
    /// those for half a second after their release.
    pub strain_max: f64,
    /// Largest root mean square edge strain over the same edges.
    pub strain_rms: f64,
    /// Lowest and highest z of any node at the end of any step [m].
    pub height: [f64; 2],
    /// Largest distance between a held node and its target at the end of any step [m].
    pub held_error: f64,
    /// Nodes that a gripper closed on while another one held them, ascending.
    pub refused: Vec<u32>,
    /// Steps in which a solve ended at its iteration limit.
    pub unconverged_steps: usize,
    /// The first two held nodes that were commanded further apart than the cloth is long, if any.
    pub overstretch: Option<Overstretch>,
    /// Where the time went.
    pub timing: Timing,
}

/// Measured times; the only part of a run that differs from one run to the next.
#[derive(Clone, Copy, Debug, Default)]
pub struct Timing {
    /// Commands and targets, mean over the closed steps after the closing one.
    pub gripper_step: Duration,
    /// Selection at closing, mean over several closings.
    pub selection: Duration,
    /// Cloth, mean over the steps.
    pub solver_step: Duration,
    /// Cloth, mean over the substeps.
    pub solver_substep: Duration,
    /// Simulated time per time spent in gripper and cloth.
    pub real_time_factor: f64,
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
    mut observe: impl FnMut(usize) -> ControlFlow<()>,
) -> Result<Run, Error> {
    let mut cloth = solver.build(scenario)?;
    let mesh = &scenario.mesh;
    let mut guard = Guard::new(view(scenario, mesh.rest()), SLACK)
        .map_err(|reason| Error::Gripper { time: 0.0, reason })?;
    let mut grippers = Grippers::new(
        case.grippers
            .iter()
            .map(|plan| plan.gripper.clone())
            .collect(),
    );
    let mut recording = new_recording(scenario, case, solver)?;
    let mut commands: Vec<Command> = commands_at(case, 0.0).collect();
    let mut states: Vec<GripperState> = Vec::with_capacity(commands.len());
    let mut holder = vec![0u8; mesh.node_count()];
    let open = commands.iter().map(|command| GripperState {
        command: Command {
            jaw: Default::default(),
            ..*command
        },
        alpha: 0.0,
    });
    states.extend(open);
    recording.push(0.0, cloth.positions(), &states, &holder)?;

    let mut support = vec![Vec::new(); commands.len()];
    let mut exempt_until = vec![f64::NEG_INFINITY; mesh.node_count()];
    let mut spent = Duration::ZERO;
    let mut result = Run {
        recording,
        support: Vec::new(),
        strain_max: 0.0,
        strain_rms: 0.0,
        height: [0.0, 0.0],
        held_error: 0.0,
        refused: Vec::new(),
        unconverged_steps: 0,
        overstretch: None,
        timing: Timing::default(),
    };
    for step in 0..scenario.steps {
        let time = scenario.time(step);
        commands.clear();
        commands.extend(commands_at(case, time));

        // Gripper
        let anchors = match any_closes(&grippers, &commands) {
            true => solver.anchors(scenario, cloth.positions()),
            false => None,
        };
        let options = Options {
            anchors: anchors.as_deref(),
            ..Options::default()
        };
        let held = grippers
            .step_with(
                &commands,
                scenario.frame,
                view(scenario, cloth.positions()),
                options,
            )
            .map_err(|reason| Error::Gripper { time, reason })?;
        let over = guard
            .check(held)
            .map_err(|reason| Error::Gripper { time, reason })?;
        result.overstretch = result.overstretch.or(over.first().copied());

        // Cloth
        let before = Instant::now();
        let report = cloth
            .step(held, scenario.frame)
            .map_err(|reason| Error::Simulator { time, reason })?;
        spent += before.elapsed();
        for (&node, target) in held.nodes.iter().zip(held.targets) {
            let lag = cloth.positions()[node as usize].distance(*target);
            result.held_error = result.held_error.max(lag);
        }

        // What happened
        holder.fill(0);
        states.clear();
        for (number, (gripper, command)) in grippers.grippers().iter().zip(&commands).enumerate() {
            match gripper.event() {
                Event::Empty if !gripper.refused().is_empty() => {
                    let nodes = gripper.refused().to_vec();
                    return Err(Error::Taken {
                        gripper: number + 1,
                        time,
                        nodes,
                    });
                }
                Event::Empty => {
                    return Err(nothing_grasped(
                        scenario,
                        case,
                        number,
                        time,
                        cloth.positions(),
                    ));
                }
                Event::Captured => {
                    let nodes = gripper.nodes().iter().copied();
                    support[number] = nodes.zip(gripper.rules().iter().copied()).collect();
                    result.refused.extend(gripper.refused());
                }
                _ => {}
            }
            for &node in gripper.nodes() {
                holder[node as usize] = number as u8 + 1;
                exempt_until[node as usize] = time + RECOVERY;
            }
            states.push(GripperState {
                command: *command,
                alpha: gripper.alpha(),
            });
        }
        let positions = cloth.positions();
        let row_time = scenario.time(step + 1);
        result
            .recording
            .push(row_time, positions, &states, &holder)?;
        let counts = |edge: [u32; 2]| edge.iter().any(|&node| exempt_until[node as usize] < time);
        let (largest, rms) = edge_strain(mesh, positions, counts);
        result.strain_max = result.strain_max.max(largest);
        result.strain_rms = result.strain_rms.max(rms);
        for position in positions {
            result.height[0] = result.height[0].min(position.z);
            result.height[1] = result.height[1].max(position.z);
        }
        result.unconverged_steps += usize::from(report.status != Status::Converged);
        if observe(step).is_break() {
            return Err(Error::Stopped);
        }
    }
    result.support = support;
    result.refused.sort_unstable();
    result.refused.dedup();
    result.timing = time_gripper(scenario, case, &result.recording)?;
    let steps = scenario.steps as u32;
    result.timing.solver_step = spent / steps;
    result.timing.solver_substep = spent / (steps * solver.substeps(scenario));
    let simulated = scenario.frame * f64::from(steps);
    let gripping = result.timing.gripper_step * steps;
    result.timing.real_time_factor = simulated / (spent + gripping).as_secs_f64();
    Ok(result)
}

/// The cloth as the grippers see it.
fn view<'a>(scenario: &'a Scenario, positions: &'a [DVec3]) -> ClothView<'a> {
    let mesh = &scenario.mesh;
    ClothView {
        positions,
        edges: mesh.edges(),
        quads: mesh.quads(),
        triangles: mesh.triangles(),
    }
}

fn commands_at(case: &Case, time: f64) -> impl Iterator<Item = Command> {
    case.grippers
        .iter()
        .map(move |plan| plan.schedule.command(time))
}

/// Whether one of the grippers closes with these commands.
fn any_closes(grippers: &Grippers, commands: &[Command]) -> bool {
    let mut pairs = grippers.grippers().iter().zip(commands);
    pairs.any(|(gripper, command)| !gripper.jaw().is_closed() && command.jaw.is_closed())
}

fn new_recording(scenario: &Scenario, case: &Case, solver: Solver) -> Result<Recording, Error> {
    let rest = match scenario.mesh.as_grid() {
        Some(grid) => Rest::Grid {
            nodes: grid.nodes.map(|n| n as u32),
            sides: grid.sides,
        },
        None => Rest::Positions(scenario.mesh.rest().to_vec()),
    };
    let sheet = Sheet {
        quads: scenario.mesh.quads().to_vec(),
        triangles: scenario.mesh.triangles().to_vec(),
        rest,
    };
    let meta = serde_json::json!({
        "scenario": scenario.name,
        "case": case.name,
        "solver": solver,
        "version": env!("CARGO_PKG_VERSION"),
        "dt": scenario.frame,
        "tolerance": scenario.published.tolerance,
        "material": scenario.material,
        "settings": scenario.published,
        "input_sha256": case.input_hash,
    });
    Ok(Recording::new(
        sheet,
        case.grippers.len(),
        meta.to_string(),
    )?)
}

fn nothing_grasped(
    scenario: &Scenario,
    case: &Case,
    number: usize,
    time: f64,
    positions: &[DVec3],
) -> Error {
    let plan = &case.grippers[number];
    let centre = plan.schedule.command(time).pose.transform(plan.tip_offset);
    let nearest = positions
        .iter()
        .map(|p| p.distance(centre))
        .enumerate()
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap_or((scenario.mesh.node_count(), f64::INFINITY));
    Error::Empty {
        gripper: number + 1,
        time,
        nearest: nearest.0,
        distance: nearest.1,
    }
}

/// Plays the grippers' part of a run again, without the cloth, often enough for a clock.
fn time_gripper(scenario: &Scenario, case: &Case, recording: &Recording) -> Result<Timing, Error> {
    const REPEATS: u32 = 20;
    let mut grippers = Grippers::new(
        case.grippers
            .iter()
            .map(|plan| plan.gripper.clone())
            .collect(),
    );
    let mut commands: Vec<Command> = Vec::with_capacity(case.grippers.len());
    let (mut closing, mut closings) = (Duration::ZERO, 0);
    let (mut carrying, mut carried) = (Duration::ZERO, 0);
    let failed = |step| {
        move |reason| Error::Gripper {
            time: scenario.time(step),
            reason,
        }
    };
    for _ in 0..REPEATS {
        grippers.reset();
        let mut step = 0;
        while step < scenario.steps {
            commands.clear();
            commands.extend(commands_at(case, scenario.time(step)));
            let cloth = view(scenario, recording.positions(step));
            if any_closes(&grippers, &commands) {
                let before = Instant::now();
                black_box(
                    grippers
                        .step(&commands, scenario.frame, cloth)
                        .map_err(failed(step))?,
                );
                closing += before.elapsed();
                closings += 1;
                step += 1;
                // All closed steps in one measurement: a clock is slower than a step.
                let first = step;
                let closed = |step: &usize| {
                    let jaws = case.grippers.iter().map(|plan| &plan.schedule);
                    jaws.into_iter()
                        .all(|jaw| jaw.jaw(scenario.time(*step)).is_closed())
                };
                let end = first + (first..scenario.steps).take_while(closed).count();
                let before = Instant::now();
                while step < end {
                    commands.clear();
                    commands.extend(commands_at(case, scenario.time(step)));
                    let held = grippers.step(&commands, scenario.frame, cloth);
                    black_box(held.map_err(failed(step))?);
                    step += 1;
                }
                carrying += before.elapsed();
                carried += (step - first) as u32;
            } else {
                grippers
                    .step(&commands, scenario.frame, cloth)
                    .map_err(failed(step))?;
                step += 1;
            }
        }
    }
    Ok(Timing {
        selection: closing / u32::max(closings, 1),
        gripper_step: carrying / u32::max(carried, 1),
        ..Timing::default()
    })
}
