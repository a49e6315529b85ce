//! The triangular solves for one right hand side.

use super::points::Point;
use super::simd::{BLOCK, Four, Simd, Stored};
use super::solve::Unknown;
use super::tree::{Tile, Unknowns};

impl Unknown for f64 {
    const ZERO: Self = 0.0;
    type Given = f64;

    fn inside(given: f64) -> f64 {
        given
    }

    fn outside(self) -> f64 {
        self
    }

    #[inline(always)]
    fn plus(self, other: f64) -> f64 {
        self + other
    }

    fn of<'a>(numbers: &'a mut Unknowns<f64>, _: &'a mut Unknowns<Point>) -> &'a mut Unknowns<f64> {
        numbers
    }

    #[inline(always)]
    fn forward<S: Simd, T: Stored, const COLUMNS: usize>(
        simd: S,
        triangle: &Tile<T, COLUMNS>,
        x: &mut [f64; BLOCK],
        tiles: &[Tile<T, COLUMNS>],
        others: &mut [[f64; BLOCK]],
    ) {
        let mut solved = Four::zero(simd);
        for c in 0..COLUMNS {
            solved = solved.plus(simd, T::four(&triangle[c]), Four::splat(simd, x[c]));
        }
        solved.store(x);
        let factors: [Four<S>; COLUMNS] = std::array::from_fn(|c| Four::splat(simd, x[c]));
        for (tile, x) in tiles.iter().zip(others) {
            let mut left = Four::load(x);
            for c in 0..COLUMNS {
                left = left.minus(simd, T::four(&tile[c]), factors[c]);
            }
            left.store(x);
        }
    }

    #[inline(always)]
    fn backward<S: Simd, T: Stored, const COLUMNS: usize>(
        simd: S,
        triangle: &Tile<T, COLUMNS>,
        x: &mut [f64; BLOCK],
        tiles: &[Tile<T, COLUMNS>],
        others: &[[f64; BLOCK]],
    ) {
        let mut sums = [Four::zero(simd); COLUMNS];
        // The nearest ones are known last.
        for (tile, x) in tiles.iter().zip(others).rev() {
            let x = Four::load(x);
            for c in 0..COLUMNS {
                sums[c] = sums[c].plus(simd, T::four(&tile[c]), x);
            }
        }
        for c in 0..COLUMNS {
            x[c] -= sums[c].sum(simd);
        }
        let left = Four::load(x);
        for c in 0..COLUMNS {
            x[c] = Four::zero(simd)
                .plus(simd, T::four(&triangle[c]), left)
                .sum(simd);
        }
    }
}
