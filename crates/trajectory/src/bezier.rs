//! The quadratic Bezier curve.

use selvedge_math::DVec3;

/// A quadratic Bezier curve `p(s) = (1-s)^2 start + 2 (1-s) s mid + s^2 end` [m] for `0 <= s <= 1`
/// (the paper's pulling trajectory with `start = p_b`, `mid = p_v`, `end = p_c`).
///
/// `mid` is a control point and not on the curve. Outside `[0, 1]` the parabola goes on.
///
/// ```
/// use selvedge_math::DVec3;
/// use selvedge_trajectory::QuadBezier;
///
/// let path = QuadBezier {
///     start: DVec3::ZERO,
///     mid: DVec3::new(0.0, 1.0, 0.0),
///     end: DVec3::new(0.0, 2.0, 0.0),
/// };
/// assert_eq!(path.eval(0.25), DVec3::new(0.0, 0.5, 0.0));
/// assert_eq!(path.length(), 2.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuadBezier {
    /// `p(0)` [m].
    pub start: DVec3,
    /// The control point between the ends [m].
    pub mid: DVec3,
    /// `p(1)` [m].
    pub end: DVec3,
}

impl QuadBezier {
    /// The point at `s` [m].
    ///
    /// A coordinate that is equal in the three points stays equal to the bit, so a path that keeps
    /// its x is one whose points share it.
    pub fn eval(&self, s: f64) -> DVec3 {
        let (a, b) = self.legs();
        self.start + s * (2.0 * a + s * (b - a))
    }

    /// The derivative at `s`, `dp/ds` [m].
    pub fn derivative(&self, s: f64) -> DVec3 {
        let (a, b) = self.legs();
        2.0 * (a + s * (b - a))
    }

    /// The second derivative, `d2p/ds2` [m], the same for every `s`. Higher ones are zero.
    pub fn second_derivative(&self) -> DVec3 {
        let (a, b) = self.legs();
        2.0 * (b - a)
    }

    /// The arc length from `s = 0` to `s = 1` [m], in closed form and to a few roundings: straight,
    /// doubled-back and single-point curves included.
    pub fn length(&self) -> f64 {
        let (a, b) = self.legs();
        hodograph_length(a, b)
    }

    /// The arc length from 0 to `s` [m]; negative for negative `s`.
    pub fn length_to(&self, s: f64) -> f64 {
        let (a, b) = self.legs();
        s * hodograph_length(a, a + s * (b - a))
    }

    /// The sides of the control polygon: half the derivative at the two ends.
    fn legs(&self) -> (DVec3, DVec3) {
        (self.mid - self.start, self.end - self.mid)
    }
}

