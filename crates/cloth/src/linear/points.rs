//! The two triangular solves for points: three right hand sides, side by side in one vector.

use super::simd::{BLOCK, Simd, Stored, WithSimd};
use super::tree::{Front, Panels, Tree};

/// The coordinates of a point and a zero.
pub(super) type Point = [f64; 4];

/// `L y = b` in place for the points of a tree.
pub(super) struct DownPoints<'a>(pub(super) &'a mut Tree);

impl WithSimd for DownPoints<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Tree {
            fronts,
            rows,
            panels,
            points,
            ..
        } = self.0;
        match panels {
            Panels::Double(panels) => down_all(simd, fronts, panels, rows, points),
            Panels::Single(panels) => down_all(simd, fronts, panels, rows, points),
        }
    }
}

#[inline(always)]
fn down_all<S: Simd, T: Stored>(
    simd: S,
    fronts: &[Front],
    panels: &[T],
    rows: &[u32],
    points: &mut [Point],
) {
    for front in fronts {
        let (panel, rows) = front.parts(panels, rows);
        let own = &mut points[front.column..][..front.columns];
        for (k, block) in panel.chunks(BLOCK * front.height()).enumerate() {
            match block.len() / front.height() {
                1 => forward::<S, T, 1>(simd, block, own, k * BLOCK),
                2 => forward::<S, T, 2>(simd, block, own, k * BLOCK),
                3 => forward::<S, T, 3>(simd, block, own, k * BLOCK),
                _ => forward::<S, T, BLOCK>(simd, block, own, k * BLOCK),
            }
        }
        take_below(simd, front, panel, rows, points);
    }
}

/// `L^T x = y` in place for the points of a tree.
pub(super) struct UpPoints<'a>(pub(super) &'a mut Tree);

impl WithSimd for UpPoints<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Tree {
            fronts,
            rows,
            panels,
            points,
            below,
            ..
        } = self.0;
        match panels {
            Panels::Double(panels) => up_all(simd, fronts, panels, rows, points, below),
            Panels::Single(panels) => up_all(simd, fronts, panels, rows, points, below),
        }
    }
}

#[inline(always)]
fn up_all<S: Simd, T: Stored>(
    simd: S,
    fronts: &[Front],
    panels: &[T],
    rows: &[u32],
    points: &mut [Point],
    below: &mut [Point],
) {
    for front in fronts.iter().rev() {
        let (panel, rows) = front.parts(panels, rows);
        let below = &mut below[..front.below];
        for (point, &row) in below.iter_mut().zip(rows) {
            *point = points[row as usize];
        }
        let own = &mut points[front.column..][..front.columns];
        for (k, block) in panel.chunks(BLOCK * front.height()).enumerate().rev() {
            match block.len() / front.height() {
                1 => backward::<S, T, 1>(simd, block, front.top(), own, below, k * BLOCK),
                2 => backward::<S, T, 2>(simd, block, front.top(), own, below, k * BLOCK),
                3 => backward::<S, T, 3>(simd, block, front.top(), own, below, k * BLOCK),
                _ => backward::<S, T, BLOCK>(simd, block, front.top(), own, below, k * BLOCK),
            }
        }
    }
}

/// The vectors of a point: the first `4 / S::F64_LANES` are used.
type Sum<S> = [<S as Simd>::f64s; 4];

/// `sum += factor * point`.
#[inline(always)]
fn add<S: Simd>(simd: S, sum: &mut Sum<S>, factor: f64, point: &Point) {
    let factor = simd.splat_f64s(factor);
    for (sum, &value) in sum.iter_mut().zip(S::as_simd_f64s(point).0) {
        *sum = simd.mul_add_f64s(factor, value, *sum);
    }
}

/// `point -= sum`.
#[inline(always)]
fn take<S: Simd>(simd: S, point: &mut Point, sum: &Sum<S>) {
    for (value, &sum) in S::as_mut_simd_f64s(point).0.iter_mut().zip(sum) {
        *value = simd.sub_f64s(*value, sum);
    }
}

