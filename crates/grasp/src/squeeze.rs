//! How closing jaws press the cloth together.

use selvedge_math::DVec3;

use crate::Error;

/// The squeeze: how far held nodes are drawn to the middle of the jaws, and in how many steps.
///
/// A plain value; [`crate::Gripper::new`] checks it.
///
/// ```
/// use selvedge_grasp::{DVec3, Squeeze};
/// let squeeze = Squeeze { amount: 0.5, lift: 2e-4, steps: 10 };
/// squeeze.check()?;
/// let p0 = DVec3::new(0.01, 0.02, 0.0);
/// assert_eq!(squeeze.squeezed(p0, 0.0, 1.0), DVec3::new(0.005, 0.02, 2e-4));
/// assert_eq!(squeeze.squeezed(p0, 0.0, 0.0), p0);
/// # Ok::<(), selvedge_grasp::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Squeeze {
    /// `sigma` in [0, 1]: 0 leaves the nodes where they are, 1 draws them all to `x = c_x`.
    pub amount: f64,
    /// `epsilon >= 0` \[m\]: the lift along the z of the gripper.
    pub lift: f64,
    /// The closed steps over which `alpha` grows to 1, at least 1.
    ///
    /// The paper leaves the law open; here `alpha = min(1, k / steps)` in the k-th closed step, so
    /// `1 / steps` in the closing step itself.
    pub steps: u32,
}

impl Squeeze {
    /// Checks the ranges of the fields.
    ///
    /// # Errors
    /// [`Error::Amount`], [`Error::Lift`] or [`Error::Steps`].
    pub fn check(&self) -> Result<(), Error> {
        if !(0.0..=1.0).contains(&self.amount) {
            return Err(Error::Amount(self.amount));
        }
        if !(self.lift >= 0.0 && self.lift.is_finite()) {
            return Err(Error::Lift(self.lift));
        }
        if self.steps == 0 {
            return Err(Error::Steps);
        }
        Ok(())
    }

    /// The local target of a node captured at `p0` \[m\], gripper frame (eq. `squeeze_target` and
    /// `squeeze_interpolation` of the paper):
    ///
    /// `p* = p0 + sigma (c_x - p0_x) e_x + epsilon e_z`, `p = (1 - alpha) p0 + alpha p*`.
    ///
    /// `centre_x` is `c_x` \[m\], the x of the volume's offset. Nothing is checked or clamped. The
    /// sum is taken as `p0 + alpha (p* - p0)`, which leaves y as it is to the last bit.
    pub fn squeezed(&self, p0: DVec3, centre_x: f64, alpha: f64) -> DVec3 {
        DVec3::new(
            p0.x + alpha * (self.amount * (centre_x - p0.x)),
            p0.y,
            p0.z + alpha * self.lift,
        )
    }

    /// `alpha` in the `closed_steps`-th closed step, counted from 1.
    pub(crate) fn progress(&self, closed_steps: u32) -> f64 {
        if closed_steps >= self.steps {
            1.0
        } else {
            f64::from(closed_steps) / f64::from(self.steps)
        }
    }
}

#[cfg(test)]
mod tests {
    use alloc::string::ToString;

    use super::*;

    const SQUEEZE: Squeeze = Squeeze {
        amount: 0.75,
        lift: 0.25,
        steps: 4,
    };

    #[test]
    fn squeezes_towards_the_centre_and_lifts() {
        let p0 = DVec3::new(2.0, -1.0, 3.0);
        assert_eq!(SQUEEZE.squeezed(p0, 1.0, 1.0), DVec3::new(1.25, -1.0, 3.25));
        assert_eq!(
            SQUEEZE.squeezed(p0, 1.0, 0.5),
            DVec3::new(1.625, -1.0, 3.125)
        );
    }

    #[test]
    fn alpha_grows_by_equal_parts_and_stops_at_one() {
        let alphas = [1, 2, 3, 4, 5, u32::MAX].map(|k| SQUEEZE.progress(k));
        assert_eq!(alphas, [0.25, 0.5, 0.75, 1.0, 1.0, 1.0]);
    }

    #[test]
    fn ranges_are_checked() {
        assert_eq!(SQUEEZE.check(), Ok(()));
        for amount in [-0.1, 1.1, f64::NAN] {
            let error = Squeeze { amount, ..SQUEEZE }.check().unwrap_err();
            assert!(error.to_string().contains("between 0 and 1"));
        }
        for lift in [-1e-9, f64::INFINITY, f64::NAN] {
            assert!(Squeeze { lift, ..SQUEEZE }.check().is_err());
        }
        assert_eq!(
            Squeeze {
                steps: 0,
                ..SQUEEZE
            }
            .check(),
            Err(Error::Steps)
        );
    }
}
