//! Sparse Cholesky factorisation with the symbolic part kept: the only file that names faer.

use faer::Conj;
use faer::Par;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky, simplicial,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{MatMut, Side};

use crate::Error;

/// `S = L L^T` for a symmetric positive definite `S` whose pattern never changes.
pub(crate) struct Cholesky {
    symbolic: SymbolicCholesky<u32>,
    /// Position of each row in the fill-reducing order.
    position: Vec<u32>,
    /// The upper triangle of the permuted matrix, by columns.
    column_start: Vec<u32>,
    row: Vec<u32>,
    values: Vec<f64>,
    factor: Vec<f64>,
    scratch: MemBuffer,
    permuted: Vec<f64>,
}

impl Cholesky {
    /// Orders and analyses a pattern given as `(row, column)` pairs, each unordered pair once and
    /// the diagonal among them. Returns for each pair its place in [`Cholesky::values_mut`].
    pub(crate) fn analyse(n: usize, entries: &[(u32, u32)]) -> Result<(Self, Vec<u32>), Error> {
        let natural: Vec<u32> = (0..n as u32).collect();
        let (column_start, row, _) = upper_triangle(n, entries, &natural);
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &column_start, None, &row);
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SIMPLICIAL,
            ..Default::default()
        };
        let symbolic =
            factorize_symbolic_cholesky(pattern, Side::Upper, SymmetricOrdering::Amd, params)
                .map_err(|error| Error::Factorisation(format!("{error:?}")))?;
        let position = match symbolic.perm() {
            Some(perm) => perm.arrays().1.to_vec(),
            None => natural,
        };
        let (column_start, row, slots) = upper_triangle(n, entries, &position);
        let request = simplicial::factorize_simplicial_numeric_llt_scratch::<u32, f64>(n);
        let cholesky = Self {
            factor: vec![0.0; symbolic.len_val()],
            values: vec![0.0; row.len()],
            scratch: MemBuffer::new(request),
            permuted: vec![0.0; 3 * n],
            symbolic,
            position,
            column_start,
            row,
        };
        Ok((cholesky, slots))
    }

    /// The values of the matrix, in the places that [`Cholesky::analyse`] returned.
    pub(crate) fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// Factors the present values.
    pub(crate) fn factor(&mut self) -> Result<(), Error> {
        let n = self.position.len();
        let SymbolicCholeskyRaw::Simplicial(symbolic) = self.symbolic.raw() else {
            return Err(Error::Factorisation("a simplicial pattern was expected".into()));
        };
        let pattern =
            SymbolicSparseColMatRef::new_unsorted_checked(n, n, &self.column_start, None, &self.row);
        simplicial::factorize_simplicial_numeric_llt(
            &mut self.factor,
            SparseColMatRef::new(pattern, &self.values),
            Default::default(),
            symbolic,
            MemStack::new(&mut self.scratch),
        )
        .map(|_| ())
        .map_err(|error| Error::Factorisation(format!("{error:?}")))
    }

    /// Solves `S x = rhs` in place, for each of the columns of `rhs` laid one behind the other.
    pub(crate) fn solve(&mut self, rhs: &mut [f64]) {
        let n = self.position.len();
        let columns = rhs.len() / n;
        let SymbolicCholeskyRaw::Simplicial(symbolic) = self.symbolic.raw() else { return };
        for c in 0..columns {
            for (&p, &value) in self.position.iter().zip(&rhs[c * n..]) {
                self.permuted[c * n + p as usize] = value;
            }
        }
        simplicial::SimplicialLltRef::new(symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(&mut self.permuted[..columns * n], n, columns),
            Par::Seq,
            MemStack::new(&mut self.scratch),
        );
        for c in 0..columns {
            for (&p, value) in self.position.iter().zip(&mut rhs[c * n..]) {
                *value = self.permuted[c * n + p as usize];
            }
        }
    }
}

/// The upper triangle by columns after each index was moved to its position; and for each entry
/// its place in it.
fn upper_triangle(
    n: usize,
    entries: &[(u32, u32)],
    position: &[u32],
) -> (Vec<u32>, Vec<u32>, Vec<u32>) {
    let mut placed: Vec<(u32, u32, usize)> = entries
        .iter()
        .enumerate()
        .map(|(index, &(a, b))| {
            let (a, b) = (position[a as usize], position[b as usize]);
            (a.max(b), a.min(b), index)
        })
        .collect();
    placed.sort_unstable();
    let mut column_start = vec![0u32; n + 1];
    let mut slots = vec![0u32; entries.len()];
    for (slot, &(column, _, index)) in placed.iter().enumerate() {
        column_start[column as usize + 1] = slot as u32 + 1;
        slots[index] = slot as u32;
    }
    for c in 0..n {
        column_start[c + 1] = column_start[c + 1].max(column_start[c]);
    }
    (column_start, placed.iter().map(|&(_, row, _)| row).collect(), slots)
}
