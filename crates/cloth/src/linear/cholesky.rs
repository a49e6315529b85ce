//! The factorisation as its user sees it.

use selvedge_math::DVec3;

use super::factor::Factor;
use super::points::Point;
use super::simd::dispatch_wide;
use super::solve::{Unknown, down, up};
use super::threads::Threads;
use super::tree::{Panels, Tree};
use crate::Error;

/// A factor of more entries is large: it is solved with all threads.
const MANY: usize = 500_000;

/// `S = L L^T` of a symmetric positive definite matrix with a fixed pattern.
///
/// The pattern is analysed once; then values are factored as often as they change, and each factor
/// is used for any number of right hand sides. On one thread nothing allocates after the analysis. The
/// order of every sum is fixed, so equal values give equal bits, on any number of threads.
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
    /// Parts of the tree of eliminations that do not meet; a small matrix has none.
    pub(super) branches: Vec<Tree>,
    /// What they hang on: it is eliminated after all of them.
    pub(super) trunk: Tree,
    pub(super) threads: Threads,
}

impl Cholesky {
    /// Keeps the entries of a large factor in single precision, which takes half the time to read. They
    /// are summed in double precision, so that a solution is off by some 1e-7 of the matrix' condition:
    /// for one that is a correction.
    pub fn single_if_large(mut self) -> Self {
        if self.is_large() {
            for tree in self.branches.iter_mut().chain([&mut self.trunk]) {
                tree.panels = Panels::Single(vec![0.0; tree.panels.len()]);
            }
        }
        self
    }

    /// From now on uses these threads; the results are the same.
    pub fn set_threads(&mut self, threads: &Threads) {
        self.threads = threads.clone();
    }

