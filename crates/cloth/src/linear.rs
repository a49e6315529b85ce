//! Sparse Cholesky factorisation for matrices whose pattern never changes.
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

/// `S = L L^T` of a symmetric positive definite matrix with a fixed pattern.
///
/// The values are written in place by their slot, then factored, then used for any number of
/// right hand sides. Nothing allocates after the first factorisation, and the order of every sum
/// is fixed, so equal values give equal bits.
///
/// ```
/// use selvedge_cloth::linear::Cholesky;
///
/// // [ 4 2 ; 2 5 ] x = [ 2 ; 5 ]
/// let (mut s, slots) = Cholesky::analyse(2, &[(0, 0), (0, 1), (1, 1)])?;
/// for (&slot, value) in slots.iter().zip([4.0, 2.0, 5.0]) {
///     s.values_mut()[slot as usize] = value;
/// }
/// s.factor()?;
/// let mut x = [2.0, 5.0];
/// s.solve(&mut x);
/// assert_eq!(x, [0.0, 1.0]);
/// # Ok::<(), selvedge_cloth::Error>(())
/// ```
#[derive(Debug)]
pub struct Cholesky {
    /// Place of each row in the fill-reducing order.
    position: Vec<u32>,
    /// Children before parents.
    fronts: Vec<Front>,
    /// Rows below the columns of each front, in the fill-reducing order.
    rows: Vec<u32>,
    /// For each of these rows its place in the parent's front.
    places: Vec<u32>,
    /// The fronts below each front, in their order.
    children: Vec<u32>,
    /// Each front's columns, column by column, rows of the front one behind the other.
    values: Vec<f64>,
    /// Update matrices waiting for their parents, by parity of the depth.
    waiting: [Vec<f64>; 2],
    permuted: Vec<f64>,
    below: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
struct Front {
    /// First column, in the fill-reducing order.
    column: usize,
    columns: usize,
    /// Where the rows below begin, and how many there are.
    row: usize,
    below: usize,
    /// Where the values begin.
    value: usize,
    /// Its range of `children`.
    first_child: usize,
    last_child: usize,
    /// Which of the two stacks its update matrix goes to.
    stack: usize,
}

impl Cholesky {
    /// Orders and analyses an `n` by `n` pattern, given as `(row, column)` pairs: each unordered
    /// pair once, the diagonal among them. Returns for each pair its slot in
    /// [`Cholesky::values_mut`].
    ///
    /// # Errors
    /// [`Error::Factorisation`] when the pattern cannot be analysed (out of memory).
    ///
    /// # Panics
    /// When an index is not below `n`.
    pub fn analyse(n: usize, entries: &[(u32, u32)]) -> Result<(Self, Vec<u32>), Error> {
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

        // Fronts in that order, with the place of each row in the parent
        let mut cholesky = Self {
            permuted: vec![0.0; n],
            below: Vec::new(),
            position,
            fronts: Vec::with_capacity(count),
            rows: Vec::new(),
            places: Vec::new(),
            children: Vec::new(),
            values: Vec::new(),
            waiting: [Vec::new(), Vec::new()],
        };
        let mut number = vec![0; count];
        let mut size = 0;
        for &(s, depth) in &order {
            number[s] = cholesky.fronts.len();
            let pattern = supernodes.supernode(s).pattern();
            let columns = end[s] - begin[s];
            let first_child = cholesky.children.len();
            cholesky
                .children
                .extend(children[s].iter().map(|&child| number[child] as u32));
            cholesky.fronts.push(Front {
                column: begin[s],
                columns,
                row: cholesky.rows.len(),
                below: pattern.len(),
                value: size,
                first_child,
                last_child: cholesky.children.len(),
                stack: depth % 2,
            });
            size += columns * (columns + pattern.len());
            cholesky.rows.extend_from_slice(pattern);
            if let Some(&first) = pattern.first() {
                let parent = front_of[first as usize];
                let above = supernodes.supernode(parent).pattern();
                cholesky.places.extend(
                    pattern
                        .iter()
                        .map(|&row| place_in_front(begin[parent], end[parent], above, row) as u32),
                );
            }
        }
        cholesky.values = vec![0.0; size];
        let longest = cholesky
            .fronts
            .iter()
            .map(|front| front.below)
            .max()
            .unwrap_or(0);
        cholesky.below = vec![0.0; longest];

        let slots = entries
            .iter()
            .map(|&(a, b)| {
                let (a, b) = (cholesky.position[a as usize], cholesky.position[b as usize]);
                let (row, column) = (a.max(b), a.min(b) as usize);
                let s = front_of[column];
                let front = &cholesky.fronts[number[s]];
                let place =
                    place_in_front(begin[s], end[s], supernodes.supernode(s).pattern(), row);
                let height = front.columns + front.below;
                (front.value + (column - front.column) * height + place) as u32
            })
            .collect();
        Ok((cholesky, slots))
    }

