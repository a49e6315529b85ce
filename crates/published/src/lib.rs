#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod constraints;
mod contact;
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
    /// The material cannot be used, or a matrix could not be factored.
    #[error(transparent)]
    Cloth(#[from] selvedge_cloth::Error),
    /// A position became infinite or not a number.
    #[error("the cloth diverged: node {node} has no finite position")]
    Diverged {
        /// The first such node.
        node: usize,
    },
}
