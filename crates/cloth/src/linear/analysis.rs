//! Order and fronts of a pattern: the only file that names faer.

use faer::Side;
use faer::perm::PermRef;
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::linalg::{SupernodalThreshold, SymbolicSupernodalParams};

use selvedge_math::DVec3;

use super::cholesky::{Cholesky, Front};
use super::order::dissect;
use super::simd::BLOCK;
use crate::Error;

/// Neighbouring columns are joined into one front of up to so many columns as long as the share of
/// zeros this stores stays below the bound; measured on sheets of 644 nodes.
const RELAX: [(usize, f64); 4] = [(4, 0.5), (16, 0.3), (48, 0.1), (usize::MAX, 0.05)];

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
        Self::analyse_in_order(n, entries, SymmetricOrdering::Amd)
    }

    /// The same for unknowns that are at places in space, each a neighbour of those it meets in the
    /// matrix: of a large mesh, the factor is smaller by a tenth and takes a third less to make.
    ///
    /// # Errors
    /// As [`analyse`](Self::analyse).
    ///
    /// # Panics
    /// When there is no place for an index.
    pub fn analyse_in_space(entries: &[(u32, u32)], places: &[DVec3]) -> Result<Self, Error> {
        let n = places.len();
        let order = dissect(entries, places);
        let mut position = vec![0; n];
        for (k, &unknown) in (0u32..).zip(&order) {
            position[unknown as usize] = k;
        }
        let order = PermRef::new_checked(&order, &position, n);
        Self::analyse_in_order(n, entries, SymmetricOrdering::Custom(order))
    }

    fn analyse_in_order(
        n: usize,
        entries: &[(u32, u32)],
        ordering: SymmetricOrdering<'_, u32>,
    ) -> Result<Self, Error> {
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
        let (mut rows, mut places, mut all_children) = (Vec::new(), Vec::new(), Vec::new());
        let (mut size, mut longest) = (0, 0);
        // Present and greatest heights of the two stacks of update matrices.
        let (mut used, mut needed) = ([0, 0], [0, 0]);
        for &(s, depth) in &order {
            number[s] = fronts.len();
            let pattern = supernodes.supernode(s).pattern();
            rows.extend(pattern.iter().map(|&row| padded[row as usize]));
            let front = Front {
                column: padded[begin[s]] as usize,
                columns: end[s] - begin[s],
                row: rows.len() - pattern.len(),
                below: pattern.len(),
                panel: size,
                update: used[depth % 2],
                stack: depth % 2,
                first_entry: 0,
                last_entry: 0,
                first_child: all_children.len(),
                last_child: all_children.len() + children[s].len(),
                shared: 0,
            };
            let bottom = front.bottom();
            size += front.columns * front.height();
            longest = bottom.max(longest);

            places.resize(rows.len(), 0);
            for &child in &children[s] {
                all_children.push(number[child] as u32);
                let child_rows = supernodes.supernode(child).pattern();
                let child = &mut fronts[number[child]];
                for (place, &row) in places[child.row..].iter_mut().zip(child_rows) {
                    *place = place_in_front(begin[s], end[s], pattern, row) as u32;
                }
                let own = |row: &&u32| (**row as usize) < end[s];
                child.shared = child_rows.iter().take_while(own).count();
                used[child.stack] -= child.bottom() * child.bottom();
            }
            used[front.stack] += bottom * bottom;
            needed[front.stack] = used[front.stack].max(needed[front.stack]);
            fronts.push(front);
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
            places,
            children: all_children,
            panels: vec![0.0; size],
            waiting: needed.map(|size| vec![0.0; size]),
            padded: unknowns,
            unknowns: Vec::new(),
            local: vec![0.0; longest],
            points: vec![[0.0; 4]; unknowns],
            below: vec![[0.0; 4]; longest],
        })
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
