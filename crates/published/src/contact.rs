//! Self-collision: nodes as balls, averaged projected Jacobi, friction towards the substep's start.

use selvedge_cloth::Mesh;
use selvedge_math::DVec3;

use crate::search::Search;

/// Candidates are looked for within this many ball radii ...
const REACH: f64 = 3.5;
/// ... among this many nearest nodes.
const NEIGHBOURS: usize = 12;
/// A relative move of this size makes the candidates stale.
const STALE: f64 = 0.035;
/// Ball diameter per mean edge length, before the thickness factor.
const EDGES_PER_RADIUS: f64 = 2.05;
/// Nodes at the two ends of a short diagonal touch at this share of its length.
const SHORT: f64 = 0.976;
const SWEEP_LIMIT: usize = 50;
/// Friction is applied in the first passes only.
const FRICTION_PASSES: usize = 5;

/// The contact state that outlives a substep.
#[derive(Clone, Debug)]
struct Candidates {
    pairs: Vec<Pair>,
    /// Reference positions and distances to the origin for the staleness test.
    reference: Vec<DVec3>,
    origin_distance: Vec<f64>,
    rebuilds: u32,
}

impl Candidates {
    /// As `clone_from`, keeping the memory.
    fn copy_from(&mut self, other: &Self) {
        self.pairs.clone_from(&other.pairs);
        self.reference.copy_from_slice(&other.reference);
        self.origin_distance.copy_from_slice(&other.origin_distance);
        self.rebuilds = other.rebuilds;
    }
}

/// Two nodes that may touch.
#[derive(Clone, Copy, Debug)]
struct Pair {
    /// `i < j`.
    nodes: [u32; 2],
    /// Between the centres of touching balls: `R` [m].
    distance: f64,
}

impl Pair {
    fn between(&self, pass: &Pass<'_>, x: &[DVec3]) -> Between {
        let [i, j] = self.nodes.map(|node| node as usize);
        let vector = x[j] - x[i];
        let crossed = (pass.start[j] - pass.start[i]).dot(vector) < 0.0;
        Between { vector, crossed }
    }
}

/// From the first node of a pair to the second [m].
struct Between {
    vector: DVec3,
    /// A pair stays on the side on which it began the substep: on the other one its length counts
    /// as negative.
    crossed: bool,
}

impl Between {
    /// Whether the signed length is below a limit [m], without a root.
    fn below(&self, limit: f64) -> bool {
        let squared = self.vector.length_squared();
        if self.crossed {
            limit > 0.0 || squared > limit * limit
        } else {
            limit > 0.0 && squared < limit * limit
        }
    }
}

/// The balls and what they touch.
#[derive(Clone, Debug)]
pub(crate) struct Contact {
    /// Ball radius `r` [m].
    radius: f64,
    /// By node the later nodes of the same quads: node `i` has
    /// `close[close_start[i]..close_start[i + 1]]`, each with its contact distance; `None` across
    /// an edge, whose ends are never in contact.
    close: Vec<(u32, Option<f64>)>,
    close_start: Vec<u32>,
    inverse_areas: Vec<f64>,
    candidates: Candidates,
    /// The candidates before the present step, to go back to when it fails.
    before: Candidates,
    take_reference: bool,
    // Scratch of one substep, by pair.
    active: Vec<bool>,
    // Scratch of one pass.
    touching: Vec<Touch>,
    correction: Vec<DVec3>,
    count: Vec<f64>,
    weights: Vec<f64>,
    search: Search,
}

/// One active pair in one pass.
#[derive(Clone, Copy, Debug)]
struct Touch {
    nodes: [u32; 2],
    distance: f64,
    gap: f64,
    normal: DVec3,
    /// `w_i + w_j + c`.
    stiffness: f64,
    lambda: f64,
}

