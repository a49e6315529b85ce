//! The two triangular solves, front by front and block by block, in the order in which the factor lies in
//! memory or in its reverse.

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
        others: [(&[Tile<T, COLUMNS>], &mut [[Self; BLOCK]]); 2],
    );

    /// Solves for the columns of a block with the others known.
    fn backward<S: Simd, T: Stored, const COLUMNS: usize>(
        simd: S,
        triangle: &Tile<T, COLUMNS>,
        x: &mut [Self; BLOCK],
        others: [(&[Tile<T, COLUMNS>], &[[Self; BLOCK]]); 2],
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
        let (all, below) = (&mut *unknowns.all, &mut *unknowns.below);
        for front in fronts {
            let rows = front.rows(rows);
            gather(all, rows, &mut below[..front.bottom()]);
            let own = all[front.column..][..front.top()].as_chunks_mut().0;
            let below = below[..front.bottom()].as_chunks_mut().0;
            for k in 0..front.blocks() {
                let (columns, block) = front.block(panels, k);
                let own = &mut own[k..];
                match columns {
                    1 => forward::<S, T, U, 1>(simd, block, own, below),
                    2 => forward::<S, T, U, 2>(simd, block, own, below),
                    3 => forward::<S, T, U, 3>(simd, block, own, below),
                    _ => forward::<S, T, U, BLOCK>(simd, block, own, below),
                }
            }
            for (&x, &row) in below.as_flattened().iter().zip(rows) {
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
        let (all, below) = (&mut *unknowns.all, &mut *unknowns.below);
        for front in fronts.iter().rev() {
            let below = &mut below[..front.bottom()];
            gather(all, front.rows(rows), below);
            let own = all[front.column..][..front.top()].as_chunks_mut().0;
            let below = below.as_chunks().0;
            for k in (0..front.blocks()).rev() {
                let (columns, block) = front.block(panels, k);
                let own = &mut own[k..];
                match columns {
                    1 => backward::<S, T, U, 1>(simd, block, own, below),
                    2 => backward::<S, T, U, 2>(simd, block, own, below),
                    3 => backward::<S, T, U, 3>(simd, block, own, below),
                    _ => backward::<S, T, U, BLOCK>(simd, block, own, below),
                }
            }
        }
    }
}

/// The unknowns below a front, padded with zeros.
#[inline(always)]
fn gather<U: Unknown>(all: &[U], rows: &[u32], below: &mut [U]) {
    if let Some(padded) = below.last_chunk_mut::<BLOCK>() {
        *padded = [U::ZERO; BLOCK];
    }
    for (x, &row) in below.iter_mut().zip(rows) {
        *x = all[row as usize];
    }
}

/// A block of a front, the first of `own`.
#[inline(always)]
fn forward<S: Simd, T: Stored, U: Unknown, const COLUMNS: usize>(
    simd: S,
    block: &[T],
    own: &mut [[U; BLOCK]],
    below: &mut [[U; BLOCK]],
) {
    let tiles: &[Tile<T, COLUMNS>] = block.as_chunks().0.as_chunks().0;
    if let ([x, later @ ..], [triangle, tiles @ ..]) = (own, tiles) {
        let (tiles, tiles_below) = tiles.split_at(later.len());
        let others = [(tiles, later), (tiles_below, below)];
        U::forward(simd, triangle, x, others);
    }
}

/// The same for the other pass.
#[inline(always)]
fn backward<S: Simd, T: Stored, U: Unknown, const COLUMNS: usize>(
    simd: S,
    block: &[T],
    own: &mut [[U; BLOCK]],
    below: &[[U; BLOCK]],
) {
    let tiles: &[Tile<T, COLUMNS>] = block.as_chunks().0.as_chunks().0;
    if let ([x, later @ ..], [triangle, tiles @ ..]) = (own, tiles) {
        let (tiles, tiles_below) = tiles.split_at(later.len());
        // What is below is known first.
        let others = [(tiles_below, below), (tiles, &*later)];
        U::backward(simd, triangle, x, others);
    }
}
