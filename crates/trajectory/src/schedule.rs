//! Phases on one time axis.

use selvedge_math::{Command, Jaw, Pose};

use crate::{Error, Law, Motion, Sweep};

/// How far [m] a phase may start from the end of the one before.
const MAX_DISTANCE: f64 = 1e-9;
/// How far [rad] it may be turned from it.
const MAX_ANGLE: f64 = 1e-9;

/// Where the gripper is during a phase.
#[derive(Clone, Copy, Debug, PartialEq)]
#[allow(
    clippy::large_enum_variant,
    reason = "a schedule has a handful of phases, and a box would be followed in every step"
)]
pub enum Movement {
    /// At one pose `T_wg`.
    Hold(Pose),
    /// Along a sweep, timed by a law over the phase.
    Sweep(Sweep, Law),
}

impl Movement {
    /// `T_wg` at the local time `u` in `[0, 1]`.
    fn pose(&self, u: f64) -> Pose {
        match self {
            Self::Hold(pose) => *pose,
            Self::Sweep(sweep, law) => sweep.pose(law.eval(u)),
        }
    }
}

/// A stretch of time with one jaw state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Phase {
    /// How long it lasts [s]: finite, not negative, positive for a sweep.
    pub duration: f64,
    /// The jaw state throughout.
    pub jaw: Jaw,
    /// Where the gripper is.
    pub movement: Movement,
}

/// The times of a fold [s], `0 <= close <= start < open <= end`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoldTimes {
    /// The jaws close.
    pub close: f64,
    /// The gripper starts to move.
    pub start: f64,
    /// It has arrived and the jaws open.
    pub open: f64,
    /// The cloth has settled.
    pub end: f64,
}

/// Commands as a function of time: phases one after another from `t = 0`.
///
/// A time on the border of two phases belongs to the later one. Before 0 the gripper rests at the
/// first pose with the first jaw state, from the end on at the last pose with the last jaw state;
/// a time that is not a number counts as before 0.
///
/// ```
/// use selvedge_math::{DQuat, DVec3, Jaw};
/// use selvedge_trajectory::{FoldTimes, Law, Orientation, QuadBezier, Schedule, Sweep};
///
/// let path = QuadBezier {
///     start: DVec3::new(0.2, 0.3, 0.0),
///     mid: DVec3::new(0.2, 0.3, 0.18),
///     end: DVec3::new(0.2, -0.3, 0.04),
/// };
/// let q = DQuat::from_rotation_z(-1.6);
/// let sweep = Sweep::new(path, q, q, Orientation::Nlerp, DVec3::ZERO)?;
/// let times = FoldTimes { close: 1.0, start: 2.0, open: 5.0, end: 11.0 };
/// let fold = Schedule::fold(sweep, Law::Quintic, times)?;
/// assert_eq!(fold.jaw(1.0), Jaw::Closed);
/// assert_eq!(fold.command(3.5).pose.position(), path.eval(0.5));
/// assert_eq!(fold.jaw(5.0), Jaw::Open);
/// # Ok::<(), selvedge_trajectory::Error>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    phases: Vec<Phase>,
    /// Phase `k` is `borders[k] <= t < borders[k + 1]`; the first border is 0.
    borders: Vec<f64>,
}

impl Schedule {
    /// A schedule of phases, one after another.
    ///
    /// # Errors
    /// [`Error::NoPhase`]; [`Error::Duration`] for one that is negative, not finite, or zero for a
    /// sweep; [`Error::Jump`] where a phase starts more than 1e-9 m or 1e-9 rad from the end of the
    /// one before.
    pub fn new(phases: Vec<Phase>) -> Result<Self, Error> {
        let mut borders = vec![0.0];
        let mut end = 0.0;
        for phase in &phases {
            end += phase.duration;
            borders.push(end);
        }
        Self::with_borders(phases, borders)
    }