/// What a pass needs to know.
pub(crate) struct Pass<'a> {
    /// Pass number in the substep, from 0.
    pub(crate) number: usize,
    /// Whether the candidates must be looked for anew whatever has moved.
    pub(crate) force_rebuild: bool,
    /// Positions at the start of the substep [m].
    pub(crate) start: &'a [DVec3],
    pub(crate) held: &'a [u32],
    pub(crate) compliance: f64,
    pub(crate) tolerance: f64,
    pub(crate) friction: f64,
}

impl Contact {
    pub(crate) fn new(mesh: &Mesh, inverse_areas: &[f64], thickness_factor: f64) -> Self {
        let rest = mesh.rest();
        let length = |a: u32, b: u32| rest[a as usize].distance(rest[b as usize]);
        let radius = thickness_factor * mean_edge(mesh) / EDGES_PER_RADIUS;
        let n = rest.len();
        let mut close_to = vec![Vec::new(); n];
        for &[p, q] in mesh.edges() {
            close_to[p.min(q) as usize].push((p.max(q), None));
        }
        for &[a, b, c, d] in mesh.quads() {
            for [p, q] in [[a, c], [b, d]] {
                let distance = (2.0 * radius).min(SHORT * length(p, q));
                close_to[p.min(q) as usize].push((p.max(q), Some(distance)));
            }
        }
        let mut close_start = vec![0];
        for close in &close_to {
            close_start.push(close_start[close_start.len() - 1] + close.len() as u32);
        }
        let most_pairs = NEIGHBOURS * n;
        let candidates = || Candidates {
            pairs: Vec::with_capacity(most_pairs),
            reference: rest.to_vec(),
            origin_distance: vec![1.0; n],
            rebuilds: 0,
        };
        Self {
            radius,
            close: close_to.concat(),
            close_start,
            inverse_areas: inverse_areas.to_vec(),
            before: candidates(),
            candidates: candidates(),
            take_reference: false,
            active: Vec::with_capacity(most_pairs),
            touching: Vec::with_capacity(most_pairs),
            correction: vec![DVec3::ZERO; n],
            count: vec![0.0; n],
            weights: inverse_areas.to_vec(),
            search: Search::with_capacity(n),
        }
    }

    /// Forgets the candidates, as before the first step.
    pub(crate) fn reset(&mut self, mesh: &Mesh) {
        self.candidates.pairs.clear();
        self.active.clear();
        self.candidates.reference.copy_from_slice(mesh.rest());
        self.candidates.origin_distance.fill(1.0);
        self.candidates.rebuilds = 0;
    }

    /// The number of pairs corrected in the last substep.
    pub(crate) fn active_count(&self) -> usize {
        self.active.iter().filter(|&&active| active).count()
    }

    /// Keeps the present candidates to go back to.
    pub(crate) fn remember(&mut self) {
        self.before.copy_from(&self.candidates);
    }

    /// Goes back to the candidates last kept.
    pub(crate) fn recall(&mut self) {
        self.candidates.copy_from(&self.before);
        self.take_reference = false;
    }

    #[cfg(test)]
    pub(crate) fn rebuild_count(&self) -> u32 {
        self.candidates.rebuilds
    }

    /// Corrects `x` after the stretch solve of a pass.
    pub(crate) fn pass(&mut self, pass: &Pass<'_>, x: &mut [DVec3]) {
        if pass.number == 0 {
            self.begin_substep(pass, x);
        }
        if !self.find_active(pass, x) {
            return;
        }
        self.push_apart(pass);
        if pass.number < FRICTION_PASSES {
            self.rub(pass, x);
        }
        for (x, &move_) in x.iter_mut().zip(&self.correction) {
            *x += move_;
        }
    }

    /// At the end of the pass loop: the reference of the staleness test is read here, not where
    /// the candidates were found.
    pub(crate) fn end_substep(&mut self, x: &[DVec3]) {
        if self.take_reference {
            self.candidates.reference.copy_from_slice(x);
            self.take_reference = false;
        }
    }

