//! Vector instructions, chosen at run time: the only file that names pulp.

#[cfg(target_arch = "x86_64")]
use pulp::x86::V3;
use pulp::{Arch, Scalar};
pub(super) use pulp::{Simd, WithSimd};

/// Columns are eliminated in blocks of so many, and the two parts of a front, its columns and the
/// rows below, are each padded with zeros to a multiple of it: no vector of a block is ever cut short.
pub(super) const BLOCK: usize = 4;

/// Runs an operation with the widest vectors of this processor that a block has room for.
pub(super) fn dispatch<Op: WithSimd>(operation: Op) -> Op::Output {
    #[cfg(target_arch = "x86_64")]
    if let Some(simd) = V3::try_new() {
        return Simd::vectorize(simd, operation);
    }
    Arch::new().dispatch(AtMost::<_, BLOCK>(operation))
}

/// The same with vectors that two blocks have room for.
pub(super) fn dispatch_wide<Op: WithSimd>(operation: Op) -> Op::Output {
    Arch::new().dispatch(AtMost::<_, { 2 * BLOCK }>(operation))
}

struct AtMost<Op, const LANES: usize>(Op);

impl<Op: WithSimd, const LANES: usize> WithSimd for AtMost<Op, LANES> {
    type Output = Op::Output;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Op::Output {
        if S::F64_LANES <= LANES {
            self.0.with_simd(simd)
        } else {
            self.0.with_simd(Scalar::new())
        }
    }
}

/// A block of numbers side by side.
#[derive(Clone, Copy)]
pub(super) struct Four<S: Simd>(
    /// The first `BLOCK / S::F64_LANES` are used.
    [S::f64s; BLOCK],
);

impl<S: Simd> Four<S> {
    #[inline(always)]
    pub(super) fn zero(simd: S) -> Self {
        Self::splat(simd, 0.0)
    }

    #[inline(always)]
    pub(super) fn splat(simd: S, value: f64) -> Self {
        Self([simd.splat_f64s(value); BLOCK])
    }

    #[inline(always)]
    pub(super) fn load(values: &[f64; BLOCK]) -> Self {
        let vectors = S::as_simd_f64s(values).0;
        // Those not used repeat the first.
        Self(std::array::from_fn(|k| vectors[k % vectors.len()]))
    }

    #[inline(always)]
    pub(super) fn store(self, values: &mut [f64; BLOCK]) {
        let vectors = S::as_mut_simd_f64s(values).0;
        vectors.copy_from_slice(&self.0[..BLOCK / S::F64_LANES]);
    }

    /// `self + a b`, one by one.
    #[inline(always)]
    pub(super) fn plus(mut self, simd: S, a: Self, b: Self) -> Self {
        for k in 0..BLOCK / S::F64_LANES {
            self.0[k] = simd.mul_add_f64s(a.0[k], b.0[k], self.0[k]);
        }
        self
    }

    /// `self - a b`, one by one.
    #[inline(always)]
    pub(super) fn minus(mut self, simd: S, a: Self, b: Self) -> Self {
        for k in 0..BLOCK / S::F64_LANES {
            self.0[k] = simd.negate_mul_add_f64s(a.0[k], b.0[k], self.0[k]);
        }
        self
    }

    /// The sum of the numbers.
    #[inline(always)]
    pub(super) fn sum(self, simd: S) -> f64 {
        let mut sum = self.0[0];
        for k in 1..BLOCK / S::F64_LANES {
            sum = simd.add_f64s(sum, self.0[k]);
        }
        simd.reduce_sum_f64s(sum)
    }
}

/// What the entries of a factor are kept in. All sums are in double precision.
pub(super) trait Stored: Copy + Send + Sync {
    /// The nearest value, zero for one so small that it would be slow to reckon with.
    fn nearest(value: f64) -> Self;
    fn value(self) -> f64;

    /// As many as a block has.
    #[inline(always)]
    fn four<S: Simd>(entries: &[Self; BLOCK]) -> Four<S> {
        Four::load(&entries.map(Self::value))
    }
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
