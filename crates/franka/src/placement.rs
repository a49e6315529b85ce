//! Where the arm stands in front of the cloth.

use std::f64::consts::{FRAC_1_SQRT_2, PI, TAU};

use selvedge_math::{DQuat, DVec3, Pose};

use crate::Error;

/// A coordinate beyond this is taken for millimetres [m].
const MAX_METRES: f64 = 10.0;

/// Where an arm stands in front of the cloth, and which way round its hand is.
///
/// `T_base_tcp = T_base_cloth T_wg T_g_tcp`. In `T_g_tcp` the translation is the log's tip offset and
/// the rotation `xyzw = (sqrt(1/2), sqrt(1/2), 0, 0)`: the hand's y (closing) is the gripper's x, and
/// its z (approach) the gripper's -z. A gripper with two jaws may as well be turned by half a turn
/// about the approach: `flip`.
///
/// ```
/// use selvedge_franka::Placement;
/// use selvedge_math::{DVec3, Pose};
/// // Half a metre behind the cloth's frame, its table 2 cm below the base.
/// let placement = Placement::new([-0.5, 0.0, 0.02, 0.0], 0.0)?;
/// let tip = placement.tip(&Pose::IDENTITY, DVec3::new(0.0, 0.0, -0.1));
/// assert!(tip.position().distance(DVec3::new(0.5, 0.0, -0.12)) < 1e-15);
/// // Fingers down.
/// assert!((tip.rotation() * DVec3::Z).distance(-DVec3::Z) < 1e-15);
/// assert_eq!(placement.table_in_base(), -0.02);
/// # Ok::<(), selvedge_franka::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// The base in the cloth frame, upright.
    pub base: Pose,
    /// Height of the table in the cloth frame [m].
    pub table: f64,
    /// Whether the hand is turned by half a turn about its approach.
    pub flip: bool,
}

impl Placement {
    /// A base at `[x, y, z, yaw]` in the cloth frame [m, rad], and a table at height `table` there
    /// [m]; the hand as the log has it.
    ///
    /// # Errors
    /// [`Error::Value`] for numbers that are not finite, or so large that they must be millimetres or
    /// degrees.
    pub fn new(base: [f64; 4], table: f64) -> Result<Self, Error> {
        let [x, y, z, yaw] = base;
        for (field, value) in [("x", x), ("y", y), ("z", z)] {
            metres("base", field, value)?;
        }
        metres("table", "z", table)?;
        if !yaw.is_finite() || yaw.abs() > TAU {
            let bound = "a finite number of radians, at most 2 pi (is it in degrees?)";
            return Err(Error::value("base", "yaw", yaw, bound));
        }
        let turn = DQuat::from_rotation_z(yaw);
        Ok(Self {
            base: Pose::from_unit(DVec3::new(x, y, z), turn),
            table,
            flip: false,
        })
    }

    /// `[x, y, z, yaw]` of the base, yaw from -pi to pi.
    pub fn numbers(&self) -> [f64; 4] {
        let p = self.base.position();
        let q = self.base.rotation();
        let yaw = 2.0 * q.z.atan2(q.w);
        [p.x, p.y, p.z, yaw - TAU * (yaw / TAU).round()]
    }

    /// The pose of the tip in the base for a pose of the gripper and the tip's offset in it [m].
    pub fn tip(&self, gripper: &Pose, tip_offset: DVec3) -> Pose {
        self.base.inverse() * *gripper * self.tool(tip_offset)
    }

    /// The pose of the gripper for a pose of the tip in the base: the inverse of [`Placement::tip`].
    pub fn gripper(&self, tip: &Pose, tip_offset: DVec3) -> Pose {
        self.base * *tip * self.tool(tip_offset).inverse()
    }

    /// Height of the table in the base [m].
    pub fn table_in_base(&self) -> f64 {
        self.table - self.base.position().z
    }

    fn tool(&self, tip_offset: DVec3) -> Pose {
        let down = DQuat::from_xyzw(FRAC_1_SQRT_2, FRAC_1_SQRT_2, 0.0, 0.0);
        let turn = match self.flip {
            true => down * DQuat::from_rotation_z(PI),
            false => down,
        };
        Pose::from_unit(tip_offset, turn)
    }
}

/// Refuses what is not finite or must be in millimetres.
pub(crate) fn metres(place: &str, field: &'static str, value: f64) -> Result<(), Error> {
    if value.is_finite() && value.abs() <= MAX_METRES {
        return Ok(());
    }
    let bound = "a finite number of metres, at most 10 (is it in millimetres?)";
    Err(Error::value(place, field, value, bound))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hand_closes_along_the_grippers_x() {
        let mut placement = Placement::new([0.3, -0.2, 0.1, 0.7], 0.0).unwrap();
        let gripper = Pose::new(
            DVec3::new(0.2, 0.3, 0.05),
            DQuat::from_xyzw(0.1, -0.4, 0.2, 0.8),
        )
        .unwrap();
        let offset = DVec3::new(0.0, 0.01, -0.04);
        for flip in [false, true] {
            placement.flip = flip;
            let tip = placement.tip(&gripper, offset);
            let in_cloth = placement.base * tip;
            let side = if flip { -1.0 } else { 1.0 };
            let axis = |local: DVec3| in_cloth.rotation() * local;
            assert!(axis(DVec3::Y).distance(side * (gripper.rotation() * DVec3::X)) < 1e-14);
            assert!(axis(DVec3::Z).distance(-(gripper.rotation() * DVec3::Z)) < 1e-14);
            assert!(in_cloth.position().distance(gripper.transform(offset)) < 1e-14);
            let back = placement.gripper(&tip, offset);
            assert!(back.position().distance(gripper.position()) < 1e-14);
            assert!(back.rotation().dot(gripper.rotation()).abs() > 1.0 - 1e-14);
        }
        let numbers = placement.numbers();
        assert!((numbers[3] - 0.7).abs() < 1e-15 && numbers[..3] == [0.3, -0.2, 0.1]);
    }

    #[test]
    fn units_are_suspected() {
        let refusal = |base, table| Placement::new(base, table).unwrap_err().to_string();
        assert_eq!(
            refusal([-500.0, 0.0, 0.0, 0.0], 0.0),
            "base: x is -500, must be a finite number of metres, at most 10 (is it in millimetres?)"
        );
        assert!(refusal([0.0, 0.0, 0.0, 90.0], 0.0).contains("is it in degrees?"));
        assert!(refusal([0.0, f64::NAN, 0.0, 0.0], 0.0).starts_with("base: y is NaN"));
        assert!(refusal([0.0; 4], f64::INFINITY).starts_with("table: z is inf"));
    }
}
