//! The rest shape of a cloth.

mod faces;
mod obj;

use selvedge_math::DVec3;

use crate::Error;

/// A cloth at rest: node positions [m], edges and faces.
///
/// The rest shape is what an inextensible cloth keeps: edge lengths are measured on it.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    rest: Vec<DVec3>,
    edges: Vec<[u32; 2]>,
    quads: Vec<[u32; 4]>,
    triangles: Vec<[u32; 3]>,
    grid: Option<Grid>,
}

/// The regular grid of a rectangular sheet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    /// Nodes along x and along y.
    pub nodes: [usize; 2],
    /// Side lengths along x and along y [m].
    pub sides: [f64; 2],
}

impl Grid {
    /// Distance between neighbouring nodes along x and along y [m].
    pub fn spacing(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.sides[axis] / (self.nodes[axis] - 1) as f64)
    }

    /// Length of the diagonal `sqrt(a^2 + b^2)` [m], the scale of the folding error.
    pub fn diagonal(&self) -> f64 {
        self.sides[0].hypot(self.sides[1])
    }
}

impl Mesh {
    /// The most nodes a mesh may have.
    pub const MAX_NODES: usize = 4_000_000;

    /// A flat rectangular sheet at `z = 0` around the origin, with `nodes` nodes (not cells) and
    /// `sides` [m] along x and y; node `k = j na + i`, `i` along x.
    ///
    /// # Errors
    /// [`Error::GridSize`] for fewer than 2 nodes along a side or more than [`Mesh::MAX_NODES`] in
    /// all, [`Error::Value`] for a side that is not positive and finite.
    pub fn grid(nodes: [usize; 2], sides: [f64; 2]) -> Result<Self, Error> {
        let [na, nb] = nodes;
        if na < 2 || nb < 2 || na.saturating_mul(nb) > Self::MAX_NODES {
            return Err(Error::GridSize(na, nb));
        }
        Error::check_positive("side along x [m]", sides[0])?;
        Error::check_positive("side along y [m]", sides[1])?;
        let grid = Grid { nodes, sides };
        let [dx, dy] = grid.spacing();
        let mut rest = Vec::with_capacity(na * nb);
        let mut edges = Vec::with_capacity(2 * na * nb);
        let mut quads = Vec::with_capacity((na - 1) * (nb - 1));
        for j in 0..nb {
            for i in 0..na {
                let k = (j * na + i) as u32;
                let (right, up) = (k + 1, k + na as u32);
                let (x, y) = (
                    -sides[0] / 2.0 + i as f64 * dx,
                    -sides[1] / 2.0 + j as f64 * dy,
                );
                rest.push(DVec3::new(x, y, 0.0));
                if i + 1 < na {
                    edges.push([k, right]);
                }
                if j + 1 < nb {
                    edges.push([k, up]);
                }
                if i + 1 < na && j + 1 < nb {
                    quads.push([k, right, up + 1, up]);
                }
            }
        }
        Ok(Self {
            rest,
            edges,
            quads,
            triangles: Vec::new(),
            grid: Some(grid),
        })
    }

    /// Rest positions [m], one a node.
    pub fn rest(&self) -> &[DVec3] {
        &self.rest
    }

    /// Edges as node pairs `(p, q)`, `p < q`, lexicographic, each once.
    pub fn edges(&self) -> &[[u32; 2]] {
        &self.edges
    }

    /// Quadrilateral faces, nodes in order around the face.
    pub fn quads(&self) -> &[[u32; 4]] {
        &self.quads
    }

    /// Triangular faces, nodes in order around the face.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// The grid the mesh was made from, if it was made by [`Mesh::grid`].
    pub fn as_grid(&self) -> Option<Grid> {
        self.grid
    }

    /// Length of the diagonal [m], the scale of the folding error: of the grid, or else of the box
    /// along the axes around the rest positions.
    pub fn diagonal(&self) -> f64 {
        match self.grid {
            Some(grid) => grid.diagonal(),
            None => faces::extent(&self.rest).length(),
        }
    }

    /// The number of nodes.
    pub fn node_count(&self) -> usize {
        self.rest.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_grid_by_hand() {
        let mesh = Mesh::grid([3, 2], [2.0, 1.0]).unwrap();
        assert_eq!(mesh.rest()[0], DVec3::new(-1.0, -0.5, 0.0));
        assert_eq!(mesh.rest()[5], DVec3::new(1.0, 0.5, 0.0));
        assert_eq!(
            mesh.edges(),
            [[0, 1], [0, 3], [1, 2], [1, 4], [2, 5], [3, 4], [4, 5]]
        );
        assert_eq!(mesh.quads(), [[0, 1, 4, 3], [1, 2, 5, 4]]);
        assert_eq!(mesh.as_grid().unwrap().spacing(), [1.0, 1.0]);
        assert_eq!(mesh.diagonal(), 5f64.sqrt());
        assert!(mesh.triangles().is_empty());
    }

    #[test]
    fn impossible_grids_are_refused() {
        let error = Mesh::grid([1, 28], [0.42, 0.59]).unwrap_err();
        assert!(error.to_string().starts_with("grid has 1 x 28 nodes"));
        assert!(Mesh::grid([usize::MAX, 3], [1.0, 1.0]).is_err());
        let error = Mesh::grid([3, 3], [-0.42, 0.59]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "side along x [m] is -0.42, must be positive and finite"
        );
        assert!(Mesh::grid([3, 3], [0.42, f64::INFINITY]).is_err());
    }
}
