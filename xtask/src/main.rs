//! Selvedge's commands; `cargo xtask help` lists them.

mod experiments;

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
}

fn main() -> ExitCode {
    let result = match Arguments::parse().command {
        Command::Experiments(arguments) => experiments::run(&arguments),
    };
    result.unwrap_or_else(|error| {
        eprintln!("error: {error:#}");
        ExitCode::from(2)
    })
}
