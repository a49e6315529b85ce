//! Joint positions along a path of poses: which branch, and which `q7` where.
//!
//! A Franka has one joint more than a pose has numbers. Given `q7` the exact inverse has up to eight
//! branches, so at each pose the choice is a number and a branch. Dynamic programming (Bellman 1957)
//! on the graph of (path parameter u, q7, branch) finds the best continuous choice at some knots,
//! over chains whose links turn no joint by more than a bound: least
//! `sum |dq|^2 / du + du (sum_j (W / margin_j)^2 + (S / sin q2)^2 + (S / cos q5)^2)` over every third
//! knot, and where that leads nowhere over all knots, with `L |dq|` for the first term, since squares of steps
//! on a grid as coarse as the distance of the knots favour never to step. The chain is then searched
//! again among values of `q7` near the last ones, in ever smaller steps, by squares.
//!
//! `q7(u)` is smoothed (Whittaker 1923: least
//! `sum (x - q7)^2 + lambda sum (second difference of x)^2`), every pose is solved exactly with the
//! smoothed value, and whatever that breaks is undone with a smaller lambda, or by forbidding the
//! link of the graph that led there.

use selvedge_math::Pose;

use crate::cause::{self, Cause, room};
use crate::clearance::Ruler;
use crate::graph::{COARSE, Graph, LINK, Mesh, Node, fits, furthest, possible, squared, whirl};
use crate::inverse::Joints;
use crate::smooth::smooth;
use crate::spline::{Ends, Spline};
use crate::{Arm, Error};

/// How far a joint may turn from one pose to the next [rad].
const STEP: f64 = 0.25;
/// How often the graph is searched again without a link that proved wrong.
const RETRIES: usize = 12;
/// Smoothing, tried in this order.
const LAMBDAS: [f64; 4] = [30.0, 3.0, 0.3, 0.0];
/// Values of `q7` to either side, and the steps between them [rad], when a chain is refined.
const BESIDE: i32 = 5;
const FINER: [f64; 5] = [0.1, 0.05, 0.02, 0.01, 0.004];
/// A rotation of a radian is as long as this [m].
const LEVER: f64 = 0.2;

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn knots_are_even_and_keep_the_ends() {
        let u: Vec<f64> = (0..=100).map(|k| f64::from(k) / 100.0).collect();
        assert_eq!(knots(&u, 5), [0, 25, 50, 75, 100]);
        assert_eq!(knots(&u[..1], 5), [0]);
        assert_eq!(knots(&[0.0, 1.0], 40), [0, 1]);
        assert_eq!(knots(&[0.0, 1e-9, 1.0], 40), [0, 2]);
    }
}
