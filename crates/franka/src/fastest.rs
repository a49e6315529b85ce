//! The least time along a given path.
//!
//! On the path `q(u)` the unknown is `b = (du/dt)^2`, whose slope is twice the path acceleration `a`.
//! Joint accelerations `q' a + q'' b`, and those of the tip, `w' a` with `w` the tip's twist per `u`
//! plus `dw/du b`, are linear in both; velocities bound `b` alone. The fastest law is the largest `b`
//! everywhere (Verscheure et al. 2009, which makes it a convex program). On a grid it is found in two
//! passes (Pham and Pham 2018, "TOPP-RA"): backwards the largest `b` from which the end can still be
//! reached, forwards the largest acceleration that stays below. Bounds of vectors are kept as discs,
//! not as polygons.
//!
//! Jerk is not convex in `b`. The law's accelerations jump, so `u(t)` is averaged with two boxes one
//! after the other, a triangle in all, which turns each jump into a ramp; then the whole is made
//! slower by as much as the bounds still ask for.

use crate::spline::Spline;
use crate::timing::{TICK, slow_down, usage};
use crate::{Arm, Rates};

/// Intervals of the grid.
const GRID: usize = 400;
/// Points of the average on either side of the middle.
const TAPS: usize = 16;
/// A law that takes longer is none [s].
const LONGEST: f64 = 1000.0;
/// How often a law is made slower before it is given up.
const ROUNDS: usize = 30;

/// The fastest law: `b` on the grid and when each point is passed.
#[derive(Clone, Debug)]
struct Profile {
    u: Vec<f64>,
    b: Vec<f64>,
    t: Vec<f64>,
}

/// A law `u(t)`: a profile, slower by a factor, averaged over a triangle of width `2 half`.
#[derive(Clone, Debug)]
pub(crate) struct Law {
    profile: Profile,
    factor: f64,
    half: f64,
}

impl Law {
    pub(crate) fn duration(&self) -> f64 {
        self.factor * self.profile.t[GRID] + 2.0 * self.half
    }

    /// The same law, taking so long [s].
    pub(crate) fn lasting(mut self, duration: f64) -> Self {
        self.factor = (duration - 2.0 * self.half) / self.profile.t[GRID];
        self
    }

    /// Where on the path it is at time `t` from its start.
    pub(crate) fn at(&self, t: f64) -> f64 {
        let step = self.half / TAPS as f64;
        let mut sum = 0.0;
        for k in 0..2 * TAPS + 1 {
            let weight = (TAPS as f64 - (k as f64 - TAPS as f64).abs()) / (TAPS * TAPS) as f64;
            sum += weight * self.profile.at((t - step * k as f64) / self.factor);
        }
        sum
    }
}

impl Profile {
    fn at(&self, t: f64) -> f64 {
        if t <= 0.0 {
            return self.u[0];
        }
        if t >= self.t[GRID] {
            return self.u[GRID];
        }
        let k = self.t.partition_point(|x| *x <= t).clamp(1, GRID) - 1;
        let (tau, step) = (t - self.t[k], self.u[k + 1] - self.u[k]);
        let a = (self.b[k + 1] - self.b[k]) / (2.0 * step);
        self.u[k] + (self.b[k].sqrt() + 0.5 * a * tau) * tau
    }
}

/// What a point of the grid allows.
#[derive(Clone, Debug, Default)]
struct Point {
    largest: f64,
    /// `|first a + second b| <= bound` for each joint.
    joints: Vec<[f64; 3]>,
    /// Lengths `|p' a + p'' b| <= bound` as `[p'.p', p'.p'', p''.p'', bound]`.
    tip: [[f64; 4]; 2],
}