    /// The values of the matrix, in the slots that [`Cholesky::analyse`] returned. They are
    /// overwritten by the factor, so all of them have to be set before each factorisation: fill
    /// with zeros, then add.
    pub fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// Replaces the values by the factor.
    ///
    /// # Errors
    /// [`Error::Factorisation`] when the matrix is not positive definite or not finite.
    pub fn factor(&mut self) -> Result<(), Error> {
        Arch::new().dispatch(Factor(self))
    }

    /// Solves `S x = rhs` in place.
    ///
    /// # Panics
    /// When `rhs` has not `n` entries.
    pub fn solve(&mut self, rhs: &mut [f64]) {
        assert_eq!(rhs.len(), self.position.len(), "one entry a row");
        for (&p, &value) in self.position.iter().zip(&*rhs) {
            self.permuted[p as usize] = value;
        }
        Arch::new().dispatch(Solve(self));
        for (&p, value) in self.position.iter().zip(rhs) {
            *value = self.permuted[p as usize];
        }
    }
}

/// The place of a row among the columns `begin..end` of a front and the rows below them.
fn place_in_front(begin: usize, end: usize, below: &[u32], row: u32) -> usize {
    if (row as usize) < end {
        row as usize - begin
    } else {
        end - begin + below.partition_point(|&r| r < row)
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

struct Factor<'a>(&'a mut Cholesky);

impl WithSimd for Factor<'_> {
    type Output = Result<(), Error>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let Cholesky {
            fronts,
            places,
            children,
            values,
            waiting,
            ..
        } = self.0;
        let [even, odd] = waiting;
        even.clear();
        odd.clear();
        for front in &*fronts {
            let (own, childrens) = if front.stack == 0 {
                (&mut *even, &mut *odd)
            } else {
                (&mut *odd, &mut *even)
            };
            let height = front.columns + front.below;
            let panel = &mut values[front.value..front.value + front.columns * height];
            let base = own.len();
            own.resize(base + front.below * front.below, 0.0);
            let update = &mut own[base..];

            // What the children left, the last one on top
            for &child in children[front.first_child..front.last_child].iter().rev() {
                let Front { row, below, .. } = fronts[child as usize];
                let begin = childrens.len() - below * below;
                let places = &places[row..row + below];
                add_child(&childrens[begin..], places, panel, update, front);
                childrens.truncate(begin);
            }

            if !factor_panel(simd, panel, front.columns, height) {
                return Err(Error::Factorisation("it is not positive definite".into()));
            }
            subtract_squares(simd, update, panel, front);
        }
        Ok(())
    }
}

/// Adds a child's update matrix at the places of its rows.
#[inline(always)]
fn add_child(child: &[f64], places: &[u32], panel: &mut [f64], update: &mut [f64], front: &Front) {
    let (columns, below) = (front.columns, front.below);
    let height = columns + below;
    for (b, (column, &place)) in child.chunks_exact(places.len()).zip(places).enumerate() {
        let place = place as usize;
        // Places ascend: from here on every row lies in the same part.
        let (target, shift) = if place < columns {
            (&mut panel[place * height..(place + 1) * height], 0)
        } else {
            let column = place - columns;
            (&mut update[column * below..(column + 1) * below], columns)
        };
        for (&value, &row) in column[b..].iter().zip(&places[b..]) {
            target[row as usize - shift] += value;
        }
    }
}

