//! The rigid transform of the gripper.

use core::fmt;
use core::ops::Mul;

use glam::{DMat3, DQuat, DVec3};

/// A rigid transform `T = (p, q)`: a position [m] and a unit quaternion (x y z w).
///
/// `T_wg` maps gripper coordinates to the world, `p_w = p + R(q) p_g` (eq. `desired_world` of the
/// paper). The fields are private because the quaternion is kept at unit length; `q` and `-q` are
/// the same rotation and both are accepted.
///
/// ```
/// use selvedge_math::{DQuat, DVec3, Pose};
/// let pose = Pose::new(DVec3::Z, DQuat::from_rotation_z(0.5))?;
/// assert_eq!((pose * Pose::IDENTITY).position(), DVec3::Z);
/// assert!(Pose::new(DVec3::NAN, DQuat::IDENTITY).is_err());
/// # Ok::<(), selvedge_math::PoseError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "Unchecked", into = "Unchecked"))]
pub struct Pose {
    position: DVec3,
    rotation: DQuat,
}

impl Pose {
    /// No translation and no rotation.
    pub const IDENTITY: Self = Self {
        position: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
    };

    /// A pose from a position [m] and a quaternion of any finite length other than zero, which is
    /// normalised.
    ///
    /// # Errors
    /// [`PoseError`] when a coordinate is not finite or the quaternion is zero.
    pub fn new(position: DVec3, rotation: DQuat) -> Result<Self, PoseError> {
        if !position.is_finite() {
            return Err(PoseError::Position(position));
        }
        let length_squared = rotation.length_squared();
        // Ordinary lengths take one square root; the rest is brought near 1 first, so that its
        // square neither overflows nor vanishes. Division, not multiplication with an inverse,
        // keeps quaternions exact whose length is a whole number.
        let unit = if length_squared > 1e-200 && length_squared < 1e200 {
            rotation / rotation.length()
        } else {
            let largest = rotation.x.abs().max(rotation.y.abs()).max(rotation.z.abs());
            let largest = largest.max(rotation.w.abs());
            if !rotation.is_finite() || largest == 0.0 {
                return Err(PoseError::Rotation(rotation));
            }
            let scaled = DQuat::from_vec4(glam::DVec4::from(rotation) / largest);
            scaled / scaled.length()
        };
        Ok(Self {
            position,
            rotation: unit,
        })
    }

    /// A pose from a position [m] and a quaternion that is already of unit length, bit for bit: for
    /// loops that normalise themselves and for poses read back from a file.
    ///
    /// Not checked, beyond a debug assertion that the length is 1 to 1e-9.
    pub fn from_unit(position: DVec3, rotation: DQuat) -> Self {
        debug_assert!(
            (rotation.length() - 1.0).abs() <= 1e-9,
            "quaternion {rotation} must be of unit length"
        );
        Self { position, rotation }
    }

    /// A pure translation [m]. Not checked: a coordinate that is not finite stays so.
    pub const fn from_translation(position: DVec3) -> Self {
        Self {
            position,
            rotation: DQuat::IDENTITY,
        }
    }

    /// The position `p` [m], origin of the moving frame in the fixed one.
    pub const fn position(&self) -> DVec3 {
        self.position
    }

    /// The unit quaternion `q`, x y z w.
    pub const fn rotation(&self) -> DQuat {
        self.rotation
    }

    /// The rotation matrix `R(q)`; worth building when many points are mapped.
    #[inline]
    pub fn rotation_matrix(&self) -> DMat3 {
        DMat3::from_quat(self.rotation)
    }

    /// A point out of the moving frame: `p + R(q) local`.
    pub fn transform(&self, local: DVec3) -> DVec3 {
        self.position + self.rotation * local
    }

    /// A point into the moving frame: `R(q)^T (world - p)`.
    pub fn inverse_transform(&self, world: DVec3) -> DVec3 {
        self.rotation.conjugate() * (world - self.position)
    }

    /// The inverse transform, `T^-1 T = 1`.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.conjugate();
        Self {
            position: rotation * -self.position,
            rotation,
        }
    }
}

/// `T_ab * T_bc = T_ac`.
impl Mul for Pose {
    type Output = Self;

    fn mul(self, inner: Self) -> Self {
        let rotation = self.rotation * inner.rotation;
        Self {
            position: self.transform(inner.position),
            // A product of unit quaternions drifts by rounding; long chains must not.
            rotation: rotation / rotation.length(),
        }
    }
}

/// Why numbers do not make a pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PoseError {
    /// A coordinate of the position is infinite or not a number.
    Position(DVec3),
    /// The quaternion is zero, infinite or not a number.
    Rotation(DQuat),
}

impl fmt::Display for PoseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Position(p) => {
                write!(f, "position ({}, {}, {}) m must be finite", p.x, p.y, p.z)
            }
            Self::Rotation(q) => write!(
                f,
                "quaternion (x {}, y {}, z {}, w {}) must be finite and not zero",
                q.x, q.y, q.z, q.w
            ),
        }
    }
}

impl core::error::Error for PoseError {}

/// What is read from a file before it has been checked.
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
struct Unchecked {
    position: DVec3,
    rotation_xyzw: DQuat,
}

#[cfg(feature = "serde")]
impl TryFrom<Unchecked> for Pose {
    type Error = PoseError;

