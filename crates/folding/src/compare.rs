//! Finished folds against the ideal one.

use selvedge_math::DVec3;

use crate::ensemble::Ensemble;
use crate::expected::Expected;
use crate::table::{Measured, Row};
use crate::{Case, Experiment, Run, Scenario, Solver, fold_error, half_fold};

/// What became of the folds of an experiment.
pub(crate) struct Results<'a> {
    pub(crate) scenario: &'a Scenario,
    pub(crate) pairs: &'a [(&'a Case, Solver)],
    /// One a pair.
    pub(crate) runs: Vec<Result<Run, String>>,
    /// The last positions of the ensembles' members: the first of each pair, the second, ...
    pub(crate) ends: Vec<Result<Vec<DVec3>, String>>,
}

pub(crate) fn compare(results: &Results<'_>, expected: &Expected) -> Experiment {
    let ideal = results.ideal();
    let diagonal = results.scenario.mesh.diagonal();
    let rows = results.pairs.iter().zip(&results.runs).enumerate();
    let rows = rows.map(|(number, (&(case, solver), result))| {
        let measured = result.as_ref().map_err(String::clone).map(|run| {
            let end = last_positions(run);
            let held = run.support.iter().flatten();
            let mut support: Vec<u32> = held.map(|&(node, _)| node).collect();
            support.sort_unstable();
            let reference = results.reference(number, &ideal);
            Measured {
                support,
                error: reference.map(|reference| fold_error(end, reference, diagonal)),
                ensemble: reference.and_then(|reference| results.ensemble(number, reference)),
                half_fold_error: fold_error(end, &ideal, diagonal),
                worst: run.worst.clone(),
                refused: run.refused.clone(),
                overstretched: run.overstretch.is_some(),
            }
        });
        let timing = result.as_ref().ok().and_then(|run| run.timing);
        (Row::new(case, solver, expected, measured), timing)
    });
    Experiment {
        rows: rows.collect(),
    }
}

/// `E(t)` of every finished case from the first step on, all cases of a solver together.
pub(crate) fn curves(results: &Results<'_>, solvers: &[Solver]) -> Vec<(String, Vec<(f64, f64)>)> {
    let ideal = results.ideal();
    let mut curves = Vec::new();
    for &wanted in solvers {
        for (number, &(case, solver)) in results.pairs.iter().enumerate() {
            if solver == wanted
                && let Some(points) = results.curve(number, &ideal)
            {
                curves.push((format!("{} {solver}", case.name), points));
            }
        }
    }
    curves
}

impl Results<'_> {
    /// `E(t)` of a pair; none if it or its reference failed.
    pub(crate) fn curve(&self, number: usize, ideal: &[DVec3]) -> Option<Vec<(f64, f64)>> {
        let run = self.runs[number].as_ref().ok()?;
        let reference = self.reference(number, ideal)?;
        let diagonal = self.scenario.mesh.diagonal();
        let frames = run.recording.times().iter().enumerate();
        let error = |row| fold_error(run.recording.positions(row), reference, diagonal);
        Some(frames.map(|(row, &time)| (time, error(row))).collect())
    }

    /// The analytic half fold.
    pub(crate) fn ideal(&self) -> Vec<DVec3> {
        half_fold(&self.scenario.mesh, self.scenario.material.thickness)
    }

    /// What a pair is measured against: the end of its reference case on the same solver, or the
    /// analytic half fold.
    pub(crate) fn reference<'a>(
        &'a self,
        number: usize,
        ideal: &'a [DVec3],
    ) -> Option<&'a [DVec3]> {
        let (case, solver) = self.pairs[number];
        let Some(name) = &case.reference else {
            return Some(ideal);
        };
        let is_it = |&(case, on): &(&Case, Solver)| case.name == *name && on == solver;
        let index = self.pairs.iter().position(is_it)?;
        self.runs[index].as_ref().ok().map(last_positions)
    }

    /// The errors of a pair's ensemble; none if it has no members.
    fn ensemble(&self, number: usize, reference: &[DVec3]) -> Option<Ensemble> {
        let diagonal = self.scenario.mesh.diagonal();
        let members = self.ends.iter().skip(number).step_by(self.pairs.len());
        let mut ensemble = Ensemble::default();
        for end in members {
            match end {
                Ok(end) => ensemble.errors.push(fold_error(end, reference, diagonal)),
                Err(reason) => {
                    ensemble.failures += 1;
                    ensemble.reason.get_or_insert_with(|| reason.clone());
                }
            }
        }
        ensemble.errors.sort_by(f64::total_cmp);
        (!self.ends.is_empty()).then_some(ensemble)
    }
}

fn last_positions(run: &Run) -> &[DVec3] {
    run.recording.positions(run.recording.frame_count() - 1)
}