impl Point {
    /// The accelerations that are allowed at `b`.
    fn range(&self, b: f64) -> Option<(f64, f64)> {
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for &[first, second, bound] in &self.joints {
            let rest = second * b;
            if first.abs() < 1e-12 {
                if rest.abs() > bound {
                    return None;
                }
                continue;
            }
            let (x, y) = ((-bound - rest) / first, (bound - rest) / first);
            low = low.max(x.min(y));
            high = high.min(x.max(y));
        }
        for &[aa, ab, bb, bound] in &self.tip {
            let rest = bb * b * b - bound * bound;
            if aa < 1e-20 {
                if rest > 0.0 {
                    return None;
                }
                continue;
            }
            let middle = -ab * b / aa;
            let squared = middle * middle - rest / aa;
            if squared.is_nan() || squared < 0.0 {
                return None;
            }
            low = low.max(middle - squared.sqrt());
            high = high.min(middle + squared.sqrt());
        }
        (low <= high).then_some((low, high))
    }
}

/// The fastest law along `path`, from rest to rest; none where some velocity bound is zero on the
/// way. The law's rows, one every `period` seconds and joined by a spline, keep every bound as
/// [`usage`] sees them, and its duration is a whole number of periods.
pub(crate) fn fastest(arm: &Arm, rates: &Rates, path: &Spline, period: f64) -> Option<Law> {
    let profile = profile(arm, rates, path)?;
    // Boxes of 4 ms keep the jerk; rows further apart than that need a smoother law.
    let half = (4.0 * TICK).max(period);
    let mut law = Law {
        profile,
        factor: 1.0,
        half,
    };
    let n = arm.joints().len();
    let (mut times, mut rows, mut row) = (Vec::new(), Vec::new(), vec![0.0; n]);
    for _ in 0..ROUNDS {
        let count = (law.duration() / period - 1e-9).ceil().max(2.0);
        law = law.lasting(count * period);
        times.clear();
        rows.clear();
        for k in 0..=count as usize {
            times.push(period * k as f64);
            path.position(law.at(period * k as f64), &mut row);
            rows.extend_from_slice(&row);
        }
        let slower = slow_down(&usage(arm, rates, &times, &rows));
        if slower <= 1.0 {
            return Some(law);
        }
        if !slower.is_finite() || law.duration() > LONGEST {
            return None;
        }
        let duration = law.duration() * (slower * (1.0 + 1e-6)).min(2.0);
        law = law.lasting(duration);
    }
    None
}

fn profile(arm: &Arm, rates: &Rates, path: &Spline) -> Option<Profile> {
    let end = path.end();
    let u: Vec<f64> = (0..=GRID).map(|k| end * k as f64 / GRID as f64).collect();
    let step = end / GRID as f64;
    let points = points(arm, rates, path, &u);

    // Backwards: from where the end can be reached
    let mut reach = vec![0.0; GRID + 1];
    for k in (0..GRID).rev() {
        let next = reach[k + 1];
        let possible = |b: f64| {
            points[k].range(b).is_some_and(|(low, high)| {
                low.max(-b / (2.0 * step)) <= high.min((next - b) / (2.0 * step))
            })
        };
        reach[k] = largest(points[k].largest, possible);
    }
    // Forwards: as fast as can be
    let mut b = vec![0.0; GRID + 1];
    for k in 0..GRID {
        let (_, high) = points[k].range(b[k])?;
        b[k + 1] = (b[k] + 2.0 * step * high).min(reach[k + 1]).max(0.0);
    }
    let mut t = vec![0.0; GRID + 1];
    for k in 0..GRID {
        let speeds = b[k].sqrt() + b[k + 1].sqrt();
        if speeds.is_nan() || speeds <= 0.0 {
            return None;
        }
        t[k + 1] = t[k] + 2.0 * step / speeds;
    }
    Some(Profile { u, b, t })
}

/// The largest `b` up to `bound` for which a property holds that holds from 0 up to some value.
fn largest(bound: f64, holds: impl Fn(f64) -> bool) -> f64 {
    if holds(bound) {
        return bound;
    }
    let (mut low, mut high) = (0.0, bound);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match holds(middle) {
            true => low = middle,
            false => high = middle,
        }
    }
    low
}

