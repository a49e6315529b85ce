//! A smooth function near given values (Whittaker 1923).

/// Second differences of a function at the places `at`, as weights of three values: differences of
/// the slopes, times the mean distance of the places.
fn second_difference(at: &[f64], k: usize) -> [f64; 3] {
    let mean = (at[at.len() - 1] - at[0]) / (at.len() - 1) as f64;
    let (before, after) = (mean / (at[k + 1] - at[k]), mean / (at[k + 2] - at[k + 1]));
    [before, -before - after, after]
}

/// Solves `(1 + lambda D^T D) x = x0` in place, `D` being second differences: five diagonals,
/// positive definite, by an `L D L^T` factorisation.
pub(crate) fn smooth(x: &mut [f64], at: &[f64], lambda: f64) {
    let n = x.len();
    if n < 3 || lambda == 0.0 {
        return;
    }
    let mut bands = vec![[1.0, 0.0, 0.0]; n];
    for k in 0..n - 2 {
        let weights = second_difference(at, k);
        for (a, first) in weights.into_iter().enumerate() {
            for (b, second) in weights.into_iter().enumerate().skip(a) {
                bands[k + a][b - a] += lambda * first * second;
            }
        }
    }
    // bands[k] = [pivot, L of the next row, L of the one after].
    for k in 0..n {
        let [pivot, near, far] = bands[k];
        if k + 1 < n {
            bands[k + 1][0] -= near * near / pivot;
            bands[k + 1][1] -= near * far / pivot;
        }
        if k + 2 < n {
            bands[k + 2][0] -= far * far / pivot;
        }
        bands[k] = [pivot, near / pivot, far / pivot];
    }
    for k in 0..n {
        let value = x[k];
        for d in 1..=2.min(n - 1 - k) {
            x[k + d] -= bands[k][d] * value;
        }
    }
    for k in (0..n).rev() {
        x[k] /= bands[k][0];
        for d in 1..=2.min(n - 1 - k) {
            x[k] -= bands[k][d] * x[k + d];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smoothing_keeps_lines_and_solves_its_equation() {
        let at = [0.0, 0.1, 0.3, 0.35, 0.6, 1.0];
        let mut line = at.map(|u| 0.3 * u - 1.0);
        let kept = line;
        smooth(&mut line, &at, 100.0);
        assert!(line.iter().zip(&kept).all(|(a, b)| (a - b).abs() < 1e-12));
        let start = [0.0, 1.0, -0.5, 2.0, 0.3, 0.7];
        let (mut x, lambda) = (start, 3.0);
        smooth(&mut x, &at, lambda);
        for k in 0..x.len() {
            let mut sum = x[k];
            for m in 0..x.len() - 2 {
                let weights = second_difference(&at, m);
                let second: f64 = (0..3).map(|d| weights[d] * x[m + d]).sum();
                sum += lambda * second * weights.get(k.wrapping_sub(m)).unwrap_or(&0.0);
            }
            assert!((sum - start[k]).abs() < 1e-12);
        }
    }
}
