//! What an arm can do instead of a path that it cannot follow.

use std::fmt;

use selvedge_math::{DQuat, DVec3, Pose};
use selvedge_trajectory::log::Log;

use crate::clearance::Ruler;
use crate::reach::{follow, quality};
use crate::route::angle;
use crate::task::Task;
use crate::{Error, Placement};

/// A change of the path that makes it possible from the same base.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Offer {
    /// The hand's rotation scaled back, from the same start.
    Turn {
        /// What is asked for [rad].
        asked: f64,
        /// What is possible [rad].
        possible: f64,
    },
    /// Half of a rotation before the hand points straight down, half after.
    Symmetric {
        /// What is asked for [rad].
        asked: f64,
        /// What is possible, from plus half to minus half of it [rad].
        possible: f64,
        /// How much higher the whole path then is [m].
        raise: f64,
    },
    /// The whole path higher.
    Raise {
        /// By how much [m].
        metres: f64,
    },
}

impl fmt::Display for Offer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Turn { asked, possible } => write!(
                f,
                "turn the hand by {:.0} deg instead of {:.0} deg, from the same start",
                possible.to_degrees(),
                asked.to_degrees()
            ),
            Self::Symmetric {
                asked,
                possible,
                raise,
            } => {
                let half = 0.5 * possible.to_degrees();
                write!(
                    f,
                    "turn from {half:+.0} to {:+.0} deg about straight down",
                    -half
                )?;
                if raise > 0.0 {
                    write!(f, ", the whole path {:.0} mm higher", 1e3 * raise)?;
                }
                write!(f, " ({:.0} of {:.0} deg)", 2.0 * half, asked.to_degrees())
            }
            Self::Raise { metres } => write!(f, "raise the whole path by {:.0} mm", 1e3 * metres),
        }
    }
}

/// Steps of a share when a rotation is scaled back, and of a height [m].
const SHARES: usize = 36;
/// A smaller rotation is not worth an offer [rad].
const LEAST_TURN: f64 = 0.09;
const HEIGHT: f64 = 0.01;
const HEIGHTS: usize = 40;

/// Changes of a path that has none, tried one after the other from the same base.
pub(crate) fn offers(
    ruler: &mut Ruler<'_>,
    log: &Log,
    placement: &Placement,
    home: &[f64],
) -> Result<Vec<Offer>, Error> {
    let first = log.samples[0].command.pose;
    let last = log.samples[log.samples.len() - 1].command.pose;
    let asked = angle(&first, &last);
    let axis = axis(&first, &last);
    let mut offers = Vec::new();
    let mut possible = |change: &dyn Fn(&Pose) -> Pose| -> Result<bool, Error> {
        let mut changed = log.clone();
        for sample in &mut changed.samples {
            // The tip stays where it was, wherever the hand turns.
            let (before, after) = (sample.command.pose, change(&sample.command.pose));
            let shift = before.rotation() * log.tip_offset - after.rotation() * log.tip_offset;
            sample.command.pose = Pose::from_unit(after.position() + shift, after.rotation());
        }
        let task = Task::new(&changed, placement);
        let coarse = quality(ruler, &task.stations, home)?.is_some();
        Ok(coarse && follow(ruler, &task.stations, home)?.is_ok())
    };
    let turned = |pose: &Pose, from: DQuat, by: f64| {
        let q = from * DQuat::from_axis_angle(axis, by);
        Pose::from_unit(pose.position(), q / q.length())
    };
    let raised =
        |pose: Pose, by: f64| Pose::from_unit(pose.position() + DVec3::Z * by, pose.rotation());
    // How far each row is on the rotation from first to last.
    let progress = |pose: &Pose| angle(&first, pose);

    if asked > 0.02 {
        for k in (0..SHARES).rev() {
            let share = k as f64 / SHARES as f64;
            if 0.0 < share * asked && share * asked < LEAST_TURN {
                continue;
            }
            if possible(&|pose| turned(pose, first.rotation(), share * progress(pose)))? {
                let possible = share * asked;
                offers.push(Offer::Turn { asked, possible });
                break;
            }
        }
    }
    for k in 1..=HEIGHTS {
        let metres = HEIGHT * k as f64;
        if possible(&|pose| raised(*pose, metres))? {
            offers.push(Offer::Raise { metres });
            break;
        }
    }
    if asked > 0.02 {
        // Straight down, as near to the first row as can be.
        let up = first.rotation() * DVec3::Z;
        let down = DQuat::from_rotation_arc(up, DVec3::Z) * first.rotation();
        let symmetric = |pose: &Pose, share: f64, raise: f64| {
            let by = share * (progress(pose) - 0.5 * asked);
            raised(turned(pose, down, by), raise)
        };
        for k in (1..=SHARES).rev() {
            let share = k as f64 / SHARES as f64;
            if share * asked < LEAST_TURN {
                break;
            }
            if possible(&|pose| symmetric(pose, share, 0.0))? {
                offers.push(Offer::Symmetric {
                    asked,
                    possible: share * asked,
                    raise: 0.0,
                });
                if k == SHARES {
                    return Ok(offers);
                }
                break;
            }
        }
        for k in 1..=HEIGHTS {
            let raise = HEIGHT * k as f64;
            if possible(&|pose| symmetric(pose, 1.0, raise))? {
                offers.push(Offer::Symmetric {
                    asked,
                    possible: asked,
                    raise,
                });
                break;
            }
        }
    }
    Ok(offers)
}

/// The axis of the rotation from one pose to the other, in the gripper frame of the first.
fn axis(from: &Pose, to: &Pose) -> DVec3 {
    let turn = from.rotation().conjugate() * to.rotation();
    let turn = if turn.w < 0.0 { -turn } else { turn };
    let axis = DVec3::new(turn.x, turn.y, turn.z).normalize_or_zero();
    if axis == DVec3::ZERO { DVec3::X } else { axis }
}
