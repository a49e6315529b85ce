//! Why a gripper cannot be made, or a step cannot be taken.

use alloc::boxed::Box;
use core::fmt;

use selvedge_math::{DVec3, HeldError};

/// Why a gripper cannot be made or a step cannot be taken. A step that fails changes nothing.
///
/// ```
/// use selvedge_grasp::Error;
/// let text = Error::Amount(1.5).to_string();
/// assert_eq!(text, "squeeze amount 1.5 must be between 0 and 1");
/// ```
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Error {
    /// A side of a volume is not positive and finite.
    Size {
        /// Which side.
        field: &'static str,
        /// What was given \[m\].
        value: f64,
    },
    /// The height of a pyramid \[m\] is zero or not finite.
    Height(f64),
    /// The offset of a volume \[m\] is not finite.
    Offset(DVec3),
    /// The squeeze amount is not between 0 and 1.
    Amount(f64),
    /// The squeeze lift \[m\] is negative or not finite.
    Lift(f64),
    /// The squeeze is spread over no steps.
    Steps,
    /// The time step \[s\], or its inverse, is not positive and finite.
    TimeStep(f64),
    /// The given `alpha` is not between 0 and 1.
    Alpha(f64),
    /// The commanded position \[m\] is not finite.
    Pose(DVec3),
    /// The position of a node, or its distance to the gripper, is not finite.
    Position {
        /// The node.
        node: usize,
        /// Its position \[m\].
        position: DVec3,
    },
    /// The anchor of a node that was captured is not finite.
    Anchor {
        /// The node.
        node: u32,
        /// Its anchor \[m\].
        position: DVec3,
    },
    /// There is not one anchor a node.
    AnchorCount {
        /// Anchors given.
        anchors: usize,
        /// Nodes of the cloth.
        node_count: usize,
    },
    /// An edge or a face names a node that does not exist.
    NodeOutOfRange {
        /// `"edge"`, `"quad"` or `"triangle"`.
        element: &'static str,
        /// Which one, counted from 0.
        number: usize,
        /// The node it names.
        node: u32,
        /// Nodes of the cloth.
        node_count: usize,
    },
    /// A held node is no longer a node of the cloth.
    HeldNodeGone {
        /// The node.
        node: u32,
        /// Nodes of the cloth.
        node_count: usize,
    },
    /// There is not one command a gripper.
    CommandCount {
        /// Commands given.
        commands: usize,
        /// The number of grippers.
        grippers: usize,
    },
    /// One of several grippers cannot take the step.
    Gripper {
        /// Which one, counted from 0.
        number: usize,
        /// Why.
        error: Box<Error>,
    },
    /// The factor of a guard is not positive and finite.
    Factor(f64),
    /// Held nodes given to a guard cannot be used.
    Held(HeldError),
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Size { field, value } => {
                write!(f, "{field} {value} m must be positive and finite")
            }
            Self::Height(height) => {
                write!(f, "pyramid height {height} m must be finite and not zero")
            }
            Self::Offset(o) => {
                write!(
                    f,
                    "volume offset ({}, {}, {}) m must be finite",
                    o.x, o.y, o.z
                )
            }
            Self::Amount(amount) => {
                write!(f, "squeeze amount {amount} must be between 0 and 1")
            }
            Self::Lift(lift) => {
                write!(f, "squeeze lift {lift} m must be finite and not negative")
            }
            Self::Steps => write!(f, "squeeze steps 0 must be at least 1"),
            Self::TimeStep(dt) => write!(
                f,
                "time step {dt} s must be positive and finite, and so must its inverse"
            ),
            Self::Alpha(alpha) => write!(f, "alpha {alpha} must be between 0 and 1"),
            Self::Pose(p) => write!(
                f,
                "commanded position ({}, {}, {}) m must be finite",
                p.x, p.y, p.z
            ),
            Self::Position { node, position: p } => write!(
                f,
                "position ({}, {}, {}) m of node {node} must be finite",
                p.x, p.y, p.z
            ),
            Self::Anchor { node, position: p } => write!(
                f,
                "anchor ({}, {}, {}) m of captured node {node} must be finite",
                p.x, p.y, p.z
            ),
            Self::AnchorCount {
                anchors,
                node_count,
            } => write!(
                f,
                "there must be one anchor for each of the {node_count} nodes, got {anchors}"
            ),
            Self::NodeOutOfRange {
                element,
                number,
                node,
                node_count,
            } => write!(
                f,
                "node {node} of {element} {number} must be below the node count {node_count}"
            ),
            Self::HeldNodeGone { node, node_count } => write!(
                f,
                "held node {node} must be below the node count {node_count}, which has shrunk"
            ),
            Self::CommandCount { commands, grippers } => write!(
                f,
                "there must be one command for each of the {grippers} grippers, got {commands}"
            ),
            Self::Gripper { number, error } => write!(f, "gripper {number}: {error}"),
            Self::Factor(factor) => {
                write!(f, "guard factor {factor} must be positive and finite")
            }
            Self::Held(error) => error.fmt(f),
        }
    }
}

impl core::error::Error for Error {}

impl From<HeldError> for Error {
    fn from(error: HeldError) -> Self {
        Self::Held(error)
    }
}
