//! Which features of a cloth may come near each other: found for some time ahead.
//!
//! Nodes are taken to go on straight. What meets then is found by a tree of boxes that move, but for what is around
//! nodes where the cloth lies about as at rest, and serves until a node gets off its way by more than was
//! reckoned with.

use std::collections::HashSet;
use std::ops::Range;

use selvedge_math::DVec3;

use crate::Mesh;
use crate::broad::{Moving, Tree};
use crate::distance::{Kind, approach, distance};
use crate::star::Stars;
use crate::surroundings::Part;

/// Pairs are looked for so long ahead [s], or one substep.
const AHEAD: f64 = 1.0 / 30.0;
/// How far a node may get off its straight way in that time, as a share of the shortest edge; no less
/// than a third of the reach.
const DRIFT: f64 = 0.15;
/// Further away from the origin [m] nothing is looked for.
const FARTHEST: f64 = 1e30;
/// The way of pairs that were never looked for.
const NEVER: [f64; 2] = [f64::NAN; 2];

/// Two features.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Pair {
    pub(crate) kind: Kind,
    pub(crate) nodes: [u32; 4],
}

/// A pair that may come near, as it was when it was found.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    pair: Pair,
    /// How far apart the two were, and by how much that may shrink on the whole way [m]: no more than
    /// they move towards each other.
    distance: f64,
    approach: f64,
}

impl Candidate {
    #[inline]
    fn new(pair: Pair, paths: &[[DVec3; 2]]) -> Self {
        let nodes = pair.nodes.map(|k| k as usize);
        let (at, way) = (nodes.map(|k| paths[k][0]), nodes.map(|k| paths[k][1]));
        Self {
            pair,
            distance: distance(pair.kind, &at),
            approach: approach(pair.kind, way),
        }
    }
}

/// A quad, or a triangle that is part of none.
#[derive(Clone, Copy, Debug)]
struct Cell {
    /// A triangle has its last corner twice.
    corners: [u32; 4],
    /// Its first triangle, and how many it has.
    triangle: usize,
    count: usize,
}

impl Cell {
    fn range(&self) -> Range<usize> {
        self.triangle..self.triangle + self.count
    }
}

/// The pairs of features that may come near.
#[derive(Debug)]
pub(crate) struct Pairs {
    triangles: Vec<[u32; 3]>,
    cells: Vec<Cell>,
    /// All edges, diagonals too.
    edges: Vec<[u32; 2]>,
    /// Corners and edges of each triangle that no triangle before has.
    own: Vec<Own>,
    stars: Stars,
    tree: Tree,
    /// Where each node was when pairs were looked for, and the way [m] it was going to go.
    paths: Vec<[DVec3; 2]>,
    /// The mean way of each cell, and how much that of a corner differs from it at most [m].
    courses: Vec<(DVec3, f64)>,
    /// How near features are that matter [m].
    reach: f64,
    /// How far a node may get off its way [m].
    drift: f64,
    /// The time of that way: its start and its length [s].
    ahead: [f64; 2],
    /// The share of it that is over at the end of the present substep, and how far off a node is by
    /// then at most [m].
    share: f64,
    off: f64,
    list: Vec<Candidate>,
    /// More than this are not looked at: the input has collapsed.
    most: usize,
}

impl Pairs {
    /// Those of a mesh, of features that come within `reach` [m].
    pub(crate) fn new(mesh: &Mesh, reach: f64) -> Self {
        let mut triangles = mesh.triangles().to_vec();
        let mut edges = mesh.edges().to_vec();
        let lone = |(first, &[a, b, c]): (usize, &[u32; 3])| Cell {
            corners: [a, b, c, c],
            triangle: first,
            count: 1,
        };
        let mut cells: Vec<Cell> = triangles.iter().enumerate().map(lone).collect();
        for &[a, b, c, d] in mesh.quads() {
            let first = triangles.len();
            triangles.extend([[a, b, c], [a, c, d]]);
            edges.push([a.min(c), a.max(c)]);
            cells.push(Cell {
                corners: [a, b, c, d],
                triangle: first,
                count: 2,
            });
        }
        edges.sort_unstable();
        let rest = mesh.rest();
        let centre =
            |cell: &Cell| 0.25 * cell.corners.map(|k| rest[k as usize]).iter().sum::<DVec3>();
        let centres: Vec<DVec3> = cells.iter().map(centre).collect();
        Self {
            own: own_parts(&triangles),
            stars: Stars::new(rest, cells.iter().map(|cell| &triangles[cell.range()])),
            courses: vec![(DVec3::ZERO, 0.0); cells.len()],
            tree: Tree::new(&centres),
            paths: vec![[DVec3::ZERO; 2]; rest.len()],
            reach,
            drift: (reach / 3.0).max(DRIFT * shortest_edge(mesh)),
            ahead: NEVER,
            share: 0.0,
            off: 0.0,
            list: Vec::new(),
            most: 200 * mesh.node_count() + 10_000,
            triangles,
            cells,
            edges,
        }
    }

