//! Joint positions along a path of poses: which branch, and which `q7` where.
//!
//! A Franka has one joint more than a pose has numbers. Given `q7` the exact inverse has up to eight
//! branches, so at each pose the choice is a number and a branch. Dynamic programming (Bellman 1957)
//! on the graph of (path parameter u, q7, branch) finds the best continuous choice at some knots:
//! least `sum |dq| + du (sum_j (W / margin_j)^2 + (W / sin q2)^2 + (W / cos q5)^2)` over chains whose links turn no joint by more than a
//! bound. The chain is then searched again among values of `q7` near the last ones, in ever smaller
//! steps, with `|dq|^2 / du` for `|dq|`. Then `q7(u)` is smoothed (Whittaker 1923: least
//! `sum (x - q7)^2 + lambda sum (second difference of x)^2`), every pose is solved exactly with the
//! smoothed value, and whatever that breaks is undone with a smaller lambda, or by forbidding the
//! link of the graph that led there.

use selvedge_math::Pose;

use crate::cause::{self, Cause, OWN_MARGIN, room};
use crate::clearance::Ruler;
use crate::inverse::Joints;
use crate::spline::{Ends, Spline};
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
const LINK: f64 = 0.9;
/// How far it may turn from one pose to the next [rad].
const STEP: f64 = 0.25;
/// Every how many knots are looked at first.
const STRIDE: usize = 3;
/// How often the graph is searched again without a link that proved wrong.
const RETRIES: usize = 12;
/// Smoothing, tried in this order.
const LAMBDAS: [f64; 4] = [30.0, 3.0, 0.3, 0.0];
/// Values of `q7` to either side, and the steps between them [rad], when a chain is refined.
const BESIDE: i32 = 5;
const FINER: [f64; 5] = [0.1, 0.05, 0.02, 0.01, 0.004];
/// A rotation of a radian is as long as this [m].
const LEVER: f64 = 0.2;

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

/// A pose on the way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Station {
    /// Of the tip, in the base.
    pub(crate) tip: Pose,
    /// Whether the jaws are open.
    pub(crate) open: bool,
}

/// Where a path stops being possible.
#[derive(Clone, Debug)]
pub(crate) struct Stop {
    pub(crate) station: usize,
    pub(crate) cause: Cause,
}

/// The length of the way up to each station, in metres with rotations counted by [`LEVER`].
pub(crate) fn lengths(stations: &[Station]) -> Vec<f64> {
    let mut length = 0.0;
    let mut lengths = vec![0.0; stations.len()];
    for (k, pair) in stations.windows(2).enumerate() {
        let (a, b) = (pair[0].tip, pair[1].tip);
        length += a.position().distance(b.position()) + LEVER * angle(&a, &b);
        lengths[k + 1] = length;
    }
    lengths
}

/// The angle between two poses [rad], whatever the signs of their quaternions.
pub(crate) fn angle(a: &Pose, b: &Pose) -> f64 {
    let turn = a.rotation().conjugate() * b.rotation();
    2.0 * selvedge_math::DVec3::new(turn.x, turn.y, turn.z)
        .length()
        .atan2(turn.w.abs())
}

/// Joint positions for each station, `home` being what the ends should be near to: seven numbers a
/// station.
pub(crate) fn route(
    ruler: &mut Ruler<'_>,
    stations: &[Station],
    home: &Joints,
    mesh: Mesh,
) -> Result<Result<Vec<f64>, Stop>, Error> {
    let mut u = lengths(stations);
    let whole = u.last().copied().unwrap_or_default().max(1e-9);
    for u in &mut u {
        *u /= whole;
    }
    let knots = knots(&u, mesh.knots);
    let mut graph = match Graph::new(ruler, stations, &u, &knots, home, mesh)? {
        Ok(graph) => graph,
        Err(knot) => match first_stop(ruler, stations, knots[knot]) {
            Some(stop) => return Ok(Err(stop)),
            // A finer look finds what the mesh has missed.
            None if mesh.values < cause::TRIED => {
                let values = cause::TRIED;
                return route(ruler, stations, home, Mesh { values, ..mesh });
            }
            None => {
                let (station, cause) = (knots[knot], Cause::Wrist);
                return Ok(Err(Stop { station, cause }));
            }
        },
    };
    // A chain by squares, if what lies between its knots is as good as they are
    if let Some(picks) = graph.stride()
        && let Some(choice) = between(ruler.arm(), stations, &u, &knots, &picks)?
    {
        let finer = finer(ruler.arm(), stations, &graph.steps, &knots, &choice, home)?;
        for lambda in LAMBDAS {
            if let Ok(path) = follow(ruler, stations, &u, &knots, &finer, lambda)? {
                return Ok(Ok(path));
            }
        }
    }
    // Every knot by the length of the way
    let mut stop = None;
    for _ in 0..RETRIES {
        let chain = match graph.search() {
            Ok(chain) => chain,
            Err((knot, joint, by)) => {
                let stopped = stop.unwrap_or_else(|| Stop {
                    station: knots[knot],
                    cause: Cause::Jump {
                        joint: ruler.arm().joints()[joint].name.clone(),
                        by,
                    },
                });
                return Ok(Err(stopped));
            }
        };
        let choice: Vec<Joints> = chain.iter().map(|&node| graph.nodes[node].q).collect();
        let finer = finer(ruler.arm(), stations, &graph.steps, &knots, &choice, home)?;
        for lambda in LAMBDAS {
            if let Ok(path) = follow(ruler, stations, &u, &knots, &finer, lambda)? {
                return Ok(Ok(path));
            }
        }
        // What the chain was checked for, at least at the knots.
        match follow(ruler, stations, &u, &knots, &choice, 0.0)? {
            Ok(path) => return Ok(Ok(path)),
            Err(stopped) if knots.len() == 1 => return Ok(Err(stopped)),
            Err(stopped) => {
                // The link that leads over the station; the one that leads to it if it is a knot.
                let knot = knots.partition_point(|&k| k < stopped.station).max(1);
                graph.forbidden.push([chain[knot - 1], chain[knot]]);
                stop = stop
                    .filter(|s: &Stop| s.station >= stopped.station)
                    .or(Some(stopped));
            }
        }
    }
    Ok(Err(stop.unwrap_or(Stop {
        station: 0,
        cause: Cause::Wrist,
    })))
}

