//! The table: one row a case and solver.

mod csv;
mod text;

use selvedge_grasp::Shape;

pub(crate) use csv::{write_csv, write_timings};
pub use text::terminal;
pub(crate) use text::{columns, markdown, numbers, print, texts};

use crate::ensemble::Ensemble;
use crate::expected::Expected;
use crate::{Case, Solver, Worst};

/// One row: what a case grasped and how far its end is from the ideal fold.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The case.
    pub case: String,
    /// What it ran on.
    pub solver: Solver,
    /// The grasping volume of each gripper.
    pub volumes: Vec<Shape>,
    /// How far each gripper turns on its way [rad].
    pub rotations: Vec<f64>,
    /// The error that the paper prints, if it does and the row is of its own scheme.
    pub published: Option<f64>,
    /// The case whose end is the ideal fold; none for the analytic half fold.
    pub reference: Option<String>,
    /// What came out, or why nothing did.
    pub outcome: Result<Measured, String>,
}

/// The numbers of a finished case; lengths in metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// The nodes held, all grippers together, ascending.
    pub support: Vec<u32>,
    /// Folding error at the end against the end of the reference case on the same solver; none if
    /// that failed.
    pub error: Option<f64>,
    /// Errors of the case's ensemble against the same reference, if it has one.
    pub ensemble: Option<Ensemble>,
    /// Folding error at the end against the analytic half fold.
    pub half_fold_error: f64,
    /// How far it strayed from an ideal cloth.
    pub worst: Worst,
    /// Nodes that a gripper closed on while another one held them, ascending.
    pub refused: Vec<u32>,
    /// Whether held nodes were commanded further apart than the cloth is long.
    pub overstretched: bool,
}

impl Row {
    pub(crate) fn new(
        case: &Case,
        solver: Solver,
        expected: &Expected,
        outcome: Result<Measured, String>,
    ) -> Self {
        let published = match solver {
            Solver::Published => expected.error.get(&case.name).copied(),
            Solver::Default => None,
        };
        Self {
            case: case.name.clone(),
            solver,
            volumes: case
                .grippers
                .iter()
                .map(|plan| plan.gripper.volume().shape())
                .collect(),
            rotations: case.grippers.iter().map(|plan| plan.rotation).collect(),
            reference: case.reference.clone(),
            published,
            outcome,
        }
    }

    /// Why the row has no error: the case failed, or its reference did.
    pub fn failure(&self) -> Option<String> {
        match &self.outcome {
            Err(reason) => Some(reason.clone()),
            Ok(Measured { error: None, .. }) => {
                let name = self.reference.as_deref().unwrap_or_default();
                Some(format!("its reference {name} failed"))
            }
            Ok(_) => None,
        }
    }

    /// The case's ensemble, if it ran and has one.
    pub fn ensemble(&self) -> Option<&Ensemble> {
        self.outcome.as_ref().ok()?.ensemble.as_ref()
    }

    /// Our error minus the one that the paper prints, for its own scheme only.
    pub fn difference(&self) -> Option<f64> {
        Some(self.outcome.as_ref().ok()?.error? - self.published?)
    }

    fn volume(&self) -> String {
        let name = |shape: &Shape| match shape {
            Shape::Box { .. } => "box",
            Shape::Pyramid { .. } => "pyramid",
        };
        let names: Vec<&str> = self.volumes.iter().map(name).collect();
        names.join(" + ")
    }

    fn orientation(&self) -> String {
        let name = |&angle: &f64| match angle.abs() < 1e-9 {
            true => "kept".to_owned(),
            false => format!("turns {:.0} deg", angle.to_degrees()),
        };
        let names: Vec<String> = self.rotations.iter().map(name).collect();
        names.join(" + ")
    }
}

/// Nodes with spaces between.
fn node_text(nodes: &[u32]) -> String {
    let nodes: Vec<String> = nodes.iter().map(u32::to_string).collect();
    nodes.join(" ")
}
