//! The two triangular solves, front by front.

use super::simd::{BLOCK, Simd, Stored, WithSimd, vectors_mut};
use super::tree::{Front, Panels, Tree};

/// `L y = b` in place for the unknowns of a tree.
pub(super) struct Down<'a>(pub(super) &'a mut Tree);

impl WithSimd for Down<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Tree {
            fronts,
            rows,
            panels,
            unknowns,
            local,
            ..
        } = self.0;
        match panels {
            Panels::Double(panels) => down_all(simd, fronts, panels, rows, unknowns, local),
            Panels::Single(panels) => down_all(simd, fronts, panels, rows, unknowns, local),
        }
    }
}

/// `L^T x = y` in place for the unknowns of a tree.
pub(super) struct Up<'a>(pub(super) &'a mut Tree);

impl WithSimd for Up<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Tree {
            fronts,
            rows,
            panels,
            unknowns,
            local,
            ..
        } = self.0;
        match panels {
            Panels::Double(panels) => up_all(simd, fronts, panels, rows, unknowns, local),
            Panels::Single(panels) => up_all(simd, fronts, panels, rows, unknowns, local),
        }
    }
}

#[inline(always)]
fn down_all<S: Simd, T: Stored>(
    simd: S,
    fronts: &[Front],
    panels: &[T],
    rows: &[u32],
    x: &mut [f64],
    local: &mut [f64],
) {
    for front in fronts {
        let (panel, rows) = front.parts(panels, rows);
        down(simd, front, panel, rows, x, local);
    }
}

#[inline(always)]
fn up_all<S: Simd, T: Stored>(
    simd: S,
    fronts: &[Front],
    panels: &[T],
    rows: &[u32],
    x: &mut [f64],
    local: &mut [f64],
) {
    for front in fronts.iter().rev() {
        let (panel, rows) = front.parts(panels, rows);
        up(simd, front, panel, rows, x, local);
    }
}

/// Solves for a front's columns and takes them from the rows below.
#[inline(always)]
fn down<S: Simd, T: Stored>(
    simd: S,
    front: &Front,
    panel: &[T],
    rows: &[u32],
    x: &mut [f64],
    local: &mut [f64],
) {
    let (top, height) = (front.top(), front.height());
    let own = &mut x[front.column..][..top];
    for (k, block) in panel.chunks(BLOCK * height).enumerate() {
        match block.len() / height {
            1 => forward::<S, T, 1>(simd, block, height, own, k * BLOCK),
            2 => forward::<S, T, 2>(simd, block, height, own, k * BLOCK),
            3 => forward::<S, T, 3>(simd, block, height, own, k * BLOCK),
            _ => forward::<S, T, BLOCK>(simd, block, height, own, k * BLOCK),
        }
    }
    let mut row = top;
    while row + 4 * S::F64_LANES <= height {
        combine::<S, T, 4>(simd, panel, height, row, own, &mut local[row - top..]);
        row += 4 * S::F64_LANES;
    }
    while row < height {
        combine::<S, T, 1>(simd, panel, height, row, own, &mut local[row - top..]);
        row += S::F64_LANES;
    }
    for (&value, &row) in local.iter().zip(rows) {
        x[row as usize] -= value;
    }
}

/// Solves for a front's columns with the rows below known.
#[inline(always)]
fn up<S: Simd, T: Stored>(
    simd: S,
    front: &Front,
    panel: &[T],
    rows: &[u32],
    x: &mut [f64],
    local: &mut [f64],
) {
    let (top, height) = (front.top(), front.height());
    let below = &mut local[..front.bottom()];
    if let Some(padded) = below.last_chunk_mut::<BLOCK>() {
        *padded = [0.0; BLOCK];
    }
    for (value, &row) in below.iter_mut().zip(rows) {
        *value = x[row as usize];
    }
    let own = &mut x[front.column..][..top];
    for (k, block) in panel.chunks(BLOCK * height).enumerate().rev() {
        match block.len() / height {
            1 => backward::<S, T, 1>(simd, block, height, own, below, k * BLOCK),
            2 => backward::<S, T, 2>(simd, block, height, own, below, k * BLOCK),
            3 => backward::<S, T, 3>(simd, block, height, own, below, k * BLOCK),
            _ => backward::<S, T, BLOCK>(simd, block, height, own, below, k * BLOCK),
        }
    }
}

/// Solves for the columns of a block, from `first` on, and takes them from the front's later
/// columns.
#[inline(always)]
fn forward<S: Simd, T: Stored, const COLUMNS: usize>(
    simd: S,
    block: &[T],
    height: usize,
    own: &mut [f64],
    first: usize,
) {
    let (own, later) = own[first..].split_at_mut(BLOCK);
    let mut solved = [0.0; COLUMNS];
    for (k, column) in block.chunks_exact(height).enumerate() {
        for row in k..COLUMNS {
            solved[row] += column[first + row].value() * own[k];
        }
    }
    own[..COLUMNS].copy_from_slice(&solved);
    let factors = solved.map(|value| simd.splat_f64s(value));
    for (v, value) in S::as_mut_simd_f64s(later).0.iter_mut().enumerate() {
        let row = first + BLOCK + v * S::F64_LANES;
        for (column, factor) in block.chunks_exact(height).zip(factors) {
            let entries = T::vector::<S>(&column[row..]);
            *value = simd.negate_mul_add_f64s(entries, factor, *value);
        }
    }
}

/// `target` becomes the sum of the panel's columns, some vectors from `row` on, times `factors`.
#[inline(always)]
fn combine<S: Simd, T: Stored, const VECTORS: usize>(
    simd: S,
    panel: &[T],
    height: usize,
    row: usize,
    factors: &[f64],
    target: &mut [f64],
) {
    let mut sums = [simd.splat_f64s(0.0); VECTORS];
    for (column, &factor) in panel.chunks_exact(height).zip(factors) {
        let factor = simd.splat_f64s(factor);
        for (entries, sum) in column[row..].chunks_exact(S::F64_LANES).zip(&mut sums) {
            let entries = T::vector::<S>(entries);
            *sum = simd.mul_add_f64s(entries, factor, *sum);
        }
    }
    vectors_mut::<S, VECTORS>(target, 0).copy_from_slice(&sums);
}

/// Solves for the columns of a block, from `first` on, with the front's later columns and the rows
/// below known.
#[inline(always)]
fn backward<S: Simd, T: Stored, const COLUMNS: usize>(
    simd: S,
    block: &[T],
    height: usize,
    own: &mut [f64],
    below: &[f64],
    first: usize,
) {
    let top = own.len();
    let (own, later) = own[first..].split_at_mut(BLOCK);
    let mut sums = [simd.splat_f64s(0.0); COLUMNS];
    for (known, from) in [(&*later, first + BLOCK), (below, top)] {
        for (v, &value) in S::as_simd_f64s(known).0.iter().enumerate() {
            let row = from + v * S::F64_LANES;
            for (sum, column) in sums.iter_mut().zip(block.chunks_exact(height)) {
                let entries = T::vector::<S>(&column[row..]);
                *sum = simd.mul_add_f64s(entries, value, *sum);
            }
        }
    }
    let mut left = [0.0; COLUMNS];
    for (k, sum) in sums.into_iter().enumerate() {
        left[k] = own[k] - simd.reduce_sum_f64s(sum);
    }
    for (k, column) in block.chunks_exact(height).enumerate() {
        own[k] = 0.0;
        for row in k..COLUMNS {
            own[k] += column[first + row].value() * left[row];
        }
    }
}
