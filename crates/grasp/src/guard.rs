//! A watch for what no inextensible cloth can follow.

use alloc::collections::BinaryHeap;
use alloc::vec;
use alloc::vec::Vec;
use core::cmp::Reverse;

use selvedge_math::{DVec3, Held};

use crate::select::out_of_range;
use crate::{ClothView, Error};

/// Two held nodes that are commanded further apart than the cloth between them is long.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overstretch {
    /// The nodes, the lower one first.
    pub nodes: [u32; 2],
    /// The distance between their targets \[m\].
    pub distance: f64,
    /// What it must not exceed \[m\]: the factor times the rest distance along the cloth.
    pub bound: f64,
}

/// Reports held nodes that are commanded further apart than a factor times their distance along
/// the cloth at rest: `|u_i - u_j| > factor * d_ij`.
///
/// An inextensible cloth can follow no such command, whatever the simulator; with two grippers it is
/// easily given. The guard only reports; what is done about it is the caller's choice.
///
/// The distance `d_ij` is that of the straight segment between the nodes at rest when the segment
/// stays on the cloth, as it always does on a flat convex cloth: this is the geodesic distance
/// itself. Otherwise it is the shortest path over edges, and sides and diagonals of the faces. With
/// flat faces such a path is never too short, so it gives no false alarm, and on square cells it is
/// at most 8 % too long. Distances are found when the held nodes change; a step that holds the same
/// nodes as the one before only compares.
///
/// ```
/// use selvedge_grasp::{ClothView, DVec3, Guard, Held};
/// let positions = [DVec3::ZERO, DVec3::X, DVec3::X + DVec3::Y, DVec3::Y];
/// let rest = ClothView { positions: &positions, quads: &[[0, 1, 2, 3]], ..ClothView::default() };
/// let mut guard = Guard::new(rest, 1.01)?;
/// let held = Held { nodes: &[0, 2], targets: &[DVec3::ZERO, DVec3::Z * 1.5], velocities: &[DVec3::ZERO; 2] };
/// let [pair] = guard.check(held)? else { panic!() };
/// assert_eq!((pair.nodes, pair.distance), ([0, 2], 1.5));
/// assert!((pair.bound - 1.01 * 2.0_f64.sqrt()).abs() < 1e-15);
/// # Ok::<(), selvedge_grasp::Error>(())
/// ```
#[derive(Clone, Debug)]
pub struct Guard {
    factor: f64,
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    /// The nodes that can be reached from each node in a straight line.
    links: Lists,
    /// The triangles of each node.
    corners: Lists,
    nodes: Vec<u32>,
    /// The bound of each pair of `nodes` \[m\]: (1, 0), (2, 0), (2, 1), (3, 0) ...
    bounds: Vec<f64>,
    found: Vec<Overstretch>,
}

impl Guard {
    /// A guard for a cloth whose view at rest is `rest`.
    ///
    /// A factor a little above 1 leaves room for the strain that the simulator allows, one below 1
    /// warns early.
    ///
    /// # Errors
    /// [`Error::Factor`] unless the factor is positive and finite; [`Error::Position`] or
    /// [`Error::NodeOutOfRange`] when the view cannot be used.
    pub fn new(rest: ClothView<'_>, factor: f64) -> Result<Self, Error> {
        if !(factor > 0.0 && factor.is_finite()) {
            return Err(Error::Factor(factor));
        }
        if let Some(node) = rest.positions.iter().position(|p| !p.is_finite()) {
            let position = rest.positions[node];
            return Err(Error::Position { node, position });
        }
        let node_count = rest.positions.len();
        check_range("edge", rest.edges, node_count)?;
        check_range("quad", rest.quads, node_count)?;
        check_range("triangle", rest.triangles, node_count)?;

        let mut links = Vec::new();
        for &[a, b] in rest.edges {
            links.extend([(a, b), (b, a)]);
        }
        for nodes in rest.quads {
            links.extend(all_pairs(nodes));
        }
        for nodes in rest.triangles {
            links.extend(all_pairs(nodes));
        }
        links.sort_unstable();
        links.dedup();

        // Each quad is two triangles; how it is cut does not matter where it is flat.
        let mut triangles = Vec::with_capacity(2 * rest.quads.len() + rest.triangles.len());
        for &[a, b, c, d] in rest.quads {
            triangles.extend([[a, b, c], [a, c, d]]);
        }
        triangles.extend_from_slice(rest.triangles);
        let mut corners = Vec::with_capacity(3 * triangles.len());
        for (number, nodes) in (0..).zip(&triangles) {
            corners.extend(nodes.map(|node| (node, number)));
        }
        corners.sort_unstable();

        Ok(Self {
            factor,
            positions: rest.positions.to_vec(),
            links: Lists::new(&links, node_count),
            corners: Lists::new(&corners, node_count),
            triangles,
            nodes: Vec::new(),
            bounds: Vec::new(),
            found: Vec::new(),
        })
    }