    /// **Not physics**: staleness is measured against the distance to the world's origin, so it
    /// depends on where the cloth lies.
    fn begin_substep(&mut self, pass: &Pass<'_>, x: &[DVec3]) {
        let moved = x
            .iter()
            .zip(&self.candidates.reference)
            .zip(&self.candidates.origin_distance)
            .any(|((x, y), d)| x.distance_squared(*y) > (STALE * d) * (STALE * d));
        if pass.force_rebuild || moved {
            self.find_candidates(x, pass.held);
            for (d, x) in self.candidates.origin_distance.iter_mut().zip(x) {
                *d = x.length();
            }
            self.take_reference = true;
            self.candidates.rebuilds += 1;
        }
        self.active.clear();
        self.active.resize(self.candidates.pairs.len(), false);
    }

    /// **Not physics**: a pair whose smaller index does not see the larger one among its nearest
    /// nodes is missed, and the ball radius follows the mesh, not the material.
    fn find_candidates(&mut self, x: &[DVec3], held: &[u32]) {
        let reach = REACH * self.radius;
        self.candidates.pairs.clear();
        self.search.fill(x, reach);
        for i in 0..x.len() as u32 {
            let i_held = held.binary_search(&i).is_ok();
            let close =
                self.close_start[i as usize] as usize..self.close_start[i as usize + 1] as usize;
            let close = &self.close[close];
            for &(_, j) in self.search.nearest(x, i, reach, NEIGHBOURS) {
                if j < i || i_held && held.binary_search(&j).is_ok() {
                    continue;
                }
                let distance = match close.iter().find(|(node, _)| *node == j) {
                    Some(&(_, distance)) => distance,
                    None => Some(2.0 * self.radius),
                };
                if let Some(distance) = distance {
                    self.candidates.pairs.push(Pair {
                        nodes: [i, j],
                        distance,
                    });
                }
            }
        }
    }

    /// Finds the pairs to correct; false when none is deeper than the tolerance, in which case
    /// nothing is corrected at all.
    fn find_active(&mut self, pass: &Pass<'_>, x: &[DVec3]) -> bool {
        let pairs = &self.candidates.pairs;
        let deep = |pair: &Pair| {
            pair.between(pass, x)
                .below(pair.distance * (1.0 - pass.tolerance))
        };
        if !pairs.iter().any(deep) {
            return false;
        }
        self.weights.copy_from_slice(&self.inverse_areas);
        for &node in pass.held {
            self.weights[node as usize] = 0.0;
        }
        self.touching.clear();
        self.count.fill(0.0);
        for (pair, active) in pairs.iter().zip(&mut self.active) {
            let between = pair.between(pass, x);
            *active |= between.below(pair.distance * (1.0 + pass.tolerance));
            if *active {
                let &Pair { nodes, distance } = pair;
                let length = between.vector.length();
                let sign = if between.crossed { -1.0 } else { 1.0 };
                let normal = sign * (between.vector / length);
                let gap = sign * length - distance;
                let [i, j] = nodes.map(|node| node as usize);
                self.count[i] += 1.0;
                self.count[j] += 1.0;
                let stiffness = self.weights[i] + self.weights[j] + pass.compliance;
                let lambda = (-gap / stiffness).max(0.0);
                self.touching.push(Touch {
                    nodes,
                    distance,
                    gap,
                    normal,
                    stiffness,
                    lambda,
                });
            }
        }
        true
    }

    /// Averaged projected Jacobi. **Not physics**: with different counts at the two ends of a pair
    /// the pushes are not equal and opposite.
    fn push_apart(&mut self, pass: &Pass<'_>) {
        self.sum_pushes();
        for _ in 0..SWEEP_LIMIT {
            let mut worst = f64::INFINITY;
            for touch in &mut self.touching {
                let [i, j] = touch.nodes.map(|node| node as usize);
                let opening = touch.normal.dot(self.correction[j] - self.correction[i]);
                let residual = -touch.gap - opening - pass.compliance * touch.lambda;
                worst = worst.min(-residual / touch.distance);
                touch.lambda = (touch.lambda + residual / touch.stiffness).max(0.0);
            }
            self.sum_pushes();
            if worst >= -pass.tolerance {
                break;
            }
        }
    }

