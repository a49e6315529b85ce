//! Whether an arm can do what a log asks, and what it can do instead.

use std::fmt;

use selvedge_trajectory::log::Log;

use crate::cause::{self, Cause, room};
use crate::clearance::Ruler;
use crate::graph::{self, FINE, fits};
use crate::motion::{Path, Timing, line};
use crate::offers::{Offer, offers};
use crate::route::{self, Station};
use crate::task::{Task, check, check_arm};
use crate::track::{misfit, track};
use crate::{Arm, Error, Placement, Rates, smallest_singular_value};

/// Configurations that are looked at on the way from home and back.
const LINE_CHECKS: usize = 200;

/// What is known about a log, an arm and a place of the arm.
#[derive(Clone, Debug)]
pub struct Reach<'a> {
    /// Where the arm stands, and how the hand is turned.
    pub placement: Placement,
    /// One for each row of the log.
    pub rows: Vec<Row<'a>>,
    /// What is in the way first, if anything.
    pub blocked: Option<Blocked>,
    /// Times, when the path is possible.
    pub timing: Option<Timing>,
    /// What is possible instead, when the path is not.
    pub offers: Vec<Offer>,
}

/// What a row of the log asks of the arm.
#[derive(Clone, Debug)]
pub struct Row<'a> {
    /// The row's time [s].
    pub time: f64,
    /// Why this pose alone cannot be had, if so.
    pub cause: Option<Cause>,
    /// What it is like when the whole path can be followed.
    pub posture: Option<Posture<'a>>,
}

/// Joint positions and how good they are.
#[derive(Clone, Debug)]
pub struct Posture<'a> {
    /// Joint positions [rad or m].
    pub q: Vec<f64>,
    /// The least distance of a joint from its limits [rad or m], and which joint.
    pub margin: f64,
    /// The joint, counted from 0.
    pub joint: usize,
    /// Table and self.
    pub clearance: crate::Clearance<'a>,
    /// Smallest singular value of the Jacobian.
    pub sigma: f64,
}

/// The first thing in the way.
#[derive(Clone, Debug, PartialEq)]
pub struct Blocked {
    /// On which part of the way.
    pub part: Part,
    /// Why.
    pub cause: Cause,
}

/// A part of the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Part {
    /// From home to over the grasp, straight in joint space.
    FromHome,
    /// Down to the grasp.
    Down,
    /// A row of the log, from 0, and its time [s].
    Row(usize, f64),
    /// Up after the last row.
    Up,
    /// Back home, straight in joint space.
    ToHome,
}

impl fmt::Display for Blocked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.part {
            Part::FromHome => write!(f, "on the way from home")?,
            Part::Down => write!(f, "on the way down to the grasp")?,
            Part::Row(row, time) => write!(f, "row {} (t = {time:.3} s)", row + 1)?,
            Part::Up => write!(f, "on the way up after the last row")?,
            Part::ToHome => write!(f, "on the way back home")?,
        }
        write!(f, ": {}", self.cause)
    }
}

/// Joint positions an arm starts from and returns to: the maker's for a Franka, otherwise the middle
/// of each joint's range.
pub fn home(arm: &Arm) -> Vec<f64> {
    use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
    if arm.geometry().is_some() {
        let q = [
            0.0,
            -FRAC_PI_4,
            0.0,
            -3.0 * FRAC_PI_4,
            0.0,
            FRAC_PI_2,
            FRAC_PI_4,
        ];
        if q.iter()
            .zip(arm.joints())
            .all(|(q, joint)| joint.limits.contain(*q))
        {
            return q.to_vec();
        }
    }
    let limits = arm.joints().iter().map(|joint| joint.limits);
    limits
        .map(|l| match (l.lower.is_finite(), l.upper.is_finite()) {
            (true, true) => 0.5 * (l.lower + l.upper),
            _ => 0.0f64.max(l.lower).min(l.upper),
        })
        .collect()
}