/// Stations at nearly even distances, the first and the last among them.
fn knots(u: &[f64], count: usize) -> Vec<usize> {
    let mut knots = vec![0];
    for k in 1..count {
        let wanted = k as f64 / (count - 1) as f64;
        let after = u.partition_point(|u| *u < wanted).min(u.len() - 1);
        let near = match after > 0 && wanted - u[after - 1] < u[after] - wanted {
            true => after - 1,
            false => after,
        };
        let least = 0.3 / (count - 1) as f64;
        if knots.last().is_some_and(|last| u[near] - u[*last] > least) {
            knots.push(near);
        }
    }
    if let Some(last) = knots.last_mut()
        && u.len() > 1
        && *last + 1 != u.len()
    {
        match *last == 0 {
            true => knots.push(u.len() - 1),
            false => *last = u.len() - 1,
        }
    }
    knots
}

/// The first station without a posture, up to the given one.
fn first_stop(ruler: &mut Ruler<'_>, stations: &[Station], last: usize) -> Option<Stop> {
    let mut upto = stations.iter().enumerate().take(last + 1);
    upto.find_map(|(station, s)| {
        let cause = cause::cause(ruler, &s.tip, s.open)?;
        Some(Stop { station, cause })
    })
}

/// Whether a coarse graph has a chain from end to end, and its postures at the knots: a quick answer
/// about many places, without smoothing.
pub(crate) fn chain(
    ruler: &mut Ruler<'_>,
    stations: &[Station],
    home: &Joints,
) -> Result<Option<Vec<Joints>>, Error> {
    let mut u = lengths(stations);
    let whole = u.last().copied().unwrap_or_default().max(1e-9);
    for u in &mut u {
        *u /= whole;
    }
    let knots = knots(&u, COARSE.knots);
    // Where the hand itself is under the table no posture helps.
    if stations.iter().any(|s| ruler.hand(&s.tip, s.open).0 < 0.0) {
        return Ok(None);
    }
    // The ends and the middle are the likeliest to fail.
    for k in [0, knots.len() - 1, knots.len() / 2] {
        if !possible(ruler, &stations[knots[k]])? {
            return Ok(None);
        }
    }
    let graph = Graph::new(ruler, stations, &u, &knots, home, COARSE)?;
    let Ok(mut graph) = graph else {
        return Ok(None);
    };
    let found = graph.search().ok();
    Ok(found.map(|chain| chain.iter().map(|&node| graph.nodes[node].q).collect()))
}

/// Postures at the knots.
struct Graph {
    nodes: Vec<Node>,
    /// Where each knot's nodes start, and the end of the last.
    starts: Vec<usize>,
    /// Parameter from knot to knot.
    steps: Vec<f64>,
    window: usize,
    forbidden: Vec<[usize; 2]>,
}

struct Node {
    q: Joints,
    /// Which value of `q7`.
    value: usize,
    cost: f64,
    best: f64,
    from: usize,
}

