#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod constraints;
mod contact;
mod linear;
mod operators;
mod predictor;
mod simulator;
mod smooth;

pub use simulator::{Settings, Simulator};
pub use smooth::smoothed;

/// Why the scheme refused its input or failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting is outside its bounds.
    #[error("{field} is {value}, must be {bound}")]
    Value {
        /// The setting, with its unit.
        field: &'static str,
        /// What was given.
        value: f64,
        /// What is allowed.
        bound: &'static str,
    },
    /// The material cannot be used.
    #[error(transparent)]
    Cloth(#[from] selvedge_cloth::Error),
    /// A matrix could not be factored; the positions are far from any cloth.
    #[error("a matrix of the cloth could not be factored: {0}")]
    Factorisation(String),
    /// A position became infinite or not a number.
    #[error("the cloth diverged: node {node} has no finite position")]
    Diverged {
        /// The first such node.
        node: usize,
    },
}
