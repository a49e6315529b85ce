//! `cargo xtask bench-fold`: what the folds cost on one thread of this machine.

use std::fs::read_to_string;
use std::path::PathBuf;
use std::process::ExitCode;

use selvedge_folding::{Scenario, Solver, bench};

use crate::experiments::PAPER;
use crate::workspace;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// The scenario file; the paper's table if not given.
    #[arg(long, value_name = "FILE")]
    scenario: Option<PathBuf>,
    /// Runs of each case on each solver, of which the median time counts.
    #[arg(long, value_name = "N", default_value = "3")]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=1000))]
    repeats: u32,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let default = workspace::root()?.join(PAPER);
    let scenario = Scenario::load(arguments.scenario.as_ref().unwrap_or(&default))?;
    let solvers = [Solver::Published, Solver::Default];
    let repeats = arguments.repeats;
    let before = load();
    let result = bench(
        &scenario,
        &solvers,
        repeats as usize,
        |case, solver, repeat| {
            eprintln!("{} {solver}, {} of {repeats}", case.name, repeat + 1);
        },
    );

    println!("{}", result.table());
    for row in &result.rows {
        if let Err(reason) = &row.outcome {
            println!("{} {} failed: {reason}", row.case, row.solver);
        }
    }
    for solver in solvers {
        let cases = result.rows.iter().filter(|row| row.solver == solver);
        let (finished, all) = (
            cases.clone().filter(|row| row.outcome.is_ok()).count(),
            cases.count(),
        );
        match result.real_time_factor(solver) {
            Some(factor) => {
                println!("{solver}: {factor:.2} x real time over {finished} of {all} cases");
            }
            None => println!("{solver}: none of {all} cases ran to the end"),
        }
    }
    println!(
        "One thread, median of {repeats}, {} profile; {}; load average {before} before, {} after.",
        if cfg!(debug_assertions) {
            "dev"
        } else {
            "release"
        },
        processor(),
        load()
    );
    Ok(ExitCode::from(if result.complete() { 0 } else { 2 }))
}

/// The model of the processor, where Linux tells it.
fn processor() -> String {
    let text = read_to_string("/proc/cpuinfo").unwrap_or_default();
    let model = text.lines().find_map(|line| {
        let (key, value) = line.split_once(':')?;
        (key.trim() == "model name").then(|| value.trim().to_owned())
    });
    model.unwrap_or_else(|| format!("{} processor", std::env::consts::ARCH))
}

/// Running and waiting threads of the machine, mean over a minute, where Linux tells it.
fn load() -> String {
    let text = read_to_string("/proc/loadavg").unwrap_or_default();
    let first = text.split_whitespace().next();
    first.unwrap_or("unknown").to_owned()
}
