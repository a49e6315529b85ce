//! From a command log to checked motions: nothing in here moves anything.

use selvedge_franka::{Arm, Placement, Rates, joint_path, reach, slow_down, usage};
use selvedge_math::{DVec3, Jaw, Pose};
use selvedge_trajectory::log::Log;

use crate::error::Error;
use crate::limits::{Limits, Peaks, angle, peaks};
use crate::segment::Segment;

/// The longest way from the measured to the first pose: how far it is [m], [rad], of a joint [rad], and
/// how long it takes [s]; shorter ones take less.
pub const APPROACH: ([f64; 3], f64) = ([0.005, 0.035, 0.05], 2.0);
/// What the shortest takes [s].
const NEAR: f64 = 0.2;

/// Where the tip and the fingers may be, in the base frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Workspace {
    /// Lowest corner [m].
    pub low: DVec3,
    /// Highest corner [m].
    pub high: DVec3,
    /// Height of the table [m].
    pub table: f64,
    /// How far the fingers reach beyond the tip, along the approach [m].
    pub finger: f64,
    /// Half the open gap, along the closing direction [m].
    pub half_gap: f64,
    /// Half the fingers' width, across it [m].
    pub half_width: f64,
}

impl Workspace {
    /// The reach of a Franka all around, over a table; fingers of the Franka hand.
    pub fn franka(table: f64) -> Self {
        Self {
            low: DVec3::new(-0.86, -0.86, table),
            high: DVec3::new(0.86, 0.86, 1.2),
            table,
            finger: 0.0095,
            half_gap: 0.04,
            half_width: 0.01,
        }
    }

    /// Looks at one pose of the tip.
    ///
    /// # Errors
    /// [`Error::Value`] when the tip is outside the box or a finger under the table.
    pub fn contain(&self, tip: &Pose, jaw: Jaw, place: &str) -> Result<(), Error> {
        let p = tip.position();
        let inside = p.cmpge(self.low).all() && p.cmple(self.high).all();
        if !inside {
            let value = format!("({:.4}, {:.4}, {:.4}) m", p.x, p.y, p.z);
            let (low, high) = (self.low.to_array(), self.high.to_array());
            let bound = format!("within the workspace {low:?} to {high:?} m");
            return Err(Error::value(place, "tip", value, bound));
        }
        let gap = if jaw.is_closed() { 0.0 } else { self.half_gap };
        for (x, y) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            let end = DVec3::new(x * self.half_width, y * gap, self.finger);
            let z = tip.transform(end).z - self.table;
            if z.is_nan() || z < 0.0 {
                let value = format!("{:.1} mm above the table", 1e3 * z);
                return Err(Error::value(place, "finger", value, "0 at least"));
            }
        }
        Ok(())
    }
}

/// What is asked of [`Plan::new`].
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// The commands.
    pub log: &'a Log,
    /// Where the arm stands.
    pub placement: &'a Placement,
    /// Which arm; without one only the tip is checked.
    pub arm: Option<&'a Arm>,
    /// Share of the log's speed, above 0.
    pub speed: f64,
    /// Bounds of the tip.
    pub limits: Limits,
    /// Where it may be.
    pub workspace: Workspace,
}

/// Motions that have passed every check, each from rest to rest.
#[derive(Clone, Debug)]
pub struct Plan {
    /// One after the other; the first begins at the first row.
    pub segments: Vec<Segment>,
    /// The jaws before the first motion.
    pub jaw: Jaw,
    /// The bounds.
    pub limits: Limits,
    /// The largest rates of all motions.
    pub peaks: Peaks,
    /// How long a stop takes at most [s].
    pub brake: f64,
    /// Highest share of a joint's bound that is used, as a slow-down; 0 without an arm.
    pub joint_usage: f64,
    /// Names of the joints.
    pub joint_names: Vec<String>,
}

impl Plan {
    /// Checks a log from end to end.
    ///
    /// # Errors
    /// [`Error::Blocked`] when the arm cannot follow it, with the cause in words; [`Error::Value`] for
    /// a bound of speed or place that is not kept.
    pub fn new(request: &Request<'_>) -> Result<Self, Error> {
        let Request {
            log,
            placement,
            arm,
            speed,
            limits,
            workspace,
        } = *request;
        limits.check()?;
        if !(speed.is_finite() && speed > 0.0 && speed <= 1.0) {
            return Err(Error::value(
                "--speed",
                "share",
                speed,
                "above 0, at most 1",
            ));
        }
        if log.samples.len() < 2 {
            let rows = log.samples.len();
            return Err(Error::value("the log", "rows", rows, "2 at least"));
        }
        let joints = match arm {
            Some(arm) => joints(arm, log, placement)?,
            None => Vec::new(),
        };
        let joint_count = joints.len() / log.samples.len();
        let tips: Vec<Pose> = log
            .samples
            .iter()
            .map(|sample| placement.tip(&sample.command.pose, log.tip_offset))
            .collect();
        let mut segments = Vec::new();
        for (first, last, jaw) in parts(log) {
            let times: Vec<f64> = log.samples[first..=last].iter().map(|s| s.time).collect();
            let mut segment = Segment::new(&times, &tips[first..=last], speed, jaw);
            segment.joints = joints[first * joint_count..(last + 1) * joint_count].to_vec();
            segments.push(segment);
        }
        let jaw = log.samples[0].command.jaw;
        let mut plan = Self {
            segments,
            jaw,
            limits,
            peaks: Peaks::default(),
            brake: 0.0,
            joint_usage: 0.0,
            joint_names: arm.map_or(Vec::new(), |arm| {
                arm.joints()
                    .iter()
                    .map(|joint| joint.name.clone())
                    .collect()
            }),
        };
        plan.check(log, &workspace, arm)?;
        Ok(plan)
    }

