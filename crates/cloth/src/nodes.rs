//! What a node does with a force in one substep: its inverse mass, and the directions in which a
//! hand or an obstacle keeps it.

use selvedge_math::DVec3;

/// How a node is kept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Kept {
    /// It moves freely.
    Free,
    /// It stays on a plane with this normal.
    OnPlane(DVec3),
    /// It is where it must be.
    Fixed,
    /// It sticks to a surface with this normal, as long as friction can hold it.
    Sticks(DVec3),
}

/// Masses and ties of all nodes, for one length of the substep.
///
/// A force `f` on a free node moves it by `f / D` with `D = 2 m/h^2 + c/h`, from the implicit
/// midpoint rule for its mass `m` and drag `c`. What a tie does not let through is taken by its
/// reaction.
#[derive(Clone, Debug)]
pub(crate) struct Nodes {
    inverse: Vec<f64>,
    pub(crate) kept: Vec<Kept>,
    pub(crate) looseness: f64,
    /// Forces of the ties [N].
    pub(crate) reactions: Vec<DVec3>,
    /// How far hands give way to layers that nothing else can move [m].
    pub(crate) yielded: Vec<DVec3>,
}

impl Nodes {
    pub(crate) fn new(node_count: usize) -> Self {
        Self {
            inverse: vec![0.0; node_count],
            kept: vec![Kept::Free; node_count],
            looseness: 1.0,
            reactions: vec![DVec3::ZERO; node_count],
            yielded: vec![DVec3::ZERO; node_count],
        }
    }

    pub(crate) fn inverse(&self, node: usize) -> f64 {
        self.inverse[node]
    }

    pub(crate) fn set_inverse(&mut self, node: usize, inverse: f64) {
        self.inverse[node] = inverse;
    }

    pub(crate) fn sticks(&self, node: usize) -> bool {
        matches!(self.kept[node], Kept::Sticks(_))
    }

    /// The displacement that a force may give in the end: a node that sticks may have to slide. The
    /// rows reckon with the share `looseness` of its mobility, so that forces on sticking nodes grow
    /// from one iteration to the next no faster than it takes to find out.
    #[inline]
    pub(crate) fn prospect(&self, node: usize, force: DVec3) -> DVec3 {
        match self.kept[node] {
            Kept::Sticks(normal) => {
                let share = self.looseness * self.inverse[node];
                (force - normal * normal.dot(force)) * share
            }
            _ => self.respond(node, force),
        }
    }

    /// How far a unit force along `normal` would move the node that way if it left its surface or,
    /// when the force presses it on, slid on it.
    pub(crate) fn prospect_along(&self, node: usize, normal: DVec3) -> f64 {
        match self.kept[node] {
            Kept::Fixed => 0.0,
            Kept::Sticks(own) | Kept::OnPlane(own) => {
                let pressed = own.dot(normal).min(0.0);
                self.inverse[node] * (1.0 - pressed * pressed)
            }
            Kept::Free => self.inverse[node],
        }
    }

    /// The displacement that a force gives.
    #[inline]
    pub(crate) fn respond(&self, node: usize, force: DVec3) -> DVec3 {
        match self.kept[node] {
            Kept::Free => force * self.inverse[node],
            Kept::OnPlane(normal) => (force - normal * normal.dot(force)) * self.inverse[node],
            Kept::Fixed | Kept::Sticks(_) => DVec3::ZERO,
        }
    }

    /// How far a unit force moves the node in a direction that its tie leaves free.
    #[inline]
    pub(crate) fn mobility(&self, node: usize) -> f64 {
        match self.kept[node] {
            Kept::Fixed | Kept::Sticks(_) => 0.0,
            _ => self.inverse[node],
        }
    }

    /// Moves the node by what a force gives, and lets its tie take the rest.
    #[inline]
    pub(crate) fn push(&mut self, node: usize, force: DVec3, x: &mut DVec3) {
        match self.kept[node] {
            Kept::Free => *x += force * self.inverse[node],
            Kept::OnPlane(normal) => {
                let taken = normal * normal.dot(force);
                *x += (force - taken) * self.inverse[node];
                self.reactions[node] -= taken;
            }
            Kept::Fixed | Kept::Sticks(_) => self.reactions[node] -= force,
        }
    }

    /// Puts the node where its tie wants it, in the directions of the tie; how far that was.
    #[inline]
    pub(crate) fn place(&mut self, node: usize, target: DVec3, x: &mut DVec3) {
        let shift = match self.kept[node] {
            Kept::Free => return,
            Kept::OnPlane(normal) => normal * normal.dot(target - *x),
            Kept::Fixed | Kept::Sticks(_) => target - *x,
        };
        *x += shift;
        self.reactions[node] += shift / self.inverse[node];
    }
}
