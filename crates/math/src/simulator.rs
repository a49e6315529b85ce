//! What a cloth simulator must offer to be driven by a gripper.

use alloc::boxed::Box;
use core::error::Error;
use core::fmt;

use glam::DVec3;

use crate::{Held, HeldError};

/// A cloth simulator: node positions and velocities out, held nodes in.
///
/// How the held nodes reach their targets (projection, spring, equality rows) is the simulator's
/// choice. The trait is object-safe.
///
/// ```
/// use selvedge_math::{ClothSimulator, DVec3, Held, SimulatorError, StepReport};
///
/// /// Nodes that stay where they are unless they are held.
/// struct Frozen { positions: Vec<DVec3>, velocities: Vec<DVec3> }
///
/// impl ClothSimulator for Frozen {
///     fn positions(&self) -> &[DVec3] { &self.positions }
///     fn velocities(&self) -> &[DVec3] { &self.velocities }
///     fn step(&mut self, held: Held<'_>, _dt: f64) -> Result<StepReport, SimulatorError> {
///         held.check(self.positions.len())?;
///         for (&node, &target) in held.nodes.iter().zip(held.targets) {
///             self.positions[node as usize] = target;
///         }
///         Ok(StepReport::default())
///     }
///     fn reset(&mut self, x: &[DVec3], v: &[DVec3]) -> Result<(), SimulatorError> {
///         SimulatorError::check_state(self.positions.len(), x, v)?;
///         self.positions.copy_from_slice(x);
///         self.velocities.copy_from_slice(v);
///         Ok(())
///     }
/// }
/// let mut cloth = Frozen { positions: vec![DVec3::ZERO], velocities: vec![DVec3::ZERO] };
/// let held = Held { nodes: &[0], targets: &[DVec3::Z], velocities: &[DVec3::ZERO] };
/// cloth.step(held, 1.0 / 60.0)?;
/// assert_eq!(cloth.positions(), [DVec3::Z]);
/// # Ok::<(), SimulatorError>(())
/// ```
pub trait ClothSimulator {
    /// Node positions [m], world frame, one a node.
    fn positions(&self) -> &[DVec3];

    /// Node velocities [m/s], world frame, one a node.
    fn velocities(&self) -> &[DVec3];

    /// Advances by `dt` [s], the period of the commands; substeps are the simulator's own affair.
    ///
    /// # Errors
    /// [`SimulatorError`] when the input cannot be used or the step fails; the state is then as it
    /// was before the call.
    fn step(&mut self, held: Held<'_>, dt: f64) -> Result<StepReport, SimulatorError>;

    /// Starts anew from the given positions [m] and velocities [m/s], forgetting everything else.
    ///
    /// # Errors
    /// [`SimulatorError`] when a length is wrong or a value is not finite; nothing changes then.
    fn reset(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<(), SimulatorError>;
}

/// How one step went.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepReport {
    /// Whether every solve of the step reached its tolerance.
    pub status: Status,
    /// Constraint iterations, summed over the substeps.
    pub iterations: u32,
    /// Cloth-cloth contacts that were active at the end of the step.
    pub contacts: u32,
    /// Largest distance between a held node and its target at the end of the step [m].
    pub held_error: f64,
    /// Largest edge strain `|length/rest - 1|` at the end of any substep, if it was measured.
    pub strain: Option<f64>,
    /// Largest sine of the angle that a face is sheared by, at the end of any substep, if it was
    /// measured.
    pub shear: Option<f64>,
    /// Smallest distance between two layers, or a layer and an obstacle, less what it must be, at
    /// the end of any substep [m]; none when it was not measured or nothing is near.
    pub gap: Option<f64>,
}

/// How the solves of a step ended.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Status {
    /// Within tolerance.
    #[default]
    Converged,
    /// The iteration limit was reached first.
    IterationLimit {
        /// The largest residual left, in the units of `tolerance`.
        residual: f64,
        /// The tolerance that was asked for.
        tolerance: f64,
    },
}

/// Why a simulator refused or failed a step.
#[derive(Debug)]
#[non_exhaustive]
pub enum SimulatorError {
    /// The held nodes cannot be used.
    Held(HeldError),
    /// The time step is not a positive finite number.
    TimeStep(f64),
    /// A state with the wrong number of entries was given.
    StateLength {
        /// Nodes of the cloth.
        node_count: usize,
        /// Positions given.
        positions: usize,
        /// Velocities given.
        velocities: usize,
    },
    /// A position or velocity is infinite or not a number.
    NotFinite {
        /// The node.
        node: usize,
    },
    /// The step itself failed, for the simulator's own reason.
    Failed(Box<dyn Error + Send + Sync>),
}

impl SimulatorError {
    /// Checks a time step [s].
    ///
    /// # Errors
    /// [`SimulatorError::TimeStep`] unless `dt` is positive and finite.
    pub fn check_time_step(dt: f64) -> Result<(), Self> {
        if dt > 0.0 && dt.is_finite() {
            Ok(())
        } else {
            Err(Self::TimeStep(dt))
        }
    }

    /// Checks a state for a cloth of `node_count` nodes.
    ///
    /// # Errors
    /// [`SimulatorError::StateLength`] or [`SimulatorError::NotFinite`].
    pub fn check_state(
        node_count: usize,
        positions: &[DVec3],
        velocities: &[DVec3],
    ) -> Result<(), Self> {
        if positions.len() != node_count || velocities.len() != node_count {
            return Err(Self::StateLength {
                node_count,
                positions: positions.len(),
                velocities: velocities.len(),
            });
        }
        match positions
            .iter()
            .zip(velocities)
            .position(|(x, v)| !x.is_finite() || !v.is_finite())
        {
            Some(node) => Err(Self::NotFinite { node }),
            None => Ok(()),
        }
    }
}

impl From<HeldError> for SimulatorError {
    fn from(error: HeldError) -> Self {
        Self::Held(error)
    }
}

impl fmt::Display for SimulatorError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Held(error) => error.fmt(f),
            Self::TimeStep(dt) => write!(f, "time step {dt} s must be positive and finite"),
            Self::StateLength {
                node_count,
                positions,
                velocities,
            } => write!(
                f,
                "state must have one entry for each of the {node_count} nodes, got {positions} \
                 positions and {velocities} velocities"
            ),
            Self::NotFinite { node } => {
                write!(f, "position and velocity of node {node} must be finite")
            }
            Self::Failed(error) => error.fmt(f),
        }
    }
}

impl Error for SimulatorError {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        match self {
            // Their own text is that of this error.
            Self::Held(error) => error.source(),
            Self::Failed(error) => error.source(),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use alloc::string::ToString;

    use super::*;

    #[test]
    fn the_trait_is_object_safe_and_errors_travel() {
        fn takes(_: Option<&mut dyn ClothSimulator>) {}
        takes(None);
        fn sends<T: Send + Sync + 'static>(_: T) {}
        sends(SimulatorError::TimeStep(0.0));
    }

    #[test]
    fn bad_states_are_named() {
        let x = [DVec3::ZERO, DVec3::NAN];
        let v = [DVec3::ZERO; 2];
        let error = SimulatorError::check_state(2, &x, &v).unwrap_err();
        assert_eq!(
            error.to_string(),
            "position and velocity of node 1 must be finite"
        );
        let error = SimulatorError::check_state(3, &x, &v).unwrap_err();
        assert!(error.to_string().contains("each of the 3 nodes"));
        for dt in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(SimulatorError::check_time_step(dt).is_err());
        }
    }
}
