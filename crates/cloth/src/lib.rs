#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod bending;
mod broad;
mod contact;
mod distance;
mod hands;
pub mod linear;
mod material;
mod mesh;
mod nodes;
mod obstacle;
mod pairs;
mod predictor;
mod project;
mod rows;
mod settings;
mod shape;
mod simulator;
mod solid;
mod star;
mod state;
mod substep;
mod support;
mod surroundings;
mod touch;

pub use material::Material;
pub use mesh::{Grid, Mesh};
pub use obstacle::Obstacle;
pub use project::{Projected, Projection, project};
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
    /// A number of one node is outside its bounds.
    #[error("node {node}: {field} is {value}, must be {bound}")]
    Node {
        /// The node.
        node: usize,
        /// The field, with its unit.
        field: &'static str,
        /// What was given.
        value: f64,
        /// What is allowed.
        bound: &'static str,
    },
    /// There is not one value for each node.
    #[error("{given} {field} given, must be {wanted}, one a node")]
    Count {
        /// What was given.
        field: &'static str,
        /// How many were given.
        given: usize,
        /// The number of nodes.
        wanted: usize,
    },
    /// A file could not be read.
    #[error("{}: {message}", path.display())]
    File {
        /// The file.
        path: std::path::PathBuf,
        /// What the system says.
        message: String,
    },
    /// A cloth cannot have such a mesh.
    #[error("{place}: {what}, must be {bound}")]
    Mesh {
        /// The file and its line, or the node or face.
        place: String,
        /// What was found there, with its value.
        what: String,
        /// What is allowed.
        bound: String,
    },
    /// Something is known for rectangular grids only.
    #[error("the mesh is no grid, as Mesh::grid makes it, which {0} needs")]
    NoGrid(&'static str),
    /// No positions were found that keep the constraints.
    #[error(
        "no positions found that keep the constraints: {what} is off by {miss:.3e} m, \
         a node out of balance by {imbalance:.3e} m, must be at most {max:e} m",
        max = Projected::TOLERANCE
    )]
    Unreachable {
        /// The constraint that is off furthest.
        what: String,
        /// How far [m].
        miss: f64,
        /// How far a node is from where the forces on it are in balance [m].
        imbalance: f64,
    },
    /// A sheet needs at least one quad, and its nodes must fit into memory.
    #[error("grid has {0} x {1} nodes, must be at least 2 x 2 and at most {max} in all", max = Mesh::MAX_NODES)]
    GridSize(usize, usize),
    /// A matrix could not be analysed or factored.
    #[error("a matrix could not be factored: {0}")]
    Factorisation(String),
    /// The threads cannot be started.
    #[error("threads: {0}")]
    Threads(String),
    /// A node index is out of range.
    #[error("node {node} must be below the node count {node_count}")]
    NoSuchNode {
        /// The index.
        node: u32,
        /// The number of nodes of the cloth.
        node_count: usize,
    },
    /// There is no such obstacle.
    #[error("obstacle {obstacle} must be below the number of obstacles, {count}")]
    NoSuchObstacle {
        /// The number.
        obstacle: usize,
        /// How many there are.
        count: usize,
    },
    /// A body cannot be an obstacle.
    #[error("obstacle: {what}, must be {bound}")]
    Obstacle {
        /// What was found, with its value.
        what: String,
        /// What is allowed.
        bound: &'static str,
    },
    /// More features are near each other than a cloth of this size can have, or their ways are not finite.
    #[error(
        "the cloth has collapsed: too many of its faces are in one place, or go nowhere finite"
    )]
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
