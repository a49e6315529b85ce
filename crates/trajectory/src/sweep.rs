//! A path in space with an orientation that turns along it.

use selvedge_math::{DQuat, DVec3, Pose};

use crate::{Error, QuadBezier};

/// How the orientation goes from the first to the last. Both turn about one axis, fixed in the
/// world, along the shorter arc; they differ in when they are where.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Orientation {
    /// Spherical interpolation: the angle is proportional to `s`.
    #[default]
    Slerp,
    /// Component-wise interpolation, normalised: `(1-s) from + s to` over its length. Faster in the
    /// middle than at the ends; what the published folds use.
    Nlerp,
}

/// A gripper motion over `0 <= s <= 1`: its *tip* follows a curve while it turns from one
/// orientation to another.
///
/// With `p` the curve, `R` the orientation and `tip` a point in the gripper frame, the pose `T_wg`
/// has rotation `R(s)` and position `g(s) = p(s) - R(s) tip`. A tip of zero puts the frame's origin
/// on the curve.
///
/// The parameter is not clamped; a [`Law`](crate::Law) stays inside.
///
/// ```
/// use selvedge_math::{DQuat, DVec3};
/// use selvedge_trajectory::{Orientation, QuadBezier, Sweep};
///
/// let path = QuadBezier {
///     start: DVec3::new(0.0, 0.3, 0.0),
///     mid: DVec3::new(0.0, 0.3, 0.2),
///     end: DVec3::new(0.0, -0.3, 0.04),
/// };
/// let (from, to) = (DQuat::from_rotation_y(-0.8), DQuat::IDENTITY);
/// let tip = DVec3::new(0.0, 0.0, -0.1);
/// let sweep = Sweep::new(path, from, to, Orientation::Slerp, tip)?;
/// let pose_wg = sweep.pose(0.3);
/// assert!((pose_wg.transform(tip) - path.eval(0.3)).length() < 1e-15);
/// # Ok::<(), selvedge_trajectory::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sweep {
    path: QuadBezier,
    orientation: Orientation,
    /// `R(0)`, of unit length.
    from: DQuat,
    /// `R(1) - R(0)` as quaternions on one hemisphere.
    span: DQuat,
    /// World axis of the turn, or zero where there is none.
    axis: DVec3,
    /// Half the angle of the turn [rad], in `[0, pi/2]`.
    half_angle: f64,
    tip: DVec3,
}

/// Coordinates of a unit quaternion below this are zeros but for rounding.
const ROUNDED: f64 = 1e-12;

impl Sweep {
    /// A sweep along `path` [m, world] from the orientation `from` to `to`, which are normalised,
    /// with the point `tip` [m, gripper frame] on the path.
    ///
    /// The turn takes the shorter arc, so `q` and `-q` are the same. The two arcs of a half turn
    /// (to 1e-12) are equally long: its axis is then the one whose first coordinate that is not
    /// zero is positive.
    ///
    /// # Errors
    /// [`Error::Point`] or [`Error::Orientation`] when a coordinate is not finite or a quaternion
    /// is zero.
    pub fn new(
        path: QuadBezier,
        from: DQuat,
        to: DQuat,
        orientation: Orientation,
        tip: DVec3,
    ) -> Result<Self, Error> {
        for (field, value) in [
            ("path.start", path.start),
            ("path.mid", path.mid),
            ("path.end", path.end),
            ("tip", tip),
        ] {
            if !value.is_finite() {
                return Err(Error::Point { field, value });
            }
        }
        let unit = |field, q| match Pose::new(DVec3::ZERO, q) {
            Ok(pose) => Ok(pose.rotation()),
            Err(error) => Err(Error::Orientation { field, error }),
        };
        let (from, mut to) = (unit("from", from)?, unit("to", to)?);
        let turn = to * from.conjugate();
        // Compared in this order, the first number that is not a rounded zero decides.
        let decisive = [turn.w, turn.x, turn.y, turn.z]
            .into_iter()
            .find(|c| c.abs() > ROUNDED);
        if decisive.is_some_and(|c| c < 0.0) {
            to = -to;
        }
        // `to from*` without its real part; from the difference, so that small turns keep their
        // digits and no turn is none.
        let span = to - from;
        let turn = (span * from.conjugate()).xyz();
        let sine = turn.length();
        let axis = if sine > 0.0 { turn / sine } else { DVec3::ZERO };
        Ok(Self {
            path,
            orientation,
            from,
            span,
            axis,
            half_angle: sine.atan2(to.dot(from)),
            tip,
        })
    }