impl Node {
    /// `span` is the parameter from the knot before to the knot after.
    fn new(arm: &Arm, q: Joints, value: usize, span: f64, home: Option<&Joints>) -> Self {
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
    fn new(
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
    fn search(&mut self) -> Result<Vec<usize>, (usize, usize, f64)> {
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
    fn stride(&mut self) -> Option<Vec<(usize, Joints)>> {
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

fn possible(ruler: &mut Ruler<'_>, station: &Station) -> Result<bool, Error> {
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

fn squared(a: &Joints, b: &Joints) -> f64 {
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

/// Postures at all knots from those at some: `q7` on a line between, on the branch that is nearest.
fn between(
    arm: &Arm,
    stations: &[Station],
    u: &[f64],
    knots: &[usize],
    picks: &[(usize, Joints)],
) -> Result<Option<Vec<Joints>>, Error> {
    let mut choice: Vec<Joints> = picks.iter().take(1).map(|pick| pick.1).collect();
    for pair in picks.windows(2) {
        let [(first, a), (last, b)] = [pair[0], pair[1]];
        for k in first + 1..last {
            let at = |k: usize| u[knots[k]];
            let share = (at(k) - at(first)) / (at(last) - at(first)).max(1e-12);
            let wanted: Joints = std::array::from_fn(|j| a[j] + share * (b[j] - a[j]));
            let solutions = arm.inverse(&stations[knots[k]].tip, wanted[6], wanted[0])?;
            let good = solutions
                .as_slice()
                .iter()
                .filter(|s| s.in_limits)
                .map(|s| s.q);
            let near = good.min_by(|a, b| squared(a, &wanted).total_cmp(&squared(b, &wanted)));
            match near.filter(|q| furthest(q, &wanted).0 < LINK) {
                Some(q) => choice.push(q),
                None => return Ok(None),
            }
        }
        choice.push(b);
    }
    Ok(Some(choice))
}

/// The same branch with `q7` chosen more finely: the chain is searched again among values near the
/// last choice, in ever smaller steps. Table and self are left to [`follow`].
fn finer(
    arm: &Arm,
    stations: &[Station],
    steps: &[f64],
    knots: &[usize],
    choice: &[Joints],
    home: &Joints,
) -> Result<Vec<Joints>, Error> {
    let mut choice = choice.to_vec();
    let mut nodes: Vec<Node> = Vec::new();
    let mut starts = Vec::new();
    for step in FINER {
        nodes.clear();
        starts.clear();
        starts.push(0);
        for (k, last) in choice.iter().enumerate() {
            let span = [k.checked_sub(1), Some(k)].into_iter().flatten();
            let span: f64 = span.filter_map(|k| steps.get(k)).sum();
            let is_end = k == 0 || k + 1 == choice.len();
            for beside in -BESIDE..=BESIDE {
                let q7 = last[6] + step * f64::from(beside);
                let solutions = arm.inverse(&stations[knots[k]].tip, q7, last[0])?;
                let near = solutions.as_slice().iter().map(|s| s.q);
                let near = near.filter(|q| furthest(q, last).0 < LINK && room(arm, q).0 >= 0.0);
                let Some(q) = near.min_by(|a, b| squared(a, last).total_cmp(&squared(b, last)))
                else {
                    continue;
                };
                nodes.push(Node::new(arm, q, 0, span, is_end.then_some(home)));
            }
            if nodes.len() == starts[k] {
                return Ok(choice);
            }
            starts.push(nodes.len());
        }
        for k in 1..choice.len() {
            let weight = 1.0 / steps[k - 1].max(1e-9);
            let (done, rest) = nodes.split_at_mut(starts[k]);
            for node in &mut rest[..starts[k + 1] - starts[k]] {
                node.best = f64::INFINITY;
                for (a, other) in done.iter().enumerate().skip(starts[k - 1]) {
                    let length = weight * squared(&other.q, &node.q);
                    let total = other.best + node.cost + length + whirl(&other.q, &node.q);
                    if total < node.best {
                        (node.best, node.from) = (total, a);
                    }
                }
            }
        }
        let last = choice.len() - 1;
        let ends = starts[last]..nodes.len();
        let best = ends.min_by(|&a, &b| nodes[a].best.total_cmp(&nodes[b].best));
        let mut at = best.unwrap_or(starts[last]);
        for k in (0..=last).rev() {
            choice[k] = nodes[at].q;
            at = nodes[at].from;
        }
    }
    Ok(choice)
}

/// Every station solved with the smoothed `q7`, from the branch of the first knot on.
fn follow(
    ruler: &mut Ruler<'_>,
    stations: &[Station],
    u: &[f64],
    knots: &[usize],
    choice: &[Joints],
    lambda: f64,
) -> Result<Result<Vec<f64>, Stop>, Error> {
    let arm = ruler.arm();
    let mut sevenths: Vec<f64> = choice.iter().map(|q| q[6]).collect();
    let at: Vec<f64> = knots.iter().map(|&k| u[k]).collect();
    smooth(&mut sevenths, &at, lambda);
    let curve = (knots.len() > 1).then(|| Spline::new(&at, &sevenths, 1, Ends::Free));
    let mut path: Vec<f64> = Vec::with_capacity(7 * stations.len());
    let mut previous = choice[0];
    for (k, station) in stations.iter().enumerate() {
        let mut q7 = [sevenths[0]];
        if let Some(curve) = &curve {
            curve.position(u[k], &mut q7);
        }
        let solutions = arm.inverse(&station.tip, q7[0], previous[0])?;
        // The first only has to be on the branch chosen; its q7 has been smoothed.
        let bound = if k == 0 { LINK } else { STEP };
        let mut nearest = (f64::INFINITY, 0, previous);
        for solution in solutions.as_slice().iter().filter(|s| s.in_limits) {
            let (distance, joint) = furthest(&solution.q, &previous);
            if distance < nearest.0 {
                nearest = (distance, joint, solution.q);
            }
        }
        if nearest.0 > bound || !fits(ruler, &nearest.2, station.open) {
            let cause = cause::cause(ruler, &station.tip, station.open);
            let cause = cause.unwrap_or_else(|| Cause::Jump {
                joint: arm.joints()[nearest.1].name.clone(),
                by: nearest.0.min(std::f64::consts::TAU),
            });
            return Ok(Err(Stop { station: k, cause }));
        }
        previous = nearest.2;
        path.extend_from_slice(&previous);
    }
    Ok(Ok(path))
}

/// Second differences of a function at the places `at`, as weights of three values: differences of
/// the slopes, times the mean distance of the places.
fn second_difference(at: &[f64], k: usize) -> [f64; 3] {
    let mean = (at[at.len() - 1] - at[0]) / (at.len() - 1) as f64;
    let (before, after) = (mean / (at[k + 1] - at[k]), mean / (at[k + 2] - at[k + 1]));
    [before, -before - after, after]
}

/// Solves `(1 + lambda D^T D) x = x0` in place, `D` being second differences: five diagonals,
/// positive definite, by an `L D L^T` factorisation.
fn smooth(x: &mut [f64], at: &[f64], lambda: f64) {
    let n = x.len();
    if n < 3 || lambda == 0.0 {
        return;
    }
    let mut bands = vec![[1.0, 0.0, 0.0]; n];
    for k in 0..n - 2 {
        let weights = second_difference(at, k);
        for (a, first) in weights.into_iter().enumerate() {
            for (b, second) in weights.into_iter().enumerate().skip(a) {
                bands[k + a][b - a] += lambda * first * second;
            }
        }
    }
    // bands[k] = [pivot, L of the next row, L of the one after].
    for k in 0..n {
        let [pivot, near, far] = bands[k];
        if k + 1 < n {
            bands[k + 1][0] -= near * near / pivot;
            bands[k + 1][1] -= near * far / pivot;
        }
        if k + 2 < n {
            bands[k + 2][0] -= far * far / pivot;
        }
        bands[k] = [pivot, near / pivot, far / pivot];
    }
    for k in 0..n {
        let value = x[k];
        for d in 1..=2.min(n - 1 - k) {
            x[k + d] -= bands[k][d] * value;
        }
    }
    for k in (0..n).rev() {
        x[k] /= bands[k][0];
        for d in 1..=2.min(n - 1 - k) {
            x[k] -= bands[k][d] * x[k + d];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoothing_keeps_lines_and_solves_its_equation() {
        let at = [0.0, 0.1, 0.3, 0.35, 0.6, 1.0];
        let mut line = at.map(|u| 0.3 * u - 1.0);
        let kept = line;
        smooth(&mut line, &at, 100.0);
        assert!(line.iter().zip(&kept).all(|(a, b)| (a - b).abs() < 1e-12));
        let start = [0.0, 1.0, -0.5, 2.0, 0.3, 0.7];
        let (mut x, lambda) = (start, 3.0);
        smooth(&mut x, &at, lambda);
        for k in 0..x.len() {
            let mut sum = x[k];
            for m in 0..x.len() - 2 {
                let weights = second_difference(&at, m);
                let second: f64 = (0..3).map(|d| weights[d] * x[m + d]).sum();
                sum += lambda * second * weights.get(k.wrapping_sub(m)).unwrap_or(&0.0);
            }
            assert!((sum - start[k]).abs() < 1e-12);
        }
    }

    #[test]
    fn knots_are_even_and_keep_the_ends() {
        let u: Vec<f64> = (0..=100).map(|k| f64::from(k) / 100.0).collect();
        assert_eq!(knots(&u, 5), [0, 25, 50, 75, 100]);
        assert_eq!(knots(&u[..1], 5), [0]);
        assert_eq!(knots(&[0.0, 1.0], 40), [0, 1]);
        assert_eq!(knots(&[0.0, 1e-9, 1.0], 40), [0, 2]);
    }
}
