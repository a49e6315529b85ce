//! Time laws.

/// How the path parameter `s` grows with the local time `u`, both from 0 to 1.
///
/// ```
/// use selvedge_trajectory::Law;
/// assert_eq!(Law::Quintic.eval(0.5), 0.5);
/// assert_eq!(Law::Quintic.derivatives(0.5), [1.875, 0.0, -30.0]);
/// assert_eq!(Law::Quintic.eval(2.0), 1.0);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Law {
    /// `s = u`: constant speed, with a jump of speed at both ends.
    Linear,
    /// `s = 3 u^2 - 2 u^3`: no speed at the ends, with a jump of acceleration.
    Cubic,
    /// `s = 10 u^3 - 15 u^4 + 6 u^5`: neither speed nor acceleration at the ends (the paper's law).
    #[default]
    Quintic,
}

impl Law {
    /// `s(u)`. Outside `[0, 1]` the law is at rest: 0 before, 1 after.
    pub fn eval(self, u: f64) -> f64 {
        // `max` and `min` would turn NaN into a number.
        let u = u.clamp(0.0, 1.0);
        match self {
            Self::Linear => u,
            Self::Cubic => u * u * (3.0 - 2.0 * u),
            Self::Quintic => u * u * u * (10.0 - u * (15.0 - 6.0 * u)),
        }
    }

    /// `[ds/du, d2s/du2, d3s/du3]` on `[0, 1]`, one-sided at the ends; zero outside.
    pub fn derivatives(self, u: f64) -> [f64; 3] {
        if !(0.0..=1.0).contains(&u) {
            return [0.0; 3];
        }
        match self {
            Self::Linear => [1.0, 0.0, 0.0],
            Self::Cubic => [6.0 * u * (1.0 - u), 6.0 - 12.0 * u, -12.0],
            Self::Quintic => {
                let v = u * (1.0 - u);
                [30.0 * v * v, 60.0 * v * (1.0 - 2.0 * u), 60.0 - 360.0 * v]
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_are_met_and_the_middle_is_half_way() {
        for law in [Law::Linear, Law::Cubic, Law::Quintic] {
            assert_eq!(law.eval(0.0), 0.0);
            assert_eq!(law.eval(0.5), 0.5);
            assert_eq!(law.eval(1.0), 1.0);
            assert_eq!(law.eval(-0.1), 0.0);
            assert_eq!(law.eval(1.1), 1.0);
            assert_eq!(law.derivatives(-0.1), [0.0; 3]);
            assert_eq!(law.derivatives(1.1), [0.0; 3]);
        }
        assert_eq!(Law::Cubic.derivatives(0.0), [0.0, 6.0, -12.0]);
        assert_eq!(Law::Cubic.derivatives(1.0), [0.0, -6.0, -12.0]);
        assert_eq!(Law::Quintic.derivatives(0.0), [0.0, 0.0, 60.0]);
        assert_eq!(Law::Quintic.derivatives(1.0), [0.0, 0.0, 60.0]);
    }

    #[test]
    fn values_by_hand() {
        assert_eq!(Law::Cubic.eval(0.25), 0.15625);
        // 10/64 - 15/256 + 6/1024
        assert_eq!(Law::Quintic.eval(0.25), 0.103515625);
        assert_eq!(Law::Quintic.derivatives(0.25), [1.0546875, 5.625, -7.5]);
    }
}
