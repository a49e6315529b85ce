//! The region between the jaws.

use selvedge_math::DVec3;

use crate::Error;

/// The shape of a grasping volume, in gripper coordinates \[m\].
///
/// With the `serde` feature: `{"type": "box", "size": [x, y, z]}` or
/// `{"type": "pyramid", "side": s, "height": h}`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(tag = "type", rename_all = "lowercase"))]
pub enum Shape {
    /// The pinch grasp, eq. `box` of the paper: `|p_r| <= b_r / 2` for `r` in x, y, z.
    Box {
        /// `b`, the lengths of the sides \[m\].
        size: DVec3,
    },
    /// The point grasp, eq. `pyramid` of the paper with a signed height:
    /// `0 <= z/h <= 1` and `|x|, |y| <= s/2 (1 - z/h)`.
    ///
    /// The paper prints `h > 0`; a negative height turns the apex to the other side of the base.
    Pyramid {
        /// `s`, the side of the square base \[m\].
        side: f64,
        /// `h`, the z coordinate of the apex above the base \[m\]: not zero.
        height: f64,
    },
}

/// A grasping volume: a shape whose own origin lies at `offset` in the gripper frame.
///
/// The origin of a box is its middle, that of a pyramid the middle of its base. The fields are
/// private because they are checked once, in [`GraspVolume::new`].
///
/// ```
/// use selvedge_grasp::{DVec3, GraspVolume, Shape};
/// let shape = Shape::Pyramid { side: 0.02, height: -0.015 };
/// let volume = GraspVolume::new(shape, DVec3::ZERO)?;
/// assert!(volume.contains(DVec3::new(0.0, 0.0, -0.015))); // the apex belongs to it
/// assert!(volume.contains(DVec3::new(0.01, -0.01, 0.0))); // and so does the rim of the base
/// assert!(!volume.contains(DVec3::new(0.0, 0.0, 1e-9)));
/// # Ok::<(), selvedge_grasp::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "Unchecked", into = "Unchecked"))]
pub struct GraspVolume {
    shape: Shape,
    offset: DVec3,
}

impl GraspVolume {
    /// A volume of the given shape, moved by `offset` \[m\] in the gripper frame.
    ///
    /// # Errors
    /// [`Error::Size`] unless each side is positive and finite, [`Error::Height`] unless the height
    /// is finite and not zero, [`Error::Offset`] unless the offset is finite.
    pub fn new(shape: Shape, offset: DVec3) -> Result<Self, Error> {
        let size = |field, value: f64| {
            if value > 0.0 && value.is_finite() {
                Ok(())
            } else {
                Err(Error::Size { field, value })
            }
        };
        match shape {
            Shape::Box { size: b } => {
                size("box size x", b.x)?;
                size("box size y", b.y)?;
                size("box size z", b.z)?;
            }
            Shape::Pyramid { side, height } => {
                size("pyramid side", side)?;
                if height == 0.0 || !height.is_finite() {
                    return Err(Error::Height(height));
                }
            }
        }
        if !offset.is_finite() {
            return Err(Error::Offset(offset));
        }
        Ok(Self { shape, offset })
    }

    /// The shape.
    pub const fn shape(&self) -> Shape {
        self.shape
    }

    /// The origin of the shape \[m\], gripper frame. Its x is the squeeze centre `c_x`.
    pub const fn offset(&self) -> DVec3 {
        self.offset
    }

    /// Whether a point \[m\] of the gripper frame lies in the volume. The boundary belongs to it; a
    /// point that is not a number does not.
    pub fn contains(&self, p_g: DVec3) -> bool {
        let p = p_g - self.offset;
        match self.shape {
            Shape::Box { size } => {
                p.x.abs() <= 0.5 * size.x && p.y.abs() <= 0.5 * size.y && p.z.abs() <= 0.5 * size.z
            }
            Shape::Pyramid { side, height } => {
                let along = p.z / height;
                let half = 0.5 * side * (1.0 - along);
                (0.0..=1.0).contains(&along) && p.x.abs() <= half && p.y.abs() <= half
            }
        }
    }

    /// The lowest and the highest corner \[m\] of a box around the volume, gripper frame.
    pub(crate) fn bounds(&self) -> (DVec3, DVec3) {
        let (low, high) = match self.shape {
            Shape::Box { size } => (-0.5 * size, 0.5 * size),
            Shape::Pyramid { side, height } => (
                DVec3::new(-0.5 * side, -0.5 * side, height.min(0.0)),
                DVec3::new(0.5 * side, 0.5 * side, height.max(0.0)),
            ),
        };
        (self.offset + low, self.offset + high)
    }
}