    fn check(&mut self, log: &Log, workspace: &Workspace, arm: Option<&Arm>) -> Result<(), Error> {
        let (mut jaw, mut start) = (self.jaw, log.samples[0].time);
        for segment in &self.segments {
            let end = start + segment.law.length;
            let place = format!("the log from {start:.3} to {end:.3} s");
            let now = peaks(segment);
            for (peak, value) in self.peaks.0.iter_mut().zip(now.0) {
                *peak = peak.max(value);
            }
            self.limits.keep(&now, &place)?;
            // Not only the rows: the spline between them too.
            let count = (segment.law.length / 1e-3).ceil() as usize;
            for k in 0..=count {
                let tau = segment.law.length * k as f64 / count as f64;
                let place = format!("t = {:.3} s", start + tau);
                workspace.contain(&segment.pose(tau), jaw, &place)?;
            }
            if let Some(arm) = arm {
                let usages = usage(arm, &Rates::of(arm), &segment.times(), &segment.joints);
                let slower = slow_down(&usages);
                self.joint_usage = self.joint_usage.max(slower);
                if let Some(worst) = usages.iter().find(|usage| usage.slow_down() > 1.0) {
                    let value = format!("{:.4} at {:.3} s", worst.value, worst.time);
                    let bound = format!("at most {:.4} ({})", worst.limit, worst.bound);
                    return Err(Error::value(place, "joint rate", value, bound));
                }
            }
            jaw = segment.jaw.unwrap_or(jaw);
            start = end;
        }
        self.brake = self.limits.brake(&self.segments)?;
        Ok(())
    }

    /// The first pose of the tip.
    pub fn start(&self) -> Pose {
        self.segments[0].pose(0.0)
    }

    /// Joint positions of the first row.
    pub fn start_joints(&self) -> &[f64] {
        &self.segments[0].joints[..self.joint_names.len()]
    }

    /// What the jaws are told last.
    pub fn last_jaw(&self) -> Jaw {
        let told = self.segments.iter().rev().find_map(|segment| segment.jaw);
        told.unwrap_or(self.jaw)
    }

    /// How long all motions take, without the jaws [s].
    pub fn duration(&self) -> f64 {
        self.segments.iter().map(|s| s.law.duration()).sum()
    }

    /// The way from where the robot is to the first pose, at the end of which the jaws are put into
    /// their first state. S1 has made sure that it is short.
    pub fn approach(&self, from: &Pose, joints: &[f64]) -> Segment {
        let poses = [*from, self.start()];
        let far = poses[0].position().distance(poses[1].position());
        let turned = angle(&poses[0], &poses[1]);
        let pairs = joints.iter().zip(self.start_joints());
        let bent = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let (most, long) = APPROACH;
        let share = (0..3).map(|k| [far, turned, bent][k] / most[k]);
        let times = [0.0, (long * share.fold(0.0, f64::max)).max(NEAR)];
        let mut segment = Segment::new(&times, &poses, 1.0, Some(self.jaw));
        if joints.len() == self.start_joints().len() {
            segment.joints = [joints, self.start_joints()].concat();
        }
        segment
    }
}

/// Joint positions along the log, or why there are none.
fn joints(arm: &Arm, log: &Log, placement: &Placement) -> Result<Vec<f64>, Error> {
    let refused = |error: selvedge_franka::Error| Error::Log(error.to_string());
    match joint_path(arm, log, placement).map_err(refused)? {
        Ok(joints) => Ok(joints),
        Err(blocked) => {
            let offers = reach(arm, log, placement).map_err(refused)?.offers;
            let offers: Vec<String> = offers.iter().map(ToString::to_string).collect();
            Err(Error::Blocked(match offers.is_empty() {
                true => blocked.to_string(),
                false => format!("{blocked}; possible instead: {}", offers.join("; ")),
            }))
        }
    }
}

