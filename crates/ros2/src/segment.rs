//! A piece of a log between two jaw events: a smooth path, and when to be where on it.

use selvedge_math::{DQuat, DVec3, Jaw, Pose};

/// How long a motion takes to come to its speed, and to rest [s].
pub const RAMP: f64 = 0.5;

/// A pose and how fast it changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moving {
    /// The tip in the base.
    pub pose: Pose,
    /// Velocity of the tip [m/s].
    pub velocity: DVec3,
    /// Angular velocity, along the axes of the base [rad/s].
    pub angular: DVec3,
}

/// A path that starts and ends at rest, and what the jaws do when it is over.
///
/// Through the rows goes a cubic spline of seven numbers, position and quaternion, the quaternions
/// all on one side; its slope is zero at both ends (de Boor 1978, chapter IV). The quaternion is
/// normalised after that, so position and rotation are twice continuously differentiable in the
/// time `tau` of the log. [`Law`] then gives `tau(t)`.
#[derive(Clone, Debug)]
pub struct Segment {
    /// Times of the rows in the log, from 0 [s].
    pub tau: Vec<f64>,
    rows: Vec<[f64; 7]>,
    /// Second derivatives at the rows.
    second: Vec<[f64; 7]>,
    /// Joint positions of the rows, one number a joint; empty when no arm is known.
    pub joints: Vec<f64>,
    /// What the jaws do at the end.
    pub jaw: Option<Jaw>,
    /// When to be where.
    pub law: Law,
}

impl Segment {
    /// A path through poses of the tip at increasing times, two at least, at a share `speed` of the
    /// log's own speed.
    pub fn new(times: &[f64], poses: &[Pose], speed: f64, jaw: Option<Jaw>) -> Self {
        debug_assert!(times.len() >= 2 && times.len() == poses.len());
        let tau: Vec<f64> = times.iter().map(|t| t - times[0]).collect();
        let mut rows: Vec<[f64; 7]> = Vec::with_capacity(poses.len());
        let mut last = DQuat::IDENTITY;
        for (k, pose) in poses.iter().enumerate() {
            let (p, mut q) = (pose.position(), pose.rotation());
            if k > 0 && q.dot(last) < 0.0 {
                q = -q;
            }
            last = q;
            rows.push([p.x, p.y, p.z, q.x, q.y, q.z, q.w]);
        }
        let second = second(&tau, &rows);
        let law = Law::new(tau[tau.len() - 1], speed);
        Self {
            tau,
            rows,
            second,
            joints: Vec::new(),
            jaw,
            law,
        }
    }

    /// The pose at a time of the log, at the nearer end outside of it.
    pub fn pose(&self, tau: f64) -> Pose {
        let [c, _] = self.curve(tau);
        Pose::from_unit(position(&c), rotation(&c).normalize())
    }

    /// Pose and velocities at a time of the log when `tau` grows by `rate` a second.
    pub fn moving(&self, tau: f64, rate: f64) -> Moving {
        let [c, d] = self.curve(tau);
        let q = rotation(&c);
        // omega = 2 Im(dq/dt q*) / |q|^2; the part of dq along q is real and falls out.
        let turn = rotation(&d) * q.conjugate() * (2.0 * rate / q.length_squared());
        Moving {
            pose: Pose::from_unit(position(&c), q.normalize()),
            velocity: rate * position(&d),
            angular: DVec3::new(turn.x, turn.y, turn.z),
        }
    }

    /// The pose after `t` seconds of its motion.
    pub fn at(&self, t: f64) -> Pose {
        self.pose(self.law.at(t).0)
    }

    /// When each row is reached [s].
    pub fn times(&self) -> Vec<f64> {
        self.tau.iter().map(|tau| self.law.time(*tau)).collect()
    }

    /// Value and slope.
    fn curve(&self, tau: f64) -> [[f64; 7]; 2] {
        let n = self.tau.len();
        let tau = tau.clamp(0.0, self.tau[n - 1]);
        let k = self.tau.partition_point(|x| *x <= tau).clamp(1, n - 1) - 1;
        let h = self.tau[k + 1] - self.tau[k];
        let b = (tau - self.tau[k]) / h;
        let a = 1.0 - b;
        let (mut value, mut slope) = ([0.0; 7], [0.0; 7]);
        for j in 0..7 {
            let (y0, y1) = (self.rows[k][j], self.rows[k + 1][j]);
            let (m0, m1) = (self.second[k][j], self.second[k + 1][j]);
            value[j] =
                a * y0 + b * y1 + ((a * a * a - a) * m0 + (b * b * b - b) * m1) * h * h / 6.0;
            slope[j] =
                (y1 - y0) / h + ((3.0 * b * b - 1.0) * m1 - (3.0 * a * a - 1.0) * m0) * h / 6.0;
        }
        [value, slope]
    }
}