    fn try_from(raw: Unchecked) -> Result<Self, PoseError> {
        Self::new(raw.position, raw.rotation_xyzw)
    }
}

#[cfg(feature = "serde")]
impl From<Pose> for Unchecked {
    fn from(pose: Pose) -> Self {
        Self {
            position: pose.position,
            rotation_xyzw: pose.rotation,
        }
    }
}

/// A position and a quaternion of the `mint` interchange crate, checked as in [`Pose::new`].
#[cfg(feature = "mint")]
impl TryFrom<(mint::Point3<f64>, mint::Quaternion<f64>)> for Pose {
    type Error = PoseError;

    fn try_from((p, q): (mint::Point3<f64>, mint::Quaternion<f64>)) -> Result<Self, PoseError> {
        Self::new(p.into(), q.into())
    }
}

#[cfg(feature = "mint")]
impl From<Pose> for (mint::Point3<f64>, mint::Quaternion<f64>) {
    fn from(pose: Pose) -> Self {
        (pose.position.into(), pose.rotation.into())
    }
}

#[cfg(test)]
mod tests {
    use alloc::string::ToString;

    use super::*;

    #[test]
    fn normalises_every_finite_length() {
        let q = DQuat::from_xyzw(1.0, -2.0, 0.5, 3.0);
        let expected = Pose::new(DVec3::ZERO, q).unwrap().rotation();
        for scale in [1e-300, 1e-160, 1e-3, 1.0, 7.0, 1e160, 1e300] {
            let scaled = DQuat::from_vec4(glam::DVec4::from(q) * scale);
            let got = Pose::new(DVec3::ZERO, scaled).unwrap().rotation();
            assert!((got - expected).length() < 1e-15, "{scale:e}: {got}");
        }
        // Whole-number lengths divide exactly.
        let quarter = Pose::new(DVec3::ZERO, DQuat::from_xyzw(0.0, 0.0, 49.0, 0.0)).unwrap();
        assert_eq!(quarter.rotation(), DQuat::from_xyzw(0.0, 0.0, 1.0, 0.0));
    }

    #[test]
    fn refuses_what_is_no_rotation() {
        for bad in [0.0, f64::NAN, f64::INFINITY] {
            let q = DQuat::from_xyzw(0.0, 0.0, 0.0, bad);
            let error = Pose::new(DVec3::ZERO, q).unwrap_err();
            assert!(error.to_string().contains("finite and not zero"));
        }
        let error = Pose::new(DVec3::new(0.0, f64::NAN, 1.0), DQuat::IDENTITY).unwrap_err();
        assert_eq!(error.to_string(), "position (0, NaN, 1) m must be finite");
    }

    #[test]
    fn unit_quaternions_keep_their_bits() {
        let q = DQuat::from_xyzw(0.1, -0.2, 0.05, 0.3).normalize();
        assert_eq!(Pose::from_unit(DVec3::X, q).rotation(), q);
    }

    #[cfg(debug_assertions)]
    #[test]
    #[should_panic(expected = "unit length")]
    fn other_lengths_are_a_mistake_of_the_caller() {
        Pose::from_unit(DVec3::X, DQuat::from_xyzw(0.0, 0.0, 0.0, 1.001));
    }

    #[test]
    fn inverse_undoes_the_pose() {
        let a = Pose::new(
            DVec3::new(0.3, -2.0, 1.0),
            DQuat::from_xyzw(0.1, 0.7, -0.3, 0.5),
        )
        .unwrap();
        let p = DVec3::new(-0.4, 0.2, 5.0);
        assert!((a.inverse_transform(a.transform(p)) - p).length() < 1e-14);
        assert!((a.inverse().transform(p) - a.inverse_transform(p)).length() < 1e-14);
        assert!((a.rotation_matrix() * p + a.position() - a.transform(p)).length() < 1e-14);
        let unit = a * a.inverse();
        assert!(unit.position().length() < 1e-14);
        assert!((unit.rotation().w.abs() - 1.0).abs() < 1e-15);
    }

    #[test]
    fn product_maps_through_both_frames() {
        let a = Pose::new(DVec3::X, DQuat::from_rotation_z(0.4)).unwrap();
        let b = Pose::new(DVec3::Y, DQuat::from_rotation_x(-1.4)).unwrap();
        let p = DVec3::new(1.0, 2.0, 3.0);
        assert!(((a * b).transform(p) - a.transform(b.transform(p))).length() < 1e-14);
    }

    #[cfg(feature = "serde")]
    #[test]
    fn serde_checks_what_it_reads() {
        let pose = Pose::new(DVec3::X, DQuat::from_rotation_y(0.3)).unwrap();
        let text = serde_json::to_string(&pose).unwrap();
        assert_eq!(serde_json::from_str::<Pose>(&text).unwrap(), pose);
        let zero = r#"{"position":[0,0,0],"rotation_xyzw":[0,0,0,0]}"#;
        assert!(
            serde_json::from_str::<Pose>(zero)
                .unwrap_err()
                .to_string()
                .contains("not zero")
        );
    }

    #[cfg(feature = "mint")]
    #[test]
    fn mint_goes_both_ways() {
        let pose = Pose::new(DVec3::X, DQuat::from_rotation_y(0.3)).unwrap();
        let plain: (mint::Point3<f64>, mint::Quaternion<f64>) = pose.into();
        assert_eq!(Pose::try_from(plain).unwrap(), pose);
    }
}
