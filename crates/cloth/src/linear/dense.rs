//! Dense products of small matrices.

use super::simd::{Simd, WithSimd, dispatch};

/// `C = A B`, dense and row by row, where `B` has `inner` rows.
///
/// Fastest when the columns of `B` are a multiple of eight: pad with zeros. The order of every sum
/// is fixed, so equal values give equal bits.
///
/// ```
/// use selvedge_cloth::linear::multiply;
///
/// let mut c = [0.0; 2];
/// multiply(&[1.0, 2.0, 3.0, 4.0], &[5.0, 6.0], 2, &mut c);
/// assert_eq!(c, [17.0, 39.0]);
/// ```
///
/// # Panics
/// When the lengths are not those of such a product, or `inner` is zero.
pub fn multiply(a: &[f64], b: &[f64], inner: usize, c: &mut [f64]) {
    assert!(
        inner > 0 && b.len().is_multiple_of(inner),
        "B has `inner` rows"
    );
    assert!(a.len().is_multiple_of(inner), "A has `inner` columns");
    assert_eq!(
        c.len() * inner * inner,
        a.len() * b.len(),
        "C has the rows of A, the columns of B"
    );
    dispatch(Multiply { a, b, inner, c });
}

struct Multiply<'a> {
    a: &'a [f64],
    b: &'a [f64],
    inner: usize,
    c: &'a mut [f64],
}

impl WithSimd for Multiply<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { a, b, inner, c } = self;
        let columns = b.len() / inner;
        let mut a_blocks = a.chunks_exact(4 * inner);
        let mut c_blocks = c.chunks_exact_mut(4 * columns);
        for (a, c) in (&mut a_blocks).zip(&mut c_blocks) {
            multiply_rows::<S, 4>(simd, a, b, inner, c);
        }
        let rows = a_blocks.remainder().chunks_exact(inner);
        for (a, c) in rows.zip(c_blocks.into_remainder().chunks_exact_mut(columns)) {
            multiply_rows::<S, 1>(simd, a, b, inner, c);
        }
    }
}

/// `ROWS` rows of the product, two vectors at a time.
#[inline(always)]
fn multiply_rows<S: Simd, const ROWS: usize>(
    simd: S,
    a: &[f64],
    b: &[f64],
    inner: usize,
    c: &mut [f64],
) {
    let columns = b.len() / inner;
    let mut first = 0;
    while first + 2 * S::F64_LANES <= columns {
        multiply_tile::<S, ROWS, 2>(simd, a, b, inner, c, first);
        first += 2 * S::F64_LANES;
    }
    while first + S::F64_LANES <= columns {
        multiply_tile::<S, ROWS, 1>(simd, a, b, inner, c, first);
        first += S::F64_LANES;
    }
    for column in first..columns {
        for row in 0..ROWS {
            let sum = (0..inner)
                .map(|k| a[row * inner + k] * b[k * columns + column])
                .sum();
            c[row * columns + column] = sum;
        }
    }
}

/// A tile of the product that stays in registers, from column `first` on.
#[inline(always)]
fn multiply_tile<S: Simd, const ROWS: usize, const VECTORS: usize>(
    simd: S,
    a: &[f64],
    b: &[f64],
    inner: usize,
    c: &mut [f64],
    first: usize,
) {
    let columns = b.len() / inner;
    let a: [&[f64]; ROWS] = std::array::from_fn(|row| &a[row * inner..(row + 1) * inner]);
    let mut sums = [[simd.splat_f64s(0.0); VECTORS]; ROWS];
    for (k, b) in b.chunks_exact(columns).enumerate() {
        let b = S::as_simd_f64s(&b[first..first + VECTORS * S::F64_LANES]).0;
        for (sums, a) in sums.iter_mut().zip(a) {
            let a = simd.splat_f64s(a[k]);
            for (sum, &b) in sums.iter_mut().zip(b) {
                *sum = simd.mul_add_f64s(a, b, *sum);
            }
        }
    }
    for (c, sums) in c.chunks_exact_mut(columns).zip(sums) {
        let c = S::as_mut_simd_f64s(&mut c[first..first + VECTORS * S::F64_LANES]).0;
        c.copy_from_slice(&sums);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_of_all_shapes() {
        for (rows, inner, columns) in [(1, 1, 1), (4, 3, 8), (7, 5, 3), (9, 2, 24), (28, 28, 149)] {
            // Small integers: every sum is exact in any order.
            let a: Vec<f64> = (0..rows * inner)
                .map(|k| (k * 7 % 11) as f64 - 5.0)
                .collect();
            let b: Vec<f64> = (0..inner * columns)
                .map(|k| (k * 5 % 13) as f64 - 6.0)
                .collect();
            let mut c = vec![f64::NAN; rows * columns];
            multiply(&a, &b, inner, &mut c);
            for (k, &c) in c.iter().enumerate() {
                let (row, column) = (k / columns, k % columns);
                let sum: f64 = (0..inner)
                    .map(|i| a[row * inner + i] * b[i * columns + column])
                    .sum();
                assert_eq!(c, sum, "{rows} x {inner} x {columns}");
            }
        }
    }
}
