//! Twice continuously differentiable curves through joint positions.

/// A cubic spline through rows of joint positions over increasing abscissas.
///
/// On `[x_i, x_i+1]` with `h` its length, `y = A y_i + B y_i+1 + C m_i + D m_i+1`, where `m` are the
/// second derivatives; these follow from equal slopes at the knots (de Boor 1978, chapter IV), with
/// the slopes at both ends given.
#[derive(Clone, Debug)]
pub(crate) struct Spline {
    width: usize,
    x: Vec<f64>,
    y: Vec<f64>,
    /// Second derivatives.
    m: Vec<f64>,
}

/// Slopes at the ends.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Ends {
    /// Zero: at rest.
    Rest,
    /// Those of the parabola through the three outermost rows.
    Free,
}

impl Spline {
    /// `y` holds `width` numbers a row, `x` one; at least two rows, `x` increasing.
    pub(crate) fn new(x: &[f64], y: &[f64], width: usize, ends: Ends) -> Self {
        let n = x.len();
        debug_assert!(n >= 2 && y.len() == n * width);
        let row = |k: usize| &y[k * width..(k + 1) * width];
        let chord = |k: usize, j: usize| (row(k + 1)[j] - row(k)[j]) / (x[k + 1] - x[k]);
        let mut m = vec![0.0; y.len()];
        // Thomas' algorithm; the matrix is the same for each joint and dominated by its diagonal.
        let mut upper = vec![0.0; n];
        for k in 0..n {
            let before = if k > 0 { x[k] - x[k - 1] } else { 0.0 };
            let after = if k + 1 < n { x[k + 1] - x[k] } else { 0.0 };
            let pivot = 2.0 * (before + after) - if k > 0 { before * upper[k - 1] } else { 0.0 };
            upper[k] = after / pivot;
            for j in 0..width {
                let left = match k {
                    0 => end_slope(ends, n, [0, 1], &chord, x, j),
                    _ => chord(k - 1, j),
                };
                let right = match k + 1 < n {
                    true => chord(k, j),
                    false => end_slope(ends, n, [n - 2, n.saturating_sub(3)], &chord, x, j),
                };
                let known = if k > 0 {
                    before * m[(k - 1) * width + j]
                } else {
                    0.0
                };
                m[k * width + j] = (6.0 * (right - left) - known) / pivot;
            }
        }
        for k in (0..n - 1).rev() {
            for j in 0..width {
                m[k * width + j] -= upper[k] * m[(k + 1) * width + j];
            }
        }
        Self {
            width,
            x: x.to_vec(),
            y: y.to_vec(),
            m,
        }
    }

    pub(crate) fn end(&self) -> f64 {
        self.x[self.x.len() - 1]
    }

    /// Position and the first three derivatives of each joint; outside the rows at the nearer end.
    pub(crate) fn eval(&self, at: f64, out: [&mut [f64]; 4]) {
        let at = at.max(self.x[0]).min(self.end());
        let k = self
            .x
            .partition_point(|x| *x <= at)
            .clamp(1, self.x.len() - 1)
            - 1;
        let h = self.x[k + 1] - self.x[k];
        let b = (at - self.x[k]) / h;
        let a = 1.0 - b;
        let [position, first, second, third] = out;
        for j in 0..self.width {
            let (i, n) = (k * self.width + j, (k + 1) * self.width + j);
            let (m0, m1) = (self.m[i], self.m[n]);
            position[j] = a * self.y[i]
                + b * self.y[n]
                + ((a * a * a - a) * m0 + (b * b * b - b) * m1) * h * h / 6.0;
            first[j] = (self.y[n] - self.y[i]) / h
                + ((3.0 * b * b - 1.0) * m1 - (3.0 * a * a - 1.0) * m0) * h / 6.0;
            second[j] = a * m0 + b * m1;
            third[j] = (m1 - m0) / h;
        }
    }

    /// Positions only.
    pub(crate) fn position(&self, at: f64, out: &mut [f64]) {
        let at = at.max(self.x[0]).min(self.end());
        let k = self
            .x
            .partition_point(|x| *x <= at)
            .clamp(1, self.x.len() - 1)
            - 1;
        let h = self.x[k + 1] - self.x[k];
        let b = (at - self.x[k]) / h;
        let a = 1.0 - b;
        for (j, out) in out.iter_mut().enumerate() {
            let (i, n) = (k * self.width + j, (k + 1) * self.width + j);
            *out = a * self.y[i]
                + b * self.y[n]
                + ((a * a * a - a) * self.m[i] + (b * b * b - b) * self.m[n]) * h * h / 6.0;
        }
    }
}

/// The slope at an end; `chords` are the outermost and the next interval.
fn end_slope(
    ends: Ends,
    n: usize,
    chords: [usize; 2],
    chord: &impl Fn(usize, usize) -> f64,
    x: &[f64],
    j: usize,
) -> f64 {
    match ends {
        Ends::Rest => 0.0,
        Ends::Free if n == 2 => chord(0, j),
        Ends::Free => {
            let [outer, next] = chords;
            let [h, g] = chords.map(|k| x[k + 1] - x[k]);
            chord(outer, j) + (chord(outer, j) - chord(next, j)) * h / (h + g)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(spline: &Spline, x: f64) -> [f64; 4] {
        let mut out = [[0.0]; 4];
        let [a, b, c, d] = &mut out;
        spline.eval(x, [a, b, c, d]);
        out.map(|v| v[0])
    }

    #[test]
    fn a_parabola_is_met_exactly() {
        let x = [0.0, 0.3, 1.0, 1.2, 2.0];
        let y = x.map(|x| 1.0 + 2.0 * x - 0.5 * x * x);
        let spline = Spline::new(&x, &y, 1, Ends::Free);
        for k in 0..=40 {
            let x = 0.05 * f64::from(k);
            let [p, v, a, j] = at(&spline, x);
            assert!((p - (1.0 + 2.0 * x - 0.5 * x * x)).abs() < 1e-14);
            assert!((v - (2.0 - x)).abs() < 1e-13 && (a + 1.0).abs() < 1e-12 && j.abs() < 1e-11);
        }
        let two = Spline::new(&[0.0, 2.0], &[1.0, 2.0], 1, Ends::Free);
        assert_eq!(at(&two, 1.0), [1.5, 0.5, 0.0, 0.0]);
    }

    #[test]
    fn at_rest_at_both_ends_and_smooth_between() {
        let x: Vec<f64> = (0..=20).map(|k| 0.05 * f64::from(k)).collect();
        let y: Vec<f64> = x.iter().map(|x| x * x * (3.0 - 2.0 * x)).collect();
        let spline = Spline::new(&x, &y, 1, Ends::Rest);
        // A cubic with these ends is met exactly.
        for k in 0..=100 {
            let x = 0.01 * f64::from(k);
            let [p, v, a, _] = at(&spline, x);
            assert!((p - x * x * (3.0 - 2.0 * x)).abs() < 1e-14);
            assert!((v - 6.0 * x * (1.0 - x)).abs() < 1e-12);
            assert!((a - (6.0 - 12.0 * x)).abs() < 1e-10);
        }
        assert_eq!(at(&spline, -1.0)[..2], at(&spline, 0.0)[..2]);
    }
}
