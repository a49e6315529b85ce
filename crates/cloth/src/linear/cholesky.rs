//! The factorisation as its user sees it, and what it keeps.

use selvedge_math::DVec3;

use super::factor::Factor;
use super::points::{Point, SolvePoints};
use super::simd::{BLOCK, dispatch};
use super::solve::Solve;
use crate::Error;

/// `S = L L^T` of a symmetric positive definite matrix with a fixed pattern.
///
/// The pattern is analysed once; then values are factored as often as they change, and each factor
/// is used for any number of right hand sides. Nothing allocates after the analysis, and the order
/// of every sum is fixed, so equal values give equal bits.
///
/// ```
/// use selvedge_cloth::linear::Cholesky;
///
/// // [ 4 2 ; 2 5 ] x = [ 2 ; 5 ]
/// let mut s = Cholesky::analyse(2, &[(0, 0), (0, 1), (1, 1)])?;
/// s.factor(&[4.0, 2.0, 5.0])?;
/// let mut x = [2.0, 5.0];
/// s.solve(&mut x);
/// assert_eq!(x, [0.0, 1.0]);
/// # Ok::<(), selvedge_cloth::Error>(())
/// ```
#[derive(Debug)]
pub struct Cholesky {
    /// Place of each row among the padded unknowns.
    pub(super) position: Vec<u32>,
    /// Children before parents.
    pub(super) fronts: Vec<Front>,
    /// Entries of the matrix by front: which of the values, and its place in the panel.
    pub(super) entries: Vec<[u32; 2]>,
    /// Rows below the columns of each front, by their places among the padded unknowns.
    pub(super) rows: Vec<u32>,
    /// The place of each of those rows in the parent: among its columns or, after those, below them.
    pub(super) places: Vec<u32>,
    /// The children of each front.
    pub(super) children: Vec<u32>,
    /// The panel of each front, column by column: its rows in the columns of the front, then those
    /// below, each part padded. Above the diagonal is nothing of use.
    pub(super) panels: Vec<f64>,
    /// Update matrices waiting for their parents, by parity of the depth.
    pub(super) waiting: [Vec<f64>; 2],
    /// How many unknowns there are, each front's padded with zeros like its columns.
    pub(super) padded: usize,
    /// The unknowns by front.
    pub(super) unknowns: Vec<f64>,
    /// The part below of one column.
    pub(super) local: Vec<f64>,
    /// The same two for points.
    pub(super) points: Vec<Point>,
    pub(super) below: Vec<Point>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Front {
    /// Its first column, by its place among the padded unknowns.
    pub(super) column: usize,
    pub(super) columns: usize,
    /// Where the rows below begin, and how many there are.
    pub(super) row: usize,
    pub(super) below: usize,
    /// Where the panel begins.
    pub(super) panel: usize,
    /// Where its update matrix lies on which of the two stacks.
    pub(super) update: usize,
    pub(super) stack: usize,
    /// Its range of `entries`.
    pub(super) first_entry: usize,
    pub(super) last_entry: usize,
    /// Its range of `children`.
    pub(super) first_child: usize,
    pub(super) last_child: usize,
    /// How many of the rows below are columns of the parent.
    pub(super) shared: usize,
}

impl Front {
    /// Padded number of columns: where the rows below begin in a column of the panel.
    pub(super) fn top(&self) -> usize {
        self.columns.next_multiple_of(BLOCK)
    }

    /// Padded number of rows below.
    pub(super) fn bottom(&self) -> usize {
        self.below.next_multiple_of(BLOCK)
    }

    pub(super) fn height(&self) -> usize {
        self.top() + self.bottom()
    }
}

impl Cholesky {
    /// Factors the matrix with these values, in the order of the pairs it was analysed with.
    ///
    /// # Errors
    /// [`Error::Factorisation`] when the matrix is not positive definite or not finite; the factor
    /// is then of no use until the next success.
    ///
    /// # Panics
    /// When there is not one value for each pair.
    pub fn factor(&mut self, values: &[f64]) -> Result<(), Error> {
        assert_eq!(values.len(), self.entries.len(), "one value a pair");
        if dispatch(Factor(self, values)) {
            Ok(())
        } else {
            Err(Error::Factorisation("it is not positive definite".into()))
        }
    }

    /// Solves `S x = rhs` in place.
    ///
    /// # Panics
    /// When `rhs` has not `n` entries.
    pub fn solve(&mut self, rhs: &mut [f64]) {
        let n = self.position.len();
        assert_eq!(rhs.len(), n, "one entry a row");
        // The padding too, where an earlier right hand side may have left what is not a number.
        self.unknowns.clear();
        self.unknowns.resize(self.padded, 0.0);
        for (&p, value) in self.position.iter().zip(&*rhs) {
            self.unknowns[p as usize] = *value;
        }
        dispatch(Solve(self));
        for (&p, value) in self.position.iter().zip(rhs) {
            *value = self.unknowns[p as usize];
        }
    }