    /// The pairs of held nodes that are commanded too far apart, in ascending order.
    ///
    /// Allocates when the held nodes are others than in the last call.
    ///
    /// # Errors
    /// [`Error::Held`] when `held` does not fit the cloth, see [`Held::check`].
    pub fn check(&mut self, held: Held<'_>) -> Result<&[Overstretch], Error> {
        held.check(self.positions.len())?;
        if self.nodes != held.nodes {
            self.nodes.clear();
            self.bounds.clear();
            self.nodes.extend_from_slice(held.nodes);
            for (k, &node) in held.nodes.iter().enumerate().skip(1) {
                let earlier = &held.nodes[..k];
                let factor = self.factor;
                let distances = self.rest_distances(node, earlier);
                self.bounds.extend(distances.iter().map(|d| factor * d));
            }
        }
        self.found.clear();
        let mut bounds = self.bounds.iter();
        for (k, &target) in held.targets.iter().enumerate() {
            for ((&other, &other_target), &bound) in
                held.nodes.iter().zip(&held.targets[..k]).zip(&mut bounds)
            {
                if target.distance_squared(other_target) > bound * bound {
                    self.found.push(Overstretch {
                        nodes: [other, held.nodes[k]],
                        distance: target.distance(other_target),
                        bound,
                    });
                }
            }
        }
        self.found.sort_unstable_by_key(|pair| pair.nodes);
        Ok(&self.found)
    }

    /// The distance along the cloth at rest \[m\] from a node to each of some others; infinite when
    /// the cloth does not join them.
    fn rest_distances(&self, from: u32, to: &[u32]) -> Vec<f64> {
        let mut distances = vec![f64::INFINITY; to.len()];
        let mut unseen = Vec::new();
        for (k, &node) in to.iter().enumerate() {
            if self.sees(from, node) {
                distances[k] =
                    self.positions[from as usize].distance(self.positions[node as usize]);
            } else {
                unseen.push(k);
            }
        }
        if !unseen.is_empty() {
            let paths = self.shortest_paths(from);
            for k in unseen {
                distances[k] = paths[to[k] as usize];
            }
        }
        distances
    }

    /// Dijkstra's shortest paths \[m\] over edges, sides and diagonals, from one node to all.
    fn shortest_paths(&self, from: u32) -> Vec<f64> {
        let mut distances = vec![f64::INFINITY; self.positions.len()];
        distances[from as usize] = 0.0;
        // The bits of floats that are not negative are ordered as the floats are.
        let mut heap = BinaryHeap::from([Reverse((0_u64, from))]);
        while let Some(Reverse((bits, node))) = heap.pop() {
            let distance = f64::from_bits(bits);
            if distance > distances[node as usize] {
                continue;
            }
            for &next in self.links.of(node) {
                let step = self.positions[node as usize].distance(self.positions[next as usize]);
                if distance + step < distances[next as usize] {
                    distances[next as usize] = distance + step;
                    heap.push(Reverse(((distance + step).to_bits(), next)));
                }
            }
        }
        distances
    }

    /// Whether the straight segment between two nodes stays on the cloth.
    ///
    /// Starting with the triangles of the first node, goes from triangle to triangle across shared
    /// sides, through those only that the segment touches. The segment stays on the cloth when the
    /// parts of it that lie in these triangles leave no gap and the second node is a corner of one
    /// of them. Two triangles that lie on one another without being joined, as at the two sides of
    /// a cut, do not help each other.
    fn sees(&self, from: u32, to: u32) -> bool {
        let start = self.positions[from as usize];
        let along = self.positions[to as usize] - start;
        let mut waiting: Vec<u32> = self.corners.of(from).to_vec();
        let mut visited = waiting.clone();
        let mut parts = Vec::new();
        let mut arrived = false;
        while let Some(number) = waiting.pop() {
            let nodes = self.triangles[number as usize];
            let corners = nodes.map(|node| self.positions[node as usize]);
            let Some(part) = overlap(start, along, corners) else {
                continue;
            };
            parts.push(part);
            arrived |= nodes.contains(&to);
            for &node in &nodes {
                for &next in self.corners.of(node) {
                    let shared = self.triangles[next as usize];
                    let shared = shared.iter().filter(|node| nodes.contains(node)).count();
                    if shared >= 2 && !visited.contains(&next) {
                        visited.push(next);
                        waiting.push(next);
                    }
                }
            }
        }
        parts.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut reached = 0.0;
        for (begin, end) in parts {
            if begin > reached + TOUCH {
                return false;
            }
            reached = end.max(reached);
        }
        arrived && reached >= 1.0 - TOUCH
    }
}

