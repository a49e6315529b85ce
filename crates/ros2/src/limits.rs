//! How fast the tip may move and where it may be; looked at every millisecond before anything moves.

use selvedge_math::{DVec3, Pose};

use crate::error::{Cause, Error};
use crate::segment::{Moving, Segment};

/// The period at which motions are looked at [s].
const TICK: f64 = 1e-3;
/// Stops that are tried on each segment.
const STOPS: usize = 100;

/// Bounds of velocity, acceleration and jerk of the tip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// [m/s, m/s^2, m/s^3].
    pub translation: [f64; 3],
    /// [rad/s, rad/s^2, rad/s^3].
    pub rotation: [f64; 3],
}

impl Default for Limits {
    /// 0.25 m/s, 1 m/s^2, 100 m/s^3, 0.5 rad/s, 2 rad/s^2, 200 rad/s^3: far below what the maker
    /// allows (FR3: 3 m/s, 9 m/s^2, 4500 m/s^3, 2.5 rad/s, 17 rad/s^2, 8500 rad/s^3), slow enough to
    /// step back from.
    fn default() -> Self {
        Self {
            translation: [0.25, 1.0, 100.0],
            rotation: [0.5, 2.0, 200.0],
        }
    }
}

/// The largest rates of a motion: velocity, acceleration, jerk of translation, then of rotation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Peaks(pub [f64; 6]);

const NAMES: [(&str, &str); 6] = [
    ("velocity", "m/s"),
    ("acceleration", "m/s^2"),
    ("jerk", "m/s^3"),
    ("angular velocity", "rad/s"),
    ("angular acceleration", "rad/s^2"),
    ("angular jerk", "rad/s^3"),
];

impl Limits {
    fn all(&self) -> [f64; 6] {
        let ([a, b, c], [d, e, f]) = (self.translation, self.rotation);
        [a, b, c, d, e, f]
    }

    /// Refuses bounds that bound nothing.
    ///
    /// # Errors
    /// [`Error::Value`] for what is not finite and positive.
    pub fn check(&self) -> Result<(), Error> {
        for (value, (field, unit)) in self.all().into_iter().zip(NAMES) {
            if !(value.is_finite() && value > 0.0) {
                let value = format!("{value} {unit}");
                return Err(Error::value("limits", field, value, "finite and positive"));
            }
        }
        Ok(())
    }

    /// The first bound that is not kept.
    ///
    /// # Errors
    /// [`Error::Value`] naming the bound, and `place`.
    pub fn keep(&self, peaks: &Peaks, place: &str) -> Result<(), Error> {
        for ((value, bound), (field, unit)) in peaks.0.into_iter().zip(self.all()).zip(NAMES) {
            if value.is_nan() || value > bound {
                let value = format!("{value:.4} {unit}");
                let bound = format!("at most {bound} {unit}; a lower --speed helps");
                return Err(Error::value(place, field, value, bound));
            }
        }
        Ok(())
    }

    /// The shortest of a row of times, 0.1 s to 3.2 s, within which the motion can be stopped at any
    /// moment without breaking a bound.
    ///
    /// # Errors
    /// [`Error::Value`] when 3.2 s are not enough.
    pub fn brake(&self, segments: &[Segment]) -> Result<f64, Error> {
        let mut within = 0.1;
        for segment in segments {
            let law = segment.law;
            for k in 0..STOPS {
                let t = law.duration() * k as f64 / STOPS as f64;
                loop {
                    let peaks = stop_peaks(segment, t, within);
                    if self.keep(&peaks, "").is_ok() {
                        break;
                    }
                    within *= 2.0f64.sqrt();
                    if within > 3.2 {
                        let place = format!("a stop {t:.3} s into a motion");
                        self.keep(&peaks, &place)?;
                    }
                }
            }
        }
        Ok(within)
    }
}

/// The largest rates of a segment's motion, by differences from millisecond to millisecond, with rest
/// before and after.
pub fn peaks(segment: &Segment) -> Peaks {
    let ticks = (segment.law.duration() / TICK).ceil() as usize;
    let at = |k: usize| {
        let (tau, rate, _) = segment.law.at(TICK * k as f64);
        segment.moving(tau, rate)
    };
    largest((0..ticks + 3).map(at), None)
}

