//! The default solver.

use selvedge_math::{ClothSimulator, DVec3, Held, SimulatorError, StepReport};
use serde::{Deserialize, Serialize};

use crate::{Error, Material, Mesh};

/// What the solver is told next to mesh and material.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Longest substep [s]: a step of `dt` is cut into `ceil(dt / substep)` equal ones.
    pub substep: f64,
    /// Largest edge strain at the end of a substep.
    pub tolerance: f64,
    /// Iterations after which a substep ends whatever its residual.
    pub iterations: u32,
    /// Gravitational acceleration [m/s^2], along -z.
    pub gravity: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            substep: 1.0 / 120.0,
            tolerance: 1e-5,
            iterations: 20,
            gravity: 9.8,
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
        Error::check_positive("iterations", f64::from(self.iterations))?;
        Error::check_not_negative("gravity [m/s^2]", self.gravity)
    }
}

/// An inextensible cloth on the table `z = 0`.
#[derive(Debug)]
pub struct Simulator {
    settings: Settings,
    positions: Vec<DVec3>,
    velocities: Vec<DVec3>,
}

impl Simulator {
    /// A sheet at rest.
    ///
    /// # Errors
    /// [`Error`] when a value is outside its bounds.
    pub fn new(mesh: &Mesh, material: Material, settings: Settings) -> Result<Self, Error> {
        material.check()?;
        settings.check()?;
        Ok(Self {
            settings,
            positions: mesh.rest().to_vec(),
            velocities: vec![DVec3::ZERO; mesh.node_count()],
        })
    }
}

impl ClothSimulator for Simulator {
    fn positions(&self) -> &[DVec3] {
        &self.positions
    }

    fn velocities(&self) -> &[DVec3] {
        &self.velocities
    }

    fn step(&mut self, held: Held<'_>, dt: f64) -> Result<StepReport, SimulatorError> {
        held.check(self.positions.len())?;
        SimulatorError::check_time_step(dt)?;
        for (x, v) in self.positions.iter_mut().zip(&mut self.velocities) {
            v.z -= self.settings.gravity * dt;
            *x += *v * dt;
        }
        for ((&node, &target), &velocity) in
            held.nodes.iter().zip(held.targets).zip(held.velocities)
        {
            self.positions[node as usize] = target;
            self.velocities[node as usize] = velocity;
        }
        Ok(StepReport::default())
    }

    fn reset(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<(), SimulatorError> {
        SimulatorError::check_state(self.positions.len(), positions, velocities)?;
        self.positions.copy_from_slice(positions);
        self.velocities.copy_from_slice(velocities);
        Ok(())
    }
}