    /// All edges and faces.
    pub(crate) fn parts(&self) -> impl Iterator<Item = Part> + Clone + '_ {
        let edges = self.edges.iter().map(|&[p, q]| (true, [p, q, q]));
        edges.chain(self.triangles.iter().map(|&t| (false, t)))
    }

    /// They are looked for anew.
    pub(crate) fn forget(&mut self) {
        self.ahead = NEVER;
    }

    /// Finds the pairs that may come near while the nodes go on as in the substep of `h` [s] from `now`
    /// [s] on, in which they go from `x` to `guess`; false when there are too many to be looked at, or a
    /// way is not finite: they are looked for anew then.
    pub(crate) fn find(&mut self, [x, guess]: [&[DVec3]; 2], now: f64, h: f64) -> bool {
        let substeps = (AHEAD / h).max(1.0);
        self.ahead = NEVER;
        for (path, (x, guess)) in self.paths.iter_mut().zip(x.iter().zip(guess)) {
            *path = [*x, substeps * (*guess - *x)];
        }
        self.list.clear();
        // False for what is not a number, too.
        let is_within =
            |[x, way]: &[DVec3; 2]| (x.abs() + way.abs()).cmplt(DVec3::splat(FARTHEST)).all();
        if !self.paths.iter().all(is_within) {
            return false;
        }
        let reach = self.reach + 2.0 * self.drift;
        self.stars.look(&self.paths, reach);
        for (course, cell) in self.courses.iter_mut().zip(&self.cells) {
            let ways = cell.corners.map(|k| self.paths[k as usize][1]);
            let mean = 0.25 * (ways[0] + ways[1] + ways[2] + ways[3]);
            let off = ways.map(|way| way.distance_squared(mean));
            *course = (mean, off[0].max(off[1]).max(off[2]).max(off[3]).sqrt());
        }
        self.tree.set_boxes(|cell| {
            let [a, b, c, d] = self.cells[cell as usize].corners.map(|k| {
                let [at, way] = self.paths[k as usize];
                Moving::around([at, at + way], 0.5 * reach)
            });
            a.join(&b).join(&c.join(&d))
        });
        let mut list = std::mem::take(&mut self.list);
        let mut meet = |first: Range<usize>, second: Range<usize>, far: f64| {
            for first in first {
                for second in second.clone() {
                    self.meet([first, second], [reach, far], &mut list);
                }
            }
            list.len() < self.most
        };
        let within = |(cell, (_, off)): (&Cell, &(DVec3, f64))| {
            let Range { start, end } = cell.range();
            self.stars.hold([&cell.corners; 2])
                || meet(start..start + 1, start + 1..end, reach + 2.0 * off)
        };
        let found = self.cells.iter().zip(&self.courses).all(within)
            && self.tree.meetings(|a, b| {
                let [a, b] = [a, b].map(|cell| cell as usize);
                let cells = [&self.cells[a], &self.cells[b]];
                // Far is what no two of their points bring together, a cheaper bound than that of each pair.
                let far = || {
                    let [(a, r), (b, s)] = [self.courses[a], self.courses[b]];
                    reach + a.distance(b) + r + s
                };
                self.stars.hold(cells.map(|cell| &cell.corners))
                    || meet(cells[0].range(), cells[1].range(), far())
            });
        self.list = list;
        if found {
            self.ahead = [now, substeps * h];
            (self.share, self.off) = (1.0 / substeps, 0.0);
        }
        found
    }

    /// Adds the pairs of features of two triangles that may come within `reach` [m] to a list, except those that a
    /// plane keeps `far` [m] apart.
    fn meet(&self, [first, second]: [usize; 2], [reach, far]: [f64; 2], list: &mut Vec<Candidate>) {
        let mut add = |kind: Kind, nodes: [u32; 4]| {
            let at = nodes.map(|k| self.paths[k as usize][0]);
            if !are_apart(kind, &at, far) {
                let candidate = Candidate::new(Pair { kind, nodes }, &self.paths);
                if candidate.distance <= reach + candidate.approach {
                    list.push(candidate);
                }
            }
        };
        for [of, other] in [[first, second], [second, first]] {
            let [a, b, c] = self.triangles[other];
            for &node in self.own[of].nodes() {
                if node != a && node != b && node != c {
                    add(Kind::NodeTriangle, [node, a, b, c]);
                }
            }
        }
        for &e in self.own[first].edges() {
            for &f in self.own[second].edges() {
                let ([p, q], [r, s]) = (e.min(f), e.max(f));
                if p != r && p != s && q != r && q != s {
                    add(Kind::EdgeEdge, [p, q, r, s]);
                }
            }
        }
    }

    /// Whether the pairs are those of the substep of `h` [s] from `now` [s] on too: every node is near
    /// enough to the way that it was going to go.
    pub(crate) fn covers(&mut self, [x, end]: [&[DVec3]; 2], now: f64, h: f64) -> bool {
        let [since, length] = self.ahead;
        let mut shares = [now, now + h].map(|time| (time - since) / length);
        if shares[1] > 1.0 + 1e-9 {
            // The pairs are those of nodes that stay where the way ends, too.
            shares = [1.0; 2];
        }
        let (most, mut off, mut near) = (self.drift * self.drift, 0.0_f64, shares[0] >= -1e-9);
        for ((x, end), [from, way]) in x.iter().zip(end).zip(&self.paths) {
            for (at, share) in [(x, shares[0]), (end, shares[1])] {
                let squared = at.distance_squared(*from + *way * share);
                near &= squared <= most;
                off = off.max(squared);
            }
        }
        (self.share, self.off) = (shares[1], off.sqrt());
        near
    }

    /// Those that may come within reach in the present substep.
    pub(crate) fn near(&self) -> impl Iterator<Item = &Pair> {
        let reach = self.reach + 2.0 * self.off;
        let may = move |c: &&Candidate| c.distance - self.share * c.approach <= reach;
        self.list.iter().filter(may).map(|c| &c.pair)
    }
}

