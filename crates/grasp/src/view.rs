//! What a gripper sees of a cloth.

use selvedge_math::DVec3;

/// A cloth as a gripper sees it: node positions, and which nodes make its edges and faces.
///
/// The slices are borrowed from the simulator and nothing is copied. Any of them may be empty: a
/// cloth without edges and faces is grasped by its nodes alone. Indices are checked when the jaws
/// close, the only moment at which edges and faces are read.
///
/// ```
/// use selvedge_grasp::{ClothView, DVec3};
/// let positions = [DVec3::ZERO, DVec3::X];
/// let cloth = ClothView { positions: &positions, edges: &[[0, 1]], ..ClothView::default() };
/// assert!(cloth.quads.is_empty());
/// ```
#[derive(Clone, Copy, Debug, Default)]
pub struct ClothView<'a> {
    /// Node positions \[m\], world frame, one a node.
    pub positions: &'a [DVec3],
    /// The two nodes of each edge.
    pub edges: &'a [[u32; 2]],
    /// The four nodes of each quadrilateral face.
    pub quads: &'a [[u32; 4]],
    /// The three nodes of each triangular face.
    pub triangles: &'a [[u32; 3]],
}
