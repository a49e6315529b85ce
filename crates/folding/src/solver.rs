//! The simulators that a scenario can be run on.

use selvedge_math::{ClothSimulator, DVec3};
use serde::Serialize;

use crate::{Error, Scenario};

/// Which cloth simulator runs the fold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Solver {
    /// The scheme of the paper's table, defects included.
    Published,
}

impl Solver {
    /// Its name, also that of its folder.
    pub fn name(self) -> &'static str {
        match self {
            Self::Published => "published",
        }
    }

    /// The scenario's cloth at rest.
    ///
    /// # Errors
    /// [`Error::Published`] when the solver refuses the cloth.
    pub fn build(self, scenario: &Scenario) -> Result<Box<dyn ClothSimulator + Send>, Error> {
        match self {
            Self::Published => Ok(Box::new(selvedge_published::Simulator::new(
                &scenario.mesh,
                scenario.material,
                scenario.published,
            )?)),
        }
    }

    /// The positions that a closing gripper stores, where they are not those of the nodes: the
    /// original reads the cloth through a smoother.
    pub(crate) fn anchors(self, scenario: &Scenario, positions: &[DVec3]) -> Option<Vec<DVec3>> {
        match self {
            Self::Published => Some(selvedge_published::smoothed(&scenario.mesh, positions)),
        }
    }

    /// Substeps in a step.
    pub fn substeps(self, scenario: &Scenario) -> u32 {
        match self {
            Self::Published => scenario.published.substeps,
        }
    }
}
