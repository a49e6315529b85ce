//! A rectangular cloth, shared by tests, benches and examples.

use selvedge_grasp::{ClothView, DVec3};

/// A grid of quadrilateral cells with its edges.
pub(crate) struct Grid {
    /// Node positions [m]: index `j * nx + i`, i along x.
    pub(crate) positions: Vec<DVec3>,
    /// The two nodes of each edge.
    pub(crate) edges: Vec<[u32; 2]>,
    /// The four nodes of each cell, one after the other around it.
    pub(crate) quads: Vec<[u32; 4]>,
}

impl Grid {
    /// The grid as a gripper sees it.
    #[allow(
        dead_code,
        reason = "not every program that shares this module needs it"
    )]
    pub(crate) fn view(&self) -> ClothView<'_> {
        ClothView {
            positions: &self.positions,
            edges: &self.edges,
            quads: &self.quads,
            ..ClothView::default()
        }
    }
}

/// A flat grid of `nx` by `ny` nodes and of the given sides [m], with a corner at the origin.
pub(crate) fn flat([nx, ny]: [u32; 2], sides: [f64; 2]) -> Grid {
    let mut grid = Grid {
        positions: Vec::new(),
        edges: Vec::new(),
        quads: Vec::new(),
    };
    for j in 0..ny {
        for i in 0..nx {
            let x = sides[0] * f64::from(i) / f64::from(nx - 1);
            let y = sides[1] * f64::from(j) / f64::from(ny - 1);
            grid.positions.push(DVec3::new(x, y, 0.0));
            let node = j * nx + i;
            if i + 1 < nx {
                grid.edges.push([node, node + 1]);
            }
            if j + 1 < ny {
                grid.edges.push([node, node + nx]);
            }
            if i + 1 < nx && j + 1 < ny {
                grid.quads.push([node, node + 1, node + nx + 1, node + nx]);
            }
        }
    }
    grid
}
