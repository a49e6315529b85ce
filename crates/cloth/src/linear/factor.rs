//! The numeric factorisation, front by front.

use std::ops::Range;

use super::simd::{BLOCK, Simd, WithSimd, vectors, vectors_mut};
use super::tree::{Front, Tree};

/// Factors a tree with these values, in the order of the pairs that were analysed, after the branches that
/// hang on it.
pub(super) struct Factor<'a>(
    pub(super) &'a mut Tree,
    pub(super) &'a [f64],
    pub(super) &'a [Tree],
);

impl WithSimd for Factor<'_> {
    /// Whether all pivots are positive and finite.
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Self(
            Tree {
                fronts,
                entries,
                children,
                grafts,
                places,
                panels,
                work,
                waiting,
                ..
            },
            values,
            branches,
        ) = self;
        let [even, odd] = waiting;
        for front in &*fronts {
            let (own, childrens) = if front.stack == 0 {
                (&mut *even, &*odd)
            } else {
                (&mut *odd, &*even)
            };
            let (stride, update_stride) = (front.panel_stride(), front.update_stride());
            let own_children = &children[front.first_child..front.last_child];
            let own_children = own_children.iter().map(|&k| &fronts[k as usize]);

            let panel = &mut work[..front.columns * stride];
            panel.fill(0.0);
            for &[value, place] in &entries[front.first_entry..front.last_entry] {
                panel[place as usize] = values[value as usize];
            }
            for child in own_children.clone() {
                add(panel, stride, 0, child, 0..child.shared, childrens, places);
            }
            let grafts = &grafts[front.first_graft..front.last_graft];
            let grafts = grafts.iter().map(|&k| &branches[k as usize]);
            let grafts = grafts.filter_map(|tree| Some((tree, tree.fronts.last()?)));
            for (tree, root) in grafts.clone() {
                let updates = &tree.waiting[root.stack];
                add(
                    panel,
                    stride,
                    0,
                    root,
                    0..root.shared,
                    updates,
                    &tree.places,
                );
            }
            if !factor_panel(simd, panel, front.columns, stride) {
                return false;
            }
            panels.keep(front, panel);
            let update = &mut own[front.update..][..front.update_entries()];
            if front.below > 0 {
                negative_squares(simd, update, update_stride, panel, stride);
                let top = front.top();
                for child in own_children {
                    let rest = child.shared..child.below;
                    add(update, update_stride, top, child, rest, childrens, places);
                }
                for (tree, root) in grafts {
                    let rest = root.shared..root.below;
                    let updates = &tree.waiting[root.stack];
                    add(
                        update,
                        update_stride,
                        top,
                        root,
                        rest,
                        updates,
                        &tree.places,
                    );
                }
            }
        }
        true
    }
}

/// Adds some columns of a child's update matrix to a matrix whose columns are `target_stride` apart, and whose first row
/// is the front's row `first`.
#[inline(always)]
fn add(
    target: &mut [f64],
    target_stride: usize,
    first: usize,
    child: &Front,
    columns: Range<usize>,
    childrens: &[f64],
    places: &[u32],
) {
    let places = &places[child.row..][..child.below];
    let values = &childrens[child.update..];
    let stride = child.update_stride();
    for k in columns {
        let rows = &places[k..];
        let column = &mut target[(rows[0] as usize - first) * target_stride..];
        for (&row, value) in rows.iter().zip(&values[k * stride + k..]) {
            column[row as usize - first] += value;
        }
    }
}

/// Cholesky factorisation of the first rows of a panel and the matching solve of the rest; false
/// when a pivot is not a positive finite number. Triangles on the diagonal, of a block each, are inverted.
#[inline(always)]
fn factor_panel<S: Simd>(simd: S, panel: &mut [f64], columns: usize, stride: usize) -> bool {
    for first in (0..columns).step_by(BLOCK) {
        let good = match columns - first {
            1 => factor_block::<S, 1>(simd, panel, stride, first),
            2 => factor_block::<S, 2>(simd, panel, stride, first),
            3 => factor_block::<S, 3>(simd, panel, stride, first),
            _ => factor_block::<S, BLOCK>(simd, panel, stride, first),
        };
        if !good {
            return false;
        }
    }
    true
}

/// Eliminates the columns from `first` on, after those before them.
#[inline(always)]
fn factor_block<S: Simd, const COLUMNS: usize>(
    simd: S,
    panel: &mut [f64],
    stride: usize,
    first: usize,
) -> bool {
    let (done, rest) = panel.split_at_mut(first * stride);
    let block = &mut rest[..COLUMNS * stride];

    // The triangle on the diagonal
    for row in (first..first + BLOCK).step_by(S::F64_LANES) {
        let products = products::<S, COLUMNS, 1>(simd, done, stride, row, first);
        for (column, product) in block.chunks_exact_mut(stride).zip(products) {
            let mut taken = [0.0; 2 * BLOCK];
            vectors_mut::<S, 1>(&mut taken, 0).copy_from_slice(&product);
            for (value, taken) in column[row..first + BLOCK].iter_mut().zip(taken) {
                *value -= taken;
            }
        }
    }
    let mut triangle = [[0.0; COLUMNS]; COLUMNS];
    for (own, column) in triangle.iter_mut().zip(block.chunks_exact(stride)) {
        own.copy_from_slice(&column[first..first + COLUMNS]);
    }
    if !factor_triangle(&mut triangle) {
        return false;
    }

    // The rows below it
    let mut factors = [[simd.splat_f64s(0.0); COLUMNS]; COLUMNS];
    for (factors, values) in factors.iter_mut().zip(&triangle) {
        for (factor, &value) in factors.iter_mut().zip(values) {
            *factor = simd.splat_f64s(value);
        }
    }
    let mut row = first + BLOCK;
    while row + 2 * S::F64_LANES <= stride - BLOCK {
        eliminate::<S, COLUMNS, 2>(simd, done, block, stride, row, first, &factors);
        row += 2 * S::F64_LANES;
    }
    while row < stride - BLOCK {
        eliminate::<S, COLUMNS, 1>(simd, done, block, stride, row, first, &factors);
        row += S::F64_LANES;
    }

    // Of the triangle, solves use the inverse: a product waits for less than a substitution
    invert_triangle(&mut triangle);
    for (k, (own, column)) in triangle
        .iter()
        .zip(block.chunks_exact_mut(stride))
        .enumerate()
    {
        column[first..first + k].fill(0.0);
        column[first + k..first + COLUMNS].copy_from_slice(&own[k..]);
    }
    true
}

