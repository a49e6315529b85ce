//! Why a pose cannot be had, in words.

use std::fmt;

use selvedge_math::Pose;

use crate::clearance::Ruler;

/// The least distance of a joint from its limits [rad or m].
pub const LIMIT_MARGIN: f64 = 0.05;
/// The least distance of links that are not neighbours [m].
pub const OWN_MARGIN: f64 = 0.01;
/// Values of `q7` that are tried for a cause.
pub(crate) const TRIED: usize = 81;

/// Why the arm cannot be where the path wants it.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Cause {
    /// The wrist would have to be further from the shoulder than the arm is long, or nearer than it
    /// folds.
    OutOfReach {
        /// By how much [m].
        metres: f64,
    },
    /// The elbow would reach but the forearm cannot be turned the way the hand needs.
    Wrist,
    /// In every posture some joint is too near to its limit or beyond it; in the best one, this.
    Limit {
        /// The joint.
        joint: String,
        /// How far it is beyond its limit less [`LIMIT_MARGIN`] [rad].
        beyond: f64,
    },
    /// A link would be under the table in every posture that the joints allow.
    Table {
        /// The link.
        link: String,
        /// How deep in the best posture [m].
        below: f64,
        /// Whether it is the hand itself, so that no posture and no base helps.
        any_base: bool,
    },
    /// Two links would be nearer than [`OWN_MARGIN`] in every posture above the table.
    Own {
        /// The links.
        links: [String; 2],
        /// Their distance in the best posture [m].
        distance: f64,
    },
    /// There are postures, but none that the one before leads to without a jump.
    Jump {
        /// The joint that would have to jump most.
        joint: String,
        /// By how much at least [rad].
        by: f64,
    },
    /// No posture was found; for an arm without an exact inverse that is no proof.
    NotFound {
        /// How far the best try stayed away: metres and radians as one length.
        residual: f64,
    },
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let millimetres = |x: f64| format!("{:.1} mm", 1e3 * x);
        match self {
            Self::OutOfReach { metres } => write!(f, "out of reach by {}", millimetres(*metres)),
            Self::Wrist => write!(f, "the forearm cannot be turned the way the hand needs"),
            Self::Limit { joint, beyond } => write!(
                f,
                "{joint} is beyond its limit, less a margin of {:.1} deg, by {:.1} deg in the best \
                 of all branches",
                LIMIT_MARGIN.to_degrees(),
                beyond.to_degrees()
            ),
            Self::Table {
                link,
                below,
                any_base,
            } => {
                let below = millimetres(*below);
                let whose = match any_base {
                    true => "whatever the posture and the base",
                    false => "in the best of all branches",
                };
                write!(f, "{link} is below the table by {below}, {whose}")
            }
            Self::Own {
                links: [a, b],
                distance,
            } if *distance > 0.0 => write!(
                f,
                "{a} and {b} are only {} apart, at least {} are asked for",
                millimetres(*distance),
                millimetres(OWN_MARGIN)
            ),
            Self::Own {
                links: [a, b],
                distance,
            } => write!(f, "{a} and {b} overlap by {}", millimetres(-distance)),
            Self::Jump { joint, by } => write!(
                f,
                "branch jump: no posture continues the one before, {joint} would have to jump by \
                 {:.1} deg at least",
                by.to_degrees()
            ),
            Self::NotFound { residual } => write!(
                f,
                "no posture was found from any start (off by {residual:.2e}, metres and radians)"
            ),
        }
    }
}

/// Values of `q7` over the whole range of the joint, [`LIMIT_MARGIN`] inside, one turn at most.
pub(crate) fn grid(arm: &crate::Arm, count: usize) -> impl Iterator<Item = f64> {
    // A joint without limits needs one turn.
    let limits = arm.joints()[6].limits;
    let turn = std::f64::consts::PI + LIMIT_MARGIN;
    let lower = limits.lower.max(-turn) + LIMIT_MARGIN;
    let upper = limits.upper.min(turn) - LIMIT_MARGIN;
    let step = (upper - lower) / (count - 1) as f64;
    (0..count).map(move |k| (lower + step * k as f64).min(upper))
}

/// How far the worst joint is inside its limits less the margin; negative beyond. And which.
pub(crate) fn room(arm: &crate::Arm, q: &[f64]) -> (f64, usize) {
    let mut worst = (f64::INFINITY, 0);
    for (k, (joint, &q)) in arm.joints().iter().zip(q).enumerate() {
        let room = joint.limits.margin(q) - LIMIT_MARGIN;
        if room < worst.0 {
            worst = (room, k);
        }
    }
    worst
}

/// Why a Franka cannot have a pose by itself, or none if it can.
pub(crate) fn cause(ruler: &mut Ruler<'_>, tip: &Pose, open: bool) -> Option<Cause> {
    let arm = ruler.arm();
    let (height, link) = ruler.hand(tip, open);
    if height < 0.0 {
        return Some(Cause::Table {
            link: link.to_owned(),
            below: -height,
            any_base: true,
        });
    }
    let mut beyond = f64::INFINITY;
    let mut limit: Option<(f64, usize)> = None;
    let mut table: Option<(f64, String)> = None;
    let mut own: Option<(f64, [String; 2])> = None;
    for q7 in grid(arm, TRIED) {
        beyond = beyond.min(arm.beyond_reach(tip, q7)?);
        let solutions = arm.inverse(tip, q7, 0.0).ok()?;
        for solution in solutions.as_slice() {
            let room = room(arm, &solution.q);
            if room.0 < 0.0 {
                if limit.is_none_or(|best| room.0 > best.0) {
                    limit = Some(room);
                }
                continue;
            }
            let clearance = ruler.clearance(&solution.q, open);
            if clearance.table < 0.0 {
                if table.as_ref().is_none_or(|best| clearance.table > best.0) {
                    table = Some((clearance.table, clearance.lowest.to_owned()));
                }
            } else if clearance.own < OWN_MARGIN {
                if own.as_ref().is_none_or(|best| clearance.own > best.0) {
                    own = Some((clearance.own, clearance.nearest.map(str::to_owned)));
                }
            } else {
                return None;
            }
        }
    }
    // The last hurdle that some posture came to is the one to tell.
    Some(if let Some((distance, links)) = own {
        Cause::Own { links, distance }
    } else if let Some((height, link)) = table {
        Cause::Table {
            link,
            below: -height,
            any_base: false,
        }
    } else if let Some((room, joint)) = limit {
        Cause::Limit {
            joint: arm.joints()[joint].name.clone(),
            beyond: -room,
        }
    } else if beyond > 0.0 {
        Cause::OutOfReach { metres: beyond }
    } else {
        Cause::Wrist
    })
}
