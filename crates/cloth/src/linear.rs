//! Sparse Cholesky factorisation for matrices whose pattern never changes, and dense products.
//!
//! The ordering (approximate minimum degree) and the symbolic factorisation are faer's; the numeric
//! part is a multifrontal factorisation of our own (Liu 1992), because the fronts of a cloth of
//! some hundred nodes have 5 to 60 rows, where a kernel without set-up cost is several times
//! faster. This is the only file that names faer and pulp.

use faer::Side;
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::linalg::{SupernodalThreshold, SymbolicSupernodalParams};
use pulp::{Arch, Simd, WithSimd};

use crate::Error;

/// Neighbouring columns are joined into one front of up to so many columns as long as the share of
/// zeros this stores stays below the bound; measured on sheets of 644 nodes.
const RELAX: [(usize, f64); 4] = [(4, 0.5), (16, 0.3), (48, 0.1), (usize::MAX, 0.05)];

/// Columns are eliminated in blocks of so many, and the two parts of a front, its columns and the
/// rows below, are each padded with zeros to a multiple of it: no vector is ever cut short.
const BLOCK: usize = 4;

/// `S = L L^T` of a symmetric positive definite matrix with a fixed pattern.
///
/// The pattern is analysed once; then values are factored as often as they change, and each factor
/// is used for any number of right hand sides. Nothing allocates after the analysis, and the order
/// of every sum is fixed, so equal values give equal bits.
///
/// ```
/// use selvedge_cloth::linear::Cholesky;
///
/// // [ 4 2 ; 2 5 ] x = [ 2 ; 5 ]
/// let mut s = Cholesky::analyse(2, &[(0, 0), (0, 1), (1, 1)])?;
/// s.factor(&[4.0, 2.0, 5.0])?;
/// let mut x = [2.0, 5.0];
/// s.solve(&mut x);
/// assert_eq!(x, [0.0, 1.0]);
/// # Ok::<(), selvedge_cloth::Error>(())
/// ```
#[derive(Debug)]
pub struct Cholesky {
    /// Place of each row among the padded unknowns.
    position: Vec<u32>,
    /// Children before parents.
    fronts: Vec<Front>,
    /// Entries of the matrix by front: which of the values, and its place in the panel.
    entries: Vec<[u32; 2]>,
    /// Rows below the columns of each front, by their places among the padded unknowns.
    rows: Vec<u32>,
    /// What the children of each front add to it: where it waits on their stack, and its place in
    /// the panel or, after those, in the update matrix.
    additions: Vec<[u32; 2]>,
    /// The panel of each front, column by column: its rows in the columns of the front, then those
    /// below, each part padded. Above the diagonal is nothing of use.
    panels: Vec<f64>,
    /// Update matrices waiting for their parents, by parity of the depth.
    waiting: [Vec<f64>; 2],
    /// The unknowns by front, each front's padded with zeros like its columns.
    unknowns: Vec<f64>,
    /// The part below of one column.
    local: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
struct Front {
    /// Its first column, by its place among the padded unknowns.
    column: usize,
    columns: usize,
    /// Where the rows below begin, and how many there are.
    row: usize,
    below: usize,
    /// Where the panel begins.
    panel: usize,
    /// Where its update matrix lies on which of the two stacks.
    update: usize,
    stack: usize,
    /// Its range of `entries`.
    first_entry: usize,
    last_entry: usize,
    /// Its ranges of `additions`: to the panel `[0]..[1]`, to the update matrix `[1]..[2]`.
    additions: [usize; 3],
}

impl Front {
    /// Padded number of columns: where the rows below begin in a column of the panel.
    fn top(&self) -> usize {
        self.columns.next_multiple_of(BLOCK)
    }

    /// Padded number of rows below.
    fn bottom(&self) -> usize {
        self.below.next_multiple_of(BLOCK)
    }