    fn sum_pushes(&mut self) {
        self.correction.fill(DVec3::ZERO);
        for touch in &self.touching {
            let [i, j] = touch.nodes.map(|node| node as usize);
            let push = touch.lambda * touch.normal;
            self.correction[i] -= push;
            self.correction[j] += push;
        }
        for ((correction, &w), &count) in self
            .correction
            .iter_mut()
            .zip(&self.weights)
            .zip(&self.count)
        {
            if count > 0.0 {
                *correction *= w / count;
            }
        }
    }

    /// **Not physics**: each node is pulled back towards where it began the substep, whatever its
    /// partner does, so layers that move together are braked.
    fn rub(&mut self, pass: &Pass<'_>, x: &[DVec3]) {
        const TINY: f64 = 1e-12;
        for ((correction, &x), &start) in self.correction.iter_mut().zip(x).zip(pass.start) {
            let depth = correction.length();
            if depth > 0.0 {
                let normal = *correction / (depth + TINY);
                let back = start - (x + *correction);
                let slip = back - back.dot(normal) * normal;
                let share = (pass.friction * depth / (slip.length() + TINY)).min(1.0);
                *correction += share * slip;
            }
        }
    }
}

/// The mean rest length of the edges [m].
pub(crate) fn mean_edge(mesh: &Mesh) -> f64 {
    let rest = mesh.rest();
    let sum: f64 = mesh
        .edges()
        .iter()
        .map(|&[p, q]| rest[p as usize].distance(rest[q as usize]))
        .sum();
    sum / mesh.edges().len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three by three nodes with edges of 1 m, far from each other but for those that a test moves.
    fn scattered() -> (Contact, Vec<DVec3>) {
        let mesh = Mesh::grid([3, 3], [2.0, 2.0]).unwrap();
        let contact = Contact::new(&mesh, &[WEIGHT; 9], 0.95);
        (
            contact,
            (0..9).map(|k| DVec3::Z * 100.0 * f64::from(k)).collect(),
        )
    }

    /// Inverse area of every node, and the compliance.
    const WEIGHT: f64 = 4.0;
    const COMPLIANCE: f64 = 2.0;
    /// Contact distance at edges of 1 m.
    const DIAMETER: f64 = 2.0 * 0.95 / 2.05;

    fn first_pass<'a>(start: &'a [DVec3], held: &'a [u32]) -> Pass<'a> {
        Pass {
            number: 0,
            force_rebuild: true,
            start,
            held,
            compliance: COMPLIANCE,
            tolerance: 0.0075,
            friction: 0.0,
        }
    }

    #[test]
    fn two_balls_are_pushed_apart_along_their_line() {
        let (mut contact, mut x) = scattered();
        (x[0], x[4]) = (DVec3::ZERO, DVec3::X * 0.5);
        let start = x.clone();
        contact.pass(&first_pass(&start, &[]), &mut x);
        assert_eq!(contact.active_count(), 1);
        // One pair: exact in the first sweep.
        let push = WEIGHT * (DIAMETER - 0.5) / (2.0 * WEIGHT + COMPLIANCE);
        assert!(x[0].distance(DVec3::X * -push) < 1e-15);
        assert!(x[4].distance(DVec3::X * (0.5 + push)) < 1e-15);
    }

    #[test]
    fn a_ball_that_changed_sides_is_pushed_back() {
        let (mut contact, mut x) = scattered();
        (x[0], x[4]) = (DVec3::ZERO, DVec3::X * -0.5);
        let start = x.clone();
        x[4] = DVec3::X * 0.3;
        contact.pass(&first_pass(&start, &[]), &mut x);
        // The gap is -0.3 - R, the normal from node 0 to node 4 still points to -x.
        let push = WEIGHT * (DIAMETER + 0.3) / (2.0 * WEIGHT + COMPLIANCE);
        assert!(x[0].distance(DVec3::X * push) < 1e-15);
        assert!(x[4].distance(DVec3::X * (0.3 - push)) < 1e-15);
    }

    #[test]
    fn nothing_is_corrected_until_one_pair_is_deep() {
        let (mut contact, mut x) = scattered();
        (x[0], x[4]) = (DVec3::ZERO, DVec3::X * (DIAMETER * 0.993));
        (x[1], x[5]) = (
            DVec3::Y * 50.0,
            DVec3::Y * 50.0 + DVec3::X * (DIAMETER * 1.007),
        );
        let start = x.clone();
        contact.pass(&first_pass(&start, &[]), &mut x);
        assert_eq!((contact.active_count(), &x), (0, &start));
        x[4] = DVec3::X * (DIAMETER * 0.99);
        contact.pass(&first_pass(&start, &[]), &mut x);
        assert_eq!(contact.active_count(), 2);
    }

    /// A ball between two held ones has nowhere to go. With no motion a sweep leaves the share
    /// `q = 1 - c/D`, `D = w + c`, of the residual: `lambda = (1 - q^51) g/c` after 50 sweeps.
    #[test]
    fn sweeps_end_at_their_limit() {
        let (mut contact, mut x) = scattered();
        (x[0], x[4], x[8]) = (DVec3::X * -0.25, DVec3::ZERO, DVec3::X * 0.25);
        let start = x.clone();
        let compliance = 0.01;
        let pass = Pass {
            compliance,
            ..first_pass(&start, &[0, 8])
        };
        contact.pass(&pass, &mut x);
        assert_eq!(x, start);
        let left: f64 = 1.0 - compliance / (WEIGHT + compliance);
        let lambda = (1.0 - left.powi(51)) * (DIAMETER - 0.25) / compliance;
        assert_eq!(contact.active_count(), 2);
        for touch in &contact.touching {
            assert!(
                (touch.lambda / lambda - 1.0).abs() < 1e-12,
                "{} {lambda}",
                touch.lambda
            );
        }
    }

    #[test]
    fn thick_cloth_keeps_short_diagonals() {
        let mesh = Mesh::grid([2, 2], [1.0, 1.0]).unwrap();
        // Balls of 1.5/2.05 m would overlap along the diagonal of 1.414 m, those of 0.95/2.05 not.
        for (thickness, distance) in [(1.5, 0.976 * 2f64.sqrt()), (0.95, DIAMETER)] {
            let mut contact = Contact::new(&mesh, &[1.0; 4], thickness);
            contact.find_candidates(mesh.rest(), &[]);
            let nodes: Vec<[u32; 2]> = contact.candidates.pairs.iter().map(|p| p.nodes).collect();
            assert_eq!(nodes, [[0, 3], [1, 2]]);
            assert!(
                contact
                    .candidates
                    .pairs
                    .iter()
                    .all(|p| (p.distance - distance).abs() < 1e-15)
            );
        }
    }

    #[test]
    fn near_the_origin_candidates_are_stale_sooner() {
        let mesh = Mesh::grid([3, 3], [2.0, 2.0]).unwrap();
        let mut contact = Contact::new(&mesh, &[WEIGHT; 9], 0.95);
        let mut x = mesh.rest().to_vec();
        let start = x.clone();
        let mut step = |contact: &mut Contact, node: usize, move_: f64| {
            x[node].x += move_;
            contact.pass(
                &Pass {
                    force_rebuild: false,
                    ..first_pass(&start, &[])
                },
                &mut x,
            );
            contact.end_substep(&x);
            contact.rebuild_count()
        };
        // Before the first search the distances count as 1 m.
        assert_eq!(step(&mut contact, 4, 0.034), 0);
        assert_eq!(step(&mut contact, 4, 0.002), 1);
        // Node 4 is now 0.036 m from the origin, node 5 1 m.
        assert_eq!(step(&mut contact, 5, 0.034), 1);
        assert_eq!(step(&mut contact, 4, 0.002), 2);
    }
}
