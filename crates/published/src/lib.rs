#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod constraints;
mod contact;
mod operators;
mod predictor;
mod search;
mod simulator;
mod smooth;

pub use simulator::{Settings, Simulator};
pub use smooth::smoothed;

/// Why the scheme refused its input or failed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A setting or the material cannot be used, or a matrix could not be factored.
    #[error(transparent)]
    Cloth(#[from] selvedge_cloth::Error),
    /// A position became infinite or not a number.
    #[error("the cloth diverged: node {node} has no finite position")]
    Diverged {
        /// The first such node.
        node: usize,
    },
}
