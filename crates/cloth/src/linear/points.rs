//! The two triangular solves for points: three right hand sides, side by side in one vector.

use super::cholesky::{Cholesky, Front};
use super::simd::{BLOCK, Simd, WithSimd};

/// Numbers a point takes: its coordinates and a zero.
pub(super) const POINT: usize = 4;

/// Solves in place for the points.
pub(super) struct SolvePoints<'a>(pub(super) &'a mut Cholesky);

impl WithSimd for SolvePoints<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Cholesky {
            fronts,
            rows,
            panels,
            unknowns,
            local,
            ..
        } = self.0;
        // L y = b
        for front in &*fronts {
            let panel = &panels[front.panel..][..front.columns * front.height()];
            let rows = &rows[front.row..][..front.below];
            down(simd, front, panel, rows, unknowns);
        }
        // L^T x = y
        for front in fronts.iter().rev() {
            let panel = &panels[front.panel..][..front.columns * front.height()];
            let rows = &rows[front.row..][..front.below];
            let below = &mut local[..POINT * front.bottom()];
            for (point, &row) in below.chunks_exact_mut(POINT).zip(rows) {
                point.copy_from_slice(&unknowns[POINT * row as usize..][..POINT]);
            }
            below[POINT * rows.len()..].fill(0.0);
            let own = &mut unknowns[POINT * front.column..][..POINT * front.top()];
            for (k, block) in panel.chunks(BLOCK * front.height()).enumerate().rev() {
                match block.len() / front.height() {
                    1 => backward::<S, 1>(simd, block, front, own, below, k * BLOCK),
                    2 => backward::<S, 2>(simd, block, front, own, below, k * BLOCK),
                    3 => backward::<S, 3>(simd, block, front, own, below, k * BLOCK),
                    _ => backward::<S, BLOCK>(simd, block, front, own, below, k * BLOCK),
                }
            }
        }
    }
}

/// One vector of each of some points; of a point's vectors there are `POINT / S::F64_LANES`.
type Sums<S, const COUNT: usize> = [[<S as Simd>::f64s; POINT]; COUNT];

/// `sum += factor * point`, vector by vector.
#[inline(always)]
fn add<S: Simd>(simd: S, sum: &mut [S::f64s; POINT], factor: f64, point: &[S::f64s]) {
    let factor = simd.splat_f64s(factor);
    for (sum, &value) in sum.iter_mut().zip(point) {
        *sum = simd.mul_add_f64s(factor, value, *sum);
    }
}

#[inline(always)]
fn point<S: Simd>(x: &[f64], k: usize) -> &[S::f64s] {
    S::as_simd_f64s(&x[POINT * k..][..POINT]).0
}

/// `x_k -= sum`.
#[inline(always)]
fn subtract<S: Simd>(simd: S, x: &mut [f64], k: usize, sum: &[S::f64s; POINT]) {
    let values = S::as_mut_simd_f64s(&mut x[POINT * k..][..POINT]).0;
    for (value, &sum) in values.iter_mut().zip(sum) {
        *value = simd.sub_f64s(*value, sum);
    }
}

#[inline(always)]
fn scale(x: &mut [f64], k: usize, by: f64) {
    for value in &mut x[POINT * k..][..POINT] {
        *value *= by;
    }
}

/// Solves for a front's columns and takes them from the rows below.
#[inline(always)]
fn down<S: Simd>(simd: S, front: &Front, panel: &[f64], rows: &[u32], x: &mut [f64]) {
    let (top, height) = (front.top(), front.height());
    let zero = simd.splat_f64s(0.0);
    let own = POINT * front.column;
    for first in (0..front.columns).step_by(BLOCK) {
        let x = &mut x[own..][..POINT * top];
        let last = front.columns.min(first + BLOCK);
        for k in first..last {
            // What the columns of the block before this one take
            let mut sum = [zero; POINT];
            for c in first..k {
                add::<S>(simd, &mut sum, panel[c * height + k], point::<S>(x, c));
            }
            subtract::<S>(simd, x, k, &sum);
            scale(x, k, panel[k * height + k]);
        }
        for row in last..front.columns {
            let mut sum = [zero; POINT];
            for c in first..last {
                add::<S>(simd, &mut sum, panel[c * height + row], point::<S>(x, c));
            }
            subtract::<S>(simd, x, row, &sum);
        }
    }
    let mut sums: Sums<S, BLOCK>;
    for (row, rows) in (top..).step_by(BLOCK).zip(rows.chunks(BLOCK)) {
        sums = [[zero; POINT]; BLOCK];
        for (c, column) in panel.chunks_exact(height).enumerate() {
            let value = point::<S>(&x[own..], c);
            for (sum, &factor) in sums.iter_mut().zip(&column[row..row + BLOCK]) {
                add::<S>(simd, sum, factor, value);
            }
        }
        for (sum, &row) in sums.iter().zip(rows) {
            subtract::<S>(simd, x, row as usize, sum);
        }
    }
}

/// Solves for the columns of a block, from `first` on, with the front's later columns and the rows
/// below known.
#[inline(always)]
fn backward<S: Simd, const COLUMNS: usize>(
    simd: S,
    block: &[f64],
    front: &Front,
    own: &mut [f64],
    below: &[f64],
    first: usize,
) {
    let height = front.height();
    let zero = simd.splat_f64s(0.0);
    let mut sums: Sums<S, COLUMNS> = [[zero; POINT]; COLUMNS];
    for (known, from, start) in [(&*own, 0, first + COLUMNS), (below, front.top(), 0)] {
        let count = if from == 0 {
            front.columns
        } else {
            front.below
        };
        for k in start..count {
            let value = point::<S>(known, k);
            for (sum, column) in sums.iter_mut().zip(block.chunks_exact(height)) {
                add::<S>(simd, sum, column[from + k], value);
            }
        }
    }
    for k in (0..COLUMNS).rev() {
        let column = &block[k * height..][..height];
        for row in k + 1..COLUMNS {
            add::<S>(
                simd,
                &mut sums[k],
                column[first + row],
                point::<S>(own, first + row),
            );
        }
        subtract::<S>(simd, own, first + k, &sums[k]);
        scale(own, first + k, column[first + k]);
    }
}