    /// The curve of the tip [m], world frame.
    pub fn path(&self) -> &QuadBezier {
        &self.path
    }

    /// The angle between the first and the last orientation [rad], in `[0, pi]`.
    pub fn angle(&self) -> f64 {
        2.0 * self.half_angle
    }

    /// `T_wg` at a finite `s`.
    pub fn pose(&self, s: f64) -> Pose {
        let rotation = match self.orientation {
            Orientation::Slerp => {
                let (sin, cos) = (self.half_angle * s).sin_cos();
                let turn = self.axis * sin;
                DQuat::from_xyzw(turn.x, turn.y, turn.z, cos) * self.from
            }
            Orientation::Nlerp => {
                // On one hemisphere the length is at least sqrt(1/2).
                let q = self.from + self.span * s;
                q / q.length()
            }
        };
        Pose::from_unit(self.path.eval(s) - rotation * self.tip, rotation)
    }

    /// Pose and its first three time derivatives where `s(t)` has the value `s` and the derivatives
    /// `ds` [1/s], `dds` [1/s^2], `ddds` [1/s^3].
    ///
    /// The turn is about a fixed axis `n` by the angle `phi(s)`: `theta s` (slerp) or
    /// `2 atan2(s sin w, 1 - s + s cos w)` with `w = theta / 2` (nlerp). Angular velocity,
    /// acceleration and jerk are `n` times the time derivatives of `phi`.
    pub fn motion(&self, s: f64, ds: f64, dds: f64, ddds: f64) -> Motion {
        let pose = self.pose(s);

        // d/ds of the angle, three times.
        let (phi1, phi2, phi3) = match self.orientation {
            Orientation::Slerp => (self.angle(), 0.0, 0.0),
            Orientation::Nlerp => {
                // phi' = 2 sin(w) / D with D = |q|^2 = 1 - 2 s (1-s) (1 - cos w).
                let versine = 2.0 * (0.5 * self.half_angle).sin().powi(2);
                let d = 1.0 - 2.0 * s * (1.0 - s) * versine;
                let d1 = -2.0 * (1.0 - 2.0 * s) * versine;
                let d2 = 4.0 * versine;
                let k = 2.0 * self.half_angle.sin() / d;
                (k, -k * d1 / d, k * (2.0 * d1 * d1 / d - d2) / d)
            }
        };

        // Chain rule, for the angle and for the curve (whose third derivative is zero).
        let velocity = self.axis * (phi1 * ds);
        let acceleration = self.axis * (phi2 * ds * ds + phi1 * dds);
        let jerk = self.axis * (phi3 * ds * ds * ds + 3.0 * phi2 * ds * dds + phi1 * ddds);
        let (p1, p2) = (self.path.derivative(s), self.path.second_derivative());

        // The tip's offset r = R tip turns with the gripper.
        let r = pose.rotation() * self.tip;
        let r1 = velocity.cross(r);
        let r2 = acceleration.cross(r) + velocity.cross(r1);
        let r3 = jerk.cross(r) + 2.0 * acceleration.cross(r1) + velocity.cross(r2);

        Motion {
            pose,
            velocity: Rates {
                linear: p1 * ds - r1,
                angular: velocity,
            },
            acceleration: Rates {
                linear: p2 * (ds * ds) + p1 * dds - r2,
                angular: acceleration,
            },
            jerk: Rates {
                linear: p2 * (3.0 * ds * dds) + p1 * ddds - r3,
                angular: jerk,
            },
        }
    }
}