/// Follows a log with an arm that stands at a place: down to the grasp from above, through all rows,
/// up again, from home and back.
///
/// ```
/// use selvedge_franka::{Arm, Placement, reach};
/// use selvedge_math::{Command, DVec3, Jaw, Pose};
/// use selvedge_trajectory::log::{Log, Sample};
/// // Half a metre sideways in a second, fingers down.
/// let mut log = Log::new("sideways");
/// for k in 0..=60 {
///     let s = f64::from(k) / 60.0;
///     let y = 0.25 - 0.5 * s * s * (3.0 - 2.0 * s);
///     let pose = Pose::from_translation(DVec3::new(0.0, y, 0.05));
///     let command = Command { pose, jaw: Jaw::Closed };
///     log.samples.push(Sample { time: s, command });
/// }
/// let arm = Arm::fr3();
/// let near = reach(&arm, &log, &Placement::new([-0.5, 0.0, 0.0, 0.0], 0.0)?)?;
/// assert!(near.blocked.is_none());
/// let far = reach(&arm, &log, &Placement::new([-1.5, 0.0, 0.0, 0.0], 0.0)?)?;
/// assert!(far.blocked.unwrap().to_string().contains("out of reach by"));
/// # Ok::<(), selvedge_franka::Error>(())
/// ```
///
/// # Errors
/// [`Error::Value`] for a log that no arm should follow: fewer than two rows, values that are not
/// finite or in other units, jumps from row to row.
pub fn reach<'a>(arm: &'a Arm, log: &Log, placement: &Placement) -> Result<Reach<'a>, Error> {
    check(log)?;
    check_arm(arm)?;
    let home = home(arm);
    let mut ruler = Ruler::new(arm, placement.table_in_base());
    let task = Task::new(log, placement);
    let mut reach = Reach {
        placement: *placement,
        rows: Vec::with_capacity(log.samples.len()),
        blocked: None,
        timing: None,
        offers: Vec::new(),
    };
    match follow(&mut ruler, &task.stations, &home)? {
        Ok(q) => {
            let n = home.len();
            let at = |k: usize| &q[k * n..(k + 1) * n];
            for (sample, &k) in log.samples.iter().zip(&task.rows) {
                reach.rows.push(Row {
                    time: sample.time,
                    cause: None,
                    posture: Some(posture(&mut ruler, at(k), task.stations[k].open)),
                });
            }
            let (first, last) = (task.stations[0], task.stations[task.stations.len() - 1]);
            let lines = [
                (Part::FromHome, &home[..], at(0), first.open),
                (
                    Part::ToHome,
                    at(task.stations.len() - 1),
                    &home[..],
                    last.open,
                ),
            ];
            for (part, from, to, open) in lines {
                let way = line(from, to, LINE_CHECKS);
                let bad = way.chunks(n).find(|q| !fits(&mut ruler, q, open));
                if let Some(bad) = bad.filter(|_| reach.blocked.is_none()) {
                    let cause = misfit(&mut ruler, bad, open);
                    reach.blocked = Some(Blocked { part, cause });
                }
            }
            if reach.blocked.is_none() {
                let path = Path {
                    arm,
                    log,
                    placement,
                    stations: &task.stations,
                    rows: &task.rows,
                    q: &q,
                    home: &home,
                };
                reach.timing = path.timing(&Rates::of(arm));
            }
        }
        Err(stop) => {
            reach.blocked = Some(blocked(&task, log, stop));
            let mut known: Option<(usize, Option<Cause>)> = None;
            for (sample, &k) in log.samples.iter().zip(&task.rows) {
                let cause = match known.take() {
                    Some((station, cause)) if station == k => cause,
                    _ => cause::cause(&mut ruler, &task.stations[k].tip, task.stations[k].open),
                };
                known = Some((k, cause.clone()));
                reach.rows.push(Row {
                    time: sample.time,
                    cause,
                    posture: None,
                });
            }
            reach.offers = offers(&mut ruler, log, placement, &home)?;
        }
    }
    Ok(reach)
}