/// Those of a stop that begins after `t` seconds of it.
fn stop_peaks(segment: &Segment, t: f64, within: f64) -> Peaks {
    let brake = segment.law.brake(t, within);
    let ticks = (brake.within / TICK).ceil() as usize;
    let before = |back: f64| {
        let (tau, rate, _) = segment.law.at(t - back);
        segment.moving(tau, rate)
    };
    let at = |k: usize| {
        let (tau, rate) = brake.at(TICK * k as f64);
        segment.moving(tau, rate)
    };
    let start = [before(2.0 * TICK), before(TICK)];
    largest((0..ticks + 3).map(at), Some(start))
}

fn largest(moving: impl Iterator<Item = Moving>, before: Option<[Moving; 2]>) -> Peaks {
    let rates = |m: &Moving| [m.velocity, m.angular];
    let (mut last, mut last_acceleration) = ([DVec3::ZERO; 2], [DVec3::ZERO; 2]);
    if let Some([a, b]) = before {
        last = rates(&b);
        last_acceleration = [0, 1].map(|k| (last[k] - rates(&a)[k]) / TICK);
    }
    let mut peaks = [0.0f64; 6];
    for now in moving {
        let now = rates(&now);
        for k in 0..2 {
            let acceleration = (now[k] - last[k]) / TICK;
            let jerk = (acceleration - last_acceleration[k]) / TICK;
            for (i, value) in [now[k], acceleration, jerk].into_iter().enumerate() {
                let length = value.length();
                let peak = &mut peaks[3 * k + i];
                // Also what is not a number comes out.
                if length.is_nan() || length > *peak {
                    *peak = length;
                }
            }
            last_acceleration[k] = acceleration;
        }
        last = now;
    }
    Peaks(peaks)
}

/// The last look at each sample before it is sent: no step is longer than 1.5 times what the highest
/// velocity covers in the time since the last one.
#[derive(Clone, Copy, Debug)]
pub struct Guard {
    limits: Limits,
    last: Option<(f64, Pose)>,
}

impl Guard {
    /// A guard that has not seen a sample yet; the first is let through.
    pub fn new(limits: Limits) -> Self {
        Self { limits, last: None }
    }

    /// Its bounds.
    pub fn limits(&self) -> Limits {
        self.limits
    }

    /// Looks at the sample to be sent at time `now` [s].
    ///
    /// # Errors
    /// [`Cause::Guard`] for a step that is too long, [`Cause::Impossible`] for what is not finite.
    pub fn pass(&mut self, now: f64, pose: &Pose) -> Result<(), Cause> {
        if !(pose.position().is_finite() && pose.rotation().is_finite()) {
            return Err(Cause::Impossible {
                what: "the next sample".into(),
                value: format!("{pose:?}"),
            });
        }
        if let Some((then, last)) = self.last {
            let span = 1.5 * (now - then).max(1e-4);
            let moved = pose.position().distance(last.position());
            let turned = angle(pose, &last);
            for (what, step, bound) in [
                ("the tip", moved, span * self.limits.translation[0]),
                ("the rotation", turned, span * self.limits.rotation[0]),
            ] {
                // What rounding makes of an angle of zero is let through.
                if step.is_nan() || step > bound.max(1e-7) {
                    return Err(Cause::Guard { what, step, bound });
                }
            }
        }
        self.last = Some((now, *pose));
        Ok(())
    }
}

/// The angle between two rotations, 0 to pi [rad].
pub fn angle(a: &Pose, b: &Pose) -> f64 {
    let q = a.rotation().conjugate() * b.rotation();
    2.0 * DVec3::new(q.x, q.y, q.z).length().atan2(q.w.abs())
}

#[cfg(test)]
mod tests {
    use super::*;
    use selvedge_math::DQuat;

    fn straight(metres: f64, turn: f64, seconds: f64, speed: f64) -> Segment {
        let times: Vec<f64> = (0..=60).map(|k| seconds * f64::from(k) / 60.0).collect();
        let poses: Vec<Pose> = (0..=60)
            .map(|k| {
                let u = f64::from(k) / 60.0;
                let s = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
                let q = DQuat::from_rotation_y(turn * s);
                Pose::from_unit(DVec3::X * metres * s, q)
            })
            .collect();
        Segment::new(&times, &poses, speed, None)
    }