/// `integral of 2 |a + s (b - a)| ds` over `[0, 1]`.
///
/// The derivative runs along the segment from `a` to `b`, of length `L` and mean `m`. Let
/// `r0 = |a|`, `r1 = |b|`, `R = r0 + r1`, `x` the part of `m` along the segment and `h` the distance of the
/// origin from its line. The textbook antiderivative `(x r + h^2 asinh(x/h)) / L` taken between the
/// ends loses all its digits for small `L`; with `r1 - r0 = 2 L x / R` and
/// `asinh(x1/h) - asinh(x0/h) = 2 atanh(L/R)` it becomes a sum of terms that are never negative:
///
/// `R/2 + 2 x^2/R + 2 h^2 atanh(L/R) / L`.
fn hodograph_length(a: DVec3, b: DVec3) -> f64 {
    // Scaled, so that no square overflows or vanishes.
    let scale = a.abs().max(b.abs()).max_element();
    if scale == 0.0 {
        return 0.0;
    }
    let (a, b) = (a / scale, b / scale);
    let chord = b - a;
    let (l, r) = (chord.length(), a.length() + b.length());
    if l <= 1e-9 * r {
        // A straight line at constant speed, to (L/R)^2.
        return scale * r;
    }
    let along = chord / l;
    let m = 0.5 * (a + b);
    let x = m.dot(along);
    let h_squared = m.cross(along).length_squared();
    // Near 1 the curve doubles back and h^2 <= R (R - L): the cut at a rounding from 1 costs no
    // more than a rounding and keeps 0 * infinity away.
    let ratio = (l / r).min(1.0 - f64::EPSILON);
    scale * (0.5 * r + 2.0 * x * x / r + 2.0 * h_squared * ratio.atanh() / l)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(start: [f64; 3], mid: [f64; 3], end: [f64; 3]) -> QuadBezier {
        QuadBezier {
            start: start.into(),
            mid: mid.into(),
            end: end.into(),
        }
    }

    /// Arc length by Gauss-Legendre (5 points) on pieces that are halved toward the slowest point,
    /// where the integrand has its kink.
    fn quadrature(path: &QuadBezier) -> f64 {
        const NODES: [(f64, f64); 5] = [
            (0.0, 0.568_888_888_888_888_9),
            (-0.538_469_310_105_683, 0.478_628_670_499_366_5),
            (0.538_469_310_105_683, 0.478_628_670_499_366_5),
            (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
            (0.906_179_845_938_664, 0.236_926_885_056_189_1),
        ];
        let (a, d) = (path.derivative(0.0), path.second_derivative());
        let slowest = if d == DVec3::ZERO {
            0.5
        } else {
            (-a.dot(d) / d.length_squared()).clamp(0.0, 1.0)
        };
        let mut sum = 0.0;
        for end in [0.0, 1.0] {
            let span = end - slowest;
            let mut far = 1.0;
            for level in 0..60 {
                let near = if level == 59 { 0.0 } else { 0.5 * far };
                let parts = 16;
                for k in 0..parts {
                    let half = 0.5 * (far - near) / f64::from(parts);
                    let centre = near + (2.0 * f64::from(k) + 1.0) * half;
                    for (node, weight) in NODES {
                        let s = slowest + span * (centre + half * node);
                        sum += weight * half * span.abs() * path.derivative(s).length();
                    }
                }
                far = near;
            }
        }
        sum
    }

    #[test]
    fn points_and_derivatives() {
        let path = curve([1.0, 0.0, 0.0], [2.0, 2.0, 0.0], [5.0, 0.0, 4.0]);
        assert_eq!(path.eval(0.0), path.start);
        assert_eq!(path.eval(1.0), path.end);
        assert_eq!(path.eval(0.5), DVec3::new(2.5, 1.0, 1.0));
        assert_eq!(path.derivative(0.0), DVec3::new(2.0, 4.0, 0.0));
        assert_eq!(path.derivative(1.0), DVec3::new(6.0, -4.0, 8.0));
        assert_eq!(path.second_derivative(), DVec3::new(4.0, -8.0, 8.0));
    }

    #[test]
    fn equal_coordinates_stay_equal() {
        let x = 0.1 + 0.2;
        let path = curve([x, 0.3, 0.0], [x, 0.2, 0.18], [x, -0.3, 0.04]);
        for k in 0..=1000 {
            assert_eq!(path.eval(f64::from(k) / 1000.0).x, x);
        }
    }

    #[test]
    fn length_of_known_curves() {
        // y = x^2 from 0 to 1: sqrt(5)/2 + asinh(2)/4.
        let parabola = curve([0.0; 3], [0.5, 0.0, 0.0], [1.0, 1.0, 0.0]);
        let expected = 5.0_f64.sqrt() / 2.0 + 2.0_f64.asinh() / 4.0;
        assert!((parabola.length() - expected).abs() < 1e-15);
        // Out to x = 1 (at s = 1/2) and back.
        let back = curve([0.0; 3], [2.0, 0.0, 0.0], [0.0; 3]);
        assert_eq!(back.length(), 2.0);
        let point = curve([3.0; 3], [3.0; 3], [3.0; 3]);
        assert_eq!(point.length(), 0.0);
        assert_eq!(point.length_to(0.3), 0.0);
    }

    #[test]
    fn length_agrees_with_quadrature_down_to_degenerate_curves() {
        let mut curves = vec![
            curve(
                [0.21, 0.295, 0.01],
                [0.21, 0.295, 0.18],
                [0.21, -0.295, 0.04],
            ),
            // A cusp of speed at one end, at both ends coincident points, all in one place but one.
            curve([0.0; 3], [0.0; 3], [1.0, 2.0, 3.0]),
            curve([0.0; 3], [1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
            curve([0.0; 3], [1.0, 2.0, 3.0], [0.0; 3]),
            // Far from the origin.
            curve([1e6, 0.0, 0.0], [1e6 + 1.0, 0.5, 0.0], [1e6, 2.0, 0.25]),
            curve([0.0; 3], [1e-200, 2e-200, 0.0], [3e-200, -1e-200, 0.0]),
            curve([0.0; 3], [1e200, 2e200, 0.0], [3e200, -1e200, 0.0]),
        ];
        for k in 0..=40 {
            let e = 10.0_f64.powf(-0.5 * f64::from(k));
            // Nearly straight, nearly uniform, nearly doubled back, nearly closed, nearly a stop.
            curves.push(curve([0.0; 3], [0.3, e, 0.0], [1.0, 0.0, 0.0]));
            curves.push(curve([0.0; 3], [0.5, 0.0, e], [1.0, e, 0.0]));
            curves.push(curve([0.0; 3], [1.0, e, 0.0], [0.4, 0.0, 0.0]));
            curves.push(curve([0.0; 3], [1.0, e, 0.0], [0.0, 0.0, e]));
            curves.push(curve([0.0; 3], [e, 0.0, 0.0], [1.0, 1.0, 0.0]));
            curves.push(curve([0.0; 3], [0.0, e, 0.0], [1.0, 1.0, 0.0]));
        }
        for path in curves {
            let (length, expected) = (path.length(), quadrature(&path));
            // Quadrature and distance square lengths unscaled.
            if (1e-100..1e100).contains(&path.end.abs().max_element()) {
                assert!(
                    (length - expected).abs() <= 1e-12 * expected,
                    "{path:?}: {length} {expected}"
                );
                assert!(length >= path.start.distance(path.end) * (1.0 - 1e-15));
            }
            assert!(length.is_finite());
            let half = path.length_to(0.5);
            let rest = QuadBezier {
                start: path.end,
                end: path.start,
                ..path
            };
            assert!((half + rest.length_to(0.5) - length).abs() <= 1e-12 * length);
        }
    }

    #[test]
    fn length_scales() {
        let unit = curve([0.0; 3], [1.0, 2.0, 0.0], [3.0, -1.0, 0.0]);
        for scale in [2.0_f64.powi(-700), 2.0_f64.powi(700)] {
            let scaled = QuadBezier {
                start: unit.start * scale,
                mid: unit.mid * scale,
                end: unit.end * scale,
            };
            assert_eq!(scaled.length() / scale, unit.length());
        }
    }
}