/// Joint positions for each row of a log, without a report and without times: `q` with one number a
/// joint for each row, or what is in the way. The way down to the first row and up from the last is
/// thought of as in [`reach`], that from home and back is not.
///
/// # Errors
/// As [`reach`].
pub fn joint_path(
    arm: &Arm,
    log: &Log,
    placement: &Placement,
) -> Result<Result<Vec<f64>, Blocked>, Error> {
    check(log)?;
    check_arm(arm)?;
    let home = home(arm);
    let mut ruler = Ruler::new(arm, placement.table_in_base());
    let task = Task::new(log, placement);
    let followed = follow(&mut ruler, &task.stations, &home)?;
    Ok(followed
        .map(|q| {
            let n = home.len();
            let rows = task.rows.iter().flat_map(|&k| &q[k * n..(k + 1) * n]);
            rows.copied().collect()
        })
        .map_err(|stop| blocked(&task, log, stop)))
}

/// Which part of the way a stop is on.
fn blocked(task: &Task, log: &Log, stop: route::Stop) -> Blocked {
    let part = match task.rows.iter().position(|&k| k >= stop.station) {
        _ if stop.station < task.rows[0] => Part::Down,
        Some(row) => Part::Row(row, log.samples[row].time),
        None => Part::Up,
    };
    let cause = stop.cause;
    Blocked { part, cause }
}

/// Joint positions for each station, by the exact inverse where the arm has one.
pub(crate) fn follow(
    ruler: &mut Ruler<'_>,
    stations: &[Station],
    home: &[f64],
) -> Result<Result<Vec<f64>, route::Stop>, Error> {
    match <&[f64; 7]>::try_from(home) {
        Ok(home) if ruler.arm().geometry().is_some() => route::route(ruler, stations, home, FINE),
        _ => track(ruler, stations, home),
    }
}

/// The worst of a chain of postures that a coarse look finds: least distance of a joint from its
/// limits, or four times the smallest singular value where that is less, or for a Franka 1.5 times the
/// sine of `q2` or the cosine of `q5`, 0 where one changes its sign. None without a chain.
pub(crate) fn quality(
    ruler: &mut Ruler<'_>,
    stations: &[Station],
    home: &[f64],
) -> Result<Option<f64>, Error> {
    let arm = ruler.arm();
    let mut columns = vec![[0.0; 6]; home.len()];
    let mut worst = |q: &[f64]| {
        arm.jacobian(q, &mut columns);
        let sigma = smallest_singular_value(&columns);
        (room(arm, q).0 + cause::LIMIT_MARGIN).min(4.0 * sigma)
    };
    if let (Ok(home), true) = (<&[f64; 7]>::try_from(home), arm.geometry().is_some()) {
        let chain = route::chain(ruler, stations, home)?;
        return Ok(chain.map(|chain| {
            let whirls = chain
                .windows(2)
                .any(|pair| graph::whirl(&pair[0], &pair[1]) > 0.0);
            let apart = |q: &[f64; 7]| 1.5 * q[1].sin().abs().min(q[4].cos().abs());
            let start = if whirls { 0.0 } else { f64::INFINITY };
            let all = chain.iter().map(|q| worst(q).min(apart(q)));
            all.fold(start, f64::min)
        }));
    }
    let path = track(ruler, stations, home)?.ok();
    Ok(path.map(|path| {
        path.chunks(home.len())
            .map(worst)
            .fold(f64::INFINITY, f64::min)
    }))
}

fn posture<'a>(ruler: &mut Ruler<'a>, q: &[f64], open: bool) -> Posture<'a> {
    let arm = ruler.arm();
    let mut columns = vec![[0.0; 6]; q.len()];
    arm.jacobian(q, &mut columns);
    let (room, joint) = room(arm, q);
    Posture {
        q: q.to_vec(),
        margin: room + cause::LIMIT_MARGIN,
        joint,
        clearance: ruler.clearance(q, open),
        sigma: smallest_singular_value(&columns),
    }
}
