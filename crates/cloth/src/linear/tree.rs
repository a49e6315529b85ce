//! A part of the tree of eliminations, and what it keeps.

use selvedge_math::DVec3;

use super::points::Point;
use super::simd::{BLOCK, Stored};

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

    /// Keeps the panel that begins at `start`.
    #[inline(always)]
    pub(super) fn keep(&mut self, start: usize, panel: &[f64]) {
        match self {
            Self::Double(panels) => keep(&mut panels[start..], panel),
            Self::Single(panels) => keep(&mut panels[start..], panel),
        }
    }
}

#[inline(always)]
fn keep<T: Stored>(kept: &mut [T], panel: &[f64]) {
    for (kept, &value) in kept.iter_mut().zip(panel) {
        *kept = T::nearest(value);
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
    /// The panel of each front, column by column: its rows in the columns of the front, then those
    /// below, each part padded. Triangles on the diagonal, of a block each, are inverted; above them is
    /// nothing of use.
    pub(super) panels: Panels,
    /// The panel that is being factored.
    pub(super) work: Vec<f64>,
    /// Update matrices waiting for their parents, by parity of the depth.
    pub(super) waiting: [Vec<f64>; 2],
    /// Whether all pivots of the last factorisation were positive.
    pub(super) definite: bool,
    /// Its own unknowns with the rows of the matrix that they are.
    pub(super) members: Vec<[u32; 2]>,
    /// How many unknowns are its own, each front's padded with zeros like its columns.
    pub(super) own: usize,
    /// Its own unknowns by front; then, of a branch, those of the trunk.
    pub(super) unknowns: Vec<f64>,
    /// The part below of one column.
    pub(super) local: Vec<f64>,
    /// The same two for points.
    pub(super) points: Vec<Point>,
    pub(super) below: Vec<Point>,
}

impl Tree {
    /// Takes its own unknowns from a right hand side; the others are zero.
    pub(super) fn gather(&mut self, rhs: &[f64]) {
        // The padding too, where an earlier right hand side may have left what is not a number.
        self.unknowns.fill(0.0);
        for &[unknown, row] in &self.members {
            self.unknowns[unknown as usize] = rhs[row as usize];
        }
    }

    /// The same for points.
    pub(super) fn gather_points(&mut self, rhs: &[DVec3]) {
        self.points.fill([0.0; 4]);
        for &[unknown, row] in &self.members {
            let point = rhs[row as usize];
            self.points[unknown as usize] = [point.x, point.y, point.z, 0.0];
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

    /// Its panel and its rows below, of those of the tree.
    pub(super) fn parts<'a, T>(&self, panels: &'a [T], rows: &'a [u32]) -> (&'a [T], &'a [u32]) {
        (
            &panels[self.panel..][..self.columns * self.height()],
            &rows[self.row..][..self.below],
        )
    }
}
