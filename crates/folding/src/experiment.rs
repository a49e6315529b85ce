//! All cases of a scenario: run side by side, compared, written.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use selvedge_math::DVec3;

use crate::run::run;
use crate::table::{Expected, Measured, Row};
use crate::{Case, Error, Run, Scenario, Solver, Timing, files, fold_error, half_fold};

/// What to run and where to write.
#[derive(Clone, Debug)]
pub struct Options {
    /// Names of cases; all of them if empty. A case's reference is run with it.
    pub cases: Vec<String>,
    /// The cloth simulator.
    pub solver: Solver,
    /// The folder for the files, made if it is not there.
    pub out: PathBuf,
    /// Cases that run at the same time.
    pub jobs: usize,
}

/// What [`experiment`] tells while it works.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// A case is about to run.
    Started {
        /// Which case.
        case: &'a str,
        /// How many steps it has.
        steps: usize,
    },
    /// A step of a case is done.
    Step {
        /// Which case.
        case: &'a str,
        /// The step, from 0.
        step: usize,
    },
    /// A case is done and its files are written.
    Finished {
        /// Which case.
        case: &'a str,
        /// Why it failed, if it did.
        failure: Option<&'a str>,
    },
}

/// A finished experiment: the rows in the order of the scenario.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// Rows with the times of the cases that ran to the end.
    pub rows: Vec<(Row, Option<Timing>)>,
}

impl Experiment {
    /// Whether every case ran to the end.
    pub fn complete(&self) -> bool {
        self.rows.iter().all(|(row, _)| row.outcome.is_ok())
    }
}