    /// Solves for the three coordinates of points in place: in little more time than for one.
    ///
    /// # Panics
    /// When there is not one point a row.
    pub fn solve_points(&mut self, points: &mut [DVec3]) {
        assert_eq!(points.len(), self.position.len(), "one point a row");
        for (&p, point) in self.position.iter().zip(&*points) {
            self.points[p as usize] = [point.x, point.y, point.z, 0.0];
        }
        dispatch(SolvePoints(self));
        for (&p, point) in self.position.iter().zip(points) {
            *point = DVec3::from_slice(&self.points[p as usize]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The five-point matrix of a grid with a diagonal that makes it definite, and one without.
    fn grid_matrix(n: usize, diagonal: f64) -> Vec<((u32, u32), f64)> {
        let mut entries = Vec::new();
        for j in 0..n {
            for i in 0..n {
                let k = (j * n + i) as u32;
                entries.push(((k, k), diagonal + 0.01 * f64::from(k)));
                if i + 1 < n {
                    entries.push(((k + 1, k), -1.0 - 0.02 * f64::from(k % 7)));
                }
                if j + 1 < n {
                    entries.push(((k, k + n as u32), 0.9));
                }
            }
        }
        entries
    }

    fn analyse(n: usize, matrix: &[((u32, u32), f64)]) -> Cholesky {
        let pattern: Vec<(u32, u32)> = matrix.iter().map(|&(entry, _)| entry).collect();
        Cholesky::analyse(n, &pattern).unwrap()
    }

    fn values(matrix: &[((u32, u32), f64)]) -> Vec<f64> {
        matrix.iter().map(|&(_, value)| value).collect()
    }

    #[test]
    fn solves_to_rounding() {
        for n in [1, 2, 5, 17, 40] {
            let matrix = grid_matrix(n, 4.5);
            let mut cholesky = analyse(n * n, &matrix);
            cholesky.factor(&values(&matrix)).unwrap();
            let x: Vec<f64> = (0..n * n).map(|k| (k as f64 * 0.37).sin()).collect();
            let mut rhs = vec![0.0; n * n];
            for &((a, b), value) in &matrix {
                rhs[a as usize] += value * x[b as usize];
                if a != b {
                    rhs[b as usize] += value * x[a as usize];
                }
            }
            cholesky.solve(&mut rhs);
            let off = x
                .iter()
                .zip(&rhs)
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max);
            assert!(off < 1e-13, "{n} x {n}: {off:e}");
        }
    }

    #[test]
    fn points_are_three_right_hand_sides() {
        for n in [1, 2, 5, 17, 40] {
            let matrix = grid_matrix(n, 4.5);
            let mut cholesky = analyse(n * n, &matrix);
            cholesky.factor(&values(&matrix)).unwrap();
            let angle = |k: usize| k as f64 * 0.37;
            let mut points: Vec<DVec3> = (0..n * n)
                .map(|k| DVec3::new(angle(k).sin(), 2.0 * angle(k).cos(), 1.0))
                .collect();
            let mut alone =
                [0, 1, 2].map(|axis| points.iter().map(|p| p[axis]).collect::<Vec<_>>());
            cholesky.solve_points(&mut points);
            for (axis, rhs) in alone.iter_mut().enumerate() {
                cholesky.solve(rhs);
                for (point, value) in points.iter().zip(rhs) {
                    assert!((point[axis] - *value).abs() < 1e-14, "{n} x {n}");
                }
            }
        }
    }

    #[test]
    fn indefinite_or_nan_is_an_error_and_the_next_factorisation_works() {
        let n = 12;
        let good = grid_matrix(n, 4.5);
        let mut cholesky = analyse(n * n, &good);
        for bad in [-1.0, 0.0, f64::NAN, f64::INFINITY] {
            let mut matrix = good.clone();
            matrix[100].1 = if matrix[100].0.0 == matrix[100].0.1 {
                bad
            } else {
                f64::NAN
            };
            assert!(matches!(
                cholesky.factor(&values(&matrix)),
                Err(Error::Factorisation(_))
            ));
        }
        cholesky.factor(&values(&good)).unwrap();
        let mut expected = vec![1.0; n * n];
        cholesky.solve(&mut expected);
        let mut lost = vec![f64::NAN; n * n];
        cholesky.solve(&mut lost);
        let mut x = vec![1.0; n * n];
        cholesky.solve(&mut x);
        assert_eq!(x, expected);
    }
}
