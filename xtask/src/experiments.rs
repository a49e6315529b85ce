//! `cargo xtask experiments`: the paper's table, or that of any scenario.

use std::collections::HashMap;
use std::io::IsTerminal;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::available_parallelism;
use std::time::Instant;

use anyhow::Context;
use clap::ValueEnum;
use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use selvedge_folding::{
    Error, Event, Expected, Experiment, Options, Scenario, Solver, experiment, terminal,
};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Cases to run; all of them if none is named. A case's reference runs with it.
    cases: Vec<String>,
    /// The scenario file; the paper's table if not given.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// The cloth simulator.
    #[arg(long, value_enum, default_value = "published")]
    solver: SolverName,
    /// Folder for the files [default: target/experiments/SCENARIO].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Cases that run at the same time [default: the number of processors].
    #[arg(long, value_name = "N")]
    jobs: Option<std::num::NonZeroUsize>,
    /// Print the table only.
    #[arg(long)]
    quiet: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum SolverName {
    /// The scheme of the paper's table, defects included.
    Published,
}

/// Set by Ctrl-C; running cases stop after their present step.
static STOP: AtomicBool = AtomicBool::new(false);

/// A lag of held nodes that is worth a line [m].
const LAG: f64 = 1e-4;

/// As a shell reports a program that was interrupted.
const INTERRUPTED: u8 = 130;

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .context("xtask has no parent")?;
    let default = root.join("fixtures/scenarios/corner_fold.toml");
    let path = arguments.scenario.as_ref().unwrap_or(&default);
    let scenario = Scenario::load(path)?;
    let expected = Expected::beside(&scenario, path)?;
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or(root.join("target"), PathBuf::from);
    let out = arguments.out.clone();
    let options = Options {
        cases: arguments.cases.clone(),
        solver: match arguments.solver {
            SolverName::Published => Solver::Published,
        },
        out: out.unwrap_or_else(|| target.join("experiments").join(&scenario.name)),
        jobs: arguments.jobs.map_or_else(
            || available_parallelism().map_or(1, |n| n.get()),
            |n| n.get(),
        ),
    };
    ctrlc::set_handler(|| STOP.store(true, Ordering::Relaxed)).context("Ctrl-C")?;

    let start = Instant::now();
    let progress = Progress::new(arguments.quiet);
    let result = experiment(&scenario, &expected, &options, &|event| {
        progress.show(event);
        match STOP.load(Ordering::Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    });
    progress.bars.clear()?;
    match result {
        Ok(result) => {
            report(&result, &expected, &options, start, arguments.quiet);
            Ok(ExitCode::from(if result.complete() { 0 } else { 2 }))
        }
        Err(Error::Stopped) => {
            eprintln!(
                "stopped; the files of finished cases are in {}",
                options.out.display()
            );
            Ok(ExitCode::from(INTERRUPTED))
        }
        Err(error) => Err(error.into()),
    }
}

fn report(
    result: &Experiment,
    expected: &Expected,
    options: &Options,
    start: Instant,
    quiet: bool,
) {
    println!("{}", terminal(&result.rows));
    for (row, _) in &result.rows {
        if let (Ok(_), Some(reason)) = (&row.outcome, row.failure()) {
            println!("{}: {reason}", row.case);
        }
        if let Ok(measured) = &row.outcome {
            if measured.unconverged_steps > 0 {
                let n = measured.unconverged_steps;
                println!("{}: {n} steps ended at the iteration limit", row.case);
            }
            if !measured.refused.is_empty() {
                let nodes = &measured.refused;
                println!(
                    "{}: another gripper held nodes {nodes:?} when one closed",
                    row.case
                );
            }
            if measured.held_error > LAG {
                let lag = measured.held_error * 1e3;
                println!(
                    "{}: held nodes were up to {lag:.1} mm from their targets (below the table, or \
                     faster than the solver's move limit)",
                    row.case
                );
            }
            if measured.overstretched {
                println!(
                    "{}: held nodes were pulled further apart than the cloth is long",
                    row.case
                );
            }
        }
    }
    if !quiet {
        if !expected.source.is_empty() {
            println!("Paper: {}.", expected.source);
        }
        println!("Strain: largest edge strain at the end of any step, see docs/SCENARIOS.md.");
        let seconds = start.elapsed().as_secs_f64();
        println!("{seconds:.1} s; files in {}", options.out.display());
    }
}

/// A bar a case on a terminal, a line a case otherwise.
struct Progress {
    bars: MultiProgress,
    running: Mutex<HashMap<String, ProgressBar>>,
    lines: bool,
}

impl Progress {
    fn new(quiet: bool) -> Self {
        let bars = MultiProgress::new();
        if quiet {
            bars.set_draw_target(ProgressDrawTarget::hidden());
        }
        let lines = !quiet && !std::io::stderr().is_terminal();
        Self {
            bars,
            running: Mutex::default(),
            lines,
        }
    }

    fn show(&self, event: Event<'_>) {
        let Ok(mut running) = self.running.lock() else {
            return;
        };
        match event {
            Event::Started { case, steps } => {
                let bar = self.bars.add(ProgressBar::new(steps as u64));
                let style = "{prefix:>8} {bar:32} {pos:>4}/{len} steps  {per_sec}  {eta} left";
                if let Ok(style) = ProgressStyle::with_template(style) {
                    bar.set_style(style);
                }
                bar.set_prefix(case.to_owned());
                running.insert(case.to_owned(), bar);
            }
            Event::Step { case, step } => {
                if let Some(bar) = running.get(case) {
                    bar.set_position(step as u64 + 1);
                }
            }
            Event::Finished { case, failure } => {
                if let Some(bar) = running.remove(case) {
                    bar.finish_and_clear();
                }
                if self.lines {
                    match failure {
                        None => eprintln!("{case} done"),
                        Some(reason) => eprintln!("{case} failed: {reason}"),
                    }
                }
            }
        }
    }
}
