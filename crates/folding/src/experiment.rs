//! All cases of a scenario: run side by side, compared, written.

use std::fmt;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use selvedge_math::DVec3;

use crate::compare::{Results, compare, curves};
use crate::ensemble::run_member;
use crate::expected::Expected;
use crate::report::report;
use crate::resume::{finished_member, finished_run, member_path, write_member};
use crate::run::{run, sheet};
use crate::table::Row;
use crate::{Case, Error, Run, Scenario, Solver, Timing, files};

/// What to run and where to write.
#[derive(Clone, Debug)]
pub struct Options {
    /// Names of cases; all of them if empty. A case's reference is run with it.
    pub cases: Vec<String>,
    /// The cloth simulators, each once; every case is run on each.
    pub solvers: Vec<Solver>,
    /// The folder for the files, made if it is not there.
    pub out: PathBuf,
    /// Folds that run at the same time.
    pub jobs: usize,
    /// How many times each case is run again from a perturbed start.
    pub ensemble: usize,
    /// How far a coordinate of a perturbed start may be from that of the sheet at rest [m].
    pub noise: f64,
    /// Whether finished folds of an earlier experiment in the same folder are taken as they are,
    /// where their inputs are the same.
    pub resume: bool,
    /// What else is written for each case.
    pub exports: Vec<Export>,
    /// The command that runs this experiment, for its page.
    pub command: String,
    /// More tables for its page.
    pub tables: Vec<selvedge_view::Table>,
}

/// A file for other programs and for looking at, beside each recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Export {
    /// `CASE.frames.png`: key frames side by side.
    Frames,
    /// `CASE.gif`: an animation.
    Video,
    /// `CASE.mcap`: for Foxglove and other robot tools.
    Mcap,
}

/// One fold: a case on a solver, as it is or as a member of its ensemble.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct FoldName<'a> {
    /// The case.
    pub case: &'a str,
    /// The cloth simulator.
    pub solver: Solver,
    /// The member of the ensemble, from 1; 0 for the case as it is.
    pub member: usize,
}

impl fmt::Display for FoldName<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.case, self.solver)?;
        match self.member {
            0 => Ok(()),
            member => write!(f, " #{member}"),
        }
    }
}

/// What [`experiment`] tells while it works.
#[derive(Clone, Copy, Debug)]
pub enum Event<'a> {
    /// A fold is about to run.
    Started {
        /// Which one.
        fold: FoldName<'a>,
        /// How many steps it has.
        steps: usize,
    },
    /// A step of a fold is done.
    Step {
        /// Which one.
        fold: FoldName<'a>,
        /// The step, from 0.
        step: usize,
    },
    /// A fold was done by an earlier experiment.
    Reused {
        /// Which one.
        fold: FoldName<'a>,
    },
    /// A fold is done and its files are written.
    Finished {
        /// Which one.
        fold: FoldName<'a>,
        /// Why it failed, if it did.
        failure: Option<&'a str>,
    },
}

/// A finished experiment: the rows in the order of the scenario, for each case the solvers.
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

