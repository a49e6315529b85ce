//! The two triangular solves, front by front and block by block, in the order in which the factor lies in
//! memory or in its reverse.

use std::ops::Range;

use super::points::Point;
use super::simd::{BLOCK, Simd, Stored, WithSimd, dispatch};
use super::tree::{Front, Panels, Tile, Tree, Unknowns};

/// What is solved for: numbers, or points, whose coordinates are three right hand sides side by side.
pub(super) trait Unknown: Copy + Send + Sync {
    const ZERO: Self;
    /// The same outside of this module.
    type Given: Copy + Send + Sync;

    fn inside(given: Self::Given) -> Self;
    fn outside(self) -> Self::Given;
    fn plus(self, other: Self) -> Self;

    /// Those of this kind.
    fn of<'a>(
        numbers: &'a mut Unknowns<f64>,
        points: &'a mut Unknowns<Point>,
    ) -> &'a mut Unknowns<Self>;

    /// Solves for the columns of a block and takes them from other unknowns.
    fn forward<S: Simd, T: Stored, const COLUMNS: usize>(
        simd: S,
        triangle: &Tile<T, COLUMNS>,
        x: &mut [Self; BLOCK],
        tiles: &[Tile<T, COLUMNS>],
        others: &mut [[Self; BLOCK]],
    );

    /// Solves for the columns of a block with the others known.
    fn backward<S: Simd, T: Stored, const COLUMNS: usize>(
        simd: S,
        triangle: &Tile<T, COLUMNS>,
        x: &mut [Self; BLOCK],
        tiles: &[Tile<T, COLUMNS>],
        others: &[[Self; BLOCK]],
    );
}

/// `L y = b` in place for the unknowns of a tree.
pub(super) fn down<U: Unknown>(tree: &mut Tree) {
    let (fronts, rows) = (&*tree.fronts, &*tree.rows);
    let unknowns = U::of(&mut tree.numbers, &mut tree.points);
    match &tree.panels {
        Panels::Double(panels) => dispatch(Down(fronts, rows, panels, unknowns)),
        Panels::Single(panels) => dispatch(Down(fronts, rows, panels, unknowns)),
    }
}

/// `L^T x = y` in place for the unknowns of a tree.
pub(super) fn up<U: Unknown>(tree: &mut Tree) {
    let (fronts, rows) = (&*tree.fronts, &*tree.rows);
    let unknowns = U::of(&mut tree.numbers, &mut tree.points);
    match &tree.panels {
        Panels::Double(panels) => dispatch(Up(fronts, rows, panels, unknowns)),
        Panels::Single(panels) => dispatch(Up(fronts, rows, panels, unknowns)),
    }
}

struct Down<'a, T, U>(&'a [Front], &'a [u32], &'a [T], &'a mut Unknowns<U>);

impl<T: Stored, U: Unknown> WithSimd for Down<'_, T, U> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self(fronts, rows, panels, unknowns) = self;
        let (all, local) = (&mut *unknowns.all, &mut *unknowns.local);
        for front in fronts {
            let (own, rows) = (front.column..front.column + front.top(), front.rows(rows));
            let local = gather(all, own.clone(), rows, local);
            for k in 0..front.blocks() {
                let (columns, block) = front.block(panels, k);
                match columns {
                    1 => forward::<S, T, U, 1>(simd, block, &mut local[k..]),
                    2 => forward::<S, T, U, 2>(simd, block, &mut local[k..]),
                    3 => forward::<S, T, U, 3>(simd, block, &mut local[k..]),
                    _ => forward::<S, T, U, BLOCK>(simd, block, &mut local[k..]),
                }
            }
            let (own_solved, below) = local.as_flattened().split_at(own.len());
            all[own].copy_from_slice(own_solved);
            for (&x, &row) in below.iter().zip(rows) {
                all[row as usize] = x;
            }
        }
    }
}

struct Up<'a, T, U>(&'a [Front], &'a [u32], &'a [T], &'a mut Unknowns<U>);

impl<T: Stored, U: Unknown> WithSimd for Up<'_, T, U> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self(fronts, rows, panels, unknowns) = self;
        let (all, local) = (&mut *unknowns.all, &mut *unknowns.local);
        for front in fronts.iter().rev() {
            let own = front.column..front.column + front.top();
            let local = gather(all, own.clone(), front.rows(rows), local);
            for k in (0..front.blocks()).rev() {
                let (columns, block) = front.block(panels, k);
                match columns {
                    1 => backward::<S, T, U, 1>(simd, block, &mut local[k..]),
                    2 => backward::<S, T, U, 2>(simd, block, &mut local[k..]),
                    3 => backward::<S, T, U, 3>(simd, block, &mut local[k..]),
                    _ => backward::<S, T, U, BLOCK>(simd, block, &mut local[k..]),
                }
            }
            let solved = &local.as_flattened()[..own.len()];
            all[own].copy_from_slice(solved);
        }
    }
}

/// The unknowns of a front and those below, padded with zeros.
#[inline(always)]
fn gather<'a, U: Unknown>(
    all: &[U],
    own: Range<usize>,
    rows: &[u32],
    local: &'a mut [U],
) -> &'a mut [[U; BLOCK]] {
    let height = own.len() + rows.len().next_multiple_of(BLOCK);
    let local = local[..height].as_chunks_mut().0;
    if let Some(padded) = local.last_mut() {
        *padded = [U::ZERO; BLOCK];
    }
    let (own_part, below) = local.as_flattened_mut().split_at_mut(own.len());
    own_part.copy_from_slice(&all[own]);
    for (x, &row) in below.iter_mut().zip(rows) {
        *x = all[row as usize];
    }
    local
}

/// [`Unknown::forward`] for the first of these blocks of unknowns, and those after it.
#[inline(always)]
fn forward<S: Simd, T: Stored, U: Unknown, const COLUMNS: usize>(
    simd: S,
    block: &[T],
    unknowns: &mut [[U; BLOCK]],
) {
    let tiles = block.as_chunks().0.as_chunks().0;
    if let ([x, others @ ..], [triangle, tiles @ ..]) = (unknowns, tiles) {
        U::forward::<S, T, COLUMNS>(simd, triangle, x, tiles, others);
    }
}

/// [`Unknown::backward`] for the first of these blocks of unknowns, and those after it.
#[inline(always)]
fn backward<S: Simd, T: Stored, U: Unknown, const COLUMNS: usize>(
    simd: S,
    block: &[T],
    unknowns: &mut [[U; BLOCK]],
) {
    let tiles = block.as_chunks().0.as_chunks().0;
    if let ([x, others @ ..], [triangle, tiles @ ..]) = (unknowns, tiles) {
        U::backward::<S, T, COLUMNS>(simd, triangle, x, tiles, others);
    }
}
