//! A command log as poses for an arm: what is asked of it, checked once.

use selvedge_math::{DVec3, Pose};
use selvedge_trajectory::log::Log;

use crate::placement::metres;
use crate::route::{Station, angle};
use crate::{Arm, Error, Placement};

/// How far the tip comes down to the grasp and goes up after the last row [m].
pub const LIFT: f64 = 0.12;
/// Poses of that way.
const LIFT_STEPS: usize = 12;
/// Rows of a log are no further apart than this [m] and [rad].
const JUMP: (f64, f64) = (0.1, 0.5);
/// How long a log and how short a step of it may be [s].
const LONGEST: f64 = 600.0;
const SHORTEST: f64 = 1e-4;
/// Poses nearer than this are one [m] and [rad].
const SAME: (f64, f64) = (1e-9, 1e-9);

/// The poses of a whole task, and which of them each row of the log is.
#[derive(Clone, Debug)]
pub(crate) struct Task {
    pub(crate) stations: Vec<Station>,
    pub(crate) rows: Vec<usize>,
}

impl Task {
    /// Down from above the first row, through the rows, up from the last.
    pub(crate) fn new(log: &Log, placement: &Placement) -> Self {
        let tip = |pose: &Pose| placement.tip(pose, log.tip_offset);
        let (mut stations, mut rows) = (Vec::<Station>::new(), Vec::new());
        let lifted = |pose: &Pose, share: f64| {
            let up = pose.position() + DVec3::Z * (LIFT * share);
            tip(&Pose::from_unit(up, pose.rotation()))
        };
        if let Some(first) = log.samples.first() {
            for k in 0..LIFT_STEPS {
                stations.push(Station {
                    tip: lifted(&first.command.pose, 1.0 - k as f64 / LIFT_STEPS as f64),
                    open: !first.command.jaw.is_closed(),
                });
            }
        }
        let mut last: Option<(Pose, bool)> = None;
        for sample in &log.samples {
            let (pose, open) = (sample.command.pose, !sample.command.jaw.is_closed());
            if last.is_none_or(|(before, jaw)| jaw != open || !same(&before, &pose)) {
                let tip = tip(&pose);
                stations.push(Station { tip, open });
                last = Some((pose, open));
            }
            rows.push(stations.len() - 1);
        }
        if let Some((pose, open)) = last {
            for k in 1..=LIFT_STEPS {
                let tip = lifted(&pose, k as f64 / LIFT_STEPS as f64);
                stations.push(Station { tip, open });
            }
        }
        Self { stations, rows }
    }
}

fn same(a: &Pose, b: &Pose) -> bool {
    a.position().distance(b.position()) <= SAME.0 && angle(a, b) <= SAME.1
}

/// Whether two rows have one pose.
pub(crate) fn rests(log: &Log, row: usize) -> bool {
    let pose = |k: usize| log.samples[k].command.pose;
    same(&pose(row), &pose(row + 1))
}

/// Refuses a log that no arm should follow.
pub(crate) fn check(log: &Log) -> Result<(), Error> {
    if log.samples.len() < 2 {
        let count = log.samples.len();
        return Err(Error::value("the log", "rows", count, "2 at least"));
    }
    for (k, value) in log.tip_offset.to_array().into_iter().enumerate() {
        let field = ["x", "y", "z"][k];
        if !(value.is_finite() && value.abs() <= 1.0) {
            let bound = "a finite number of metres, at most 1 (is it in millimetres?)";
            return Err(Error::value("tip_offset_m", field, value, bound));
        }
    }
    for (k, sample) in log.samples.iter().enumerate() {
        let row = || format!("row {} (t = {} s)", k + 1, sample.time);
        let pose = sample.command.pose;
        for (field, value) in ["px", "py", "pz"]
            .into_iter()
            .zip(pose.position().to_array())
        {
            metres(&row(), field, value)?;
        }
        if !pose.rotation().is_finite() || (pose.rotation().length() - 1.0).abs() > 1e-6 {
            let length = pose.rotation().length();
            let bound = "of length 1 to 1e-6";
            return Err(Error::value(row(), "quaternion length", length, bound));
        }
        if !sample.time.is_finite() {
            let bound = "a finite number of seconds";
            return Err(Error::value(row(), "t", sample.time, bound));
        }
        let Some(before) = k.checked_sub(1).map(|k| log.samples[k]) else {
            continue;
        };
        if sample.time - log.samples[0].time > LONGEST {
            let bound = "within 600 s of the first (is it in milliseconds?)";
            return Err(Error::value(row(), "t", sample.time, bound));
        }
        if sample.time <= before.time {
            let value = format!("{} after {}", sample.time, before.time);
            let bound = "larger than the one before";
            return Err(Error::value(row(), "t", value, bound));
        }
        if sample.time - before.time < SHORTEST {
            let value = format!("{} after {}", sample.time, before.time);
            let bound = "0.1 ms after the one before at least";
            return Err(Error::value(row(), "t", value, bound));
        }
        let moved = pose.position().distance(before.command.pose.position());
        if moved > JUMP.0 {
            let bound = "0.1 m from the row before at most: a jump, or rows too far apart";
            let value = format!("{moved:.4} m from it");
            return Err(Error::value(row(), "position", value, bound));
        }
        let turned = angle(&pose, &before.command.pose);
        if turned > JUMP.1 {
            let bound = "0.5 rad from the row before at most: a jump, or rows too far apart";
            let value = format!("{turned:.4} rad from it");
            return Err(Error::value(row(), "rotation", value, bound));
        }
    }
    Ok(())
}

/// Refuses an arm whose limits must be in degrees.
pub(crate) fn check_arm(arm: &Arm) -> Result<(), Error> {
    for joint in arm.joints() {
        let limits = joint.limits;
        let large = limits.lower.abs().max(limits.upper.abs());
        if large.is_finite() && large > 15.0 {
            let value = format!("{} to {}", limits.lower, limits.upper);
            let bound = "within 15 rad (are they in degrees or millimetres?)";
            return Err(Error::value(&joint.name, "limits", value, bound));
        }
    }
    Ok(())
}