fn points(arm: &Arm, rates: &Rates, path: &Spline, u: &[f64]) -> Vec<Point> {
    let n = arm.joints().len();
    let mut at = [vec![0.0; n], vec![0.0; n], vec![0.0; n], vec![0.0; n]];
    let mut columns = vec![[0.0; 6]; n];
    let mut twist = |u: f64, at: &mut [Vec<f64>; 4]| {
        let [q, first, second, third] = at;
        path.eval(u, [q, first, second, third]);
        arm.jacobian(q, &mut columns);
        let mut twist = [0.0; 6];
        for (column, first) in columns.iter().zip(first.iter()) {
            for (sum, c) in twist.iter_mut().zip(column) {
                *sum += c * first;
            }
        }
        twist
    };
    let small = 1e-4 * path.end();
    let points = u.iter().map(|&u| {
        let (before, after) = ((u - small).max(0.0), (u + small).min(path.end()));
        let [w0, w1] = [before, after].map(|u| twist(u, &mut at));
        let slope: [f64; 6] = std::array::from_fn(|k| (w1[k] - w0[k]) / (after - before));
        let w = twist(u, &mut at);
        let mut point = Point {
            largest: f64::MAX,
            ..Point::default()
        };
        let [q, firsts, seconds, _] = &at;
        for (j, ((&q, &first), &second)) in q.iter().zip(firsts).zip(seconds).enumerate() {
            let [down, up] = rates.velocity(j, q);
            let mut speed = if first < 0.0 { -down } else { up };
            let mut bound = rates.joints[j][1];
            if arm.geometry().is_some() && j == 2 {
                speed = speed.min(rates.elbow[0]);
                bound = bound.min(rates.elbow[1]);
            }
            if first.abs() > 1e-12 {
                point.largest = point.largest.min((speed / first).powi(2));
            }
            point.joints.push([first, second, bound]);
        }
        for (part, bounds) in [rates.translation, rates.rotation].iter().enumerate() {
            let dot = |a: &[f64; 6], b: &[f64; 6]| {
                (3 * part..3 * part + 3).map(|k| a[k] * b[k]).sum::<f64>()
            };
            let aa = dot(&w, &w);
            if aa > 1e-20 {
                point.largest = point.largest.min(bounds[0] * bounds[0] / aa);
            }
            point.tip[part] = [aa, dot(&w, &slope), dot(&slope, &slope), bounds[1]];
        }
        // Where nothing moves no speed is too high; any finite one will do.
        point.largest = point.largest.min(1e6);
        point
    });
    points.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spline::Ends;

    /// One joint that turns, with the bounds given.
    fn joint(velocity: f64, acceleration: f64, jerk: f64) -> (Arm, Rates) {
        let text = r#"<robot name="one"><link name="a"/><link name="b"/><joint name="j" type="revolute">
            <parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
            <limit lower="-10" upper="10" velocity="1" effort="1"/></joint></robot>"#;
        let arm = Arm::from_urdf(text, "a", "b").unwrap();
        let mut rates = Rates::of(&arm);
        rates.joints = vec![[velocity, acceleration, jerk]];
        rates.rotation = [f64::INFINITY; 3];
        (arm, rates)
    }

    fn line(distance: f64) -> Spline {
        let u: Vec<f64> = (0..5).map(|k| 0.25 * f64::from(k)).collect();
        let q: Vec<f64> = u.iter().map(|u| distance * u).collect();
        Spline::new(&u, &q, 1, Ends::Free)
    }

    #[test]
    fn bang_bang_takes_twice_the_root_of_distance_over_acceleration() {
        let (arm, rates) = joint(100.0, 4.0, f64::INFINITY);
        let profile = profile(&arm, &rates, &line(2.0)).unwrap();
        // 2 sqrt(d / a)
        let expected = 2.0 * (2.0f64 / 4.0).sqrt();
        assert!((profile.t[GRID] - expected).abs() < 1e-9);
        // Half way at half time, at v = sqrt(a d).
        assert!((profile.at(0.5 * expected) - 0.5).abs() < 1e-9);
        assert!((profile.b[GRID / 2].sqrt() * 2.0 - 8.0f64.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn a_trapezoid_takes_distance_over_speed_and_speed_over_acceleration() {
        let (arm, rates) = joint(1.6, 4.0, f64::INFINITY);
        let profile = profile(&arm, &rates, &line(2.0)).unwrap();
        // d / v + v / a; the corners lie 0.32 / 2 = 64 intervals from the ends, on the grid.
        let expected = 2.0 / 1.6 + 1.6 / 4.0;
        assert!(
            (profile.t[GRID] - expected).abs() < 1e-9,
            "{}",
            profile.t[GRID]
        );
    }

    #[test]
    fn a_circle_at_bounded_acceleration_of_the_tip() {
        // The tip on a lever of 0.5 m, nothing but the tip's acceleration bounded by 2: the speed
        // on the circle is at most sqrt(A r) = 1 m/s, and tangent and normal parts share the disc.
        // s'' = sqrt(A^2 - (s'^2 / r)^2): with z = s'^2, dz/ds = 2 sqrt(A^2 - z^2 / r^2), so
        // z = A r sin(2 s / r) until s = r pi / 4.
        let text = r#"<robot name="one"><link name="a"/><link name="b"/><link name="c"/>
            <joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>
            <joint name="k" type="fixed"><parent link="b"/><child link="c"/><origin xyz="0.5 0 0"/></joint></robot>"#;
        let arm = Arm::from_urdf(text, "a", "c").unwrap();
        let mut rates = Rates::of(&arm);
        rates.joints = vec![[1e3, 1e6, 1e9]];
        (rates.translation, rates.rotation) = ([1e3, 2.0, 1e9], [1e3, 1e6, 1e9]);
        let turn = 2.0 * std::f64::consts::PI;
        let profile = profile(&arm, &rates, &line(turn)).unwrap();
        for k in 0..=GRID / 2 {
            let s = 0.5 * turn * profile.u[k];
            let expected = match s < 0.5 * std::f64::consts::FRAC_PI_4 {
                true => (2.0 * s / 0.5).sin(),
                false => 1.0,
            };
            let z = profile.b[k] * (0.5 * turn).powi(2);
            assert!((z - expected).abs() < 0.02, "{k}: {z} {expected}");
            assert!(z <= 1.0 + 1e-6, "{z}");
        }
    }

    #[test]
    fn the_rows_keep_every_bound_and_lose_little() {
        let (arm, rates) = joint(1.6, 4.0, 1000.0);
        for (period, loss) in [(TICK, 0.01), (1.0 / 60.0, 0.07)] {
            let path = line(2.0);
            let law = fastest(&arm, &rates, &path, period).unwrap();
            let least = 2.0 / 1.6 + 1.6 / 4.0;
            let share = law.duration() / least - 1.0;
            assert!(share > 0.0 && share < loss, "{period}: {share}");
            // By differences of the positions, not by the code that made it so.
            let q = |t: f64| 2.0 * law.at(t);
            let mut t = 0.0;
            while t < law.duration() {
                let v = (q(t + TICK) - q(t)) / TICK;
                let a = (q(t + 2.0 * TICK) - 2.0 * q(t + TICK) + q(t)) / (TICK * TICK);
                assert!(
                    v.abs() <= 1.6 + 1e-9 && a.abs() <= 4.0 * 1.02,
                    "{t}: {v} {a}"
                );
                if period == TICK {
                    let [x0, x1, x2, x3] = [0.0, 1.0, 2.0, 3.0].map(|k| q(t + k * TICK));
                    let jerk = (x3 - 3.0 * x2 + 3.0 * x1 - x0) / TICK.powi(3);
                    assert!(jerk.abs() <= 1000.0 * 1.02, "{t}: {jerk}");
                }
                t += TICK;
            }
            assert!((law.at(law.duration()) - 1.0).abs() < 1e-12 && law.at(0.0) == 0.0);
        }
    }
}
