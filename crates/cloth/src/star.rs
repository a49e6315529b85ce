//! Nodes around which the cloth lies about as it does at rest: no features there come near each other.
//!
//! The star of a node is the cells that meet in it, quads of two triangles or lone ones. With any rotation
//! `R` of the star at rest, the end of a spoke, from the node to another, is `e - R e_0` off. On a triangle that
//! is linear, so no point of the star is off by more than the largest, `o`, and two features that are `d` apart
//! at rest are now at least `d - 2 o` apart. When the ways of the nodes differ by at most `w` from that of the
//! node in the middle, they come nearer by no more than `2 w`.

use glam::{DMat2, DVec2};
use selvedge_math::DVec3;

use crate::distance::{Kind, distance};
use crate::pairs::edges;

/// The stars of all nodes.
#[derive(Debug)]
pub(crate) struct Stars {
    spokes: Vec<Spoke>,
    /// Where the spokes of each node begin, and where the last ones end.
    first: Vec<u32>,
    /// How far features of each star that share no node are apart at rest [m].
    clearance: Vec<f64>,
    calm: Vec<bool>,
}

/// A way from the node of a star to another.
#[derive(Clone, Copy, Debug)]
struct Spoke {
    /// Its other end.
    node: u32,
    /// Its vector at rest, in the star's frame [m].
    rest: DVec3,
    /// Weights [1/m] that give the two tangents of the star by least squares.
    weights: DVec2,
}

impl Stars {
    /// Those of cells that are one or more triangles each: a star has all of them that meet in its node.
    pub(crate) fn new<'a>(rest: &[DVec3], cells: impl Iterator<Item = &'a [[u32; 3]]>) -> Self {
        let mut around = vec![Vec::new(); rest.len()];
        for cell in cells {
            let mut corners = cell.as_flattened().to_vec();
            corners.sort_unstable();
            corners.dedup();
            for node in corners {
                around[node as usize].extend_from_slice(cell);
            }
        }
        let (mut spokes, mut first) = (Vec::new(), vec![0]);
        for (node, star) in (0u32..).zip(&around) {
            add_spokes(&mut spokes, rest, node, star);
            first.push(spokes.len() as u32);
        }
        Self {
            spokes,
            first,
            clearance: around.iter().map(|star| clearance(rest, star)).collect(),
            calm: vec![false; rest.len()],
        }
    }

    /// Finds the stars that are calm: whose features stay further apart than `reach` [m] while the nodes go from
    /// where their paths begin along their ways.
    pub(crate) fn look(&mut self, paths: &[[DVec3; 2]], reach: f64) {
        for (node, ([from, way], calm)) in paths.iter().zip(&mut self.calm).enumerate() {
            let [first, end] = [0, 1].map(|k| self.first[node + k] as usize);
            let spokes = &self.spokes[first..end];
            let (mut u, mut v, mut apart) = (DVec3::ZERO, DVec3::ZERO, 0.0_f64);
            for spoke in spokes {
                let [end, end_way] = paths[spoke.node as usize];
                u += (end - *from) * spoke.weights.x;
                v += (end - *from) * spoke.weights.y;
                apart = apart.max(end_way.distance_squared(*way));
            }
            let Some([u, v, normal]) = frame(u, v) else {
                *calm = false;
                continue;
            };
            let off = |spoke: &Spoke| {
                let at = paths[spoke.node as usize][0] - *from;
                let DVec3 { x, y, z } = spoke.rest;
                at.distance_squared(u * x + v * y + normal * z)
            };
            let off = spokes.iter().map(off).fold(0.0, f64::max);
            *calm = self.clearance[node] - 2.0 * (off.sqrt() + apart.sqrt()) > reach;
        }
    }

    /// Whether two cells are in the same calm star.
    #[inline]
    pub(crate) fn hold(&self, [first, second]: [&[u32; 4]; 2]) -> bool {
        let is_calm = |&&node: &&u32| self.calm[node as usize];
        first
            .iter()
            .filter(is_calm)
            .any(|node| second.contains(node))
    }
}

/// The orthonormal frame nearest to two tangents, and their normal; none when they are parallel, up to rounding,
/// as those of a star that has collapsed into a line or a point.
#[inline]
fn frame(u: DVec3, v: DVec3) -> Option<[DVec3; 3]> {
    let normal = u.cross(v).normalize();
    let u = (u.normalize() + v.normalize().cross(normal)).normalize();
    let v = normal.cross(u);
    // What is left of the normal of parallel tangents is rounding, which may point along them.
    (v.length_squared() > 1.0 - 1e-12).then_some([u, v, normal])
}

/// Adds the spokes of a node, whose star is these triangles.
fn add_spokes(spokes: &mut Vec<Spoke>, rest: &[DVec3], node: u32, star: &[[u32; 3]]) {
    let (first, at) = (spokes.len(), rest[node as usize]);
    let normal: DVec3 = star
        .iter()
        .map(|t| t.map(|k| rest[k as usize]))
        .map(|[a, b, c]| (b - a).cross(c - a))
        .sum();
    let Some(normal) = normal.try_normalize() else {
        return;
    };
    let u = normal.any_orthonormal_vector();
    let v = normal.cross(u);
    let mut square = DMat2::ZERO;
    for &end in star.as_flattened() {
        if end != node && spokes[first..].iter().all(|spoke| spoke.node != end) {
            let e = rest[end as usize] - at;
            let rest = DVec3::new(e.dot(u), e.dot(v), e.dot(normal));
            let weights = rest.truncate();
            square += DMat2::from_cols(weights * weights.x, weights * weights.y);
            spokes.push(Spoke {
                node: end,
                rest,
                weights,
            });
        }
    }
    let inverse = square.inverse();
    for spoke in &mut spokes[first..] {
        spoke.weights = inverse * spoke.weights;
    }
}

