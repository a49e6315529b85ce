//! `cargo xtask experiments`: the paper's table, or that of any scenario.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::available_parallelism;
use std::time::Instant;

use anyhow::Context;
use clap::ValueEnum;
use selvedge_folding::{
    Error, Expected, Experiment, Export, Measured, Options, Scenario, Solver, experiment, terminal,
};
use selvedge_trajectory::log;

use crate::progress::Progress;
use crate::reach::{self, Robot};
use crate::workspace;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Cases to run; all of them if none is named. A case's reference runs with it.
    cases: Vec<String>,
    /// The scenario file; the paper's table if not given.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// The cloth simulator.
    #[arg(long, value_enum, default_value = "both")]
    solver: Solvers,
    /// Runs of each case from perturbed starts; 0 for none.
    #[arg(long, value_name = "N", default_value = "8")]
    #[arg(value_parser = clap::value_parser!(u32).range(0..=1000))]
    ensemble: u32,
    /// How far a coordinate of a perturbed start is from that of the sheet at rest at most [m].
    #[arg(long, value_name = "M", default_value = "1e-9", value_parser = noise)]
    #[arg(allow_hyphen_values = true)]
    noise: f64,
    /// Folder for the files [default: target/experiments/SCENARIO].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Folds that run at the same time [default: the number of processors].
    #[arg(long, value_name = "N")]
    jobs: Option<std::num::NonZeroUsize>,
    /// Commands that the one case named follows instead of the scenario's, for instance another timing
    /// of the same path, as `selvedge-reach` writes it.
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Look for a base from which this arm can do the folds, and add what is found to the table.
    #[arg(long, value_enum)]
    robot: Option<Robot>,
    /// Go on with an interrupted run: folds whose inputs are the same are not run again.
    #[arg(long)]
    resume: bool,
    /// Write key frames of each case side by side, CASE.frames.png.
    #[arg(long)]
    frames: bool,
    /// Write an animation of each case, CASE.gif.
    #[arg(long)]
    video: bool,
    /// Write each recording for robot tools, CASE.mcap.
    #[arg(long)]
    mcap: bool,
    /// Print the table only.
    #[arg(long)]
    quiet: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum Solvers {
    /// The inextensible cloth.
    Default,
    /// The scheme of the paper's table, defects included.
    Published,
    /// One after the other, side by side in the table.
    Both,
}

impl Solvers {
    fn list(self) -> Vec<Solver> {
        match self {
            Self::Default => vec![Solver::Default],
            Self::Published => vec![Solver::Published],
            Self::Both => vec![Solver::Published, Solver::Default],
        }
    }
}

impl Arguments {
    fn exports(&self) -> Vec<Export> {
        let wanted = [
            (self.frames, Export::Frames),
            (self.video, Export::Video),
            (self.mcap, Export::Mcap),
        ];
        wanted
            .into_iter()
            .filter(|(wanted, _)| *wanted)
            .map(|(_, export)| export)
            .collect()
    }
}

/// The command as one may type it again.
fn command(arguments: impl Iterator<Item = String>) -> String {
    let quoted = arguments.map(|argument| match argument.contains(' ') {
        true => format!("'{argument}'"),
        false => argument,
    });
    ["cargo xtask".to_owned()]
        .into_iter()
        .chain(quoted)
        .collect::<Vec<_>>()
        .join(" ")
}

/// A noise within its bounds: larger ones change the task.
fn noise(text: &str) -> Result<f64, String> {
    const MAX: f64 = 1e-3;
    match text.parse() {
        Ok(noise) if (0.0..=MAX).contains(&noise) => Ok(noise),
        _ => Err(format!("must be a length from 0 to {MAX} m")),
    }
}

/// The scenario of the paper's table.
pub(crate) const PAPER: &str = "fixtures/scenarios/corner_fold.toml";

/// Set by Ctrl-C; running cases stop after their present step.
static STOP: AtomicBool = AtomicBool::new(false);

/// A lag of held nodes that is worth a line [m].
const LAG: f64 = 1e-4;