/// Columns are eliminated in blocks of so many.
const BLOCK: usize = 4;

/// Cholesky factorisation of the first rows of a panel and the matching solve of the rest; false
/// when a pivot is not a positive finite number.
#[inline(always)]
fn factor_panel<S: Simd>(simd: S, panel: &mut [f64], columns: usize, height: usize) -> bool {
    let mut block = 0;
    while block < columns {
        let end = (block + BLOCK).min(columns);
        for k in block..end {
            let (done, rest) = panel.split_at_mut(k * height);
            let column = &mut rest[k..height];
            for t in block..k {
                let source = &done[t * height + k..(t + 1) * height];
                subtract(simd, column, source, source[0]);
            }
            let pivot = column[0];
            if !(pivot > 0.0 && pivot.is_finite()) {
                return false;
            }
            // The inverse is kept on the diagonal: it is all that is used of it.
            let scale = 1.0 / pivot.sqrt();
            column[0] = scale;
            for value in &mut column[1..] {
                *value *= scale;
            }
        }
        if end < columns {
            let (done, rest) = panel.split_at_mut(end * height);
            let block = &done[block * height..];
            subtract_products(simd, rest, height, block, 0, end);
        }
        block = end;
    }
    true
}

/// `update -= B B^T`, lower triangle, `B` the rows of the panel below its columns.
#[inline(always)]
fn subtract_squares<S: Simd>(simd: S, update: &mut [f64], panel: &[f64], front: &Front) {
    if front.below > 0 {
        let height = front.columns + front.below;
        for block in panel.chunks(BLOCK * height) {
            subtract_products(
                simd,
                update,
                front.below,
                block,
                front.columns,
                front.columns,
            );
        }
    }
}

/// For the columns of `target`, whose first row on the diagonal is row `first` of the block:
/// subtracts the block's columns times the block's entry in that row. Two columns at a time; what
/// is above the diagonal is not used.
#[inline(always)]
fn subtract_products<S: Simd>(
    simd: S,
    target: &mut [f64],
    target_height: usize,
    block: &[f64],
    skip: usize,
    first: usize,
) {
    // The target's rows are the last rows of the block.
    let height = target_height + skip;
    if block.len() < BLOCK * height {
        for (j, column) in target.chunks_exact_mut(target_height).enumerate() {
            let row = first + j;
            for source in block.chunks_exact(height) {
                subtract(simd, &mut column[row - skip..], &source[row..], source[row]);
            }
        }
        return;
    }
    let (a, rest) = block.split_at(height);
    let (b, rest) = rest.split_at(height);
    let (c, d) = rest.split_at(height);
    let mut row = first;
    let mut pairs = target.chunks_exact_mut(2 * target_height);
    for pair in &mut pairs {
        let (one, two) = pair.split_at_mut(target_height);
        let (one, two) = (&mut one[row - skip..], &mut two[row - skip..]);
        let sources = (&a[row..], &b[row..], &c[row..], &d[row..]);
        subtract_four_twice(simd, one, two, sources);
        row += 2;
    }
    let last = pairs.into_remainder();
    if !last.is_empty() {
        for source in [a, b, c, d] {
            subtract(simd, &mut last[row - skip..], &source[row..], source[row]);
        }
    }
}

type Four<'a> = (&'a [f64], &'a [f64], &'a [f64], &'a [f64]);