type Observe<'a> = &'a (dyn Fn(Event<'_>) -> ControlFlow<()> + Sync);

/// Runs the cases on each solver, and writes for each its recording `SOLVER/CASE.npz`, a picture of
/// its end `CASE.png` and its commands `CASE.commands.csv`, then all ends `SOLVER/ends.png`, `table.csv`, `table.md`,
/// `curves.csv`, `curves.svg`, `timings.csv` and a page `report.html` with all of it and a 3D player.
/// Only the last two depend on the machine and the day: the others are the same bytes whenever and
/// with however many jobs they are made.
///
/// What an earlier experiment left under these names is removed first, but for what is taken up
/// again. A case that fails is a row with its reason; the others go on. Of a member of an ensemble
/// only the end is kept, `SOLVER/members/CASE.MEMBER.npz`. `observe` is called from the running threads and stops the experiment when it breaks.
///
/// # Errors
/// [`Error::UnknownCase`], [`Error::Stopped`], and whatever prevents a file from being written.
/// Files appear whole or not at all.
pub fn experiment(
    scenario: &Scenario,
    expected: &Expected,
    options: &Options,
    observe: Observe<'_>,
) -> Result<Experiment, Error> {
    let cases = chosen(scenario, &options.cases)?;
    for solver in &options.solvers {
        let folder = options.out.join(solver.name());
        files::make_folder(&folder)?;
        if options.ensemble > 0 {
            files::make_folder(&folder.join("members"))?;
        }
        files::remove_old(&options.out, &folder, &cases, options.resume)?;
    }
    let on_each = |case| options.solvers.iter().map(move |&solver| (case, solver));
    let pairs: Vec<(&Case, Solver)> = cases.into_iter().flat_map(on_each).collect();

    // All cases as they are, then all first members, and so on.
    let runs = slots(pairs.len());
    let ends = slots(pairs.len() * options.ensemble);
    let (next, total) = (AtomicUsize::new(0), runs.len() + ends.len());
    let job = Job {
        scenario,
        options,
        observe,
    };
    let work = || {
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= total {
                break;
            }
            let ((case, solver), member) = (pairs[number % pairs.len()], number / pairs.len());
            let fold = FoldName {
                case: &case.name,
                solver,
                member,
            };
            let kept = match number.checked_sub(runs.len()) {
                None => keep(&runs[number], job.case(fold, case)),
                Some(index) => keep(&ends[index], job.member(fold, case)),
            };
            if kept.is_break() {
                next.store(total, Ordering::Relaxed);
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 1..options.jobs.min(total) {
            scope.spawn(work);
        }
        work();
    });

    let results = Results {
        scenario,
        pairs: &pairs,
        runs: taken(runs)?,
        ends: taken(ends)?,
    };
    let result = compare(&results, expected);
    files::write_tables(&options.out, &result.rows)?;
    files::write_curves(&options.out, &curves(&results, &options.solvers))?;
    for &solver in &options.solvers {
        let of_solver = |(pair, _): &(&(&Case, Solver), _)| pair.1 == solver;
        let finished = results.pairs.iter().zip(&results.runs).filter(of_solver);
        let recordings = finished.filter_map(|(_, run)| Some(&run.as_ref().ok()?.recording));
        let folder = options.out.join(solver.name());
        files::write_ends(&folder, &recordings.collect::<Vec<_>>())?;
    }
    let html = report(&results, &result, options)?;
    files::write_text(&options.out.join(files::REPORT), &html)?;
    Ok(result)
}

type Slot<T> = Mutex<Option<Result<T, Error>>>;

fn slots<T>(number: usize) -> Vec<Slot<T>> {
    (0..number).map(|_| Mutex::new(None)).collect()
}

/// Puts a result where it belongs, and says whether the other folds may go on.
fn keep<T>(slot: &Slot<T>, result: Result<T, Error>) -> ControlFlow<()> {
    let fatal = matches!(&result, Err(error) if !is_row(error));
    if let Ok(mut slot) = slot.lock() {
        *slot = Some(result);
    }
    match fatal {
        true => ControlFlow::Break(()),
        false => ControlFlow::Continue(()),
    }
}

/// The results, with the reasons of those that failed.
fn taken<T>(slots: Vec<Slot<T>>) -> Result<Vec<Result<T, String>>, Error> {
    let mut results = Vec::with_capacity(slots.len());
    for slot in slots {
        results.push(match slot.into_inner().ok().flatten() {
            Some(Err(error)) if !is_row(&error) => return Err(error),
            Some(result) => result.map_err(|error| error.to_string()),
            // Not begun, because another fold ended all: its error comes later.
            None => Err(Error::Stopped.to_string()),
        });
    }
    Ok(results)
}

/// Whether a failure concerns one case only.
fn is_row(error: &Error) -> bool {
    matches!(
        error,
        Error::Empty { .. }
            | Error::Taken { .. }
            | Error::Gripper { .. }
            | Error::Simulator { .. }
            | Error::Cloth(_)
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

/// What all folds of an experiment share.
#[derive(Clone, Copy)]
struct Job<'a> {
    scenario: &'a Scenario,
    options: &'a Options,
    observe: Observe<'a>,
}

impl Job<'_> {
    fn case(&self, fold: FoldName<'_>, case: &Case) -> Result<Run, Error> {
        let (scenario, solver) = (self.scenario, fold.solver);
        let folder = self.options.out.join(solver.name());
        let path = folder.join(format!("{}.npz", case.name));
        if self.options.resume
            && let Some(run) = finished_run(&path, case, solver)
        {
            files::write_commands(&folder, scenario, case)?;
            files::write_pictures(&folder, case, &run.recording, &self.options.exports)?;
            self.reused(fold)?;
            return Ok(run);
        }
        self.told(fold, |step| {
            let run = run(scenario, case, solver, step)?;
            files::write_commands(&folder, scenario, case)?;
            files::write_pictures(&folder, case, &run.recording, &self.options.exports)?;
            // Last: it is what tells that the case is finished.
            run.recording.write(&path)?;
            Ok(run)
        })
    }

    fn member(&self, fold: FoldName<'_>, case: &Case) -> Result<Vec<DVec3>, Error> {
        let (scenario, noise) = (self.scenario, self.options.noise);
        let (solver, member) = (fold.solver, fold.member);
        let folder = self.options.out.join(solver.name());
        let path = member_path(&folder, case, member);
        if self.options.resume
            && let Some(end) = finished_member(&path, case, solver, noise)
        {
            self.reused(fold)?;
            return Ok(end);
        }
        self.told(fold, |step| {
            let end = run_member(scenario, case, solver, member, noise, step)?;
            let time = scenario.time(scenario.steps);
            let name = (case, solver, member);
            write_member(&path, sheet(scenario), name, noise, time, &end)?;
            Ok(end)
        })
    }

    fn reused(&self, fold: FoldName<'_>) -> Result<(), Error> {
        match (self.observe)(Event::Reused { fold }) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(Error::Stopped),
        }
    }

    /// Does a fold's work and tells of it.
    fn told<T>(
        &self,
        fold: FoldName<'_>,
        work: impl FnOnce(&mut dyn FnMut(usize) -> ControlFlow<()>) -> Result<T, Error>,
    ) -> Result<T, Error> {
        let (observe, steps) = (self.observe, self.scenario.steps);
        if observe(Event::Started { fold, steps }).is_break() {
            return Err(Error::Stopped);
        }
        let result = work(&mut |step| observe(Event::Step { fold, step }));
        let failure = result.as_ref().err().map(Error::to_string);
        let finished = Event::Finished {
            fold,
            failure: failure.as_deref(),
        };
        if observe(finished).is_break() {
            return Err(Error::Stopped);
        }
        result
    }
}
