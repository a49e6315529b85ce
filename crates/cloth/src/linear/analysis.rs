//! Order and fronts of a pattern: the only file that names faer.

use faer::Side;
use faer::perm::PermRef;
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::linalg::{SupernodalThreshold, SymbolicSupernodalParams};

use selvedge_math::DVec3;

use super::cholesky::Cholesky;
use super::order::dissect;
use super::simd::BLOCK;
use super::threads::Threads;
use super::tree::{Front, Panels, Tree, Unknowns};
use crate::Error;

/// Neighbouring columns are joined into one front of up to so many columns as long as the share of
/// zeros this stores stays below the bound; measured on sheets of 644 nodes.
const RELAX: [(usize, f64); 4] = [(4, 0.5), (16, 0.3), (48, 0.1), (usize::MAX, 0.05)];

/// A matrix of less work [multiplications] has no branches.
const MIN_WORK: f64 = 1e7;
/// What share of the work a branch may be: four that are as large leave little for the trunk.
const MIN_SHARE: f64 = 0.01;
const MAX_SHARE: f64 = 0.26;

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
        let [begin, end] = [supernodes.supernode_begin(), supernodes.supernode_end()]
            .map(|bounds| bounds.iter().map(|&k| k as usize).collect::<Vec<_>>());
        let below = |s: usize| supernodes.supernode(s).pattern();
        let mut front_of = vec![0; n];
        for s in 0..count {
            front_of[begin[s]..end[s]].fill(s);
        }
        let parents: Vec<Option<usize>> = (0..count)
            .map(|s| below(s).first().map(|&row| front_of[row as usize]))
            .collect();
        let mut children = vec![Vec::new(); count];
        for (s, parent) in parents.iter().enumerate() {
            if let Some(parent) = *parent {
                children[parent].push(s);
            }
        }
        let order = children_first(&parents, &children);
        let work = |s: usize| {
            let columns = (end[s] - begin[s]) as f64;
            columns * (columns + below(s).len() as f64).powi(2)
        };
        let (tree_of, branch_count) = branches(&order, &parents, work);

        // The places of the columns among the unknowns of their trees
        let mut trees: Vec<Tree> = (0..=branch_count).map(|_| Tree::default()).collect();
        let mut unknown = vec![0u32; n];
        for &(s, _) in &order {
            let tree = &mut trees[tree_of[s]];
            for (place, column) in (tree.own..).zip(begin[s]..end[s]) {
                unknown[column] = place as u32;
            }
            tree.own += (end[s] - begin[s]).next_multiple_of(BLOCK);
        }
        for (row, &column) in (0u32..).zip(&position) {
            let tree = &mut trees[tree_of[front_of[column as usize]]];
            tree.members.push([unknown[column as usize], row]);
        }

        // Fronts in that order, with the place of each row in the parent
        let mut number = vec![0; count];
        let mut sizes = vec![Sizes::default(); trees.len()];
        for &(s, depth) in &order {
            let own = tree_of[s];
            let tree = &mut trees[own];
            let pattern = below(s);
            let (row, columns) = (tree.rows.len(), end[s] - begin[s]);
            tree.rows.extend(pattern.iter().map(|&row| {
                let above = tree_of[front_of[row as usize]] != own;
                unknown[row as usize] + if above { tree.own as u32 } else { 0 }
            }));
            tree.places.resize(tree.rows.len(), 0);
            let (first_child, first_graft) = (tree.children.len(), tree.grafts.len());
            for &child in &children[s] {
                match tree_of[child] == own {
                    true => tree.children.push(number[child]),
                    false => tree.grafts.push(tree_of[child] as u32),
                }
            }
            let size = &mut sizes[own];
            let front = Front {
                column: unknown[begin[s]] as usize,
                columns,
                row,
                below: pattern.len(),
                panel: size.panels,
                update: size.used[depth % 2],
                stack: depth % 2,
                first_entry: 0,
                last_entry: 0,
                first_child,
                last_child: tree.children.len(),
                first_graft,
                last_graft: tree.grafts.len(),
                shared: 0,
            };
            size.panels += front.entries();
            size.panel = size.panel.max(front.columns * front.panel_stride());
            size.tallest = front.height().max(size.tallest);
            number[s] = tree.fronts.len() as u32;
            tree.fronts.push(front);
            for &child in &children[s] {
                let tree = &mut trees[tree_of[child]];
                let rows = below(child);
                let own_child = tree_of[child] == own;
                let child = &mut tree.fronts[number[child] as usize];
                for (place, &row) in tree.places[child.row..].iter_mut().zip(rows) {
                    *place = place_in_front(begin[s], end[s], pattern, row) as u32;
                }
                let shared = |row: &&u32| (**row as usize) < end[s];
                child.shared = rows.iter().take_while(shared).count();
                if own_child {
                    sizes[own].used[child.stack] -= child.update_entries();
                }
            }
            let size = &mut sizes[own];
            size.used[front.stack] += front.update_entries();
            size.needed[front.stack] = size.used[front.stack].max(size.needed[front.stack]);
        }

        // The entries by front
        let mut sorted: Vec<(usize, u32, [u32; 2])> = (0u32..)
            .zip(entries)
            .map(|(k, &(a, b))| {
                let (a, b) = (position[a as usize], position[b as usize]);
                let (row, column) = (a.max(b), a.min(b) as usize);
                let s = front_of[column];
                let front = &trees[tree_of[s]].fronts[number[s] as usize];
                let place = place_in_front(begin[s], end[s], below(s), row);
                let place = (column - begin[s]) * front.panel_stride() + place;
                (tree_of[s], number[s], [k, place as u32])
            })
            .collect();
        sorted.sort_unstable();
        for (tree, number, entry) in sorted {
            let tree = &mut trees[tree];
            let front = &mut tree.fronts[number as usize];
            if front.last_entry == 0 {
                front.first_entry = tree.entries.len();
            }
            tree.entries.push(entry);
            front.last_entry = tree.entries.len();
        }

        let above = trees[branch_count].own;
        for (k, (tree, size)) in trees.iter_mut().zip(sizes).enumerate() {
            let all = tree.own + if k < branch_count { above } else { 0 };
            tree.panels = Panels::Double(vec![0.0; size.panels]);
            tree.work = vec![0.0; size.panel];
            tree.waiting = size.needed.map(|size| vec![0.0; size]);
            tree.numbers = Unknowns::zeros(all, size.tallest);
            tree.points = Unknowns::zeros(all, size.tallest);
        }
        let trunk = trees.pop().unwrap_or_default();
        Ok(Self {
            branches: trees,
            trunk,
            threads: Threads::default(),
        })
    }
}