/// The inverse of a small lower triangle with inverses on its diagonal, column by column.
#[inline(always)]
fn invert_triangle<const N: usize>(columns: &mut [[f64; N]; N]) {
    for row in 0..N {
        for column in 0..row {
            // The rows above are inverted already.
            let (own, above) = (columns.iter().skip(column), &columns[column][column..row]);
            let sum: f64 = own.zip(above).map(|(own, above)| own[row] * above).sum();
            columns[column][row] = -sum * columns[row][row];
        }
    }
}

/// Cholesky factorisation of a small matrix, column by column, with inverses on the diagonal; false
/// when a pivot is not a positive finite number.
#[inline(always)]
fn factor_triangle<const N: usize>(columns: &mut [[f64; N]; N]) -> bool {
    for k in 0..N {
        let pivot = columns[k][k];
        if !(pivot > 0.0 && pivot.is_finite()) {
            return false;
        }
        // The next pivot waits for this division, but for no root.
        let inverse = 1.0 / pivot;
        for column in k + 1..N {
            for row in column..N {
                columns[column][row] -= columns[k][row] * columns[k][column] * inverse;
            }
        }
        let scale = inverse.sqrt();
        columns[k][k] = scale;
        for value in &mut columns[k][k + 1..] {
            *value *= scale;
        }
    }
    true
}

/// Some rows of a block: what the columns before it take, and the solve with its triangle.
#[inline(always)]
fn eliminate<S: Simd, const COLUMNS: usize, const VECTORS: usize>(
    simd: S,
    done: &[f64],
    block: &mut [f64],
    stride: usize,
    row: usize,
    first: usize,
    triangle: &[[S::f64s; COLUMNS]; COLUMNS],
) {
    let mut x = products::<S, COLUMNS, VECTORS>(simd, done, stride, row, first);
    for (k, column) in block.chunks_exact_mut(stride).enumerate() {
        let values = vectors_mut::<S, VECTORS>(column, row);
        for (v, value) in values.iter_mut().enumerate() {
            let mut sum = simd.sub_f64s(*value, x[k][v]);
            for t in 0..k {
                sum = simd.negate_mul_add_f64s(triangle[t][k], x[t][v], sum);
            }
            x[k][v] = simd.mul_f64s(sum, triangle[k][k]);
            *value = x[k][v];
        }
    }
}

/// `update = -B B^T`, lower triangle in blocks, `B` the last rows of the panel.
#[inline(always)]
fn negative_squares<S: Simd>(
    simd: S,
    update: &mut [f64],
    update_stride: usize,
    panel: &[f64],
    stride: usize,
) {
    let (top, bottom) = (stride - update_stride, update_stride - BLOCK);
    for (block, target) in update.chunks_exact_mut(BLOCK * update_stride).enumerate() {
        let first = block * BLOCK;
        let mut row = first;
        while row + 2 * S::F64_LANES <= bottom {
            let sums = products::<S, BLOCK, 2>(simd, panel, stride, top + row, top + first);
            for (column, sums) in target.chunks_exact_mut(update_stride).zip(sums) {
                for (value, sum) in vectors_mut::<S, 2>(column, row).iter_mut().zip(sums) {
                    *value = simd.neg_f64s(sum);
                }
            }
            row += 2 * S::F64_LANES;
        }
        while row < bottom {
            let sums = products::<S, BLOCK, 1>(simd, panel, stride, top + row, top + first);
            for (column, sums) in target.chunks_exact_mut(update_stride).zip(sums) {
                for (value, sum) in vectors_mut::<S, 1>(column, row).iter_mut().zip(sums) {
                    *value = simd.neg_f64s(sum);
                }
            }
            row += S::F64_LANES;
        }
    }
}

/// Sums over the panel's columns: the vectors from `row` on times each of the entries from
/// `factor` on.
#[inline(always)]
fn products<S: Simd, const COLUMNS: usize, const VECTORS: usize>(
    simd: S,
    panel: &[f64],
    stride: usize,
    row: usize,
    factor: usize,
) -> [[S::f64s; VECTORS]; COLUMNS] {
    let mut sums = [[simd.splat_f64s(0.0); VECTORS]; COLUMNS];
    for column in panel.chunks_exact(stride) {
        let values = vectors::<S, VECTORS>(column, row);
        for (sums, &factor) in sums.iter_mut().zip(&column[factor..factor + COLUMNS]) {
            let factor = simd.splat_f64s(factor);
            for (sum, &value) in sums.iter_mut().zip(values) {
                *sum = simd.mul_add_f64s(factor, value, *sum);
            }
        }
    }
    sums
}
