//! What the gripper is told.

use crate::Pose;

/// The jaw state `s_g`: 0 open, 1 closed (paper, section on pose and jaw state).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(rename_all = "lowercase"))]
pub enum Jaw {
    /// `s_g = 0`: nothing is held.
    #[default]
    Open,
    /// `s_g = 1`: what was in the volume when the jaws closed is held.
    Closed,
}

impl Jaw {
    /// Whether the jaws are closed.
    pub const fn is_closed(self) -> bool {
        matches!(self, Self::Closed)
    }
}

/// What the gripper is told for one step: a pose and a jaw state.
///
/// ```
/// use selvedge_math::{Command, Jaw, Pose};
/// let command = Command { pose: Pose::IDENTITY, jaw: Jaw::Closed };
/// assert!(command.jaw.is_closed());
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Command {
    /// `T_wg`, gripper to world.
    pub pose: Pose,
    /// Open or closed.
    pub jaw: Jaw,
}
