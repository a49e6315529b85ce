//! The cloth itself: faces and the shape at rest.

use selvedge_math::DVec3;

use crate::Error;

/// What stays the same in every frame: the faces and the shape at rest.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    /// Four nodes a face, in order around it.
    pub quads: Vec<[u32; 4]>,
    /// Three nodes a face.
    pub triangles: Vec<[u32; 3]>,
    /// The shape at rest.
    pub rest: Rest,
}

/// The shape at rest, which also tells how many nodes there are.
#[derive(Clone, Debug, PartialEq)]
pub enum Rest {
    /// A rectangle of `nodes[0]` by `nodes[1]` nodes along x and y, node `(i, j)` at index
    /// `j * nodes[0] + i`.
    Grid {
        /// Nodes along x and along y.
        nodes: [u32; 2],
        /// Lengths along x and along y [m].
        sides: [f64; 2],
    },
    /// Any other shape, by its node positions [m].
    Positions(Vec<DVec3>),
}

impl Sheet {
    /// Checks the sheet and counts its nodes.
    pub(crate) fn check(&self) -> Result<usize, Error> {
        let node_count = match &self.rest {
            Rest::Grid {
                nodes: [a, b],
                sides,
            } => {
                let Some(count) = a.checked_mul(*b).filter(|&count| count > 0) else {
                    let bound = "of 1 to 2^32 - 1 nodes";
                    return Err(Error::value("grid", format!("{a} by {b}"), bound));
                };
                if !sides.iter().all(|side| *side > 0.0 && side.is_finite()) {
                    let value = format!("{sides:?} m");
                    return Err(Error::value("sides", value, "positive and finite"));
                }
                count as usize
            }
            Rest::Positions(rest) => {
                if let Some(node) = rest.iter().position(|p| !p.is_finite()) {
                    let value = format!("node {node} is {} m", rest[node]);
                    return Err(Error::value("rest", value, "finite"));
                }
                if rest.is_empty() || u32::try_from(rest.len()).is_err() {
                    let value = format!("{} nodes", rest.len());
                    return Err(Error::value("rest", value, "1 to 2^32 - 1"));
                }
                rest.len()
            }
        };
        let corners = |array, face: usize, nodes: &[u32]| match nodes
            .iter()
            .find(|&&node| node as usize >= node_count)
        {
            Some(node) => {
                let value = format!("face {face} has node {node}");
                let bound = format!("below the node count {node_count}");
                Err(Error::value(array, value, bound))
            }
            None => Ok(()),
        };
        for (k, quad) in self.quads.iter().enumerate() {
            corners("quads", k, quad)?;
        }
        for (k, triangle) in self.triangles.iter().enumerate() {
            corners("triangles", k, triangle)?;
        }
        if self.quads.is_empty() && self.triangles.is_empty() {
            let value = "no face, and none in triangles";
            return Err(Error::value("quads", value, "one face at least"));
        }
        Ok(node_count)
    }
}