/// `point = sum`.
#[inline(always)]
fn set<S: Simd>(point: &mut Point, sum: &Sum<S>) {
    for (value, &sum) in S::as_mut_simd_f64s(point).0.iter_mut().zip(sum) {
        *value = sum;
    }
}

/// The columns of a block, from one of their rows on.
#[inline(always)]
fn columns<T, const COLUMNS: usize>(block: &[T], from: usize, count: usize) -> [&[T]; COLUMNS] {
    let height = block.len() / COLUMNS;
    std::array::from_fn(|c| &block[c * height + from..][..count])
}

/// Solves for the columns of a block, from `first` on, and takes them from the front's later ones.
#[inline(always)]
fn forward<S: Simd, T: Stored, const COLUMNS: usize>(
    simd: S,
    block: &[T],
    own: &mut [Point],
    first: usize,
) {
    let (own, later) = own[first..].split_at_mut(COLUMNS);
    let triangle = columns::<T, COLUMNS>(block, first, COLUMNS);
    let zero = [simd.splat_f64s(0.0); 4];
    let given: [Point; COLUMNS] = std::array::from_fn(|c| own[c]);
    for k in 0..COLUMNS {
        let mut sum = zero;
        for c in 0..=k {
            add::<S>(simd, &mut sum, triangle[c][k].value(), &given[c]);
        }
        set::<S>(&mut own[k], &sum);
    }
    let columns = columns::<T, COLUMNS>(block, first + COLUMNS, later.len());
    for (row, point) in later.iter_mut().enumerate() {
        let mut sum = zero;
        for c in 0..COLUMNS {
            add::<S>(simd, &mut sum, columns[c][row].value(), &own[c]);
        }
        take::<S>(simd, point, &sum);
    }
}

/// Takes the columns of a front from the rows below.
#[inline(always)]
fn take_below<S: Simd, T: Stored>(
    simd: S,
    front: &Front,
    panel: &[T],
    rows: &[u32],
    points: &mut [Point],
) {
    let (top, height) = (front.top(), front.height());
    for (row, rows) in (top..).step_by(BLOCK).zip(rows.chunks(BLOCK)) {
        let mut sums = [[simd.splat_f64s(0.0); 4]; BLOCK];
        let own = &points[front.column..][..front.columns];
        for (column, point) in panel.chunks_exact(height).zip(own) {
            for (sum, &factor) in sums.iter_mut().zip(&column[row..row + BLOCK]) {
                add::<S>(simd, sum, factor.value(), point);
            }
        }
        for (sum, &row) in sums.iter().zip(rows) {
            take::<S>(simd, &mut points[row as usize], sum);
        }
    }
}

/// Solves for the columns of a block, from `first` on, with the front's later columns and the rows
/// below known.
#[inline(always)]
fn backward<S: Simd, T: Stored, const COLUMNS: usize>(
    simd: S,
    block: &[T],
    top: usize,
    own: &mut [Point],
    below: &[Point],
    first: usize,
) {
    let (own, later) = own[first..].split_at_mut(COLUMNS);
    let mut sums = [[simd.splat_f64s(0.0); 4]; COLUMNS];
    for (known, from) in [(&*later, first + COLUMNS), (below, top)] {
        let columns = columns::<T, COLUMNS>(block, from, known.len());
        for (k, point) in known.iter().enumerate() {
            for c in 0..COLUMNS {
                add::<S>(simd, &mut sums[c], columns[c][k].value(), point);
            }
        }
    }
    let triangle = columns::<T, COLUMNS>(block, first, COLUMNS);
    for (point, sum) in own.iter_mut().zip(&sums) {
        take::<S>(simd, point, sum);
    }
    let left: [Point; COLUMNS] = std::array::from_fn(|c| own[c]);
    for k in 0..COLUMNS {
        let mut sum = [simd.splat_f64s(0.0); 4];
        for row in k..COLUMNS {
            add::<S>(simd, &mut sum, triangle[k][row].value(), &left[row]);
        }
        set::<S>(&mut own[k], &sum);
    }
}