/// How far from a triangle a segment still touches it, as a part of its length.
const TOUCH: f64 = 1e-9;

/// The part of the segment `start + t along`, `0 <= t <= 1`, that lies in a triangle, as the first
/// and last `t`.
fn overlap(start: DVec3, along: DVec3, corners: [DVec3; 3]) -> Option<(f64, f64)> {
    let length = along.length();
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
    let area = normal.length();
    if area == 0.0 {
        return None;
    }
    let normal = normal / area;
    let touch = TOUCH * length;
    let (mut first, mut last) = (0.0_f64, 1.0_f64);
    for k in 0..3 {
        let corner = corners[k];
        let side = corners[(k + 1) % 3] - corner;
        let inward = normal.cross(side) / side.length();
        // Distances [m] of the ends of the segment to the line through the side, inside positive.
        let begin = inward.dot(start - corner);
        let change = inward.dot(along);
        let end = begin + change;
        if begin < -touch && end < -touch {
            return None;
        }
        if begin < -touch {
            first = first.max(-begin / change);
        } else if end < -touch {
            last = last.min(-begin / change);
        }
    }
    if first > last + TOUCH {
        return None;
    }
    // What lies above the triangle must lie in its plane.
    let height = |t: f64| normal.dot(start + t * along - corners[0]).abs();
    (height(first) <= touch && height(last) <= touch).then_some((first, last))
}

/// For each node, a list of numbers.
#[derive(Clone, Debug)]
struct Lists {
    /// Where the list of each node begins in `items`, and where the last one ends.
    begin: Vec<usize>,
    items: Vec<u32>,
}

impl Lists {
    /// The lists of `(node, number)`, sorted by node.
    fn new(sorted: &[(u32, u32)], node_count: usize) -> Self {
        let begin = (0..=node_count)
            .map(|node| sorted.partition_point(|&(n, _)| (n as usize) < node))
            .collect();
        let items = sorted.iter().map(|&(_, number)| number).collect();
        Self { begin, items }
    }

    fn of(&self, node: u32) -> &[u32] {
        &self.items[self.begin[node as usize]..self.begin[node as usize + 1]]
    }
}

/// All ordered pairs of different entries.
fn all_pairs(nodes: &[u32]) -> impl Iterator<Item = (u32, u32)> + '_ {
    nodes
        .iter()
        .flat_map(move |&a| nodes.iter().map(move |&b| (a, b)))
        .filter(|(a, b)| a != b)
}

