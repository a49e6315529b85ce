//! Steps that run one after another, whatever becomes of the earlier ones, and the table of how
//! they ended.

use std::fmt::Display;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::Result;

/// How a step ended when it did not fail.
pub(crate) enum Outcome {
    Passed,
    Skipped(String),
}

/// What the machine lacks is skipped by name, but in CI it is an error.
pub(crate) fn lacking(reason: impl Display) -> Result<Outcome> {
    let in_ci = std::env::var_os("CI").is_some_and(|value| value == "true");
    anyhow::ensure!(!in_ci, "{reason}");
    Ok(Outcome::Skipped(reason.to_string()))
}

struct Row {
    name: String,
    result: Result<Outcome>,
    time: Duration,
}

#[derive(Default)]
pub(crate) struct Report {
    rows: Vec<Row>,
}

impl Report {
    pub(crate) fn step(&mut self, name: &str, step: impl FnOnce() -> Result<Outcome>) {
        println!("\n== {name}");
        let start = Instant::now();
        let result = step();
        self.rows.push(Row {
            name: name.to_owned(),
            result,
            time: start.elapsed(),
        });
    }

    /// Prints the table; the exit code is 1 when a step failed.
    pub(crate) fn finish(&self) -> ExitCode {
        print!("\n{}", self.table());
        ExitCode::from(u8::from(self.failed()))
    }

    fn failed(&self) -> bool {
        self.rows.iter().any(|row| row.result.is_err())
    }

    fn table(&self) -> String {
        let width = self.rows.iter().map(|row| row.name.len()).max();
        let width = width.unwrap_or_default();
        let line = |row: &Row| {
            let (word, reason) = match &row.result {
                Ok(Outcome::Passed) => ("ok", String::new()),
                Ok(Outcome::Skipped(reason)) => ("skipped", format!("  {reason}")),
                Err(error) => ("FAILED", format!("  {error:#}")),
            };
            let seconds = row.time.as_secs_f64();
            format!("{:width$}  {word:7} {seconds:7.1} s{reason}\n", row.name)
        };
        self.rows.iter().map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_step_runs_and_one_failure_fails_the_whole() {
        let mut report = Report::default();
        report.step("lint", || Ok(Outcome::Passed));
        report.step("advisories", || Ok(Outcome::Skipped("no network".into())));
        assert!(!report.failed());
        report.step("docs", || anyhow::bail!("cargo: exit status: 101"));
        report.step("tests", || Ok(Outcome::Passed));
        assert!(report.failed());
        let expected = "\
lint        ok          0.0 s
advisories  skipped     0.0 s  no network
docs        FAILED      0.0 s  cargo: exit status: 101
tests       ok          0.0 s
";
        assert_eq!(report.table(), expected);
    }
}