/// Subtracts four columns from two, with the factors in the first and second row of the four.
#[inline(always)]
fn subtract_four_twice<S: Simd>(simd: S, one: &mut [f64], two: &mut [f64], (a, b, c, d): Four<'_>) {
    let factor = |value: f64| simd.splat_f64s(-value);
    let f = [factor(a[0]), factor(b[0]), factor(c[0]), factor(d[0])];
    let g = [factor(a[1]), factor(b[1]), factor(c[1]), factor(d[1])];
    let step = |x, factors: [S::f64s; 4], a, b, c, d| {
        let x = simd.mul_add_f64s(a, factors[0], x);
        let x = simd.mul_add_f64s(b, factors[1], x);
        let x = simd.mul_add_f64s(c, factors[2], x);
        simd.mul_add_f64s(d, factors[3], x)
    };
    let ((one, one_end), (two, two_end)) = (S::as_mut_simd_f64s(one), S::as_mut_simd_f64s(two));
    let ((a, a_end), (b, b_end)) = (S::as_simd_f64s(a), S::as_simd_f64s(b));
    let ((c, c_end), (d, d_end)) = (S::as_simd_f64s(c), S::as_simd_f64s(d));
    let sources = a.iter().zip(b).zip(c).zip(d);
    for ((one, two), (((&a, &b), &c), &d)) in one.iter_mut().zip(two).zip(sources) {
        *one = step(*one, f, a, b, c, d);
        *two = step(*two, g, a, b, c, d);
    }
    if !one_end.is_empty() {
        let [a, b] = [simd.partial_load_f64s(a_end), simd.partial_load_f64s(b_end)];
        let [c, d] = [simd.partial_load_f64s(c_end), simd.partial_load_f64s(d_end)];
        let x = step(simd.partial_load_f64s(one_end), f, a, b, c, d);
        simd.partial_store_f64s(one_end, x);
        let x = step(simd.partial_load_f64s(two_end), g, a, b, c, d);
        simd.partial_store_f64s(two_end, x);
    }
}

/// `target -= factor source`.
#[inline(always)]
fn subtract<S: Simd>(simd: S, target: &mut [f64], source: &[f64], factor: f64) {
    let factor = simd.splat_f64s(-factor);
    let (target, target_end) = S::as_mut_simd_f64s(target);
    let (source, source_end) = S::as_simd_f64s(source);
    for (target, &source) in target.iter_mut().zip(source) {
        *target = simd.mul_add_f64s(source, factor, *target);
    }
    if !target_end.is_empty() {
        let source = simd.partial_load_f64s(source_end);
        let sum = simd.mul_add_f64s(source, factor, simd.partial_load_f64s(target_end));
        simd.partial_store_f64s(target_end, sum);
    }
}

struct Solve<'a>(&'a mut Cholesky);

impl WithSimd for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Cholesky {
            fronts,
            rows,
            values,
            permuted: x,
            below,
            ..
        } = self.0;
        // L y = b
        for front in &*fronts {
            let height = front.columns + front.below;
            let own = &mut x[front.column..front.column + front.columns];
            let panel = &values[front.value..front.value + front.columns * height];
            for (k, column) in panel.chunks_exact(height).enumerate() {
                own[k] *= column[k];
                let y = own[k];
                for (own, inside) in own[k + 1..].iter_mut().zip(&column[k + 1..]) {
                    *own -= inside * y;
                }
            }
            if front.below > 0 {
                let below = &mut below[..front.below];
                below.fill(0.0);
                let blocks = panel.chunks(BLOCK * height).zip(own.chunks(BLOCK));
                for (block, y) in blocks {
                    subtract_combination(simd, below, block, height, front.columns, y);
                }
                for (&value, &row) in below.iter().zip(&rows[front.row..]) {
                    x[row as usize] += value;
                }
            }
        }
        // L^T x = y
        for front in fronts.iter().rev() {
            let height = front.columns + front.below;
            let below = &mut below[..front.below];
            for (value, &row) in below.iter_mut().zip(&rows[front.row..]) {
                *value = x[row as usize];
            }
            let own = &mut x[front.column..front.column + front.columns];
            let panel = &values[front.value..front.value + front.columns * height];
            if front.below > 0 {
                for (column, own) in panel.chunks_exact(height).zip(&mut *own) {
                    *own -= dot(simd, &column[front.columns..], below);
                }
            }
            for (k, column) in panel.chunks_exact(height).enumerate().rev() {
                let mut sum = own[k];
                for (own, inside) in own[k + 1..].iter().zip(&column[k + 1..]) {
                    sum -= inside * own;
                }
                own[k] = sum * column[k];
            }
        }
    }
}

