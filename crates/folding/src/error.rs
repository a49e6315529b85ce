//! What can go wrong between a scenario file and its table.

use std::path::PathBuf;

/// Why a scenario, a case or an experiment failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read or written.
    #[error("{}: {reason}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: std::io::Error,
    },
    /// A file is not TOML, or has a key that is unknown, missing or of another type.
    #[error("{file}: {message}")]
    Syntax {
        /// The file.
        file: String,
        /// What is wrong and where.
        message: String,
    },
    /// A value of a scenario is outside its bounds.
    #[error("{file}: {key} = {value}, must be {bound}")]
    Value {
        /// The file.
        file: String,
        /// The key, with its table.
        key: String,
        /// What was given.
        value: String,
        /// What is allowed.
        bound: String,
    },
    /// A case was asked for that the scenario does not have.
    #[error("case {name} is not in {file}, which has {known}")]
    UnknownCase {
        /// The file.
        file: String,
        /// What was asked for.
        name: String,
        /// The cases there are.
        known: String,
    },
    /// The jaws closed and no node, edge centre or face centre was in the volume.
    #[error(
        "gripper {gripper} closes on nothing at t = {time} s: the node nearest to the middle of \
         its volume is {nearest}, {distance:.4} m away"
    )]
    Empty {
        /// Which gripper, from 1.
        gripper: usize,
        /// When [s].
        time: f64,
        /// The nearest node.
        nearest: usize,
        /// Its distance [m].
        distance: f64,
    },
    /// The jaws closed on nodes that another gripper holds, and on no other.
    #[error(
        "gripper {gripper} closes at t = {time} s on nodes that another gripper holds, and on no \
         other: {nodes:?}"
    )]
    Taken {
        /// Which gripper, from 1.
        gripper: usize,
        /// When [s].
        time: f64,
        /// The nodes it was refused.
        nodes: Vec<u32>,
    },
    /// The gripper refused a command.
    #[error("the gripper failed at t = {time} s: {reason}")]
    Gripper {
        /// When [s].
        time: f64,
        /// Why.
        reason: selvedge_grasp::Error,
    },
    /// The cloth failed.
    #[error("the cloth failed at t = {time} s: {reason}")]
    Simulator {
        /// When [s].
        time: f64,
        /// Why.
        reason: selvedge_math::SimulatorError,
    },
    /// The default solver refused the cloth.
    #[error(transparent)]
    Cloth(#[from] selvedge_cloth::Error),
    /// The published scheme refused the cloth.
    #[error(transparent)]
    Published(#[from] selvedge_published::Error),
    /// A recording could not be made or written.
    #[error(transparent)]
    View(#[from] selvedge_view::Error),
    /// A command log could not be written.
    #[error(transparent)]
    Trajectory(#[from] selvedge_trajectory::Error),
    /// A case cannot follow a log.
    #[error("{case} cannot follow the log: {reason}")]
    Follow {
        /// The case.
        case: String,
        /// Why.
        reason: String,
    },
    /// Somebody asked to stop.
    #[error("stopped on request")]
    Stopped,
}
