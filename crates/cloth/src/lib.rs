#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod bending;
mod broad;
mod contact;
mod distance;
pub mod linear;
mod material;
mod mesh;
mod nodes;
mod predictor;
mod rows;
mod settings;
mod simulator;
mod state;
mod substep;
mod support;

pub use material::Material;
pub use mesh::{Grid, Mesh};
pub use settings::Settings;
pub use simulator::Simulator;
pub use state::State;

/// Squeezed edges get their length back within this time after their release [s].
pub const RECOVERY: f64 = 0.5;

/// Why a mesh or a material was refused.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A number is outside its bounds.
    #[error("{field} is {value}, must be {bound}")]
    Value {
        /// The field, with its unit.
        field: &'static str,
        /// What was given.
        value: f64,
        /// What is allowed.
        bound: &'static str,
    },
    /// A sheet needs at least one quad, and its nodes must fit into memory.
    #[error("grid has {0} x {1} nodes, must be at least 2 x 2 and at most {max} in all", max = Mesh::MAX_NODES)]
    GridSize(usize, usize),
    /// A matrix could not be analysed or factored.
    #[error("a matrix could not be factored: {0}")]
    Factorisation(String),
    /// A node index is out of range.
    #[error("node {node} must be below the node count {node_count}")]
    Node {
        /// The index.
        node: u32,
        /// The number of nodes of the cloth.
        node_count: usize,
    },
    /// A position became infinite or not a number.
    #[error("the cloth diverged")]
    Diverged,
    /// More features are near each other than a cloth of this size can have.
    #[error("the cloth has collapsed: too many of its faces are in one place")]
    Crowded,
}

impl Error {
    /// Checks that a value is above zero.
    ///
    /// # Errors
    /// [`Error::Value`] with the field's name if it is not, or not finite.
    pub fn check_positive(field: &'static str, value: f64) -> Result<(), Self> {
        if value > 0.0 && value.is_finite() {
            Ok(())
        } else {
            Err(Self::Value {
                field,
                value,
                bound: "positive and finite",
            })
        }
    }

    /// Checks that a value is not below zero.
    ///
    /// # Errors
    /// [`Error::Value`] with the field's name if it is, or not finite.
    pub fn check_not_negative(field: &'static str, value: f64) -> Result<(), Self> {
        if value >= 0.0 && value.is_finite() {
            Ok(())
        } else {
            Err(Self::Value {
                field,
                value,
                bound: "at least 0 and finite",
            })
        }
    }
}