    fn height(&self) -> usize {
        self.top() + self.bottom()
    }
}

impl Cholesky {
    /// Orders and analyses an `n` by `n` pattern, given as `(row, column)` pairs: each unordered
    /// pair once, the diagonal among them.
    ///
    /// # Errors
    /// [`Error::Factorisation`] when the pattern cannot be analysed (out of memory).
    ///
    /// # Panics
    /// When an index is not below `n`.
    pub fn analyse(n: usize, entries: &[(u32, u32)]) -> Result<Self, Error> {
        let failed = |error| Error::Factorisation(format!("{error:?}"));
        let mut upper: Vec<(u32, u32)> =
            entries.iter().map(|&(a, b)| (a.max(b), a.min(b))).collect();
        upper.sort_unstable();
        let row: Vec<u32> = upper.iter().map(|&(_, row)| row).collect();
        let mut start = vec![0u32; n + 1];
        for &(column, _) in &upper {
            start[column as usize + 1] += 1;
        }
        for column in 0..n {
            start[column + 1] += start[column];
        }
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &start, None, &row);
        let params = CholeskySymbolicParams {
            // Below zero, since a diagonal matrix has no operations to count.
            supernodal_flop_ratio_threshold: SupernodalThreshold(-1.0),
            supernodal_params: SymbolicSupernodalParams {
                relax: Some(&RELAX),
            },
            ..Default::default()
        };
        let ordering = SymmetricOrdering::Amd;
        let symbolic =
            factorize_symbolic_cholesky(pattern, Side::Upper, ordering, params).map_err(failed)?;
        let SymbolicCholeskyRaw::Supernodal(supernodes) = symbolic.raw() else {
            return Err(Error::Factorisation(
                "the analysis gave no supernodes".into(),
            ));
        };
        let position = match symbolic.perm() {
            Some(perm) => perm.arrays().1.to_vec(),
            None => (0..n as u32).collect(),
        };

        // The tree of the fronts
        let count = supernodes.n_supernodes();
        let begin: Vec<usize> = supernodes
            .supernode_begin()
            .iter()
            .map(|&k| k as usize)
            .collect();
        let end: Vec<usize> = supernodes
            .supernode_end()
            .iter()
            .map(|&k| k as usize)
            .collect();
        let mut front_of = vec![0; n];
        for s in 0..count {
            front_of[begin[s]..end[s]].fill(s);
        }
        let mut children = vec![Vec::new(); count];
        let mut roots = Vec::new();
        for s in 0..count {
            match supernodes.supernode(s).pattern().first() {
                Some(&row) => children[front_of[row as usize]].push(s),
                None => roots.push(s),
            }
        }
        let order = children_first(&roots, &children);
        let mut padded = vec![0u32; n];
        let mut unknowns = 0;
        for &(s, _) in &order {
            for (place, column) in (unknowns..).zip(begin[s]..end[s]) {
                padded[column] = place as u32;
            }
            unknowns += (end[s] - begin[s]).next_multiple_of(BLOCK);
        }

        // Fronts in that order, with the place of each row in the parent
        let mut number = vec![0; count];
        let mut fronts: Vec<Front> = Vec::with_capacity(count);
        let (mut rows, mut additions) = (Vec::new(), Vec::new());
        let (mut size, mut longest) = (0, 0);
        // Present and greatest heights of the two stacks of update matrices.
        let (mut used, mut needed) = ([0, 0], [0, 0]);
        for &(s, depth) in &order {
            number[s] = fronts.len();
            let pattern = supernodes.supernode(s).pattern();
            rows.extend(pattern.iter().map(|&row| padded[row as usize]));
            let mut front = Front {
                column: padded[begin[s]] as usize,
                columns: end[s] - begin[s],
                row: rows.len() - pattern.len(),
                below: pattern.len(),
                panel: size,
                update: used[depth % 2],
                stack: depth % 2,
                first_entry: 0,
                last_entry: 0,
                additions: [additions.len(); 3],
            };
            let (top, height, bottom) = (front.top(), front.height(), front.bottom());
            size += front.columns * height;
            longest = bottom.max(longest);

            let mut to_update = Vec::new();
            for &child in &children[s] {
                let places: Vec<usize> = supernodes
                    .supernode(child)
                    .pattern()
                    .iter()
                    .map(|&row| place_in_front(begin[s], end[s], pattern, row))
                    .collect();
                let child = &fronts[number[child]];
                for (k, &column) in places.iter().enumerate() {
                    for (row, &place) in places.iter().enumerate().skip(k) {
                        let from = (child.update + k * child.bottom() + row) as u32;
                        if column < top {
                            additions.push([from, (column * height + place) as u32]);
                        } else {
                            let to = (column - top) * bottom + place - top;
                            to_update.push([from, to as u32]);
                        }
                    }
                }
                used[child.stack] -= child.bottom() * child.bottom();
            }
            front.additions[1] = additions.len();
            additions.append(&mut to_update);
            front.additions[2] = additions.len();
            used[front.stack] += bottom * bottom;
            needed[front.stack] = used[front.stack].max(needed[front.stack]);
            fronts.push(front);
        }