/// Length of the shortest edge at rest [m].
pub(crate) fn shortest_edge(mesh: &Mesh) -> f64 {
    let rest = mesh.rest();
    let length = |e: &[u32; 2]| rest[e[0] as usize].distance(rest[e[1] as usize]);
    mesh.edges()
        .iter()
        .map(length)
        .fold(f64::INFINITY, f64::min)
}

/// The edges of a triangle, each with its lower node first.
pub(crate) fn edges(&[a, b, c]: &[u32; 3]) -> [[u32; 2]; 3] {
    [[a, b], [b, c], [c, a]].map(|[p, q]| [p.min(q), p.max(q)])
}

/// Corners and edges of a triangle that no triangle before has: so many of the first.
#[derive(Clone, Copy, Debug)]
struct Own {
    nodes: [u32; 3],
    edges: [[u32; 2]; 3],
    count: [usize; 2],
}

impl Own {
    fn nodes(&self) -> &[u32] {
        &self.nodes[..self.count[0]]
    }

    fn edges(&self) -> &[[u32; 2]] {
        &self.edges[..self.count[1]]
    }
}

fn own_parts(triangles: &[[u32; 3]]) -> Vec<Own> {
    let (mut nodes, mut sides) = (HashSet::new(), HashSet::new());
    let own = triangles.iter().map(|triangle| {
        let mut own = Own {
            nodes: *triangle,
            edges: edges(triangle),
            count: [0; 2],
        };
        for k in 0..3 {
            if nodes.insert(own.nodes[k]) {
                own.nodes.swap(own.count[0], k);
                own.count[0] += 1;
            }
            if sides.insert(own.edges[k]) {
                own.edges.swap(own.count[1], k);
                own.count[1] += 1;
            }
        }
        own
    });
    own.collect()
}

