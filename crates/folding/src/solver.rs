//! The simulators that a scenario can be run on.

use std::fmt;

use selvedge_math::{ClothSimulator, DVec3};
use serde::Serialize;
use serde_json::{Value, json};

use crate::{Error, Scenario};

/// A substep that is longer by rounding only is not cut in two.
const ROUNDED: f64 = 1e-9;

/// Which cloth simulator runs the fold.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Solver {
    /// The scheme of the paper's table, defects included.
    Published,
    /// The inextensible cloth.
    Default,
}

impl Solver {
    /// Its name, also that of its folder.
    pub fn name(self) -> &'static str {
        match self {
            Self::Published => "published",
            Self::Default => "default",
        }
    }

    /// The scenario's cloth at rest.
    ///
    /// # Errors
    /// [`Error::Published`] or [`Error::Cloth`] when the solver refuses the cloth.
    pub fn build(self, scenario: &Scenario) -> Result<Box<dyn ClothSimulator + Send>, Error> {
        let (mesh, material) = (&scenario.mesh, scenario.material);
        Ok(match self {
            Self::Published => Box::new(selvedge_published::Simulator::new(
                mesh,
                material,
                scenario.published,
            )?),
            Self::Default => Box::new(selvedge_cloth::Simulator::new(
                mesh,
                material,
                scenario.default,
            )?),
        })
    }

    /// The positions that a closing gripper stores, where they are not those of the nodes: the
    /// original reads the cloth through a smoother.
    pub fn anchors(self, scenario: &Scenario, positions: &[DVec3]) -> Option<Vec<DVec3>> {
        match self {
            Self::Published => Some(selvedge_published::smoothed(&scenario.mesh, positions)),
            Self::Default => None,
        }
    }

    /// Substeps in a step.
    pub fn substeps(self, scenario: &Scenario) -> u32 {
        match self {
            Self::Published => scenario.published.substeps,
            Self::Default => {
                let number = scenario.frame / scenario.default.substep;
                (number - ROUNDED).ceil().max(1.0) as u32
            }
        }
    }

    /// What a recording says of the solver: settings, tolerance, and the material as far as the
    /// solver uses it.
    pub(crate) fn meta(self, scenario: &Scenario) -> (Value, f64, Value) {
        let mut material = json!(scenario.material);
        match self {
            Self::Published => {
                if let Some(fields) = material.as_object_mut() {
                    fields.remove("shear");
                    fields.remove("internal_damping");
                }
                let settings = scenario.published;
                (json!(settings), settings.tolerance, material)
            }
            Self::Default => {
                let settings = scenario.default;
                (json!(settings), settings.tolerance, material)
            }
        }
    }
}

impl fmt::Display for Solver {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}
