//! Postures at some poses of a path, and the best chains through them; `route` says what
//! for.

use crate::cause::{self, OWN_MARGIN, room};
use crate::clearance::Ruler;
use crate::inverse::Joints;
use crate::route::Station;
use crate::{Arm, Error};

/// Weight of a joint's distance from its limits [rad].
const BARRIER: f64 = 0.25;
/// Weight of the length of the way in joint space, on the coarse graph.
const LENGTH: f64 = 2.0;
/// Weight of the sine of `q2` and the cosine of `q5`. Where the upper arm stands on the axis of
/// joint 1, joints 1 and 3 turn the arm alike; where joint 5 is at a quarter turn two branches meet.
/// Near both the other joints whirl when `q7` is given.
const SINGULAR: f64 = 0.12;
/// Cost of a link on which one of them changes its sign.
const WHIRL: f64 = 30.0;
/// Weight of the distance from home at both ends.
const HOMING: f64 = 0.2;
/// How far a joint may turn from knot to knot [rad].
pub(crate) const LINK: f64 = 0.9;
/// Every how many knots are looked at first.
const STRIDE: usize = 3;

/// How finely the graph is laid out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mesh {
    pub(crate) knots: usize,
    pub(crate) values: usize,
}

/// For a path that is to be followed.
pub(crate) const FINE: Mesh = Mesh {
    knots: 40,
    values: 41,
};
/// For a question about feasibility.
pub(crate) const COARSE: Mesh = Mesh {
    knots: 17,
    values: 25,
};

/// Postures at the knots.
pub(crate) struct Graph {
    pub(crate) nodes: Vec<Node>,
    /// Where each knot's nodes start, and the end of the last.
    pub(crate) starts: Vec<usize>,
    /// Parameter from knot to knot.
    pub(crate) steps: Vec<f64>,
    window: usize,
    pub(crate) forbidden: Vec<[usize; 2]>,
}

/// A posture at a knot.
pub(crate) struct Node {
    pub(crate) q: Joints,
    /// Which value of `q7`.
    value: usize,
    pub(crate) cost: f64,
    pub(crate) best: f64,
    pub(crate) from: usize,
}

impl Node {
    /// `span` is the parameter from the knot before to the knot after.
    pub(crate) fn new(
        arm: &Arm,
        q: Joints,
        value: usize,
        span: f64,
        home: Option<&Joints>,
    ) -> Self {
        let margins = arm.joints().iter().zip(&q);
        let barrier = |(joint, q): (&crate::Joint, &f64)| {
            let share = BARRIER / joint.limits.margin(*q);
            share * share
        };
        let whirls = [q[1].sin(), q[4].cos()].map(|x| (SINGULAR / x.abs().max(1e-3)).powi(2));
        let limits = margins.map(barrier).sum::<f64>();
        let barriers = 0.5 * span * (limits + whirls[0] + whirls[1]);
        let cost = barriers + home.map_or(0.0, |home| HOMING * squared(&q, home));
        Self {
            q,
            value,
            cost,
            best: cost,
            from: 0,
        }
    }
}

impl Graph {
    /// Or the first knot without a posture.
    pub(crate) fn new(
        ruler: &mut Ruler<'_>,
        stations: &[Station],
        u: &[f64],
        knots: &[usize],
        home: &Joints,
        mesh: Mesh,
    ) -> Result<Result<Self, usize>, Error> {
        let arm = ruler.arm();
        let (mut nodes, mut starts) = (Vec::new(), vec![0]);
        for (k, &knot) in knots.iter().enumerate() {
            let station = &stations[knot];
            let is_end = k == 0 || k + 1 == knots.len();
            let span = u[knots[(k + 1).min(knots.len() - 1)]] - u[knots[k.saturating_sub(1)]];
            for (value, q7) in cause::grid(arm, mesh.values).enumerate() {
                let solutions = arm.inverse(&station.tip, q7, home[0])?;
                for solution in solutions.as_slice() {
                    let q = solution.q;
                    if !solution.in_limits || !fits(ruler, &q, station.open) {
                        continue;
                    }
                    nodes.push(Node::new(arm, q, value, span, is_end.then_some(home)));
                }
            }
            if nodes.len() == starts[k] {
                return Ok(Err(k));
            }
            starts.push(nodes.len());
        }
        let mut values = cause::grid(arm, mesh.values);
        let step = values
            .next()
            .zip(values.next())
            .map_or(LINK, |(a, b)| (b - a).abs());
        Ok(Ok(Self {
            nodes,
            starts,
            steps: knots.windows(2).map(|k| u[k[1]] - u[k[0]]).collect(),
            window: (LINK / step.max(1e-3)).ceil() as usize,
            forbidden: Vec::new(),
        }))
    }