/// Whether a plane keeps the two features further apart than `reach`, across the line between their middles
/// or, of edges, across what of it is at right angles to one of them: a cheap test that leaves out most pairs.
#[inline]
fn are_apart(kind: Kind, x: &[DVec3; 4], reach: f64) -> bool {
    // How far apart along an axis, times its length
    let is_enough = |apart: f64, axis: DVec3| {
        apart > 0.0 && apart * apart > reach * reach * axis.length_squared()
    };
    match kind {
        Kind::NodeTriangle => {
            let d = x[0] - (x[1] + x[2] + x[3]) / 3.0;
            let [a, b, c] = [1, 2, 3].map(|k| (x[0] - x[k]).dot(d));
            is_enough(a.min(b).min(c), d)
        }
        Kind::EdgeEdge => {
            let (u, v) = (x[1] - x[0], x[3] - x[2]);
            let d = 0.5 * (x[0] + x[1] - x[2] - x[3]);
            let are_apart = |axis: DVec3| {
                let along = 0.5 * (u.dot(axis).abs() + v.dot(axis).abs());
                is_enough(d.dot(axis) - along, axis)
            };
            let across = |edge: DVec3| d * edge.length_squared() - edge * d.dot(edge);
            are_apart(d) || are_apart(across(u)) || are_apart(across(v))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const H: f64 = 1.0 / 120.0;
    const REACH: f64 = 1.5e-3;

    fn random(state: &mut u64) -> DVec3 {
        let mut next = || {
            *state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (*state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        DVec3::new(next(), next(), next())
    }

    /// Whatever comes within reach in one of the substeps for which the pairs serve is among the near
    /// ones.
    #[test]
    fn nothing_that_comes_near_is_left_out() {
        let grid = Mesh::grid([5, 6], [0.08, 0.1]).unwrap();
        nothing_is_left_out(&grid);
        // Some quads as two triangles
        let (halved, quads): (Vec<_>, Vec<_>) =
            (0..).zip(grid.quads()).partition(|(k, _)| k % 3 == 0);
        let halves = halved
            .iter()
            .flat_map(|(_, [a, b, c, d])| [[*b, *c, *d], [*b, *d, *a]]);
        let (quads, halves) = (
            quads.iter().map(|(_, quad)| **quad).collect(),
            halves.collect(),
        );
        let mixed = Mesh::new(grid.rest().to_vec(), quads, halves).unwrap();
        nothing_is_left_out(&mixed);
    }

    fn nothing_is_left_out(mesh: &Mesh) {
        let Pairs {
            triangles, edges, ..
        } = Pairs::new(mesh, REACH);
        let mut all = Vec::new();
        for &[a, b, c] in &triangles {
            let nodes = (0..mesh.node_count() as u32).filter(|node| ![a, b, c].contains(node));
            all.extend(nodes.map(|node| Pair {
                kind: Kind::NodeTriangle,
                nodes: [node, a, b, c],
            }));
        }
        for (k, &[p, q]) in edges.iter().enumerate() {
            let others = edges[k + 1..]
                .iter()
                .filter(|other| !other.contains(&p) && !other.contains(&q));
            all.extend(others.map(|&[r, s]| Pair {
                kind: Kind::EdgeEdge,
                nodes: [p, q, r, s],
            }));
        }
        let (state, mut near_count, mut left_out) = (&mut 3, 0, 0);
        for round in 0..60 {
            let mut pairs = Pairs::new(mesh, REACH);
            // A crumpled sheet, or one folded once, that goes as a whole, or whose nodes go anywhere, not quite
            // straight
            let mut x: Vec<DVec3> = Vec::new();
            x.extend(mesh.rest().iter().map(|at| match round % 3 {
                0 => {
                    let layer = DVec3::Z * 5e-4_f64.copysign(at.x);
                    DVec3::new(at.x.abs(), at.y, 0.0) + layer + 2e-4 * random(state)
                }
                _ => 0.4 * *at + 0.04 * random(state),
            }));
            let mut ways: Vec<DVec3> = Vec::new();
            let apart = 0.01 * f64::from(round % 2);
            ways.extend(x.iter().map(|_| 0.01 * DVec3::X + apart * random(state)));
            let guess: Vec<DVec3> = x.iter().zip(&ways).map(|(x, way)| *x + *way).collect();
            assert!(pairs.find([&x, &guess], 0.0, H));
            for substep in 0..4 {
                let mut end = Vec::new();
                let stray = 0.5 * pairs.drift;
                end.extend(
                    x.iter()
                        .zip(&ways)
                        .map(|(x, way)| *x + *way + stray * random(state)),
                );
                if !pairs.covers([&x, &end], H * f64::from(substep), H) {
                    break;
                }
                let near: HashSet<_> = pairs.near().map(|p| (p.kind as u8, p.nodes)).collect();
                for pair in &all {
                    let nodes = pair.nodes.map(|k| k as usize);
                    let comes = (0..=8).any(|k| {
                        let at = nodes.map(|node| x[node].lerp(end[node], f64::from(k) / 8.0));
                        distance(pair.kind, &at) < REACH
                    });
                    let is_there = near.contains(&(pair.kind as u8, pair.nodes));
                    assert!(is_there || !comes, "{pair:?}");
                    near_count += usize::from(comes);
                    left_out += usize::from(!is_there);
                }
                x = end;
            }
        }
        assert!(
            near_count > 1000 && left_out > 1000,
            "{near_count} {left_out}"
        );
    }

    #[test]
    fn ways_without_end_are_not_looked_at() {
        let mesh = Mesh::grid([3, 3], [0.04, 0.04]).unwrap();
        let mut pairs = Pairs::new(&mesh, REACH);
        for bad in [f64::NAN, f64::INFINITY, -1e35] {
            let mut guess = mesh.rest().to_vec();
            guess[4].y = bad;
            assert!(!pairs.find([mesh.rest(), &guess], 0.0, H), "{bad}");
            assert!(!pairs.covers([mesh.rest(), mesh.rest()], 0.0, H));
        }
        assert!(pairs.find([mesh.rest(), mesh.rest()], 0.0, H));
        assert!(pairs.covers([mesh.rest(), mesh.rest()], 0.0, H));
    }
}
