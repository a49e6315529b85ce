//! Vector instructions, chosen at run time: the only file that names pulp.

use pulp::{Arch, Scalar};
pub(super) use pulp::{Simd, WithSimd};

/// Columns are eliminated in blocks of so many, and the two parts of a front, its columns and the
/// rows below, are each padded with zeros to a multiple of it: no vector is ever cut short.
pub(super) const BLOCK: usize = 4;

/// Runs an operation with the widest vectors of this processor that a block has room for.
pub(super) fn dispatch<Op: WithSimd>(operation: Op) -> Op::Output {
    Arch::new().dispatch(AtMostBlock(operation))
}

struct AtMostBlock<Op>(Op);

impl<Op: WithSimd> WithSimd for AtMostBlock<Op> {
    type Output = Op::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Op::Output {
        // Wider vectors are there only if another crate asks pulp for them.
        if S::F64_LANES <= BLOCK {
            self.0.with_simd(simd)
        } else {
            self.0.with_simd(Scalar::new())
        }
    }
}

/// What the entries of a factor are kept in. All sums are in double precision.
pub(super) trait Stored: Copy {
    /// The nearest value, zero for one so small that it would be slow to reckon with.
    fn nearest(value: f64) -> Self;
    fn value(self) -> f64;
    /// The first entries, as many as a vector has.
    fn vector<S: Simd>(entries: &[Self]) -> S::f64s;
}

impl Stored for f64 {
    #[inline(always)]
    fn nearest(value: f64) -> Self {
        value
    }

    #[inline(always)]
    fn value(self) -> f64 {
        self
    }

    #[inline(always)]
    fn vector<S: Simd>(entries: &[Self]) -> S::f64s {
        vectors::<S, 1>(entries, 0)[0]
    }
}

impl Stored for f32 {
    #[inline(always)]
    fn nearest(value: f64) -> Self {
        let nearest = value as f32;
        if nearest.abs() < f32::MIN_POSITIVE {
            0.0
        } else {
            nearest
        }
    }

    #[inline(always)]
    fn value(self) -> f64 {
        f64::from(self)
    }

    #[inline(always)]
    fn vector<S: Simd>(entries: &[Self]) -> S::f64s {
        let mut wide = [0.0; BLOCK];
        let wide = &mut wide[..S::F64_LANES];
        for (wide, &entry) in wide.iter_mut().zip(&entries[..S::F64_LANES]) {
            *wide = f64::from(entry);
        }
        vectors::<S, 1>(wide, 0)[0]
    }
}

/// So many vectors of a column, from `row` on.
#[inline(always)]
pub(super) fn vectors<S: Simd, const VECTORS: usize>(column: &[f64], row: usize) -> &[S::f64s] {
    S::as_simd_f64s(&column[row..row + VECTORS * S::F64_LANES]).0
}

/// As [`vectors`], to be changed.
#[inline(always)]
pub(super) fn vectors_mut<S: Simd, const VECTORS: usize>(
    column: &mut [f64],
    row: usize,
) -> &mut [S::f64s] {
    S::as_mut_simd_f64s(&mut column[row..row + VECTORS * S::F64_LANES]).0
}
