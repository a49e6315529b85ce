//! Whether a motion keeps the bounds of the arm, and how much slower it must be if not.

use crate::spline::{Ends, Spline};
use crate::{Arm, Rates};

/// The robot's control period, at which bounds are looked at [s].
pub const TICK: f64 = 1e-3;

/// How much of a bound a motion uses at the worst moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Usage {
    /// Which bound.
    pub bound: String,
    /// When [s].
    pub time: f64,
    /// The value there, in the unit of the bound.
    pub value: f64,
    /// The bound there.
    pub limit: f64,
    /// 1 for a velocity, 2 for an acceleration, 3 for a jerk, 0 for a position.
    pub order: u32,
}

impl Usage {
    /// How much slower the motion must be for this bound: a motion that takes `k` times as long has
    /// `1/k` of the velocity, `1/k^2` of the acceleration and `1/k^3` of the jerk. Below 1 when it
    /// might be faster; no slowing helps against a position, which has 0 within and infinity beyond.
    pub fn slow_down(&self) -> f64 {
        let ratio = self.value / self.limit;
        match self.order {
            0 if ratio <= 1.0 => 0.0,
            0 => f64::INFINITY,
            1 => ratio,
            2 => ratio.sqrt(),
            _ => ratio.cbrt(),
        }
    }
}

/// The factor by which a motion must take longer to keep every bound; below 1 when it may be faster.
pub fn slow_down(usages: &[Usage]) -> f64 {
    usages.iter().map(Usage::slow_down).fold(0.0, f64::max)
}

/// How much of each bound a motion through rows of joint positions uses: the worst joint for each of
/// velocity, acceleration and jerk, and the tip and the elbow.
///
/// The rows, `q` with one number a joint and `times` [s], are joined by a spline whose velocity and
/// acceleration are continuous and which is at rest at both ends. It is looked at every millisecond:
/// positions, velocities and accelerations of the joints as they are there, the tip's velocity as
/// `J dq`; jerks, and the tip's accelerations, are differences from one millisecond to the next,
/// with rest before and after, so that a motion that starts or ends at an acceleration is found out.
///
/// # Panics
/// When there are not two rows at least, or `q` has not one number a joint for each.
pub fn usage(arm: &Arm, rates: &Rates, times: &[f64], q: &[f64]) -> Vec<Usage> {
    let n = arm.joints().len();
    assert!(times.len() >= 2, "two rows at least");
    assert_eq!(q.len(), n * times.len(), "one number a joint for each row");
    let spline = Spline::new(times, q, n, Ends::Rest);
    let start = times[0];
    let ticks = ((spline.end() - start) / TICK - 1e-9).ceil().max(1.0) as usize;
    let mut worst = Worst::default();
    let mut now = [vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]];
    let mut columns = vec![[0.0; 6]; n];
    let mut last_acceleration = vec![0.0; n];
    // Tip: velocity and acceleration before, translation then rotation.
    let mut last = [[0.0; 6]; 2];
    let is_franka = arm.geometry().is_some();
    // Two more, at rest, for the differences.
    for tick in 0..ticks + 3 {
        let time = (start + TICK * tick as f64).min(spline.end());
        let [position, velocity, acceleration, third] = &mut now;
        spline.eval(time, [position, velocity, acceleration, third]);
        if tick > ticks {
            velocity.fill(0.0);
            acceleration.fill(0.0);
        }
        for (j, joint) in arm.joints().iter().enumerate() {
            let (q, v, a) = (position[j], velocity[j], acceleration[j]);
            let jerk = (a - last_acceleration[j]) / TICK;
            last_acceleration[j] = a;
            let limits = joint.limits;
            if !limits.contain(q) {
                // 1 + how far beyond, so that the worst comes out.
                worst.see(0, j, time, 1.0 - limits.margin(q), 1.0);
            }
            let [down, up] = rates.velocity(j, q);
            let bound = if v < 0.0 { -down } else { up };
            // At rest where nothing may move is fine.
            if v.abs() > 1e-12 {
                worst.see(1, j, time, v.abs(), bound);
            }
            worst.see(2, j, time, a.abs(), rates.joints[j][1]);
            worst.see(3, j, time, jerk.abs(), rates.joints[j][2]);
            if is_franka && j == 2 {
                worst.see(10, j, time, v.abs(), rates.elbow[0]);
                worst.see(11, j, time, a.abs(), rates.elbow[1]);
                worst.see(12, j, time, jerk.abs(), rates.elbow[2]);
            }
        }
        arm.jacobian(position, &mut columns);
        let mut twist = [0.0; 6];
        for (column, v) in columns.iter().zip(velocity.iter()) {
            for (sum, c) in twist.iter_mut().zip(column) {
                *sum += c * v;
            }
        }
        let rate = |now: &[f64; 6], before: &[f64; 6]| {
            std::array::from_fn::<f64, 6, _>(|k| (now[k] - before[k]) / TICK)
        };
        let acceleration = rate(&twist, &last[0]);
        let jerk = rate(&acceleration, &last[1]);
        last = [twist, acceleration];
        for (k, value) in [twist, acceleration, jerk].iter().enumerate() {
            let length = |part: &[f64]| part.iter().map(|x| x * x).sum::<f64>().sqrt();
            worst.see(4 + k, 0, time, length(&value[..3]), rates.translation[k]);
            worst.see(7 + k, 0, time, length(&value[3..]), rates.rotation[k]);
        }
    }
    worst.told(arm)
}

/// What was worst so far: positions, joints, tip, tip's rotation, elbow.
#[derive(Default)]
struct Worst {
    kinds: [Option<Seen>; 13],
}

#[derive(Clone, Copy)]
struct Seen {
    ratio: f64,
    joint: usize,
    time: f64,
    value: f64,
    limit: f64,
}

const KINDS: [(&str, u32); 13] = [
    ("position", 0),
    ("velocity", 1),
    ("acceleration", 2),
    ("jerk", 3),
    ("tip velocity", 1),
    ("tip acceleration", 2),
    ("tip jerk", 3),
    ("tip angular velocity", 1),
    ("tip angular acceleration", 2),
    ("tip angular jerk", 3),
    ("elbow velocity", 1),
    ("elbow acceleration", 2),
    ("elbow jerk", 3),
];

impl Worst {
    fn see(&mut self, kind: usize, joint: usize, time: f64, value: f64, limit: f64) {
        let ratio = value / limit;
        if self.kinds[kind].is_none_or(|worst| ratio > worst.ratio) {
            self.kinds[kind] = Some(Seen {
                ratio,
                joint,
                time,
                value,
                limit,
            });
        }
    }

    fn told(&self, arm: &Arm) -> Vec<Usage> {
        let kinds = self.kinds.iter().zip(KINDS);
        let told = kinds.filter_map(|(worst, (name, order))| {
            let Seen {
                joint,
                time,
                value,
                limit,
                ..
            } = (*worst)?;
            let bound = match name.contains(' ') {
                true => name.to_owned(),
                false => format!("{name} of {}", arm.joints()[joint].name),
            };
            limit.is_finite().then_some(Usage {
                bound,
                time,
                value,
                limit,
                order,
            })
        });
        told.collect()
    }
}