fn check_range<const N: usize>(
    element: &'static str,
    elements: &[[u32; N]],
    node_count: usize,
) -> Result<(), Error> {
    let outside = |nodes: &[u32; N]| nodes.iter().any(|&node| node as usize >= node_count);
    match elements.iter().position(outside) {
        Some(number) => Err(out_of_range(element, number, &elements[number], node_count)),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use alloc::string::ToString;

    use super::*;

    /// A grid of `n` by `n` unit cells, without those for which `hole` is true.
    fn grid(n: u32, hole: impl Fn(u32, u32) -> bool) -> (Vec<DVec3>, Vec<[u32; 4]>) {
        let node = |i, j| j * (n + 1) + i;
        let mut positions = Vec::new();
        let mut quads = Vec::new();
        for j in 0..=n {
            for i in 0..=n {
                positions.push(DVec3::new(f64::from(i), f64::from(j), 0.0));
                if i < n && j < n && !hole(i, j) {
                    quads.push([
                        node(i, j),
                        node(i + 1, j),
                        node(i + 1, j + 1),
                        node(i, j + 1),
                    ]);
                }
            }
        }
        (positions, quads)
    }

    fn guard(positions: &[DVec3], quads: &[[u32; 4]]) -> Guard {
        let rest = ClothView {
            positions,
            quads,
            ..ClothView::default()
        };
        Guard::new(rest, 1.0).unwrap()
    }

    #[test]
    fn distances_on_a_flat_convex_cloth_are_straight() {
        let (positions, quads) = grid(5, |_, _| false);
        let guard = guard(&positions, &quads);
        let all: Vec<u32> = (0..36).collect();
        for from in 0..36 {
            for (&to, distance) in all.iter().zip(guard.rest_distances(from, &all)) {
                let straight = positions[from as usize].distance(positions[to as usize]);
                assert_eq!(distance, straight, "{from} to {to}");
                let path = guard.shortest_paths(from)[to as usize];
                assert!(path >= straight - 1e-12 && path <= 1.0824 * straight + 1e-12);
            }
        }
    }

    #[test]
    fn paths_go_around_a_hole() {
        // The middle cell of three by three is missing.
        let (positions, quads) = grid(3, |i, j| i == 1 && j == 1);
        let guard = guard(&positions, &quads);
        // From the lower left corner to the upper right one: around the hole by two knight's moves.
        let distance = guard.rest_distances(0, &[15])[0];
        assert!((distance - (2.0 + 2.0 * 2.0_f64.sqrt())).abs() < 1e-12);
        // Along the rim of the hole, and past it.
        assert_eq!(guard.rest_distances(5, &[6, 4, 7]), [1.0, 1.0, 2.0]);
        assert_eq!(guard.rest_distances(5, &[10])[0], 2.0);
    }

    #[test]
    fn a_cut_is_gone_around() {
        // Two rows of cells that share nodes only at x = 0: nodes 0..4 below the cut, and 1..4
        // again above it.
        let row = |y: f64| (0..4).map(move |i| DVec3::new(f64::from(i), y, 0.0));
        let positions: Vec<DVec3> = row(0.0)
            .chain(row(0.0).skip(1))
            .chain(row(-1.0))
            .chain(row(1.0))
            .collect();
        let (below, above) = (|i: u32| i, |i: u32| if i == 0 { 0 } else { 3 + i });
        let mut quads = Vec::new();
        for i in 0..3 {
            quads.push([7 + i, 8 + i, below(i + 1), below(i)]);
            quads.push([above(i), above(i + 1), 12 + i, 11 + i]);
        }
        let guard = guard(&positions, &quads);
        // From the lower side at x = 2 straight up to the upper side: through the end of the cut.
        let (down, up) = (9, 13);
        let straight = positions[down as usize].distance(positions[up as usize]);
        assert_eq!(straight, 2.0);
        let distance = guard.rest_distances(down, &[up])[0];
        assert!((distance - 2.0 * (1.0 + 2.0_f64.sqrt())).abs() < 1e-12);
        // The two nodes on both sides of the cut lie on one another.
        assert_eq!(guard.rest_distances(2, &[5])[0], 4.0);
    }

    #[test]
    fn a_fold_in_the_rest_shape_is_no_short_cut() {
        // Three nodes up and down a roof of two cells.
        let positions = [
            DVec3::new(0.0, 0.0, 0.0),
            DVec3::new(0.0, 1.0, 0.0),
            DVec3::new(3.0, 0.0, 4.0),
            DVec3::new(3.0, 1.0, 4.0),
            DVec3::new(6.0, 0.0, 0.0),
            DVec3::new(6.0, 1.0, 0.0),
        ];
        let guard = guard(&positions, &[[0, 2, 3, 1], [2, 4, 5, 3]]);
        assert_eq!(guard.rest_distances(0, &[2, 4]), [5.0, 10.0]);
    }

    #[test]
    fn reports_pairs_and_bounds() {
        let (positions, quads) = grid(2, |_, _| false);
        let rest = ClothView {
            positions: &positions,
            quads: &quads,
            ..ClothView::default()
        };
        let mut guard = Guard::new(rest, 1.5).unwrap();
        let nodes = [0, 1, 2];
        let fits = [0.0, 1.0, 2.0].map(|x| DVec3::X * x);
        let velocities = [DVec3::ZERO; 3];
        let held = Held {
            nodes: &nodes,
            targets: &fits,
            velocities: &velocities,
        };
        assert_eq!(guard.check(held).unwrap(), []);
        let targets = [-2.0, 1.0, 2.0].map(|x| DVec3::X * x);
        let held = Held {
            targets: &targets,
            ..held
        };
        let far = |a, b, distance, bound| Overstretch {
            nodes: [a, b],
            distance,
            bound,
        };
        let expected = [far(0, 1, 3.0, 1.5), far(0, 2, 4.0, 3.0)];
        assert_eq!(guard.check(held).unwrap(), expected);
        let outside = Held {
            nodes: &[0, 1, 9],
            ..held
        };
        assert!(
            guard
                .check(outside)
                .unwrap_err()
                .to_string()
                .contains("held node 9")
        );
        assert_eq!(guard.check(Held::NONE).unwrap(), []);
    }

    #[test]
    fn the_rest_view_is_checked() {
        let rest = ClothView {
            positions: &[DVec3::ZERO],
            triangles: &[[0, 0, 3]],
            ..ClothView::default()
        };
        assert!(
            Guard::new(rest, 1.0)
                .unwrap_err()
                .to_string()
                .contains("triangle 0")
        );
        assert_eq!(
            Guard::new(rest, f64::NAN).unwrap_err().to_string(),
            "guard factor NaN must be positive and finite"
        );
    }
}