fn position(c: &[f64; 7]) -> DVec3 {
    DVec3::new(c[0], c[1], c[2])
}

fn rotation(c: &[f64; 7]) -> DQuat {
    DQuat::from_xyzw(c[3], c[4], c[5], c[6])
}

/// Second derivatives of the cubic spline with zero slopes at its ends: Thomas' algorithm.
fn second(x: &[f64], y: &[[f64; 7]]) -> Vec<[f64; 7]> {
    let n = x.len();
    let mut m = vec![[0.0; 7]; n];
    let mut upper = vec![0.0; n];
    for k in 0..n {
        let before = if k > 0 { x[k] - x[k - 1] } else { 0.0 };
        let after = if k + 1 < n { x[k + 1] - x[k] } else { 0.0 };
        let carried = if k > 0 { before * upper[k - 1] } else { 0.0 };
        let pivot = 2.0 * (before + after) - carried;
        upper[k] = after / pivot;
        for j in 0..7 {
            let left = if k > 0 {
                (y[k][j] - y[k - 1][j]) / before
            } else {
                0.0
            };
            let right = if k + 1 < n {
                (y[k + 1][j] - y[k][j]) / after
            } else {
                0.0
            };
            let known = if k > 0 { before * m[k - 1][j] } else { 0.0 };
            m[k][j] = (6.0 * (right - left) - known) / pivot;
        }
    }
    for k in (0..n - 1).rev() {
        let after = m[k + 1];
        for (value, after) in m[k].iter_mut().zip(after) {
            *value -= upper[k] * after;
        }
    }
    m
}

/// When to be where: `tau(t)`, whose rate rises to a share of the log's speed and falls to zero
/// again, each within [`RAMP`].
///
/// On a ramp the rate is `peak (3 u^2 - 2 u^3)`, so it and its slope are continuous and both zero at
/// the ends: velocity and acceleration of the tip are continuous, and zero at the ends.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Law {
    /// What there is of `tau` [s].
    pub length: f64,
    /// The highest rate.
    pub peak: f64,
}

impl Law {
    fn new(length: f64, speed: f64) -> Self {
        let peak = speed.min(length / RAMP);
        Self { length, peak }
    }

    /// How long the motion takes [s].
    pub fn duration(&self) -> f64 {
        self.length / self.peak + RAMP
    }

    /// `tau`, its rate and the slope of the rate after `t` seconds.
    pub fn at(&self, t: f64) -> (f64, f64, f64) {
        let t = t.clamp(0.0, self.duration());
        let back = self.duration() - t;
        if t < RAMP {
            let (gone, rate, slope) = self.ramp(t);
            (gone, rate, slope)
        } else if back < RAMP {
            let (left, rate, slope) = self.ramp(back);
            (self.length - left, rate, -slope)
        } else {
            (self.peak * (t - 0.5 * RAMP), self.peak, 0.0)
        }
    }

    fn ramp(&self, t: f64) -> (f64, f64, f64) {
        let u = t / RAMP;
        let gone = self.peak * RAMP * u * u * u * (1.0 - 0.5 * u);
        let rate = self.peak * u * u * (3.0 - 2.0 * u);
        (gone, rate, self.peak * 6.0 * u * (1.0 - u) / RAMP)
    }

    /// The time at which `tau` is reached, by bisection [s].
    pub fn time(&self, tau: f64) -> f64 {
        let (mut low, mut high) = (0.0, self.duration());
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            match self.at(middle).0 < tau {
                true => low = middle,
                false => high = middle,
            }
        }
        0.5 * (low + high)
    }

    /// The way to rest from the state after `t` seconds, on the same path.
    pub fn brake(&self, t: f64, within: f64) -> Brake {
        let (tau, rate, slope) = self.at(t);
        // Where it slows down already, a longer brake would turn back.
        let within = match slope < 0.0 {
            true => within.min(3.0 * rate / -slope),
            false => within,
        };
        Brake {
            tau,
            rate,
            slope,
            within,
        }
    }
}

/// A stop along the path: the rate of `tau` goes to zero as a cubic in time that starts with the rate
/// and slope it had and ends with both zero. It never leaves the path, which has been checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Brake {
    tau: f64,
    rate: f64,
    slope: f64,
    /// How long it takes [s].
    pub within: f64,
}