    /// Factors the matrix with these values, in the order of the pairs it was analysed with.
    ///
    /// # Errors
    /// [`Error::Factorisation`] when the matrix is not positive definite or not finite; the factor
    /// is then of no use until the next success.
    ///
    /// # Panics
    /// When there is not one value for each pair.
    pub fn factor(&mut self, values: &[f64]) -> Result<(), Error> {
        let trees = self.branches.iter().chain([&self.trunk]);
        let count: usize = trees.map(|tree| tree.entries.len()).sum();
        assert_eq!(values.len(), count, "one value a pair");
        self.threads.each(&mut self.branches, |tree| {
            tree.definite = dispatch_wide(Factor(tree, values, &[]));
        });
        let good = self.branches.iter().all(|tree| tree.definite);
        if good && dispatch_wide(Factor(&mut self.trunk, values, &self.branches)) {
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
        assert_eq!(rhs.len(), self.row_count(), "one entry a row");
        self.solve_for::<f64>(rhs);
    }

    /// Solves for the three coordinates of points in place: in little more time than for one.
    ///
    /// # Panics
    /// When there is not one point a row.
    pub fn solve_points(&mut self, points: &mut [DVec3]) {
        assert_eq!(points.len(), self.row_count(), "one point a row");
        self.solve_for::<Point>(points);
    }

    fn solve_for<U: Unknown>(&mut self, rhs: &mut [U::Given]) {
        let threads = self.threads_to_solve();
        let (branches, trunk) = (&mut self.branches, &mut self.trunk);
        threads.each(branches, |tree| {
            tree.gather::<U>(rhs);
            down::<U>(tree);
        });
        trunk.gather::<U>(rhs);
        let above = U::of(&mut trunk.numbers, &mut trunk.points);
        for tree in &mut *branches {
            let taken = U::of(&mut tree.numbers, &mut tree.points);
            for (x, &taken) in above.all.iter_mut().zip(&taken.all[tree.own..]) {
                *x = x.plus(taken);
            }
        }
        down::<U>(trunk);
        up::<U>(trunk);
        let above = &*U::of(&mut trunk.numbers, &mut trunk.points);
        threads.each(branches, |tree| {
            let unknowns = U::of(&mut tree.numbers, &mut tree.points);
            unknowns.all[tree.own..].copy_from_slice(&above.all);
            up::<U>(tree);
        });
        for tree in branches.iter_mut().chain([trunk]) {
            tree.scatter::<U>(rhs);
        }
    }

    /// The threads, if solving takes long enough to wake them.
    fn threads_to_solve(&self) -> Threads {
        match self.is_large() {
            true => self.threads.clone(),
            false => Threads::default(),
        }
    }

    fn is_large(&self) -> bool {
        let trees = self.branches.iter().chain([&self.trunk]);
        trees.map(|tree| tree.panels.len()).sum::<usize>() > MANY
    }

    fn row_count(&self) -> usize {
        let trees = self.branches.iter().chain([&self.trunk]);
        trees.map(|tree| tree.members.len()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::super::simd::dispatch;
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
        for n in [1, 2, 5, 17, 40, 120] {
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

    /// A grid in space whose factor is made on so many threads.
    fn in_space(n: usize, threads: usize, matrix: &[((u32, u32), f64)]) -> Cholesky {
        let pattern: Vec<(u32, u32)> = matrix.iter().map(|&(entry, _)| entry).collect();
        let place = |k| DVec3::new((k % n) as f64, (k / n) as f64, 0.0);
        let places: Vec<DVec3> = (0..n * n).map(place).collect();
        let mut cholesky = Cholesky::analyse_in_space(&pattern, &places).unwrap();
        assert!(cholesky.branches.len() > 2);
        cholesky.set_threads(&Threads::new(threads).unwrap());
        cholesky
    }

    /// Where there are vectors of eight numbers, factors are made with them, and are those of vectors of four.
    #[test]
    fn wide_vectors_give_the_same_bits() {
        for n in [1, 2, 3, 5, 17, 40] {
            let matrix = grid_matrix(n, 4.5);
            let values = values(&matrix);
            let mut wide = analyse(n * n, &matrix);
            let mut narrow = analyse(n * n, &matrix);
            wide.factor(&values).unwrap();
            assert!(
                narrow.branches.is_empty() && dispatch(Factor(&mut narrow.trunk, &values, &[]))
            );
            let bits = |cholesky: &Cholesky| match &cholesky.trunk.panels {
                Panels::Double(panels) => panels.iter().map(|x| x.to_bits()).collect::<Vec<_>>(),
                Panels::Single(_) => panic!("large"),
            };
            assert_eq!(bits(&wide), bits(&narrow), "{n} x {n}");
        }
    }

    fn solve(cholesky: &mut Cholesky, n: usize) -> (Vec<f64>, Vec<DVec3>) {
        let mut rhs: Vec<f64> = (0..n * n).map(|k| (k as f64).sin()).collect();
        let mut points: Vec<DVec3> = rhs.iter().map(|x| DVec3::new(*x, 2.0 * x, 1.0)).collect();
        cholesky.solve(&mut rhs);
        cholesky.solve_points(&mut points);
        (rhs, points)
    }

    #[test]
    fn threads_give_the_same_bits() {
        let n = 90;
        let matrix = grid_matrix(n, 4.5);
        let [alone, two, five] = [1, 2, 5].map(|threads| {
            let mut cholesky = in_space(n, threads, &matrix);
            cholesky.factor(&values(&matrix)).unwrap();
            solve(&mut cholesky, n)
        });
        assert!(alone == two && alone == five);
    }

    #[test]
    fn a_large_factor_in_single_precision_solves_to_it() {
        let n = 160;
        let matrix = grid_matrix(n, 4.5);
        let mut double = in_space(n, 1, &matrix);
        double.factor(&values(&matrix)).unwrap();
        let (exact, exact_points) = solve(&mut double, n);
        let [alone, two] = [1, 2].map(|threads| {
            let mut single = in_space(n, threads, &matrix).single_if_large();
            single.factor(&values(&matrix)).unwrap();
            solve(&mut single, n)
        });
        assert!(alone == two);
        let off = |a: f64, b: f64| (a - b).abs();
        let worst = exact.iter().zip(&alone.0).map(|(a, b)| off(*a, *b));
        let worst = worst.fold(0.0, f64::max);
        let of_points = exact_points.iter().zip(&alone.1);
        let of_points = of_points.map(|(a, b)| a.distance(*b)).fold(0.0, f64::max);
        assert!(1e-9 < worst && worst < 1e-6, "{worst:e}");
        assert!(1e-9 < of_points && of_points < 1e-6, "{of_points:e}");
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
