//! What the folds cost, all on the calling thread, and what is got for it.

use std::time::{Duration, Instant};

use crate::fold::Fold;
use crate::table::{numbers, print, texts};
use crate::timing::median;
use crate::worst::{Watch, Worst};
use crate::{Case, Error, Scenario, Solver};

/// A case on a solver, timed.
#[derive(Clone, Debug)]
pub struct BenchRow {
    /// The case.
    pub case: String,
    /// The cloth simulator.
    pub solver: Solver,
    /// Median time of the fold, and how far it strayed from an ideal cloth; or why it failed.
    pub outcome: Result<(Duration, Worst), String>,
}

/// All cases of a scenario, timed.
#[derive(Clone, Debug)]
pub struct Bench {
    /// For each case the solvers.
    pub rows: Vec<BenchRow>,
    /// Steps of a fold.
    pub steps: usize,
    /// Simulated time of a fold [s].
    pub simulated: f64,
}

/// Times every case on each solver, `repeats` times in turn, so that what else the machine does
/// falls on all of them. The time is that of gripper and cloth; nothing is recorded, and looking at
/// the cloth after a step is not counted.
///
/// `observe` is called before each fold with its case, its solver and the repeat from 0.
pub fn bench(
    scenario: &Scenario,
    solvers: &[Solver],
    repeats: usize,
    observe: impl Fn(&Case, Solver, usize),
) -> Bench {
    let on_each = |case| solvers.iter().map(move |&solver| (case, solver));
    let pairs: Vec<(&Case, Solver)> = scenario.cases.iter().flat_map(on_each).collect();
    let mut times = vec![Vec::with_capacity(repeats); pairs.len()];
    let mut worst: Vec<Result<Worst, String>> = vec![Err("not run".to_owned()); pairs.len()];
    for repeat in 0..repeats {
        for (number, &(case, solver)) in pairs.iter().enumerate() {
            observe(case, solver, repeat);
            let result = timed(scenario, case, solver);
            worst[number] = result
                .map(|(time, worst)| {
                    times[number].push(time);
                    worst
                })
                .map_err(|error| error.to_string());
        }
    }
    let rows = pairs.iter().zip(times).zip(worst);
    let rows = rows.map(|((&(case, solver), times), worst)| BenchRow {
        case: case.name.clone(),
        solver,
        outcome: worst.map(|worst| (median(times), worst)),
    });
    Bench {
        rows: rows.collect(),
        steps: scenario.steps,
        simulated: scenario.frame * scenario.steps as f64,
    }
}

fn timed(scenario: &Scenario, case: &Case, solver: Solver) -> Result<(Duration, Worst), Error> {
    let mesh = &scenario.mesh;
    let mut fold = Fold::new(scenario, case, solver)?;
    let mut watch = Watch::new(mesh);
    let mut spent = Duration::ZERO;
    for step in 0..scenario.steps {
        let before = Instant::now();
        let report = fold.step(step)?;
        spent += before.elapsed();
        let (positions, held) = (fold.cloth.positions(), fold.grippers.held());
        watch.see(mesh, scenario.time(step), positions, held, &report);
    }
    Ok((spent, watch.worst))
}

impl Bench {
    /// Simulated time over the time it took, all finished cases of a solver together.
    pub fn real_time_factor(&self, solver: Solver) -> Option<f64> {
        let (mut simulated, mut spent) = (0.0, 0.0);
        for row in self.rows.iter().filter(|row| row.solver == solver) {
            if let Ok((time, _)) = &row.outcome {
                simulated += self.simulated;
                spent += time.as_secs_f64();
            }
        }
        (spent > 0.0).then(|| simulated / spent)
    }

    /// Whether every case ran to the end.
    pub fn complete(&self) -> bool {
        self.rows.iter().all(|row| row.outcome.is_ok())
    }

    /// A line a case and solver.
    pub fn table(&self) -> String {
        let column = |header: &str, cell: &dyn Fn(Duration, &Worst) -> String| {
            let cells = self.rows.iter().map(|row| match &row.outcome {
                Ok((time, worst)) => cell(*time, worst),
                Err(_) => "-".to_owned(),
            });
            numbers(header, cells)
        };
        let percent = |value: f64| format!("{:.4} %", value * 100.0);
        let micrometres = |value: f64| format!("{:.1} um", value * 1e6);
        let measured = |value: Option<String>| value.unwrap_or("-".to_owned());
        let seconds = |time: Duration| time.as_secs_f64();
        print(&[
            texts("Case", self.rows.iter().map(|row| row.case.clone())),
            texts("Solver", self.rows.iter().map(|row| row.solver.to_string())),
            column("ms/step", &|time, _| {
                format!("{:.4}", seconds(time) * 1e3 / self.steps as f64)
            }),
            column("x real time", &|time, _| {
                format!("{:.2}", self.simulated / seconds(time))
            }),
            column("Strain", &|_, worst| percent(worst.strain)),
            column("Strain, rms", &|_, worst| percent(worst.strain_rms)),
            column("Shear", &|_, worst| {
                measured(worst.shear.map(|shear| format!("{shear:.4}")))
            }),
            column("Gap", &|_, worst| measured(worst.gap.map(micrometres))),
            column("Held error", &|_, worst| micrometres(worst.held_error)),
            column("Unconverged", &|_, worst| {
                worst.unconverged_steps.to_string()
            }),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cases_are_rows_and_failures_have_their_reason() {
        let text = include_str!("../../../fixtures/tests/small_fold.toml");
        let scenario = Scenario::parse(text, "small", "small.toml").unwrap();
        let bench = bench(&scenario, &[Solver::Published], 2, |_, _, _| {});
        let names: Vec<&str> = bench.rows.iter().map(|row| row.case.as_str()).collect();
        assert_eq!(names, ["one", "two", "misses"]);
        assert!(!bench.complete());
        let reason = bench.rows[2].outcome.as_ref().unwrap_err();
        assert!(reason.contains("closes on nothing"), "{reason}");
        assert!(bench.real_time_factor(Solver::Published).unwrap() > 0.0);
        assert_eq!(bench.real_time_factor(Solver::Default), None);
        assert_eq!(bench.table().lines().count(), 5);
    }
}