/// Subtracts the block's columns, from row `skip` on, times `factors`.
#[inline(always)]
fn subtract_combination<S: Simd>(
    simd: S,
    target: &mut [f64],
    block: &[f64],
    height: usize,
    skip: usize,
    factors: &[f64],
) {
    let &[fa, fb, fc, fd] = factors else {
        for (column, &factor) in block.chunks_exact(height).zip(factors) {
            subtract(simd, target, &column[skip..], factor);
        }
        return;
    };
    let column = |k: usize| S::as_simd_f64s(&block[k * height + skip..(k + 1) * height]);
    let ((a, a_end), (b, b_end)) = (column(0), column(1));
    let ((c, c_end), (d, d_end)) = (column(2), column(3));
    let factor = |value: f64| simd.splat_f64s(-value);
    let (fa, fb, fc, fd) = (factor(fa), factor(fb), factor(fc), factor(fd));
    let step = |x, a, b, c, d| {
        let x = simd.mul_add_f64s(a, fa, x);
        let x = simd.mul_add_f64s(b, fb, x);
        let x = simd.mul_add_f64s(c, fc, x);
        simd.mul_add_f64s(d, fd, x)
    };
    let (target, target_end) = S::as_mut_simd_f64s(target);
    let sources = a.iter().zip(b).zip(c).zip(d);
    for (target, (((&a, &b), &c), &d)) in target.iter_mut().zip(sources) {
        *target = step(*target, a, b, c, d);
    }
    if !target_end.is_empty() {
        let [a, b] = [simd.partial_load_f64s(a_end), simd.partial_load_f64s(b_end)];
        let [c, d] = [simd.partial_load_f64s(c_end), simd.partial_load_f64s(d_end)];
        let x = step(simd.partial_load_f64s(target_end), a, b, c, d);
        simd.partial_store_f64s(target_end, x);
    }
}

#[inline(always)]
fn dot<S: Simd>(simd: S, a: &[f64], b: &[f64]) -> f64 {
    let ((a, a_end), (b, b_end)) = (S::as_simd_f64s(a), S::as_simd_f64s(b));
    let [a_end, b_end] = [simd.partial_load_f64s(a_end), simd.partial_load_f64s(b_end)];
    let mut sum = simd.mul_f64s(a_end, b_end);
    for (&a, &b) in a.iter().zip(b) {
        sum = simd.mul_add_f64s(a, b, sum);
    }
    simd.reduce_sum_f64s(sum)
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

/// `ROWS` rows of the product, three vectors at a time.
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
    while first + 3 * S::F64_LANES <= columns {
        multiply_tile::<S, ROWS, 3>(simd, a, b, inner, c, first);
        first += 3 * S::F64_LANES;
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

    fn assemble(n: usize, matrix: &[((u32, u32), f64)]) -> Cholesky {
        let pattern: Vec<(u32, u32)> = matrix.iter().map(|&(entry, _)| entry).collect();
        let (mut cholesky, slots) = Cholesky::analyse(n, &pattern).unwrap();
        set(&mut cholesky, &slots, matrix);
        cholesky
    }

    fn set(cholesky: &mut Cholesky, slots: &[u32], matrix: &[((u32, u32), f64)]) {
        cholesky.values_mut().fill(0.0);
        for (&slot, &(_, value)) in slots.iter().zip(matrix) {
            cholesky.values_mut()[slot as usize] = value;
        }
    }

    #[test]
    fn solves_to_rounding() {
        for n in [1, 2, 5, 17, 40] {
            let matrix = grid_matrix(n, 4.5);
            let mut cholesky = assemble(n * n, &matrix);
            cholesky.factor().unwrap();
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
        let pattern: Vec<(u32, u32)> = good.iter().map(|&(entry, _)| entry).collect();
        let (mut cholesky, slots) = Cholesky::analyse(n * n, &pattern).unwrap();
        for bad in [-1.0, 0.0, f64::NAN, f64::INFINITY] {
            let mut matrix = good.clone();
            matrix[100].1 = if matrix[100].0.0 == matrix[100].0.1 {
                bad
            } else {
                f64::NAN
            };
            set(&mut cholesky, &slots, &matrix);
            assert!(matches!(cholesky.factor(), Err(Error::Factorisation(_))));
        }
        set(&mut cholesky, &slots, &good);
        cholesky.factor().unwrap();
    }
}