/// Runs the cases, and writes for each its recording `SOLVER/CASE.npz` and its commands
/// `SOLVER/CASE.commands.csv`, then `table.csv`, `table.md`, `curves.csv`, `curves.svg` and
/// `timings.csv`. Only the last depends on the machine: the others are the same bytes whenever and
/// with however many jobs they are made.
///
/// What an earlier experiment left under these names is removed first. A case that fails is a row
/// with its reason; the others go on. `observe` is called from the
/// running threads and stops the experiment when it breaks.
///
/// # Errors
/// [`Error::UnknownCase`], [`Error::Stopped`], and whatever prevents a file from being written.
/// Files appear whole or not at all.
pub fn experiment(
    scenario: &Scenario,
    expected: &Expected,
    options: &Options,
    observe: &(dyn Fn(Event<'_>) -> ControlFlow<()> + Sync),
) -> Result<Experiment, Error> {
    let cases = chosen(scenario, &options.cases)?;
    let folder = options.out.join(options.solver.name());
    files::make_folder(&folder)?;
    files::remove_old(&options.out, &folder, &cases)?;

    let runs: Vec<Mutex<Option<Result<Run, Error>>>> =
        cases.iter().map(|_| Mutex::new(None)).collect();
    let next = AtomicUsize::new(0);
    let work = || {
        while let Some((case, slot)) = {
            let k = next.fetch_add(1, Ordering::Relaxed);
            cases.get(k).zip(runs.get(k))
        } {
            let result = run_case(scenario, case, options, &folder, observe);
            if matches!(&result, Err(error) if !is_row(error)) {
                next.store(cases.len(), Ordering::Relaxed);
            }
            if let Ok(mut slot) = slot.lock() {
                *slot = Some(result);
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..options.jobs.clamp(1, cases.len()) {
            scope.spawn(work);
        }
        work();
    });

    let mut finished = Vec::with_capacity(cases.len());
    for slot in runs {
        match slot.into_inner().ok().flatten() {
            Some(Err(error)) if !is_row(&error) => return Err(error),
            Some(result) => finished.push(result.map_err(|error| error.to_string())),
            // Not begun, because another case's file could not be written: that error comes later.
            None => finished.push(Err(Error::Stopped.to_string())),
        }
    }
    let result = compare(scenario, &cases, &finished, expected);
    files::write_tables(&options.out, &result.rows)?;
    files::write_curves(&options.out, &curves(scenario, &cases, &finished))?;
    Ok(result)
}

/// Whether a failure concerns one case only.
fn is_row(error: &Error) -> bool {
    matches!(
        error,
        Error::Empty { .. }
            | Error::Taken { .. }
            | Error::Gripper { .. }
            | Error::Simulator { .. }
            | Error::Published(_)
            | Error::View(selvedge_view::Error::Value { .. })
    )
}

/// The cases asked for and their references, in the order of the scenario.
fn chosen<'a>(scenario: &'a Scenario, names: &[String]) -> Result<Vec<&'a Case>, Error> {
    let mut wanted: Vec<&str> = Vec::new();
    for name in names {
        let Some(case) = scenario.case(name) else {
            let known: Vec<&str> = scenario
                .cases
                .iter()
                .map(|case| case.name.as_str())
                .collect();
            return Err(Error::UnknownCase {
                file: scenario.name.clone(),
                name: name.clone(),
                known: known.join(", "),
            });
        };
        // With its reference, that one's reference, and so on; circles end where they began.
        let mut next = Some(case);
        while let Some(case) = next.filter(|case| !wanted.contains(&case.name.as_str())) {
            wanted.push(&case.name);
            next = case
                .reference
                .as_deref()
                .and_then(|name| scenario.case(name));
        }
    }
    let is_wanted = |case: &&Case| names.is_empty() || wanted.contains(&case.name.as_str());
    Ok(scenario.cases.iter().filter(is_wanted).collect())
}

fn run_case(
    scenario: &Scenario,
    case: &Case,
    options: &Options,
    folder: &std::path::Path,
    observe: &(dyn Fn(Event<'_>) -> ControlFlow<()> + Sync),
) -> Result<Run, Error> {
    let name = case.name.as_str();
    if observe(Event::Started {
        case: name,
        steps: scenario.steps,
    })
    .is_break()
    {
        return Err(Error::Stopped);
    }
    let step = |step| observe(Event::Step { case: name, step });
    let result = run(scenario, case, options.solver, step);
    if let Ok(run) = &result {
        run.recording.write(folder.join(format!("{name}.npz")))?;
        files::write_commands(folder, scenario, case)?;
    }
    let failure = result.as_ref().err().map(Error::to_string);
    let told = observe(Event::Finished {
        case: name,
        failure: failure.as_deref(),
    });
    if told.is_break() {
        Err(Error::Stopped)
    } else {
        result
    }
}

fn compare(
    scenario: &Scenario,
    cases: &[&Case],
    runs: &[Result<Run, String>],
    expected: &Expected,
) -> Experiment {
    let diagonal = scenario.mesh.diagonal();
    let ideal = half_fold(&scenario.mesh, scenario.material.thickness);
    let rows = cases.iter().zip(runs).map(|(case, result)| {
        let measured = result.as_ref().map_err(String::clone).map(|run| {
            let end = last_positions(run);
            let mut support: Vec<u32> = run
                .support
                .iter()
                .flatten()
                .map(|&(node, _)| node)
                .collect();
            support.sort_unstable();
            let reference = reference_of(case, cases, runs, &ideal);
            Measured {
                support,
                error: reference.map(|reference| fold_error(end, reference, diagonal)),
                half_fold_error: fold_error(end, &ideal, diagonal),
                strain: [run.strain_max, run.strain_rms],
                height: run.height,
                held_error: run.held_error,
                refused: run.refused.clone(),
                unconverged_steps: run.unconverged_steps,
                overstretched: run.overstretch.is_some(),
            }
        });
        let timing = result.as_ref().ok().map(|run| run.timing);
        (Row::new(case, expected, measured), timing)
    });
    Experiment {
        rows: rows.collect(),
    }
}

fn last_positions(run: &Run) -> &[DVec3] {
    run.recording.positions(run.recording.frame_count() - 1)
}

/// What a case is measured against: the end of its reference case, or the analytic half fold.
fn reference_of<'a>(
    case: &Case,
    cases: &[&Case],
    runs: &'a [Result<Run, String>],
    ideal: &'a [DVec3],
) -> Option<&'a [DVec3]> {
    let Some(name) = &case.reference else {
        return Some(ideal);
    };
    let index = cases.iter().position(|other| other.name == *name)?;
    runs[index].as_ref().ok().map(last_positions)
}

/// `E(t)` of every finished case, from the first step on.
fn curves(
    scenario: &Scenario,
    cases: &[&Case],
    runs: &[Result<Run, String>],
) -> Vec<(String, Vec<(f64, f64)>)> {
    let diagonal = scenario.mesh.diagonal();
    let ideal = half_fold(&scenario.mesh, scenario.material.thickness);
    let mut curves = Vec::new();
    for (case, run) in cases.iter().zip(runs) {
        let (Ok(run), Some(reference)) = (run, reference_of(case, cases, runs, &ideal)) else {
            continue;
        };
        let recording = &run.recording;
        let points = recording.times().iter().enumerate().map(|(row, &time)| {
            (
                time,
                fold_error(recording.positions(row), reference, diagonal),
            )
        });
        curves.push((case.name.clone(), points.collect()));
    }
    curves
}
