//! What the solver is told.

use serde::{Deserialize, Serialize};

use crate::Error;

/// What the solver is told next to mesh and material.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Longest substep [s]: a step of `dt` is cut into `ceil(dt / substep)` equal ones.
    pub substep: f64,
    /// Largest edge strain at the end of a substep, that by tension apart; edges with a node that sticks to
    /// a surface may have 1.8 times as much.
    pub tolerance: f64,
    /// The iterations of a substep have converged when the last one moved no node further [m].
    pub settled: f64,
    /// Iterations after which a substep ends whatever its residual.
    pub iterations: u32,
    /// Gravitational acceleration [m/s^2], along -z.
    pub gravity: f64,
    /// Whether the half space below `z = 0` is a table.
    pub table: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            substep: 1.0 / 120.0,
            tolerance: 5e-5,
            settled: 3e-5,
            iterations: 20,
            gravity: 9.8,
            table: true,
        }
    }
}

impl Settings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Value`] names the first field outside its bounds.
    pub fn check(&self) -> Result<(), Error> {
        Error::check_positive("substep [s]", self.substep)?;
        Error::check_positive("tolerance", self.tolerance)?;
        Error::check_positive("settled [m]", self.settled)?;
        Error::check_positive("iterations", f64::from(self.iterations))?;
        Error::check_not_negative("gravity [m/s^2]", self.gravity)
    }
}
