//! The triangular solves for points: three right hand sides, side by side in one vector.

use selvedge_math::DVec3;

use super::simd::{BLOCK, Four, Simd, Stored};
use super::solve::Unknown;
use super::tree::{Tile, Unknowns};

/// The coordinates of a point and a zero.
pub(super) type Point = [f64; BLOCK];

impl Unknown for Point {
    const ZERO: Self = [0.0; BLOCK];
    type Given = DVec3;

    fn inside(DVec3 { x, y, z }: DVec3) -> Point {
        [x, y, z, 0.0]
    }

    fn outside(self) -> DVec3 {
        DVec3::from_slice(&self)
    }

    #[inline(always)]
    fn plus(self, other: Point) -> Point {
        std::array::from_fn(|axis| self[axis] + other[axis])
    }

    fn of<'a>(
        _: &'a mut Unknowns<f64>,
        points: &'a mut Unknowns<Point>,
    ) -> &'a mut Unknowns<Point> {
        points
    }

    #[inline(always)]
    fn forward<S: Simd, T: Stored, const COLUMNS: usize>(
        simd: S,
        triangle: &Tile<T, COLUMNS>,
        x: &mut [Point; BLOCK],
        tiles: &[Tile<T, COLUMNS>],
        others: &mut [[Point; BLOCK]],
    ) {
        let mut solved = [Four::zero(simd); COLUMNS];
        for row in 0..COLUMNS {
            for c in 0..=row {
                let factor = Four::splat(simd, triangle[c][row].value());
                solved[row] = solved[row].plus(simd, factor, Four::load(&x[c]));
            }
        }
        for c in 0..COLUMNS {
            solved[c].store(&mut x[c]);
        }
        for (tile, points) in tiles.iter().zip(others) {
            let tile = tile.map(|column| column.map(T::value));
            for row in 0..BLOCK {
                let mut left = Four::load(&points[row]);
                for c in 0..COLUMNS {
                    left = left.minus(simd, Four::splat(simd, tile[c][row]), solved[c]);
                }
                left.store(&mut points[row]);
            }
        }
    }

    #[inline(always)]
    fn backward<S: Simd, T: Stored, const COLUMNS: usize>(
        simd: S,
        triangle: &Tile<T, COLUMNS>,
        x: &mut [Point; BLOCK],
        tiles: &[Tile<T, COLUMNS>],
        others: &[[Point; BLOCK]],
    ) {
        let mut left: [Four<S>; COLUMNS] = std::array::from_fn(|c| Four::load(&x[c]));
        // The nearest ones are known last.
        for (tile, points) in tiles.iter().zip(others).rev() {
            let tile = tile.map(|column| column.map(T::value));
            for row in 0..BLOCK {
                let x = Four::load(&points[row]);
                for c in 0..COLUMNS {
                    left[c] = left[c].minus(simd, Four::splat(simd, tile[c][row]), x);
                }
            }
        }
        for c in 0..COLUMNS {
            let mut sum = Four::zero(simd);
            for row in c..COLUMNS {
                sum = sum.plus(simd, Four::splat(simd, triangle[c][row].value()), left[row]);
            }
            sum.store(&mut x[c]);
        }
    }
}
