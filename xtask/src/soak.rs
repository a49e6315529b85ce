//! A long stream of poses through the ROS 2 bridge, by its example `soak`.

use std::process::ExitCode;

use anyhow::{Result, ensure};

use crate::test::python_environment;
use crate::workspace::{self, command, succeed};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// How long.
    #[arg(long, default_value_t = 10.0)]
    minutes: f64,
    /// Poses a second.
    #[arg(long, default_value_t = 250.0)]
    rate: f64,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let Arguments { minutes, rate } = *arguments;
    let within = |value: f64, most: f64| value > 0.0 && value <= most;
    ensure!(
        within(minutes, 1440.0),
        "--minutes is {minutes}, must be above 0 and at most 1440"
    );
    ensure!(
        within(rate, 1000.0),
        "--rate is {rate}, must be above 0 and at most 1000"
    );
    let metadata = workspace::load()?;
    let python = python_environment(&metadata)?;
    let example = "run --quiet --release -p selvedge-ros2 --example soak --";
    let mut soak = command(&metadata, "cargo", example);
    soak.args([minutes, rate].map(|number| number.to_string()));
    succeed(soak.env("SELVEDGE_PYTHON", python))?;
    Ok(ExitCode::SUCCESS)
}
