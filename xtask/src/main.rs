//! Selvedge's commands; `cargo xtask help` lists them.
//!
//! The exit code is 0 when all is well, 1 when a check failed and 2 for bad input.

#![forbid(unsafe_code)]

mod bench_fold;
mod ci;
mod experiments;
mod export;
mod layers;
mod progress;
mod reach;
mod report;
mod scenes;
mod show;
mod simulators;
mod soak;
mod test;
mod workspace;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

#[derive(Parser)]
#[command(name = "cargo xtask", about, version)]
struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Simulate the folds of a scenario and compare their errors.
    Experiments(experiments::Arguments),
    /// Time the folds of a scenario on one thread.
    BenchFold(bench_fold::Arguments),
    /// Write a moment of a recording, or all of it, as a picture, a film or a mesh.
    Export(export::Arguments),
    /// Make a page with a 3D player of recordings.
    Show(show::Arguments),
    /// Simulate scenes with a known answer and record them.
    Scenes(scenes::Arguments),
    /// Run the folds of a scenario on other people's simulators, from Python, and tabulate them.
    Simulators(simulators::Arguments),
    /// Send poses through the ROS 2 bridge for long, and look at losses, period and memory.
    Soak(soak::Arguments),
    /// Run every test, doctest and example.
    Test(test::Arguments),
    /// Check which crate needs which, and where heavy packages are named.
    Layers,
    /// Run all that CI runs: formatting, lints, layers, licences, documentation, tests.
    Ci,
}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Experiments(arguments) => experiments::run(&arguments),
        Command::BenchFold(arguments) => bench_fold::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Show(arguments) => show::run(&arguments),
        Command::Scenes(arguments) => scenes::run(&arguments),
        Command::Simulators(arguments) => simulators::run(&arguments),
        Command::Soak(arguments) => soak::run(&arguments),
        Command::Test(arguments) => test::run(&arguments),
        Command::Layers => layers::run(),
        Command::Ci => ci::run(),
    };
    result.unwrap_or_else(|error| {
        eprintln!("error: {error:#}");
        ExitCode::from(2)
    })
}