        if needed.iter().any(|&needed| u32::try_from(needed).is_err()) {
            return Err(Error::Factorisation("the matrix is too large".into()));
        }

        // The entries by front
        let mut sorted: Vec<(usize, [u32; 2])> = (0u32..)
            .zip(entries)
            .map(|(k, &(a, b))| {
                let (a, b) = (position[a as usize], position[b as usize]);
                let (row, column) = (a.max(b), a.min(b) as usize);
                let s = front_of[column];
                let front = &fronts[number[s]];
                let pattern = supernodes.supernode(s).pattern();
                let place = place_in_front(begin[s], end[s], pattern, row);
                (
                    number[s],
                    [k, ((column - begin[s]) * front.height() + place) as u32],
                )
            })
            .collect();
        sorted.sort_unstable();
        for (k, &(number, _)) in sorted.iter().enumerate() {
            let front = &mut fronts[number];
            if front.last_entry == 0 {
                front.first_entry = k;
            }
            front.last_entry = k + 1;
        }
        Ok(Self {
            position: position.iter().map(|&k| padded[k as usize]).collect(),
            fronts,
            entries: sorted.into_iter().map(|(_, entry)| entry).collect(),
            rows,
            additions,
            panels: vec![0.0; size],
            waiting: needed.map(|size| vec![0.0; size]),
            unknowns: vec![0.0; unknowns],
            local: vec![0.0; longest],
        })
    }

    /// Factors the matrix with these values, in the order of the pairs it was analysed with.
    ///
    /// # Errors
    /// [`Error::Factorisation`] when the matrix is not positive definite or not finite; the factor
    /// is then of no use until the next success.
    ///
    /// # Panics
    /// When there is not one value for each pair.
    pub fn factor(&mut self, values: &[f64]) -> Result<(), Error> {
        assert_eq!(values.len(), self.entries.len(), "one value a pair");
        if Arch::new().dispatch(Factor(self, values)) {
            Ok(())
        } else {
            Err(Error::Factorisation("it is not positive definite".into()))
        }
    }

    /// Solves `S x = rhs` in place.
    ///
    /// # Panics
    /// When `rhs` has not `n` entries.
    pub fn solve(&mut self, rhs: &mut [f64]) {
        assert_eq!(rhs.len(), self.position.len(), "one entry a row");
        // The padding too, where an earlier right hand side may have left what is not a number.
        self.unknowns.fill(0.0);
        for (&p, &value) in self.position.iter().zip(&*rhs) {
            self.unknowns[p as usize] = value;
        }
        Arch::new().dispatch(Solve(self));
        for (&p, value) in self.position.iter().zip(rhs) {
            *value = self.unknowns[p as usize];
        }
    }
}

/// The place of a row in the panel of the front with the columns `begin..end` and the rows `below`.
fn place_in_front(begin: usize, end: usize, below: &[u32], row: u32) -> usize {
    if (row as usize) < end {
        row as usize - begin
    } else {
        (end - begin).next_multiple_of(BLOCK) + below.partition_point(|&r| r < row)
    }
}

/// Every front after its children, with its depth; the children of one front directly follow each
/// other's subtrees.
fn children_first(roots: &[usize], children: &[Vec<usize>]) -> Vec<(usize, usize)> {
    let mut order = Vec::with_capacity(children.len());
    let mut open: Vec<(usize, usize)> = roots.iter().rev().map(|&root| (root, 0)).collect();
    while let Some((s, depth)) = open.pop() {
        order.push((s, depth));
        open.extend(children[s].iter().map(|&child| (child, depth + 1)));
    }
    // Parents came before children, and the last child first: backwards it is a postorder.
    order.reverse();
    order
}

struct Factor<'a>(&'a mut Cholesky, &'a [f64]);