    /// The usual fold: open at the start of the sweep until `close`, closed there until `start`,
    /// along the sweep until `open`, open at its end until `end`.
    ///
    /// The times are the borders to the bit: the sweep's local time is
    /// `(t - start) / (open - start)`.
    ///
    /// # Errors
    /// [`Error::FoldTime`] unless `0 <= close <= start < open <= end`, all finite.
    pub fn fold(sweep: Sweep, law: Law, times: FoldTimes) -> Result<Self, Error> {
        let FoldTimes {
            close,
            start,
            open,
            end,
        } = times;
        let check = |field, value: f64, holds: bool, bound, limit| {
            if value.is_finite() && holds {
                Ok(())
            } else {
                Err(Error::FoldTime {
                    field,
                    value,
                    bound,
                    limit,
                })
            }
        };
        check("close", close, close >= 0.0, "at least", 0.0)?;
        check("start", start, start >= close, "at least close,", close)?;
        check("open", open, open > start, "more than start,", start)?;
        check("end", end, end >= open, "at least open,", open)?;
        let phase = |duration, jaw, movement| Phase {
            duration,
            jaw,
            movement,
        };
        let (first, last) = (
            Movement::Hold(sweep.pose(0.0)),
            Movement::Hold(sweep.pose(1.0)),
        );
        Self::with_borders(
            vec![
                phase(close, Jaw::Open, first),
                phase(start - close, Jaw::Closed, first),
                phase(open - start, Jaw::Closed, Movement::Sweep(sweep, law)),
                phase(end - open, Jaw::Open, last),
            ],
            vec![0.0, close, start, open, end],
        )
    }

    fn with_borders(phases: Vec<Phase>, borders: Vec<f64>) -> Result<Self, Error> {
        if phases.is_empty() {
            return Err(Error::NoPhase);
        }
        for (k, phase) in phases.iter().enumerate() {
            let sweeps = matches!(phase.movement, Movement::Sweep(..));
            let bound = if !(phase.duration >= 0.0 && phase.duration.is_finite()) {
                "finite and at least 0"
            } else if !borders[k + 1].is_finite() {
                "such that the schedule ends at a finite time"
            } else if sweeps && borders[k + 1] <= borders[k] {
                "positive for a sweep and not lost beside the time it starts at"
            } else {
                continue;
            };
            return Err(Error::Duration {
                phase: k,
                duration: phase.duration,
                bound,
            });
        }
        for (k, pair) in phases.windows(2).enumerate() {
            let (end, start) = (pair[0].movement.pose(1.0), pair[1].movement.pose(0.0));
            let distance = end.position().distance(start.position());
            let turn = start.rotation() * end.rotation().conjugate();
            let angle = 2.0 * turn.xyz().length().atan2(turn.w.abs());
            if !(distance <= MAX_DISTANCE && angle <= MAX_ANGLE) {
                return Err(Error::Jump {
                    phase: k + 1,
                    distance,
                    max_distance: MAX_DISTANCE,
                    angle,
                    max_angle: MAX_ANGLE,
                });
            }
        }
        Ok(Self { phases, borders })
    }

    /// When the last phase ends [s].
    pub fn duration(&self) -> f64 {
        self.borders[self.phases.len()]
    }

    /// The phases, in order.
    pub fn phases(&self) -> &[Phase] {
        &self.phases
    }

    /// Pose and jaw at the time `t` [s].
    pub fn command(&self, t: f64) -> Command {
        let (k, u) = self.locate(t);
        let phase = &self.phases[k];
        Command {
            pose: phase.movement.pose(u),
            jaw: phase.jaw,
        }
    }

    /// The jaw state at the time `t` [s].
    pub fn jaw(&self, t: f64) -> Jaw {
        self.phases[self.locate(t).0].jaw
    }

    /// Pose and its derivatives at the time `t` [s]; on a border those of the later phase, before 0
    /// and from the end on at rest.
    pub fn motion(&self, t: f64) -> Motion {
        let (k, u) = self.locate(t);
        match &self.phases[k].movement {
            Movement::Sweep(sweep, law) if t >= 0.0 && t < self.duration() => {
                let rate = 1.0 / (self.borders[k + 1] - self.borders[k]);
                let [d1, d2, d3] = law.derivatives(u);
                let (d2, d3) = (d2 * rate * rate, d3 * rate * rate * rate);
                sweep.motion(law.eval(u), d1 * rate, d2, d3)
            }
            movement => Motion::at_rest(movement.pose(u)),
        }
    }

