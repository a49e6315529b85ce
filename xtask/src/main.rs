//! The project's own commands: `cargo xtask --help`.
//!
//! The exit code is 0 when all is well, 1 when a check failed and 2 for bad input.

#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::Parser;

mod ci;
mod layers;
mod report;
mod test;
mod workspace;

#[derive(Parser)]
#[command(bin_name = "cargo xtask", about = "The project's own commands")]
enum Xtask {
    /// Check the arrows between the crates and what they may depend on
    Layers,
    /// Run every test, doctest and example
    Test(test::Arguments),
    /// Run all that CI runs: the tests, formatting, lints, docs, layers, licences, advisories
    Ci,
}

fn main() -> ExitCode {
    let result = match Xtask::parse() {
        Xtask::Layers => layers::run(),
        Xtask::Test(arguments) => test::run(&arguments),
        Xtask::Ci => ci::run(),
    };
    result.unwrap_or_else(|error| {
        eprintln!("error: {error:#}");
        ExitCode::from(2)
    })
}