impl WithSimd for Factor<'_> {
    /// Whether all pivots are positive and finite.
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> bool {
        let Self(
            Cholesky {
                fronts,
                entries,
                additions,
                panels,
                waiting,
                ..
            },
            values,
        ) = self;
        let [even, odd] = waiting;
        for front in &*fronts {
            let (own, childrens) = if front.stack == 0 {
                (&mut *even, &*odd)
            } else {
                (&mut *odd, &*even)
            };
            let (height, bottom) = (front.height(), front.bottom());
            let [first, middle, last] = front.additions;

            let panel = &mut panels[front.panel..][..front.columns * height];
            panel.fill(0.0);
            for &[value, place] in &entries[front.first_entry..front.last_entry] {
                panel[place as usize] = values[value as usize];
            }
            add(panel, childrens, &additions[first..middle]);
            if !factor_panel(simd, panel, front.columns, height) {
                return false;
            }
            let update = &mut own[front.update..][..bottom * bottom];
            if bottom > 0 {
                negative_squares(simd, update, bottom, panel, height);
                add(update, childrens, &additions[middle..last]);
            }
        }
        true
    }
}

/// Adds entries of the children's update matrices at their places.
#[inline(always)]
fn add(target: &mut [f64], childrens: &[f64], additions: &[[u32; 2]]) {
    for &[from, to] in additions {
        target[to as usize] += childrens[from as usize];
    }
}

