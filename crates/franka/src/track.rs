//! Joint positions along a path for arms without an exact inverse: solved one after the other.

use crate::cause::{Cause, OWN_MARGIN, room};
use crate::clearance::Ruler;
use crate::graph::{fits, furthest};
use crate::route::{Station, Stop};
use crate::{Arm, Error};

/// Starts beside home.
const STARTS: usize = 40;
/// How far a joint may turn or slide from one pose to the next.
const STEP: f64 = 0.5;

/// Follows the stations from many starts, nearest to home first, each pose solved from the one
/// before; the first that comes to the end, or where the one that came furthest stopped.
pub(crate) fn track(
    ruler: &mut Ruler<'_>,
    stations: &[Station],
    home: &[f64],
) -> Result<Result<Vec<f64>, Stop>, Error> {
    let arm = ruler.arm();
    let mut starts: Vec<Vec<f64>> = Vec::new();
    let mut missed = f64::INFINITY;
    for start in 0..STARTS {
        let solution = arm.inverse_near(&stations[0].tip, &spread(arm, home, start))?;
        if !solution.converged {
            missed = missed.min(solution.residual);
        } else if !starts.iter().any(|q| furthest(q, &solution.q).0 < 1e-3) {
            starts.push(solution.q);
        }
    }
    starts.sort_by(|a, b| furthest(a, home).0.total_cmp(&furthest(b, home).0));
    let mut stop = Stop {
        station: 0,
        cause: Cause::NotFound { residual: missed },
    };
    for (number, start) in starts.iter().enumerate() {
        match follow(ruler, stations, start)? {
            Ok(path) => return Ok(Ok(path)),
            Err(stopped) if number == 0 || stopped.station > stop.station => stop = stopped,
            Err(_) => {}
        }
    }
    Ok(Err(stop))
}

fn follow(
    ruler: &mut Ruler<'_>,
    stations: &[Station],
    start: &[f64],
) -> Result<Result<Vec<f64>, Stop>, Error> {
    let arm = ruler.arm();
    let mut path = Vec::with_capacity(start.len() * stations.len());
    let mut previous = start.to_vec();
    for (k, station) in stations.iter().enumerate() {
        let solution = arm.inverse_near(&station.tip, &previous)?;
        let (by, joint) = furthest(&solution.q, &previous);
        let cause = if !solution.converged {
            Some(Cause::NotFound {
                residual: solution.residual,
            })
        } else if by > STEP {
            let joint = arm.joints()[joint].name.clone();
            Some(Cause::Jump { joint, by })
        } else if !fits(ruler, &solution.q, station.open) {
            Some(misfit(ruler, &solution.q, station.open))
        } else {
            None
        };
        if let Some(cause) = cause {
            return Ok(Err(Stop { station: k, cause }));
        }
        path.extend_from_slice(&solution.q);
        previous = solution.q;
    }
    Ok(Ok(path))
}

/// Why a posture does not keep its margins.
pub(crate) fn misfit(ruler: &mut Ruler<'_>, q: &[f64], open: bool) -> Cause {
    let arm = ruler.arm();
    let (room, joint) = room(arm, q);
    let clearance = ruler.clearance(q, open);
    if room < 0.0 {
        Cause::Limit {
            joint: arm.joints()[joint].name.clone(),
            beyond: -room,
        }
    } else if clearance.table < 0.0 || clearance.own >= OWN_MARGIN {
        Cause::Table {
            link: clearance.lowest.to_owned(),
            below: -clearance.table,
            any_base: false,
        }
    } else {
        Cause::Own {
            links: clearance.nearest.map(str::to_owned),
            distance: clearance.own,
        }
    }
}

/// Starts spread over the joints' ranges, home first: a Kronecker sequence with the roots of primes.
fn spread(arm: &Arm, home: &[f64], number: usize) -> Vec<f64> {
    const PRIMES: [f64; 8] = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0];
    if number == 0 {
        return home.to_vec();
    }
    let joints = arm.joints().iter().enumerate();
    let spread = joints.map(|(k, joint)| {
        let share = (number as f64 * PRIMES[k % PRIMES.len()].sqrt() + 0.1 * k as f64).fract();
        let (lower, upper) = (joint.limits.lower, joint.limits.upper);
        match lower.is_finite() && upper.is_finite() {
            true => (lower + share * (upper - lower)).clamp(lower, upper),
            false => std::f64::consts::PI * (2.0 * share - 1.0),
        }
    });
    spread.collect()
}
