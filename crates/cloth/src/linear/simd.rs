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