    #[test]
    fn peaks_are_those_of_a_quintic() {
        // Peaks of a quintic over d and t: 1.875 d / t, 5.7735 d / t^2; velocities as they are, for
        // the ramps are over before the middle.
        let Peaks(peaks) = peaks(&straight(0.2, 0.5, 4.0, 1.0));
        assert!((peaks[0] - 1.875 * 0.2 / 4.0).abs() < 1e-5, "{peaks:?}");
        assert!((peaks[3] - 1.875 * 0.5 / 4.0).abs() < 1e-4, "{peaks:?}");
        assert!((peaks[1] - 5.7735 * 0.2 / 16.0).abs() < 2e-4, "{peaks:?}");
    }

    #[test]
    fn what_is_too_fast_is_refused_and_a_lower_speed_helps() {
        let limits = Limits::default();
        let fast = straight(0.5, 0.0, 3.0, 1.0);
        let error = limits
            .keep(&peaks(&fast), "the log")
            .unwrap_err()
            .to_string();
        let message = "the log: velocity is 0.3125 m/s, must be at most 0.25 m/s; a lower --speed \
                       helps";
        assert_eq!(error, message);
        limits
            .keep(&peaks(&straight(0.5, 0.0, 3.0, 0.5)), "")
            .unwrap();
        // A jump of a row, 5 mm within 1/60 s, is a matter of acceleration.
        let times: Vec<f64> = (0..120).map(|k| f64::from(k) / 60.0).collect();
        let step = |k: i32| DVec3::X * if k < 60 { 0.0 } else { 0.005 };
        let step: Vec<Pose> = (0..120).map(|k| Pose::from_translation(step(k))).collect();
        let jump = Segment::new(&times, &step, 0.5, None);
        let error = limits.keep(&peaks(&jump), "the log").unwrap_err();
        assert!(error.to_string().contains("acceleration is"), "{error}");
        let turn = limits
            .keep(&peaks(&straight(0.1, 2.0, 3.0, 1.0)), "x")
            .unwrap_err();
        assert!(
            turn.to_string().starts_with("x: angular velocity is 1.25"),
            "{turn}"
        );
        let nothing = Limits {
            rotation: [0.5, f64::NAN, 1.0],
            ..limits
        };
        assert!(
            nothing
                .check()
                .unwrap_err()
                .to_string()
                .contains("angular acceleration is NaN")
        );
    }

    #[test]
    fn every_stop_keeps_the_limits() {
        let limits = Limits::default();
        let segments = [straight(0.5, 0.3, 3.0, 0.5), straight(0.02, 0.0, 0.3, 0.4)];
        for segment in &segments {
            limits.keep(&peaks(segment), "").unwrap();
        }
        let within = limits.brake(&segments).unwrap();
        for k in 0..300 {
            let t = segments[0].law.duration() * f64::from(k) / 300.0;
            let Peaks(peaks) = stop_peaks(&segments[0], t, within);
            // Between the moments tried it may be a little more.
            assert!(peaks[1] < 1.02 && peaks[2] < 105.0, "{t}: {peaks:?}");
        }
        // Short stops would not do: half a second at 0.16 m/s is 0.5 m/s^2 and more.
        let Peaks(short) = stop_peaks(&segments[0], 3.2, 0.1);
        assert!(short[1] > 1.0, "{short:?}");
    }

    #[test]
    fn a_jump_in_the_stream_does_not_pass() {
        let mut guard = Guard::new(Limits::default());
        let at = |x: f64| Pose::from_translation(DVec3::X * x);
        guard.pass(0.0, &at(0.5)).unwrap();
        guard.pass(0.004, &at(0.501)).unwrap();
        let cause = guard.pass(0.008, &at(0.504)).unwrap_err();
        assert!(
            matches!(
                cause,
                Cause::Guard {
                    what: "the tip",
                    ..
                }
            ),
            "{cause}"
        );
        // What did not pass is not where the robot is.
        guard.pass(0.008, &at(0.502)).unwrap();
        let turned = Pose::from_unit(DVec3::X * 0.502, DQuat::from_rotation_z(0.01));
        assert!(guard.pass(0.012, &turned).is_err());
        assert!(guard.pass(0.016, &at(f64::NAN)).is_err());
    }
}