/// First and last row of each part, and what the jaws do at its end: at the first row that has them
/// otherwise. A part of one row is none; then the jaws act after the approach.
fn parts(log: &Log) -> Vec<(usize, usize, Option<Jaw>)> {
    let jaw = |k: usize| log.samples[k].command.jaw;
    let rows = log.samples.len();
    let mut parts = Vec::new();
    let mut first = 0;
    for row in 1..rows {
        if jaw(row) != jaw(row - 1) {
            parts.push((first, row, Some(jaw(row))));
            first = row;
        }
    }
    if first + 1 < rows {
        parts.push((first, rows - 1, None));
    }
    parts
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use selvedge_math::Command;
    use selvedge_trajectory::log::Sample;

    /// 0.2 m sideways in two seconds, fingers down, closed on the way.
    pub(crate) fn log() -> Log {
        let mut log = Log::new("sideways");
        for k in 0..=180 {
            let t = f64::from(k) / 60.0;
            let u = (t - 0.5).clamp(0.0, 2.0) / 2.0;
            let s = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
            let pose = Pose::from_translation(DVec3::new(0.0, 0.1 - 0.2 * s, 0.05));
            let jaw = match t > 0.25 && t < 2.75 {
                true => Jaw::Closed,
                false => Jaw::Open,
            };
            let command = Command { pose, jaw };
            log.samples.push(Sample { time: t, command });
        }
        log
    }

    fn plan(log: &Log, base: [f64; 4], speed: f64, arm: Option<&Arm>) -> Result<Plan, Error> {
        let placement = Placement::new(base, 0.0).unwrap();
        Plan::new(&Request {
            log,
            placement: &placement,
            arm,
            speed,
            limits: Limits::default(),
            workspace: Workspace::franka(placement.table_in_base()),
        })
    }

    const BASE: [f64; 4] = [-0.5, 0.0, 0.0, 0.0];

    #[test]
    fn a_log_becomes_parts_between_jaw_events() {
        let arm = Arm::fr3();
        let plan = plan(&log(), BASE, 0.5, Some(&arm)).unwrap();
        let jaws: Vec<_> = plan.segments.iter().map(|s| s.jaw).collect();
        assert_eq!(jaws, [Some(Jaw::Closed), Some(Jaw::Open), None]);
        assert_eq!(plan.jaw, Jaw::Open);
        // Each begins where the one before ends.
        for pair in plan.segments.windows(2) {
            let end = pair[0].pose(pair[0].law.length);
            assert!(end.position().distance(pair[1].pose(0.0).position()) < 1e-12);
        }
        // 0.2 m and 1.875 / 2 s at half speed, at rest and back.
        assert!((plan.peaks.0[0] - 0.09375).abs() < 1e-3, "{:?}", plan.peaks);
        // The joints lead to the tip.
        for segment in &plan.segments {
            for (tau, q) in segment.tau.iter().zip(segment.joints.chunks(7)) {
                let tip = arm.forward(q);
                assert!(tip.position().distance(segment.pose(*tau).position()) < 1e-9);
            }
        }
        assert!(plan.joint_usage > 0.0 && plan.joint_usage <= 1.0);
    }

    #[test]
    fn what_the_arm_or_the_table_forbids_is_refused() {
        let arm = Arm::fr3();
        let far = plan(&log(), [-1.5, 0.0, 0.0, 0.0], 0.1, Some(&arm)).unwrap_err();
        assert!(matches!(far, Error::Blocked(_)), "{far}");
        assert!(far.to_string().contains("out of reach by"), "{far}");
        // Without an arm the box still says no.
        let far = plan(&log(), [-1.5, 0.0, 0.0, 0.0], 0.1, None).unwrap_err();
        assert!(far.to_string().contains("within the workspace"), "{far}");
        let mut low = log();
        for sample in &mut low.samples {
            let p = sample.command.pose.position();
            let down = DVec3::new(p.x, p.y, 0.009);
            sample.command.pose = Pose::from_translation(down);
        }
        let low = plan(&low, BASE, 0.1, None).unwrap_err().to_string();
        let message = "t = 0.000 s: finger is -0.5 mm above the table, must be 0 at least";
        assert_eq!(low, message);
        for speed in [0.0, -0.1, f64::NAN, 1.5] {
            assert!(plan(&log(), BASE, speed, None).is_err());
        }
    }

    #[test]
    fn the_approach_takes_two_seconds_at_most_and_keeps_the_limits() {
        let plan = plan(&log(), BASE, 0.1, None).unwrap();
        for (off, seconds) in [(0.005, 2.0), (0.001, 0.4), (0.0, NEAR)] {
            let from = Pose::from_unit(
                plan.start().position() + DVec3::X * off,
                plan.start().rotation(),
            );
            let way = plan.approach(&from, &[]);
            let long = seconds + crate::segment::RAMP;
            // Short ways are not as fast as their own time asks for.
            let peak = way.law.peak;
            assert!(
                (way.law.duration() - long).abs() < 1e-9 || peak < 1.0,
                "{off}"
            );
            assert!(way.at(0.0).position().distance(from.position()) < 1e-15);
            assert!(way.at(9.0).position().distance(plan.start().position()) < 1e-15);
            plan.limits.keep(&peaks(&way), "").unwrap();
            assert_eq!(way.jaw, Some(Jaw::Open));
        }
    }
}