/// Cholesky factorisation of the first rows of a panel and the matching solve of the rest; false
/// when a pivot is not a positive finite number. The diagonal keeps the inverses, which are all
/// that is used of it.
#[inline(always)]
fn factor_panel<S: Simd>(simd: S, panel: &mut [f64], columns: usize, height: usize) -> bool {
    for first in (0..columns).step_by(BLOCK) {
        let good = match columns - first {
            1 => factor_block::<S, 1>(simd, panel, height, first),
            2 => factor_block::<S, 2>(simd, panel, height, first),
            3 => factor_block::<S, 3>(simd, panel, height, first),
            _ => factor_block::<S, BLOCK>(simd, panel, height, first),
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
    height: usize,
    first: usize,
) -> bool {
    let (done, rest) = panel.split_at_mut(first * height);
    let block = &mut rest[..COLUMNS * height];

    // The triangle on the diagonal
    for row in (first..first + BLOCK).step_by(S::F64_LANES) {
        let products = products::<S, COLUMNS, 1>(simd, done, height, row, first);
        for (column, [product]) in block.chunks_exact_mut(height).zip(products) {
            for value in vectors_mut::<S, 1>(column, row) {
                *value = simd.sub_f64s(*value, product);
            }
        }
    }
    let mut triangle = [[0.0; COLUMNS]; COLUMNS];
    for (own, column) in triangle.iter_mut().zip(block.chunks_exact(height)) {
        own.copy_from_slice(&column[first..first + COLUMNS]);
    }
    if !factor_triangle(&mut triangle) {
        return false;
    }
    for (own, column) in triangle.iter().zip(block.chunks_exact_mut(height)) {
        column[first..first + COLUMNS].copy_from_slice(own);
    }

    // The rows below it
    let mut factors = [[simd.splat_f64s(0.0); COLUMNS]; COLUMNS];
    for (factors, values) in factors.iter_mut().zip(&triangle) {
        for (factor, &value) in factors.iter_mut().zip(values) {
            *factor = simd.splat_f64s(value);
        }
    }
    let mut row = first + BLOCK;
    while row + 2 * S::F64_LANES <= height {
        eliminate::<S, COLUMNS, 2>(simd, done, block, height, row, first, &factors);
        row += 2 * S::F64_LANES;
    }
    while row < height {
        eliminate::<S, COLUMNS, 1>(simd, done, block, height, row, first, &factors);
        row += S::F64_LANES;
    }
    true
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
    height: usize,
    row: usize,
    first: usize,
    triangle: &[[S::f64s; COLUMNS]; COLUMNS],
) {
    let mut x = products::<S, COLUMNS, VECTORS>(simd, done, height, row, first);
    for (k, column) in block.chunks_exact_mut(height).enumerate() {
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
    bottom: usize,
    panel: &[f64],
    height: usize,
) {
    let top = height - bottom;
    for (block, target) in update.chunks_exact_mut(BLOCK * bottom).enumerate() {
        let first = block * BLOCK;
        let mut row = first;
        while row + 2 * S::F64_LANES <= bottom {
            let sums = products::<S, BLOCK, 2>(simd, panel, height, top + row, top + first);
            for (column, sums) in target.chunks_exact_mut(bottom).zip(sums) {
                for (value, sum) in vectors_mut::<S, 2>(column, row).iter_mut().zip(sums) {
                    *value = simd.neg_f64s(sum);
                }
            }
            row += 2 * S::F64_LANES;
        }
        while row < bottom {
            let sums = products::<S, BLOCK, 1>(simd, panel, height, top + row, top + first);
            for (column, sums) in target.chunks_exact_mut(bottom).zip(sums) {
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
    height: usize,
    row: usize,
    factor: usize,
) -> [[S::f64s; VECTORS]; COLUMNS] {
    let mut sums = [[simd.splat_f64s(0.0); VECTORS]; COLUMNS];
    for column in panel.chunks_exact(height) {
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

/// So many vectors of a column, from `row` on.
#[inline(always)]
fn vectors<S: Simd, const VECTORS: usize>(column: &[f64], row: usize) -> &[S::f64s] {
    S::as_simd_f64s(&column[row..row + VECTORS * S::F64_LANES]).0
}

/// As [`vectors`], to be changed.
#[inline(always)]
fn vectors_mut<S: Simd, const VECTORS: usize>(column: &mut [f64], row: usize) -> &mut [S::f64s] {
    S::as_mut_simd_f64s(&mut column[row..row + VECTORS * S::F64_LANES]).0
}

struct Solve<'a>(&'a mut Cholesky);

impl WithSimd for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Cholesky {
            fronts,
            rows,
            panels,
            unknowns: x,
            local,
            ..
        } = self.0;
        // L y = b
        for front in &*fronts {
            let (top, height) = (front.top(), front.height());
            let panel = &panels[front.panel..][..front.columns * height];
            let own = &mut x[front.column..][..top];
            for (k, block) in panel.chunks(BLOCK * height).enumerate() {
                match block.len() / height {
                    1 => forward::<S, 1>(simd, block, height, own, k * BLOCK),
                    2 => forward::<S, 2>(simd, block, height, own, k * BLOCK),
                    3 => forward::<S, 3>(simd, block, height, own, k * BLOCK),
                    _ => forward::<S, BLOCK>(simd, block, height, own, k * BLOCK),
                }
            }
            let mut row = top;
            while row + 4 * S::F64_LANES <= height {
                combine::<S, 4>(simd, panel, height, row, own, &mut local[row - top..]);
                row += 4 * S::F64_LANES;
            }
            while row < height {
                combine::<S, 1>(simd, panel, height, row, own, &mut local[row - top..]);
                row += S::F64_LANES;
            }
            for (&value, &row) in local.iter().zip(&rows[front.row..][..front.below]) {
                x[row as usize] -= value;
            }
        }
        // L^T x = y
        for front in fronts.iter().rev() {
            let (top, height) = (front.top(), front.height());
            let panel = &panels[front.panel..][..front.columns * height];
            let below = &mut local[..front.bottom()];
            if let Some(padded) = below.last_chunk_mut::<BLOCK>() {
                *padded = [0.0; BLOCK];
            }
            for (value, &row) in below.iter_mut().zip(&rows[front.row..][..front.below]) {
                *value = x[row as usize];
            }
            let own = &mut x[front.column..][..top];
            for (k, block) in panel.chunks(BLOCK * height).enumerate().rev() {
                match block.len() / height {
                    1 => backward::<S, 1>(simd, block, height, own, below, k * BLOCK),
                    2 => backward::<S, 2>(simd, block, height, own, below, k * BLOCK),
                    3 => backward::<S, 3>(simd, block, height, own, below, k * BLOCK),
                    _ => backward::<S, BLOCK>(simd, block, height, own, below, k * BLOCK),
                }
            }
        }
    }
}

/// Solves for the columns of a block, from `first` on, and takes them from the front's later
/// columns.
#[inline(always)]
fn forward<S: Simd, const COLUMNS: usize>(
    simd: S,
    block: &[f64],
    height: usize,
    own: &mut [f64],
    first: usize,
) {
    let (own, later) = own[first..].split_at_mut(BLOCK);
    let mut factors = [simd.splat_f64s(0.0); COLUMNS];
    for (k, column) in block.chunks_exact(height).enumerate() {
        own[k] *= column[first + k];
        for row in k + 1..COLUMNS {
            own[row] -= column[first + row] * own[k];
        }
        factors[k] = simd.splat_f64s(own[k]);
    }
    for (v, value) in S::as_mut_simd_f64s(later).0.iter_mut().enumerate() {
        let row = first + BLOCK + v * S::F64_LANES;
        for (column, factor) in block.chunks_exact(height).zip(factors) {
            let entries = vectors::<S, 1>(column, row)[0];
            *value = simd.negate_mul_add_f64s(entries, factor, *value);
        }
    }
}

/// `target` becomes the sum of the panel's columns, some vectors from `row` on, times `factors`.
#[inline(always)]
fn combine<S: Simd, const VECTORS: usize>(
    simd: S,
    panel: &[f64],
    height: usize,
    row: usize,
    factors: &[f64],
    target: &mut [f64],
) {
    let mut sums = [simd.splat_f64s(0.0); VECTORS];
    for (column, &factor) in panel.chunks_exact(height).zip(factors) {
        let factor = simd.splat_f64s(factor);
        for (sum, &entries) in sums.iter_mut().zip(vectors::<S, VECTORS>(column, row)) {
            *sum = simd.mul_add_f64s(entries, factor, *sum);
        }
    }
    vectors_mut::<S, VECTORS>(target, 0).copy_from_slice(&sums);
}

/// Solves for the columns of a block, from `first` on, with the front's later columns and the rows
/// below known.
#[inline(always)]
fn backward<S: Simd, const COLUMNS: usize>(
    simd: S,
    block: &[f64],
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
                let entries = vectors::<S, 1>(column, row)[0];
                *sum = simd.mul_add_f64s(entries, value, *sum);
            }
        }
    }
    for (k, column) in block.chunks_exact(height).enumerate().rev() {
        let mut value = own[k] - simd.reduce_sum_f64s(sums[k]);
        for row in k + 1..COLUMNS {
            value -= column[first + row] * own[row];
        }
        own[k] = value * column[first + k];
    }
}

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
    Arch::new().dispatch(Multiply { a, b, inner, c });
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

    /// The five-point matrix of a grid with a diagonal that makes it definite, and one without.
    fn grid_matrix(n: usize, diagonal: f64) -> Vec<((u32, u32), f64)> {
        let mut entries = Vec::new();
        for j in 0..n {
            for i in 0..n {
                let k = (j * n + i) as u32;
                entries.push(((k, k), diagonal + 0.01 * f64::from(k)));
                if i + 1 < n {
                    entries.push(((k + 1, k), -1.0 - 0.02 * f64::from(k % 7)));
                }
                if j + 1 < n {
                    entries.push(((k, k + n as u32), 0.9));
                }
            }
        }
        entries
    }

    fn analyse(n: usize, matrix: &[((u32, u32), f64)]) -> Cholesky {
        let pattern: Vec<(u32, u32)> = matrix.iter().map(|&(entry, _)| entry).collect();
        Cholesky::analyse(n, &pattern).unwrap()
    }

    fn values(matrix: &[((u32, u32), f64)]) -> Vec<f64> {
        matrix.iter().map(|&(_, value)| value).collect()
    }

    #[test]
    fn solves_to_rounding() {
        for n in [1, 2, 5, 17, 40] {
            let matrix = grid_matrix(n, 4.5);
            let mut cholesky = analyse(n * n, &matrix);
            cholesky.factor(&values(&matrix)).unwrap();
            let x: Vec<f64> = (0..n * n).map(|k| (k as f64 * 0.37).sin()).collect();
            let mut rhs = vec![0.0; n * n];
            for &((a, b), value) in &matrix {
                rhs[a as usize] += value * x[b as usize];
                if a != b {
                    rhs[b as usize] += value * x[a as usize];
                }
            }
            cholesky.solve(&mut rhs);
            let off = x
                .iter()
                .zip(&rhs)
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max);
            assert!(off < 1e-13, "{n} x {n}: {off:e}");
        }
    }

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

    #[test]
    fn indefinite_or_nan_is_an_error_and_the_next_factorisation_works() {
        let n = 12;
        let good = grid_matrix(n, 4.5);
        let mut cholesky = analyse(n * n, &good);
        for bad in [-1.0, 0.0, f64::NAN, f64::INFINITY] {
            let mut matrix = good.clone();
            matrix[100].1 = if matrix[100].0.0 == matrix[100].0.1 {
                bad
            } else {
                f64::NAN
            };
            assert!(matches!(
                cholesky.factor(&values(&matrix)),
                Err(Error::Factorisation(_))
            ));
        }
        cholesky.factor(&values(&good)).unwrap();
        let mut expected = vec![1.0; n * n];
        cholesky.solve(&mut expected);
        let mut lost = vec![f64::NAN; n * n];
        cholesky.solve(&mut lost);
        let mut x = vec![1.0; n * n];
        cholesky.solve(&mut x);
        assert_eq!(x, expected);
    }
}