/// A pose `T_wg` and its first three time derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// `T_wg`.
    pub pose: Pose,
    /// First derivatives [m/s, rad/s].
    pub velocity: Rates,
    /// Second derivatives [m/s^2, rad/s^2].
    pub acceleration: Rates,
    /// Third derivatives [m/s^3, rad/s^3].
    pub jerk: Rates,
}

impl Motion {
    /// A pose at rest.
    pub const fn at_rest(pose: Pose) -> Self {
        Self {
            pose,
            velocity: Rates::ZERO,
            acceleration: Rates::ZERO,
            jerk: Rates::ZERO,
        }
    }
}

/// One time derivative of a pose: of its position and of its rotation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rates {
    /// Of the origin of the gripper frame, in world axes [m/s^k].
    pub linear: DVec3,
    /// The angular velocity or its derivatives, in world axes [rad/s^k].
    pub angular: DVec3,
}

impl Rates {
    /// No motion.
    pub const ZERO: Self = Self {
        linear: DVec3::ZERO,
        angular: DVec3::ZERO,
    };
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, FRAC_PI_3, PI};

    use super::*;

    const LINE: QuadBezier = QuadBezier {
        start: DVec3::ZERO,
        mid: DVec3::X,
        end: DVec3::new(2.0, 0.0, 0.0),
    };

    fn turn(from: DQuat, to: DQuat, orientation: Orientation) -> Sweep {
        Sweep::new(LINE, from, to, orientation, DVec3::ZERO).unwrap()
    }

    #[test]
    fn a_third_of_a_quarter_turn() {
        let quarter = DQuat::from_rotation_z(FRAC_PI_2);
        let sweep = turn(DQuat::IDENTITY, quarter, Orientation::Slerp);
        assert!((sweep.angle() - FRAC_PI_2).abs() < 1e-15);
        let got = sweep.pose(1.0 / 3.0).rotation();
        assert!((got - DQuat::from_rotation_z(FRAC_PI_2 / 3.0)).length() < 1e-15);
        // Half way both kinds agree, at a third nlerp is behind.
        let nlerp = turn(DQuat::IDENTITY, quarter, Orientation::Nlerp);
        let half = DQuat::from_rotation_z(FRAC_PI_2 / 2.0);
        assert!((nlerp.pose(0.5).rotation() - half).length() < 1e-15);
        let (sin, cos) = (FRAC_PI_2 / 2.0).sin_cos();
        let behind = 2.0 * (sin / 3.0).atan2(2.0 / 3.0 + cos / 3.0);
        assert!(behind < FRAC_PI_2 / 3.0);
        let got = nlerp.pose(1.0 / 3.0).rotation();
        assert!((got - DQuat::from_rotation_z(behind)).length() < 1e-15);
    }

    #[test]
    fn a_turn_goes_the_short_way_whatever_the_signs() {
        let (from, to) = (DQuat::from_rotation_x(0.2), DQuat::from_rotation_x(1.4));
        for orientation in [Orientation::Slerp, Orientation::Nlerp] {
            let sweep = turn(from, to, orientation);
            assert!((sweep.angle() - 1.2).abs() < 1e-15);
            assert_eq!(turn(from, -to, orientation), sweep);
            let other = turn(-from, to, orientation).pose(0.3).rotation();
            assert_eq!(-other, sweep.pose(0.3).rotation());
        }
    }

    #[test]
    fn a_half_turn_has_one_axis_whatever_the_signs() {
        let half_turn = DQuat::from_xyzw(0.0, -1.0, 0.0, 0.0);
        for orientation in [Orientation::Slerp, Orientation::Nlerp] {
            for to in [half_turn, -half_turn] {
                let sweep = turn(DQuat::IDENTITY, to, orientation);
                assert_eq!(sweep.angle(), PI);
                let middle = sweep.pose(0.5).rotation();
                assert!((middle - DQuat::from_rotation_y(FRAC_PI_2)).length() < 1e-15);
            }
        }
    }

    #[test]
    fn a_half_turn_does_not_depend_on_last_digits() {
        // From -90 to +90 degrees about y, with either component the larger by one digit.
        let (a, b) = (FRAC_1_SQRT_2.next_down(), FRAC_1_SQRT_2);
        for (x, y) in [(a, b), (b, a)] {
            let from = DQuat::from_xyzw(0.0, -x, 0.0, y);
            let to = DQuat::from_xyzw(0.0, y, 0.0, x);
            let middle = turn(from, to, Orientation::Slerp).pose(0.5).rotation();
            assert!((middle - DQuat::IDENTITY).length() < 1e-15, "{middle}");
        }
    }

    #[test]
    fn no_turn_is_exact() {
        let q = DQuat::from_xyzw(0.1, 0.2, 0.3, 0.4).normalize();
        for orientation in [Orientation::Slerp, Orientation::Nlerp] {
            let sweep = turn(q, q, orientation);
            let first = sweep.pose(0.0).rotation();
            assert!((first - q).length() < 1e-15);
            for s in [0.1, 0.5, 1.0] {
                assert_eq!(sweep.pose(s).rotation(), first);
            }
            assert_eq!(sweep.motion(0.3, 1.0, 2.0, 3.0).jerk.angular, DVec3::ZERO);
        }
    }

    #[test]
    fn the_tip_stays_on_a_line_while_the_origin_circles() {
        // Tip 0.5 m below the origin, half a radian a second about y at constant speed.
        let tip = DVec3::new(0.0, 0.0, -0.5);
        let stand = QuadBezier {
            start: DVec3::X,
            mid: DVec3::X,
            end: DVec3::X,
        };
        let to = DQuat::from_rotation_y(FRAC_PI_3);
        let sweep = Sweep::new(stand, DQuat::IDENTITY, to, Orientation::Slerp, tip).unwrap();
        let w = 0.5;
        let motion = sweep.motion(0.0, w / FRAC_PI_3, 0.0, 0.0);
        assert!((motion.pose.position() - DVec3::new(1.0, 0.0, 0.5)).length() < 1e-15);
        // A circle of radius 0.5 m: speed r w, acceleration r w^2 inward, jerk r w^3 backward.
        let near = |a: DVec3, b: DVec3| (a - b).length() < 1e-15;
        assert!(near(motion.velocity.linear, DVec3::X * 0.5 * w));
        assert!(near(motion.acceleration.linear, -DVec3::Z * 0.5 * w * w));
        assert!(near(motion.jerk.linear, -DVec3::X * 0.5 * w * w * w));
        assert!(near(motion.velocity.angular, DVec3::Y * w));
    }

    #[test]
    fn bad_values_are_named() {
        let q = DQuat::IDENTITY;
        let zero = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0);
        let error = Sweep::new(LINE, q, zero, Orientation::Slerp, DVec3::ZERO).unwrap_err();
        assert_eq!(
            error.to_string(),
            "sweep to: quaternion (x 0, y 0, z 0, w 0) must be finite and not zero"
        );
        let mut path = LINE;
        path.mid.y = f64::NAN;
        let error = Sweep::new(path, q, q, Orientation::Slerp, DVec3::ZERO).unwrap_err();
        assert_eq!(
            error.to_string(),
            "sweep path.mid (1, NaN, 0) m must be finite"
        );
        let tip = DVec3::new(f64::INFINITY, 0.0, 0.0);
        let error = Sweep::new(LINE, q, q, Orientation::Slerp, tip).unwrap_err();
        assert_eq!(error.to_string(), "sweep tip (inf, 0, 0) m must be finite");
    }
}