impl Brake {
    /// `tau` and its rate `t` seconds after the brake began.
    pub fn at(&self, t: f64) -> (f64, f64) {
        if self.within <= 0.0 {
            return (self.tau, 0.0);
        }
        let (d, u) = (self.within, (t / self.within).clamp(0.0, 1.0));
        let (u2, u3) = (u * u, u * u * u);
        let u4 = u2 * u2;
        let tau = self.tau
            + d * (self.rate * (u - u3 + 0.5 * u4)
                + d * self.slope * (0.5 * u2 - 2.0 / 3.0 * u3 + 0.25 * u4));
        let rate = self.rate * (1.0 - 3.0 * u2 + 2.0 * u3) + d * self.slope * (u - 2.0 * u2 + u3);
        (tau, rate)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arc(speed: f64) -> Segment {
        let times: Vec<f64> = (0..=60).map(|k| 3.0 + f64::from(k) / 60.0).collect();
        let poses: Vec<Pose> = (0..=60)
            .map(|k| {
                let u = f64::from(k) / 60.0;
                let s = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
                let q = DQuat::from_rotation_x(3.0 * s);
                // Half of the rows with the other sign, which is the same rotation.
                let q = if k % 2 == 0 { q } else { -q };
                Pose::from_unit(DVec3::new(0.3 * s, 0.0, 0.1 * s * (1.0 - s)), q)
            })
            .collect();
        Segment::new(&times, &poses, speed, None)
    }

    #[test]
    fn the_path_goes_through_its_rows_and_its_rates_are_its_derivatives() {
        let segment = arc(0.5);
        let p = segment.pose(0.5).position();
        assert!(p.distance(DVec3::new(0.15, 0.0, 0.025)) < 1e-15);
        let h = 1e-5;
        for k in 1..40 {
            let tau = 0.0243 * f64::from(k);
            let now = segment.moving(tau, 2.0);
            let (before, after) = (segment.pose(tau - h), segment.pose(tau + h));
            let v = (after.position() - before.position()) / (2.0 * h) * 2.0;
            assert!(now.velocity.distance(v) < 1e-7, "{tau}");
            let turn = after.rotation() * before.rotation().conjugate();
            let turn = if turn.w < 0.0 { -turn } else { turn };
            let w = turn.to_scaled_axis() / (2.0 * h) * 2.0;
            assert!(now.angular.distance(w) < 1e-6, "{tau}");
        }
        assert!(segment.moving(0.0, 1.0).velocity.length() < 1e-15);
        assert!(segment.moving(1.0, 1.0).angular.length() < 1e-12);
    }

    #[test]
    fn the_law_starts_and_ends_at_rest_and_is_smooth() {
        for (length, speed) in [(1.0, 0.1), (1.0, 1.0), (0.05, 1.0), (8.0, 0.7)] {
            let law = Law::new(length, speed);
            let end = law.duration();
            assert_eq!(law.at(0.0), (0.0, 0.0, 0.0));
            let (tau, rate, slope) = law.at(end);
            assert!((tau - length).abs() < 1e-12 && rate.abs() < 1e-12 && slope.abs() < 1e-12);
            let h = end / 1e5;
            for k in 1..999 {
                let t = end * f64::from(k) / 999.0;
                let (tau, rate, slope) = law.at(t);
                assert!(rate <= speed * (1.0 + 1e-12) && rate >= 0.0);
                let (a, b) = (law.at(t - h), law.at(t + h));
                assert!(((b.0 - a.0) / (2.0 * h) - rate).abs() < 1e-4 * speed);
                assert!(((b.1 - a.1) / (2.0 * h) - slope).abs() < 2e-3 * law.peak / RAMP);
                assert!((law.time(tau) - t).abs() < 1e-3 * end);
            }
        }
    }

    #[test]
    fn a_brake_is_smooth_and_never_turns_back() {
        let law = arc(0.8).law;
        for k in 0..=100 {
            let t = law.duration() * f64::from(k) / 100.0;
            let brake = law.brake(t, 0.3);
            let (tau, rate, _) = law.at(t);
            assert_eq!(
                brake.at(0.0),
                (tau, if brake.within > 0.0 { rate } else { 0.0 })
            );
            let (end, rest) = brake.at(brake.within);
            assert!(rest.abs() < 1e-12 && end <= law.length + 0.3);
            let mut last = tau;
            for i in 1..=50 {
                let (tau, rate) = brake.at(brake.within * f64::from(i) / 50.0);
                assert!(tau >= last - 1e-12 && rate >= -1e-12, "{t} {i}");
                last = tau;
            }
        }
    }
}