    /// The phase at `t` and the local time in it, from 0 to 1.
    fn locate(&self, t: f64) -> (usize, f64) {
        let last = self.phases.len() - 1;
        if t >= self.duration() {
            return (last, 1.0);
        }
        // The first phase that ends after t, so it is not an empty one unless t is before 0.
        let k = self.borders[1..].partition_point(|&end| end <= t);
        let (start, end) = (self.borders[k], self.borders[k + 1]);
        if t >= start {
            (k, (t - start) / (end - start))
        } else {
            (0, 0.0)
        }
    }
}

#[cfg(test)]
mod tests {
    use selvedge_math::{DQuat, DVec3};

    use super::*;
    use crate::{Orientation, QuadBezier, Rates};

    fn sweep() -> Sweep {
        let path = QuadBezier {
            start: DVec3::new(0.21, 0.295, 0.01),
            mid: DVec3::new(0.21, 0.295, 0.18),
            end: DVec3::new(0.21, -0.295, 0.04),
        };
        let from = DQuat::from_xyzw(-0.270_598_05, -0.270_598_05, -0.653_281_48, 0.653_281_48);
        let to = DQuat::from_xyzw(0.0, 0.0, -1.0, 1.0);
        Sweep::new(path, from, to, Orientation::Nlerp, DVec3::ZERO).unwrap()
    }

    fn fold(close: f64, start: f64, open: f64, end: f64) -> Result<Schedule, Error> {
        let times = FoldTimes {
            close,
            start,
            open,
            end,
        };
        Schedule::fold(sweep(), Law::Quintic, times)
    }

    fn hold(duration: f64, pose: Pose) -> Phase {
        Phase {
            duration,
            jaw: Jaw::Open,
            movement: Movement::Hold(pose),
        }
    }

    #[test]
    fn the_published_timeline() {
        let schedule = fold(1.0, 2.0, 5.0, 11.0).unwrap();
        assert_eq!(schedule.duration(), 11.0);
        let dt = 1.0 / 60.0;
        for frame in 0..=700 {
            // Both ways to compute the time of a frame hit the borders.
            for t in [f64::from(frame) / 60.0, f64::from(frame) * dt] {
                let closed = (60..300).contains(&frame);
                let command = schedule.command(t);
                assert_eq!(command.jaw.is_closed(), closed, "frame {frame}");
                assert_eq!(schedule.jaw(t), command.jaw);
                let w = ((t - 2.0) / 3.0).clamp(0.0, 1.0);
                assert_eq!(command.pose, sweep().pose(Law::Quintic.eval(w)));
            }
        }
    }

    #[test]
    fn borders_are_kept_to_the_bit() {
        // 0.1 + (0.3 - 0.1) is not 0.3.
        let schedule = fold(0.1, 0.3, 0.7, 0.9).unwrap();
        let before = |t: f64| f64::from_bits(t.to_bits() - 1);
        assert_eq!(schedule.jaw(before(0.1)), Jaw::Open);
        assert_eq!(schedule.jaw(0.1), Jaw::Closed);
        let start = sweep().pose(0.0);
        assert_eq!(schedule.command(0.3).pose, start);
        assert_eq!(schedule.jaw(before(0.7)), Jaw::Closed);
        assert_eq!(schedule.jaw(0.7), Jaw::Open);
        assert_eq!(schedule.duration(), 0.9);
    }

    #[test]
    fn outside_the_gripper_rests() {
        let schedule = fold(0.0, 0.0, 3.0, 3.0).unwrap();
        for t in [-1.0, f64::NEG_INFINITY, f64::NAN] {
            assert_eq!(schedule.command(t).jaw, Jaw::Open);
            assert_eq!(schedule.motion(t), Motion::at_rest(sweep().pose(0.0)));
        }
        assert_eq!(schedule.jaw(0.0), Jaw::Closed);
        assert_ne!(schedule.motion(0.0).jerk, Rates::ZERO);
        for t in [3.0, 7.0, f64::INFINITY] {
            assert_eq!(schedule.command(t).jaw, Jaw::Open);
            assert_eq!(schedule.motion(t), Motion::at_rest(sweep().pose(1.0)));
        }
    }