/// As a shell reports a program that was interrupted.
const INTERRUPTED: u8 = 130;

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let root = workspace::root()?;
    let default = root.join(PAPER);
    let path = arguments.scenario.as_ref().unwrap_or(&default);
    let mut scenario = Scenario::load(path)?;
    let expected = Expected::beside(&scenario, path)?;
    let target = std::env::var_os("CARGO_TARGET_DIR").map_or(root.join("target"), PathBuf::from);
    if let Some(log) = &arguments.log {
        let [case] = &arguments.cases[..] else {
            anyhow::bail!("--log {}: name the one case that follows it", log.display());
        };
        let file = std::fs::File::open(log).with_context(|| format!("{}", log.display()))?;
        let log = log::read(std::io::BufReader::new(file), &log.display().to_string())?;
        scenario.follow(case, &log)?;
    }
    let reach = match arguments.robot {
        Some(robot) => Some(reach::find(robot, &scenario, &arguments.cases)?),
        None => None,
    };
    let out = arguments.out.clone();
    let options = Options {
        cases: arguments.cases.clone(),
        solvers: arguments.solver.list(),
        out: out.unwrap_or_else(|| target.join("experiments").join(&scenario.name)),
        jobs: arguments.jobs.map_or_else(
            || available_parallelism().map_or(1, |n| n.get()),
            |n| n.get(),
        ),
        ensemble: arguments.ensemble as usize,
        noise: arguments.noise,
        resume: arguments.resume,
        exports: arguments.exports(),
        command: command(std::env::args().skip(1)),
        tables: reach.iter().map(reach::Found::table).collect(),
    };
    // Of an earlier experiment, as its other files.
    std::fs::remove_file(options.out.join(reach::FILE)).ok();
    ctrlc::set_handler(|| STOP.store(true, Ordering::Relaxed)).context("Ctrl-C")?;

    let start = Instant::now();
    let progress = Progress::new(arguments.quiet, options.ensemble);
    let result = experiment(&scenario, &expected, &options, &|event| {
        progress.show(event);
        match STOP.load(Ordering::Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    });
    progress.clear()?;
    match result {
        Ok(result) => {
            report(&result, &expected, &options, start, arguments.quiet);
            if let Some(found) = &reach {
                found.write(&options.out)?;
            }
            Ok(ExitCode::from(if result.complete() { 0 } else { 2 }))
        }
        Err(Error::Stopped) => {
            eprintln!(
                "stopped; the files of finished cases are in {}, --resume goes on from there",
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
        let name = format!("{} {}", row.case, row.solver);
        if let Some(reason) = row.failure() {
            println!("{name} failed: {reason}");
        }
        if let Ok(measured) = &row.outcome {
            remarks(&name, measured);
        }
    }
    if !quiet {
        if !expected.source.is_empty() {
            println!("Paper: {}.", expected.source);
            println!("Its digits are those of the published scheme; another cloth has others.");
        }
        if options.ensemble > 0 {
            println!(
                "Median, max - min: errors of {} more folds from starts that differ by up to {:e} m.",
                options.ensemble, options.noise
            );
        }
        println!("Strain: largest edge strain of the run, see docs/SCENARIOS.md.");
        let seconds = start.elapsed().as_secs_f64();
        println!("{seconds:.1} s; files in {}", options.out.display());
        println!(
            "Open {} in a browser.",
            options.out.join("report.html").display()
        );
    }
}

/// What a reader of the table must know of a case.
fn remarks(name: &str, measured: &Measured) {
    let worst = &measured.worst;
    if worst.unconverged_steps > 0 {
        let n = worst.unconverged_steps;
        println!("{name}: {n} steps ended at the iteration limit");
    }
    if let Some(gap) = worst.gap.filter(|gap| *gap < 0.0) {
        let depth = -gap * 1e3;
        println!("{name}: layers came up to {depth:.3} mm too near to each other or the table");
    }
    if !measured.refused.is_empty() {
        let nodes = &measured.refused;
        println!("{name}: another gripper held nodes {nodes:?} when one closed");
    }
    if worst.held_error > LAG {
        let lag = worst.held_error * 1e3;
        println!(
            "{name}: held nodes were up to {lag:.1} mm from their targets (below the table, beyond \
             what the cloth allows, or faster than the solver's move limit)"
        );
    }
    if measured.overstretched {
        println!("{name}: held nodes were pulled further apart than the cloth is long");
    }
    if let Some(ensemble) = &measured.ensemble
        && let Some(reason) = &ensemble.reason
    {
        let n = ensemble.failures;
        println!("{name}: {n} perturbed starts failed, the first because {reason}");
    }
}
