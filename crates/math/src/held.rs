//! What a gripper asks of a simulator.

use core::fmt;

use glam::DVec3;

/// The nodes held in one step and where they must be at its end: the constraint
/// `p_i - u_i = 0` for each `i` in `nodes` (eq. `node_constraint` of the paper).
///
/// The three slices have one entry a held node.
///
/// ```
/// use selvedge_math::{DVec3, Held};
/// let held = Held { nodes: &[3], targets: &[DVec3::Z], velocities: &[DVec3::ZERO] };
/// assert!(held.check(4).is_ok());
/// assert_eq!(held.check(3).unwrap_err().to_string(), "held node 3 must be below the node count 3");
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct Held<'a> {
    /// Node indices, ascending and each once.
    pub nodes: &'a [u32],
    /// Positions at the end of the step [m], world frame.
    pub targets: &'a [DVec3],
    /// Velocities at the end of the step [m/s], world frame: `(target - previous target) / dt`, in
    /// the closing step from the node's own position.
    pub velocities: &'a [DVec3],
}

impl Held<'_> {
    /// Nothing is held.
    pub const NONE: Self = Self {
        nodes: &[],
        targets: &[],
        velocities: &[],
    };

    /// Checks what a simulator with `node_count` nodes relies on: equal lengths, ascending
    /// indices in range, finite targets and velocities.
    ///
    /// # Errors
    /// [`HeldError`] names the first entry that breaks a rule.
    pub fn check(&self, node_count: usize) -> Result<(), HeldError> {
        let length = self.nodes.len();
        if self.targets.len() != length || self.velocities.len() != length {
            return Err(HeldError::Lengths {
                nodes: length,
                targets: self.targets.len(),
                velocities: self.velocities.len(),
            });
        }
        for (k, &node) in self.nodes.iter().enumerate() {
            if node as usize >= node_count {
                return Err(HeldError::NodeOutOfRange { node, node_count });
            }
            if k > 0 && self.nodes[k - 1] >= node {
                return Err(HeldError::NotAscending {
                    previous: self.nodes[k - 1],
                    node,
                });
            }
            if !self.targets[k].is_finite() || !self.velocities[k].is_finite() {
                return Err(HeldError::NotFinite { node });
            }
        }
        Ok(())
    }
}

/// Why held nodes cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeldError {
    /// The slices differ in length.
    Lengths {
        /// Entries in `nodes`.
        nodes: usize,
        /// Entries in `targets`.
        targets: usize,
        /// Entries in `velocities`.
        velocities: usize,
    },
    /// An index is not a node of the cloth.
    NodeOutOfRange {
        /// The index.
        node: u32,
        /// The number of nodes of the cloth.
        node_count: usize,
    },
    /// Indices are not ascending, or one occurs twice.
    NotAscending {
        /// The index before.
        previous: u32,
        /// The index that should be larger.
        node: u32,
    },
    /// A target or a velocity is infinite or not a number.
    NotFinite {
        /// The node.
        node: u32,
    },
}

impl fmt::Display for HeldError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lengths {
                nodes,
                targets,
                velocities,
            } => write!(
                f,
                "held slices must have one length, got {nodes} nodes, {targets} targets and \
                 {velocities} velocities"
            ),
            Self::NodeOutOfRange { node, node_count } => {
                write!(
                    f,
                    "held node {node} must be below the node count {node_count}"
                )
            }
            Self::NotAscending { previous, node } => {
                write!(f, "held nodes must ascend, got {node} after {previous}")
            }
            Self::NotFinite { node } => {
                write!(f, "target and velocity of held node {node} must be finite")
            }
        }
    }
}

impl core::error::Error for HeldError {}

#[cfg(test)]
mod tests {
    use alloc::string::ToString;

    use super::*;

    #[test]
    fn check_names_the_fault() {
        let zero = [DVec3::ZERO; 2];
        let ok = Held {
            nodes: &[1, 4],
            targets: &zero,
            velocities: &zero,
        };
        assert_eq!(ok.check(5), Ok(()));
        assert_eq!(Held::NONE.check(0), Ok(()));
        assert_eq!(
            ok.check(4),
            Err(HeldError::NodeOutOfRange {
                node: 4,
                node_count: 4
            })
        );
        let twice = Held {
            nodes: &[4, 4],
            ..ok
        };
        assert_eq!(
            twice.check(5),
            Err(HeldError::NotAscending {
                previous: 4,
                node: 4
            })
        );
        let short = Held {
            targets: &zero[..1],
            ..ok
        };
        assert!(
            short
                .check(5)
                .unwrap_err()
                .to_string()
                .contains("1 targets")
        );
        let nan = [DVec3::ZERO, DVec3::NAN];
        let bad = Held {
            velocities: &nan,
            ..ok
        };
        assert_eq!(bad.check(5), Err(HeldError::NotFinite { node: 4 }));
    }
}
