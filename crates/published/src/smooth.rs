//! The display smoother through which the original gripper reads the cloth.

use selvedge_cloth::Mesh;
use selvedge_math::DVec3;

/// Twice-smoothed node positions [m]: what the original gripper stores when it closes.
///
/// Nodes and quad centres (mean of the four corners) form a mesh with four triangles a quad.
/// Border nodes keep their value; every other point becomes `3/4` of itself plus `1/4` of the mean
/// of its neighbours: four nodes and four centres around an inner node, four corners around a
/// centre. A sheet that lies flat and undistorted is not changed, nor is a mesh that is no grid.
///
/// # Panics
/// When `positions` has not one entry a node of the mesh.
pub fn smoothed(mesh: &Mesh, positions: &[DVec3]) -> Vec<DVec3> {
    assert_eq!(
        positions.len(),
        mesh.node_count(),
        "positions must have one entry a node"
    );
    let Some(grid) = mesh.as_grid() else {
        return positions.to_vec();
    };
    let [na, nb] = grid.nodes;
    let corners = |q: &[u32; 4], x: &[DVec3]| q.iter().map(|&k| x[k as usize]).sum::<DVec3>() / 4.0;
    let mut nodes = positions.to_vec();
    let mut centres: Vec<DVec3> = mesh.quads().iter().map(|q| corners(q, &nodes)).collect();
    for _ in 0..2 {
        let (before, centres_before) = (nodes.clone(), centres.clone());
        for j in 1..nb - 1 {
            for i in 1..na - 1 {
                let k = j * na + i;
                // The quad with lower left corner (i, j) has number j (na - 1) + i.
                let quad = j * (na - 1) + i;
                let below = quad - (na - 1);
                let around = before[k - 1]
                    + before[k + 1]
                    + before[k - na]
                    + before[k + na]
                    + centres_before[quad]
                    + centres_before[quad - 1]
                    + centres_before[below]
                    + centres_before[below - 1];
                nodes[k] = 0.75 * before[k] + 0.25 * (around / 8.0);
            }
        }
        for (centre, quad) in centres.iter_mut().zip(mesh.quads()) {
            *centre = 0.75 * *centre + 0.25 * corners(quad, &before);
        }
    }
    nodes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flat_sheets_stay_and_a_bump_spreads() {
        let mesh = Mesh::grid([5, 5], [0.4, 0.4]).unwrap();
        let flat = smoothed(&mesh, mesh.rest());
        for (a, b) in flat.iter().zip(mesh.rest()) {
            assert!(a.distance(*b) < 1e-16);
        }
        let mut bump = mesh.rest().to_vec();
        bump[12].z = 1.0;
        // Once: node 3/4 + 1/4 (4 centres of 1/4)/8; its centres keep 1/4 (3/4 of it own, 1/4 mean).
        // Twice: 3/4 (25/32) + 1/4 (4 nodes of 1/16 + 4 centres of 1/4)/8, where a node beside the
        // bump has become 1/4 (1 + 2 centres of 1/4)/8 = 3/64 and a centre 3/16 + 1/16 = 1/4.
        let expected = 0.75 * (25.0 / 32.0) + 0.25 * (4.0 * 3.0 / 64.0 + 1.0) / 8.0;
        assert!((smoothed(&mesh, &bump)[12].z - expected).abs() < 1e-15);
    }
}
