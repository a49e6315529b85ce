//! A part of the tree of eliminations, and what it keeps.

use super::points::Point;
use super::simd::{BLOCK, Stored};
use super::solve::Unknown;

/// The entries of a factor, in double or in single precision.
#[derive(Debug)]
pub(super) enum Panels {
    Double(Vec<f64>),
    Single(Vec<f32>),
}

impl Default for Panels {
    fn default() -> Self {
        Self::Double(Vec::new())
    }
}

impl Panels {
    pub(super) fn len(&self) -> usize {
        match self {
            Self::Double(panels) => panels.len(),
            Self::Single(panels) => panels.len(),
        }
    }

    /// Keeps the panel of a front that was factored column by column.
    #[inline(always)]
    pub(super) fn keep(&mut self, front: &Front, panel: &[f64]) {
        match self {
            Self::Double(panels) => keep(&mut panels[front.panel..], front, panel),
            Self::Single(panels) => keep(&mut panels[front.panel..], front, panel),
        }
    }
}

#[inline(always)]
fn keep<T: Stored>(kept: &mut [T], front: &Front, panel: &[f64]) {
    let (height, stride) = (front.height(), front.panel_stride());
    let mut kept = kept.chunks_exact_mut(BLOCK);
    for (k, columns) in panel.chunks(BLOCK * stride).enumerate() {
        for row in (k * BLOCK..height).step_by(BLOCK) {
            for (column, kept) in columns.chunks_exact(stride).zip(&mut kept) {
                for (kept, &value) in kept.iter_mut().zip(&column[row..row + BLOCK]) {
                    *kept = T::nearest(value);
                }
            }
        }
    }
}

/// [`BLOCK`] rows of a block of so many columns, column by column.
pub(super) type Tile<T, const COLUMNS: usize> = [[T; BLOCK]; COLUMNS];

/// What a tree is solved for.
#[derive(Debug, Default)]
pub(super) struct Unknowns<U> {
    /// Its own by front, each front's padded with zeros like its columns; then, of a branch, those of the
    /// trunk.
    pub(super) all: Vec<U>,
    /// Those of one front and those below.
    pub(super) local: Vec<U>,
}

impl<U: Unknown> Unknowns<U> {
    pub(super) fn zeros(all: usize, local: usize) -> Self {
        Self {
            all: vec![U::ZERO; all],
            local: vec![U::ZERO; local],
        }
    }
}

/// A branch, or the trunk on which all branches hang.
#[derive(Debug, Default)]
pub(super) struct Tree {
    /// Children before parents.
    pub(super) fronts: Vec<Front>,
    /// Entries of the matrix by front: which of the values, and its place in the panel.
    pub(super) entries: Vec<[u32; 2]>,
    /// Rows below the columns of each front, by their places among the unknowns.
    pub(super) rows: Vec<u32>,
    /// The place of each of those rows in the parent: among its columns or, after those, below them.
    pub(super) places: Vec<u32>,
    /// The children of each front.
    pub(super) children: Vec<u32>,
    /// The branches that hang on each front.
    pub(super) grafts: Vec<u32>,
    /// The panel of each front, block by block: of each the rows from its own first on, those in the
    /// columns of the front and those below, both padded, in tiles of [`BLOCK`] rows, column by column.
    /// Triangles on the diagonal are inverted; above them are zeros.
    pub(super) panels: Panels,
    /// The panel that is being factored, column by column.
    pub(super) work: Vec<f64>,
    /// Update matrices waiting for their parents, by parity of the depth.
    pub(super) waiting: [Vec<f64>; 2],
    /// Whether all pivots of the last factorisation were positive.
    pub(super) definite: bool,
    /// Its own unknowns with the rows of the matrix that they are.
    pub(super) members: Vec<[u32; 2]>,
    /// How many unknowns are its own, padded.
    pub(super) own: usize,
    pub(super) numbers: Unknowns<f64>,
    pub(super) points: Unknowns<Point>,
}

impl Tree {
    /// Takes its own unknowns from a right hand side; the others are zero.
    pub(super) fn gather<U: Unknown>(&mut self, rhs: &[U::Given]) {
        let Unknowns { all, .. } = U::of(&mut self.numbers, &mut self.points);
        // The padding too, where an earlier right hand side may have left what is not a number.
        all.fill(U::ZERO);
        for &[unknown, row] in &self.members {
            all[unknown as usize] = U::inside(rhs[row as usize]);
        }
    }

    /// Puts them back.
    pub(super) fn scatter<U: Unknown>(&mut self, solution: &mut [U::Given]) {
        let Unknowns { all, .. } = U::of(&mut self.numbers, &mut self.points);
        for &[unknown, row] in &self.members {
            solution[row as usize] = all[unknown as usize].outside();
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Front {
    /// Its first column, by its place among the unknowns.
    pub(super) column: usize,
    pub(super) columns: usize,
    /// Where the rows below begin, and how many there are.
    pub(super) row: usize,
    pub(super) below: usize,
    /// Where the panel begins.
    pub(super) panel: usize,
    /// Where its update matrix lies on which of the two stacks.
    pub(super) update: usize,
    pub(super) stack: usize,
    /// Its range of `entries`.
    pub(super) first_entry: usize,
    pub(super) last_entry: usize,
    /// Its range of `children`.
    pub(super) first_child: usize,
    pub(super) last_child: usize,
    /// Its range of `grafts`.
    pub(super) first_graft: usize,
    pub(super) last_graft: usize,
    /// How many of the rows below are columns of the parent.
    pub(super) shared: usize,
}

impl Front {
    /// Padded number of columns: where the rows below begin in a column of the panel.
    pub(super) fn top(&self) -> usize {
        self.columns.next_multiple_of(BLOCK)
    }

    /// Padded number of rows below.
    pub(super) fn bottom(&self) -> usize {
        self.below.next_multiple_of(BLOCK)
    }

    pub(super) fn height(&self) -> usize {
        self.top() + self.bottom()
    }

    pub(super) fn blocks(&self) -> usize {
        self.columns.div_ceil(BLOCK)
    }

    /// How far apart columns of the panel that is being factored are: the last vector of a column may
    /// reach into a block more than there is.
    pub(super) fn panel_stride(&self) -> usize {
        self.height() + BLOCK
    }

    /// The same of the update matrix.
    pub(super) fn update_stride(&self) -> usize {
        self.bottom() + BLOCK
    }

    /// How many entries its update matrix has.
    pub(super) fn update_entries(&self) -> usize {
        self.bottom() * self.update_stride()
    }

    /// How many entries its panel has.
    pub(super) fn entries(&self) -> usize {
        let full = self.columns / BLOCK;
        self.start(full) + self.columns % BLOCK * (self.height() - full * BLOCK)
    }

    /// How many columns a block has, and its entries of all panels of the tree.
    #[inline(always)]
    pub(super) fn block<'a, T>(&self, panels: &'a [T], block: usize) -> (usize, &'a [T]) {
        let first = block * BLOCK;
        let columns = BLOCK.min(self.columns - first);
        let panel = &panels[self.panel + self.start(block)..];
        (columns, &panel[..columns * (self.height() - first)])
    }

    /// Where a block begins in the panel.
    fn start(&self, block: usize) -> usize {
        // Those before it have all columns, and each a tile less than the one before.
        let tiles = block * (self.height() / BLOCK) - block * block.saturating_sub(1) / 2;
        tiles * BLOCK * BLOCK
    }

    /// Its rows below, of those of the tree.
    pub(super) fn rows<'a>(&self, rows: &'a [u32]) -> &'a [u32] {
        &rows[self.row..][..self.below]
    }
}