/// How far features of a star that share no node are apart at rest [m].
fn clearance(rest: &[DVec3], star: &[[u32; 3]]) -> f64 {
    let mut nodes = star.as_flattened().to_vec();
    nodes.sort_unstable();
    nodes.dedup();
    let mut edges: Vec<[u32; 2]> = star.iter().flat_map(edges).collect();
    edges.sort_unstable();
    edges.dedup();
    let apart = |kind, nodes: [u32; 4]| distance(kind, &nodes.map(|node: u32| rest[node as usize]));
    let mut least = f64::INFINITY;
    for node in nodes {
        for triangle @ &[a, b, c] in star {
            if !triangle.contains(&node) {
                least = least.min(apart(Kind::NodeTriangle, [node, a, b, c]));
            }
        }
    }
    for (k, [p, q]) in edges.iter().enumerate() {
        for other @ [r, s] in &edges[k + 1..] {
            if !other.contains(p) && !other.contains(q) {
                least = least.min(apart(Kind::EdgeEdge, [*p, *q, *r, *s]));
            }
        }
    }
    least
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Mesh;

    const REACH: f64 = 2e-3;

    fn random(state: &mut u64) -> f64 {
        *state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (*state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
    }

    /// A grid of cells of 1 cm, the triangles of each, and its stars.
    fn sheet(nodes: [usize; 2]) -> (Mesh, Vec<[[u32; 3]; 2]>, Stars) {
        let sides = nodes.map(|count| 0.01 * (count - 1) as f64);
        let mesh = Mesh::grid(nodes, sides).unwrap();
        let quads = mesh.quads().iter();
        let cells: Vec<_> = quads.map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
        let stars = Stars::new(mesh.rest(), cells.iter().map(|cell| &cell[..]));
        (mesh, cells, stars)
    }

    /// Features of a calm star that share no node stay apart, whichever way the sheet is bent and moves;
    /// stars of a crease are not calm.
    #[test]
    fn nothing_comes_near_in_a_calm_star() {
        let (mesh, cells, mut stars) = sheet([6, 5]);
        let state = &mut 5;
        let mut count = [0; 2];
        for round in 0..200 {
            let (bend, noise) = (60.0 * random(state), 4e-3 * f64::from(round % 8) / 8.0);
            let mut shake = || DVec3::new(random(state), random(state), random(state)) * noise;
            // Rolled up on a cylinder, which turns
            let paths: Vec<[DVec3; 2]> = mesh
                .rest()
                .iter()
                .map(|at| {
                    let angle = bend * at.x;
                    let on = DVec3::new(angle.sin(), 0.0, 1.0 - angle.cos()) / bend;
                    let x = on + DVec3::Y * at.y + shake();
                    [x, 0.05 * DVec3::Y.cross(x) + 0.3 * shake()]
                })
                .collect();
            stars.look(&paths, REACH);
            for node in 0..paths.len() as u32 {
                let calm = stars.calm[node as usize];
                count[usize::from(calm)] += 1;
                let own = cells.iter().flatten().filter(|_| calm);
                let star: Vec<[u32; 3]> = {
                    let cell = |t: &&[u32; 3]| {
                        let mut both = cells.iter().filter(|cell| cell.contains(t));
                        both.any(|cell| cell.as_flattened().contains(&node))
                    };
                    own.filter(cell).copied().collect()
                };
                for time in [0.0, 0.5, 1.0] {
                    let x: Vec<DVec3> = paths.iter().map(|[x, way]| *x + *way * time).collect();
                    assert!(clearance(&x, &star) > REACH, "round {round}, node {node}");
                }
            }
        }
        assert!(count.iter().all(|count| *count > 500), "{count:?}");

        let folded: Vec<[DVec3; 2]> = mesh
            .rest()
            .iter()
            .map(|at| [DVec3::new((at.x - 0.015).abs(), at.y, 0.0), DVec3::ZERO])
            .collect();
        stars.look(&folded, REACH);
        for (at, calm) in mesh.rest().iter().zip(&stars.calm) {
            assert_eq!(*calm, (at.x - 0.015).abs() > 0.005, "{at}");
        }
    }

    #[test]
    fn a_star_without_a_frame_is_not_calm() {
        let (_, _, mut stars) = sheet([3, 3]);
        stars.look(&[[DVec3::ONE, DVec3::ZERO]; 9], 0.0);
        assert_eq!(stars.calm, [false; 9]);
    }

    #[test]
    fn frames_are_orthonormal_and_parallel_tangents_have_none() {
        assert_eq!(
            frame(2.0 * DVec3::X, DVec3::Y),
            Some([DVec3::X, DVec3::Y, DVec3::Z])
        );
        let state = &mut 3;
        for _ in 0..1000 {
            let [u, v] = [0, 1].map(|_| DVec3::new(random(state), random(state), random(state)));
            let [a, b, c] = frame(u, v).unwrap();
            for (product, one) in [
                (a.dot(a), 1.0),
                (b.dot(b), 1.0),
                (c.dot(c), 1.0),
                (a.dot(b), 0.0),
                (b.dot(c), 0.0),
                (c.dot(a), 0.0),
            ] {
                assert!((product - one).abs() < 1e-12, "{u} {v}");
            }
            // The cross product is not exactly zero.
            assert_eq!(frame(u * random(state), u * random(state)), None, "{u}");
        }
    }
}