    #[test]
    fn phases_follow_one_another() {
        let there = sweep().pose(1.0);
        let phases = vec![
            Phase {
                duration: 2.0,
                jaw: Jaw::Closed,
                movement: Movement::Sweep(sweep(), Law::Linear),
            },
            hold(0.0, there),
            hold(1.0, there),
        ];
        let schedule = Schedule::new(phases).unwrap();
        assert_eq!(schedule.duration(), 3.0);
        assert_eq!(schedule.phases().len(), 3);
        assert_eq!(schedule.command(0.5).pose, sweep().pose(0.25));
        let velocity = sweep().motion(0.25, 0.5, 0.0, 0.0).velocity;
        assert_eq!(schedule.motion(0.5).velocity, velocity);
        assert_eq!(schedule.jaw(2.0), Jaw::Open);
    }

    #[test]
    fn jumps_are_named() {
        let q = DQuat::from_rotation_z;
        let pose = |x, angle| Pose::new(DVec3::new(x, 0.0, 0.0), q(angle)).unwrap();
        let here = pose(0.0, 0.0);
        for there in [
            pose(0.9e-9, 0.9e-9),
            Pose::new(DVec3::ZERO, -q(0.0)).unwrap(),
        ] {
            Schedule::new(vec![hold(1.0, here), hold(1.0, there)]).unwrap();
        }
        for there in [pose(1.1e-9, 0.0), pose(0.0, 1.1e-9)] {
            let phases = vec![hold(1.0, here), hold(1.0, here), hold(1.0, there)];
            let error = Schedule::new(phases).unwrap_err().to_string();
            assert!(
                error.starts_with("phase 2 must start where phase 1 ends"),
                "{error}"
            );
        }
        let error = Schedule::new(vec![hold(1.0, here), hold(1.0, pose(0.25, 0.0))]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "phase 1 must start where phase 0 ends: position off by 0.25 m (at most 0.000000001), \
             rotation by 0 rad (at most 0.000000001)"
        );
    }

    #[test]
    fn durations_are_checked() {
        assert!(matches!(Schedule::new(vec![]), Err(Error::NoPhase)));
        let here = sweep().pose(0.0);
        for bad in [-1.0, f64::NAN, f64::INFINITY] {
            let error = Schedule::new(vec![hold(1.0, here), hold(bad, here)]).unwrap_err();
            assert_eq!(
                error.to_string(),
                format!("phase 1: duration {bad} s must be finite and at least 0")
            );
        }
        let moves = |duration| Phase {
            duration,
            jaw: Jaw::Open,
            movement: Movement::Sweep(sweep(), Law::Linear),
        };
        for (before, bad) in [(0.0, 0.0), (1.0, 1e-20)] {
            let error = Schedule::new(vec![hold(before, here), moves(bad)]).unwrap_err();
            assert!(
                error.to_string().contains("positive for a sweep"),
                "{error}"
            );
        }
        let error = Schedule::new(vec![hold(f64::MAX, here); 2]).unwrap_err();
        assert!(error.to_string().contains("phase 1"), "{error}");
    }

    #[test]
    fn fold_times_are_checked() {
        for (times, message) in [
            (
                [-1.0, 2.0, 5.0, 8.0],
                "close = -1 s must be finite and at least 0 s",
            ),
            (
                [1.0, 0.5, 5.0, 8.0],
                "start = 0.5 s must be finite and at least close, 1 s",
            ),
            (
                [1.0, 2.0, 2.0, 8.0],
                "open = 2 s must be finite and more than start, 2 s",
            ),
            (
                [1.0, 2.0, 5.0, 4.0],
                "end = 4 s must be finite and at least open, 5 s",
            ),
            (
                [1.0, 2.0, f64::NAN, 8.0],
                "open = NaN s must be finite and more than start, 2 s",
            ),
            (
                [1.0, 2.0, 5.0, f64::INFINITY],
                "end = inf s must be finite and at least open, 5 s",
            ),
        ] {
            let [close, start, open, end] = times;
            let error = fold(close, start, open, end).unwrap_err();
            assert_eq!(error.to_string(), format!("fold time {message}"));
        }
    }
}