    /// The best chain of nodes, or the first knot that none leads to, with the joint that stands
    /// most in the way and how far it would have to jump.
    pub(crate) fn search(&mut self) -> Result<Vec<usize>, (usize, usize, f64)> {
        for node in &mut self.nodes[..self.starts[1]] {
            node.best = node.cost;
        }
        for k in 1..self.starts.len() - 1 {
            let (done, rest) = self.nodes.split_at_mut(self.starts[k]);
            let before = self.starts[k - 1];
            let earlier = &done[before..];
            let mut any = false;
            for (n, node) in rest[..self.starts[k + 1] - self.starts[k]]
                .iter_mut()
                .enumerate()
            {
                let first = earlier.partition_point(|a| a.value + self.window < node.value);
                (node.best, node.from) = (f64::INFINITY, usize::MAX);
                for (a, other) in earlier.iter().enumerate().skip(first) {
                    if other.value > node.value + self.window {
                        break;
                    }
                    if other.best == f64::INFINITY || furthest(&other.q, &node.q).0 > LINK {
                        continue;
                    }
                    // Squares of steps on a coarse grid would favour never to step.
                    let length = squared(&other.q, &node.q).sqrt();
                    let total = other.best + node.cost + LENGTH * length + whirl(&other.q, &node.q);
                    let link = [before + a, self.starts[k] + n];
                    if total < node.best && !self.forbidden.contains(&link) {
                        (node.best, node.from) = (total, before + a);
                        any = true;
                    }
                }
            }
            if !any {
                return Err(self.gap(k));
            }
        }
        let last = self.starts[self.starts.len() - 2];
        let ends = self.nodes[last..].iter().enumerate();
        let best = ends.min_by(|a, b| a.1.best.total_cmp(&b.1.best));
        let mut at = last + best.map_or(0, |(k, _)| k);
        let mut chain = vec![at];
        while self.nodes[at].from != usize::MAX && at >= self.starts[1] {
            at = self.nodes[at].from;
            chain.push(at);
        }
        chain.reverse();
        Ok(chain)
    }

    /// The best chain over every `STRIDE`-th knot by squares of steps, which the grid is fine enough
    /// for at that distance. What lies between is not looked at.
    pub(crate) fn stride(&mut self) -> Option<Vec<(usize, Joints)>> {
        let last = self.starts.len() - 2;
        let mut picks: Vec<usize> = (0..last).step_by(STRIDE).collect();
        picks.push(last);
        for node in &mut self.nodes[..self.starts[1]] {
            node.best = node.cost;
        }
        for pair in picks.windows(2) {
            let du: f64 = self.steps[pair[0]..pair[1]].iter().sum();
            let knots = (pair[1] - pair[0]) as f64;
            let (done, rest) = self.nodes.split_at_mut(self.starts[pair[1]]);
            let before = self.starts[pair[0]]..self.starts[pair[0] + 1];
            for node in &mut rest[..self.starts[pair[1] + 1] - self.starts[pair[1]]] {
                (node.best, node.from) = (f64::INFINITY, usize::MAX);
                for (a, other) in before.clone().zip(&done[before.clone()]) {
                    if other.value.abs_diff(node.value) > 2 * self.window
                        || furthest(&other.q, &node.q).0 > 2.0 * LINK
                    {
                        continue;
                    }
                    let total = other.best
                        + knots * node.cost
                        + squared(&other.q, &node.q) / du.max(1e-9)
                        + whirl(&other.q, &node.q);
                    if total < node.best {
                        (node.best, node.from) = (total, a);
                    }
                }
            }
        }
        let ends = self.starts[last]..self.nodes.len();
        let mut at = ends.min_by(|&a, &b| self.nodes[a].best.total_cmp(&self.nodes[b].best))?;
        let mut chain = Vec::with_capacity(picks.len());
        for &pick in picks.iter().rev() {
            chain.push((pick, self.nodes.get(at)?.q));
            at = self.nodes[at].from;
        }
        chain.reverse();
        Some(chain)
    }

    fn gap(&self, k: usize) -> (usize, usize, f64) {
        let mut least = (k, 0, f64::INFINITY);
        for a in &self.nodes[self.starts[k - 1]..self.starts[k]] {
            for b in &self.nodes[self.starts[k]..self.starts[k + 1]] {
                let (by, joint) = furthest(&a.q, &b.q);
                if a.best < f64::INFINITY && by < least.2 {
                    least = (k, joint, by);
                }
            }
        }
        least
    }
}

pub(crate) fn possible(ruler: &mut Ruler<'_>, station: &Station) -> Result<bool, Error> {
    let arm = ruler.arm();
    for q7 in cause::grid(arm, COARSE.values) {
        let solutions = arm.inverse(&station.tip, q7, 0.0)?;
        for solution in solutions.as_slice() {
            if solution.in_limits && fits(ruler, &solution.q, station.open) {
                return Ok(true);
            }
        }
    }
    Ok(false)
}

/// Whether a posture keeps its margins.
pub(crate) fn fits(ruler: &mut Ruler<'_>, q: &[f64], open: bool) -> bool {
    room(ruler.arm(), q).0 >= 0.0 && ruler.is_clear(q, open, 0.0, OWN_MARGIN)
}

pub(crate) fn whirl(a: &Joints, b: &Joints) -> f64 {
    let changes = a[1] * b[1] < 0.0 || a[4].cos() * b[4].cos() < 0.0;
    if changes { WHIRL } else { 0.0 }
}

pub(crate) fn squared(a: &Joints, b: &Joints) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum()
}

/// The largest difference of a joint, and which.
pub(crate) fn furthest(a: &[f64], b: &[f64]) -> (f64, usize) {
    let mut worst = (0.0, 0);
    for (k, (a, b)) in a.iter().zip(b).enumerate() {
        if (a - b).abs() > worst.0 {
            worst = ((a - b).abs(), k);
        }
    }
    worst
}
