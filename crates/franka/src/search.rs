//! Where an arm should stand.

use std::f64::consts::PI;

use selvedge_math::{DQuat, DVec3, Pose};
use selvedge_trajectory::log::Log;

use crate::clearance::Ruler;
use crate::reach::{Reach, home, quality, reach};
use crate::task::{Task, check, check_arm};
use crate::{Arm, Error, Placement};

/// Places along x and along y, and the distance between them [m].
pub const PLACES: [usize; 2] = [11, 13];
/// Distance between places [m].
pub const SPACING: f64 = 0.14;
/// The base with its cables needs so much around its axis [m].
const FOOT: f64 = 0.15;

/// A place that was tried.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Where, and how the hand is turned there.
    pub placement: Placement,
    /// Whether the base would stand on the cloth.
    pub on_cloth: bool,
    /// The worst along the path of a joint's distance from its limits [rad] and four times the
    /// smallest singular value; none when no path was found.
    pub score: Option<f64>,
}

/// Tries places of the base around the middle of the path, height as given, each facing that middle
/// and turned by a quarter from there, each with both turns of the hand, of which the better is told.
///
/// A place is looked at coarsely: 17 poses along the path, 25 values of `q7`, all branches, with
/// limits, table and self. The cloth is taken to reach as far from the origin of its frame as the
/// first row's tip does along x and y, and the base stands beside it.
///
/// # Errors
/// As [`reach`](crate::reach()).
pub fn search(arm: &Arm, log: &Log, height: f64, table: f64) -> Result<Vec<Place>, Error> {
    check(log)?;
    check_arm(arm)?;
    Placement::new([0.0; 4], table)?;
    Placement::new([0.0, 0.0, height, 0.0], table)?;
    let home = home(arm);
    let mut ruler = Ruler::new(arm, table - height);
    let tips: Vec<DVec3> = log
        .samples
        .iter()
        .map(|sample| sample.command.pose.transform(log.tip_offset))
        .collect();
    let (low, high) = tips.iter().fold((tips[0], tips[0]), |(low, high), tip| {
        (low.min(*tip), high.max(*tip))
    });
    let middle = 0.5 * (low + high);
    let half = tips[0].abs();
    let mut places = Vec::with_capacity(2 * PLACES[0] * PLACES[1]);
    for i in 0..PLACES[0] {
        for j in 0..PLACES[1] {
            let offset = |k: usize, count: usize| SPACING * (k as f64 - 0.5 * (count - 1) as f64);
            let (x, y) = (
                middle.x + offset(i, PLACES[0]),
                middle.y + offset(j, PLACES[1]),
            );
            let beside = DVec3::new(
                (x.abs() - half.x).max(0.0),
                (y.abs() - half.y).max(0.0),
                0.0,
            );
            let on_cloth = log.frame == "cloth" && beside.length() < FOOT;
            let facing = (middle.y - y).atan2(middle.x - x);
            for quarter in [0.0, 0.5 * PI] {
                let mut place = Place {
                    placement: Placement {
                        base: Pose::from_unit(
                            DVec3::new(x, y, height),
                            DQuat::from_rotation_z(facing + quarter),
                        ),
                        table,
                        flip: false,
                    },
                    on_cloth,
                    score: None,
                };
                for flip in [false, true] {
                    let placement = Placement {
                        flip,
                        ..place.placement
                    };
                    if on_cloth {
                        continue;
                    }
                    let task = Task::new(log, &placement);
                    let score = quality(&mut ruler, &task.stations, &home)?;
                    if score > place.score {
                        (place.placement, place.score) = (placement, score);
                    }
                }
                places.push(place);
            }
        }
    }
    Ok(places)
}

/// The report for the better turn of the hand at a place: two jaws are the same from both sides. That
/// is the one where the log's movement can be fastest, and as placed when neither has a path.
///
/// # Errors
/// As [`reach`](crate::reach()).
pub fn either<'a>(arm: &'a Arm, log: &Log, placement: &Placement) -> Result<Reach<'a>, Error> {
    let turned = Placement {
        flip: !placement.flip,
        ..*placement
    };
    let (placed, turned) = (reach(arm, log, placement)?, reach(arm, log, &turned)?);
    let least = |report: &Reach<'_>| report.timing.as_ref().map_or(f64::INFINITY, |t| t.least);
    let worse = least(&turned) >= least(&placed);
    Ok(if worse { placed } else { turned })
}

/// Places with less than this share of the best score are left out as long as others have a path.
const GOOD: f64 = 0.7;
/// How many of the places with a path are looked at in full.
const LOOKED_AT: usize = 12;

/// The report for the best of the places that [`search`] has tried: of those with the highest scores
/// the one where the log's movement can be fastest, since that is where the joints have least to do.
/// Without any, what is in the way at a place about half a metre from the first row where something
/// else is possible. None when all places are on the cloth.
///
/// # Errors
/// As [`reach`](crate::reach()).
pub fn best<'a>(arm: &'a Arm, log: &Log, places: &[Place]) -> Result<Option<Reach<'a>>, Error> {
    check(log)?;
    let mut ranked: Vec<Place> = places.to_vec();
    ranked.retain(|place| place.score.is_some());
    // Stable, so that equal ones stay in the order they were tried.
    ranked.sort_by(|a, b| b.score.unwrap_or(0.0).total_cmp(&a.score.unwrap_or(0.0)));
    let enough = GOOD * ranked.first().and_then(|place| place.score).unwrap_or(0.0);
    let (mut found, mut blocked): (Option<(f64, Reach<'a>)>, _) = (None, None);
    for (number, place) in ranked.iter().enumerate() {
        let is_good = number < LOOKED_AT && place.score >= Some(enough);
        if number >= 4 * LOOKED_AT || (found.is_some() && !is_good) {
            break;
        }
        let report = reach(arm, log, &place.placement)?;
        match report.timing.as_ref().map(|timing| timing.least) {
            Some(least) if found.as_ref().is_none_or(|best| least < best.0) => {
                found = Some((least, report));
            }
            Some(_) => {}
            None => blocked = blocked.or(Some(report)),
        }
    }
    if let Some((_, report)) = found {
        return Ok(Some(report));
    }
    if blocked.is_some() {
        return Ok(blocked);
    }
    // Nowhere: of the places about half a metre from the first row, the first with something to offer.
    let tip = log.samples[0].command.pose.position();
    let distance = |place: &Place| {
        let p = place.placement.base.position();
        ((p.x - tip.x).hypot(p.y - tip.y) - 0.5).abs()
    };
    let mut free: Vec<&Place> = places.iter().filter(|place| !place.on_cloth).collect();
    free.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    for place in free.into_iter().take(LOOKED_AT) {
        for flip in [false, true] {
            let placement = Placement {
                flip,
                ..place.placement
            };
            let report = reach(arm, log, &placement)?;
            let offers = !report.offers.is_empty();
            blocked = match blocked {
                Some(before) if !offers => Some(before),
                _ => Some(report),
            };
            if offers {
                return Ok(blocked);
            }
        }
    }
    Ok(blocked)
}