/// What is read from a file before it has been checked.
#[cfg(feature = "serde")]
#[derive(serde::Serialize, serde::Deserialize)]
struct Unchecked {
    shape: Shape,
    #[serde(default)]
    offset: DVec3,
}

#[cfg(feature = "serde")]
impl TryFrom<Unchecked> for GraspVolume {
    type Error = Error;

    fn try_from(raw: Unchecked) -> Result<Self, Error> {
        Self::new(raw.shape, raw.offset)
    }
}

#[cfg(feature = "serde")]
impl From<GraspVolume> for Unchecked {
    fn from(volume: GraspVolume) -> Self {
        Self {
            shape: volume.shape,
            offset: volume.offset,
        }
    }
}

#[cfg(test)]
mod tests {
    use alloc::string::ToString;

    use super::*;

    const BOX: Shape = Shape::Box {
        size: DVec3::new(0.5, 1.0, 2.0),
    };

    #[test]
    fn the_boundary_of_the_box_belongs_to_it() {
        let volume = GraspVolume::new(BOX, DVec3::new(1.0, 0.0, 0.0)).unwrap();
        for corner in [DVec3::new(0.25, 0.5, 1.0), DVec3::new(-0.25, 0.5, -1.0)] {
            assert!(volume.contains(DVec3::X + corner));
            assert!(!volume.contains(DVec3::X + corner * 1.000_000_1));
        }
        assert!(!volume.contains(DVec3::ZERO));
        assert!(!volume.contains(DVec3::NAN));
    }

    #[test]
    fn the_sign_of_the_height_turns_the_pyramid() {
        for height in [0.5, -0.5] {
            let volume = GraspVolume::new(Shape::Pyramid { side: 2.0, height }, DVec3::ZERO);
            let volume = volume.unwrap();
            assert!(volume.contains(DVec3::new(0.5, -0.5, 0.5 * height)));
            assert!(!volume.contains(DVec3::new(0.5, -0.51, 0.5 * height)));
            assert!(volume.contains(DVec3::new(-1.0, 1.0, 0.0)));
            assert!(volume.contains(DVec3::new(0.0, 0.0, height)));
            assert!(!volume.contains(DVec3::new(0.0, 0.0, 1.001 * height)));
            assert!(!volume.contains(DVec3::new(0.0, 0.0, -0.001 * height)));
            assert!(!volume.contains(DVec3::new(0.0, f64::NAN, 0.0)));
        }
    }

    #[test]
    fn bounds_hold_the_volume() {
        let shape = Shape::Pyramid {
            side: 2.0,
            height: -3.0,
        };
        let volume = GraspVolume::new(shape, DVec3::Z).unwrap();
        let expected = (DVec3::new(-1.0, -1.0, -2.0), DVec3::new(1.0, 1.0, 1.0));
        assert_eq!(volume.bounds(), expected);
    }

    #[test]
    fn sizes_are_checked() {
        let size = DVec3::new(0.1, -0.2, 0.3);
        let error = GraspVolume::new(Shape::Box { size }, DVec3::ZERO).unwrap_err();
        assert_eq!(
            error.to_string(),
            "box size y -0.2 m must be positive and finite"
        );
        for (side, height) in [
            (0.0, 1.0),
            (f64::NAN, 1.0),
            (1.0, 0.0),
            (1.0, f64::INFINITY),
        ] {
            assert!(GraspVolume::new(Shape::Pyramid { side, height }, DVec3::ZERO).is_err());
        }
        assert!(GraspVolume::new(BOX, DVec3::NAN).is_err());
    }

    #[cfg(feature = "serde")]
    #[test]
    fn serde_checks_what_it_reads() {
        let text = r#"{"shape":{"type":"pyramid","side":0.02,"height":-0.015}}"#;
        let volume: GraspVolume = serde_json::from_str(text).unwrap();
        assert_eq!(volume.offset(), DVec3::ZERO);
        let written = serde_json::to_string(&volume).unwrap();
        assert_eq!(
            serde_json::from_str::<GraspVolume>(&written).unwrap(),
            volume
        );
        let flat = r#"{"shape":{"type":"pyramid","side":0.02,"height":0}}"#;
        assert!(serde_json::from_str::<GraspVolume>(flat).is_err());
    }
}