/// What a tree needs, so far.
#[derive(Clone, Default)]
struct Sizes {
    panels: usize,
    /// Entries of the largest while it is factored.
    panel: usize,
    /// Height of the tallest front.
    tallest: usize,
    /// Present and greatest heights of the two stacks of update matrices.
    used: [usize; 2],
    needed: [usize; 2],
}

/// The tree that each front belongs to, the branches' numbers before the trunk's, and how many branches there
/// are: parts of the work that are neither too large for others to be done at the same time, nor too small to be
/// worth it.
fn branches(
    order: &[(usize, usize)],
    parents: &[Option<usize>],
    work: impl Fn(usize) -> f64,
) -> (Vec<usize>, usize) {
    let mut subtree = vec![0.0; order.len()];
    let mut all = 0.0;
    for &(s, _) in order {
        subtree[s] += work(s);
        match parents[s] {
            Some(parent) => subtree[parent] += subtree[s],
            None => all += subtree[s],
        }
    }
    let trunk = usize::MAX;
    let mut tree_of = vec![trunk; order.len()];
    let mut count = 0;
    for &(s, _) in order.iter().rev() {
        let over = parents[s].map_or(trunk, |parent| tree_of[parent]);
        let share = subtree[s] / all;
        tree_of[s] = if over == trunk && all > MIN_WORK && MIN_SHARE < share && share < MAX_SHARE {
            count += 1;
            count - 1
        } else {
            over
        };
    }
    for tree in &mut tree_of {
        *tree = (*tree).min(count);
    }
    (tree_of, count)
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
fn children_first(parents: &[Option<usize>], children: &[Vec<usize>]) -> Vec<(usize, usize)> {
    let mut order = Vec::with_capacity(children.len());
    let roots = (0..parents.len()).filter(|&s| parents[s].is_none());
    let mut open: Vec<(usize, usize)> = roots.rev().map(|root| (root, 0)).collect();
    while let Some((s, depth)) = open.pop() {
        order.push((s, depth));
        open.extend(children[s].iter().map(|&child| (child, depth + 1)));
    }
    // Parents came before children, and the last child first: backwards it is a postorder.
    order.reverse();
    order
}
