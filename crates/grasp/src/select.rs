//! Which nodes a closing gripper catches.

use alloc::vec::Vec;

use selvedge_math::{DVec3, Pose};

use crate::{ClothView, Error, GraspVolume};

/// Through which rules a node came into the support.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Rules {
    /// The node itself is inside: `i` in `I^n`.
    pub node: bool,
    /// The centre of one of its edges is inside: `i` in `I^e`.
    pub edge: bool,
    /// The centre of one of its faces is inside: `i` in `I^f`.
    pub face: bool,
}

/// The nodes that [`select`] found, with the buffers it needs to find them.
///
/// Made empty by `default()`, and worth keeping: the buffers grow to the size of the cloth once.
#[derive(Clone, Debug, Default)]
pub struct Support {
    nodes: Vec<u32>,
    rules: Vec<Rules>,
    /// Every node of the cloth in the gripper frame \[m\].
    local: Vec<DVec3>,
    /// On which sides of the volume's bounding box each node lies, see [`outcode`].
    codes: Vec<u8>,
    /// The rules of every node of the cloth; all false but for `nodes`.
    found: Vec<Rules>,
}

impl Support {
    /// The nodes of the support, ascending and each once.
    pub fn nodes(&self) -> &[u32] {
        &self.nodes
    }

    /// Through which rules each of [`Support::nodes`] came.
    pub fn rules(&self) -> &[Rules] {
        &self.rules
    }

    /// The position \[m\] of a node in the gripper frame, for the cloth of the last selection.
    pub(crate) fn local(&self, node: u32) -> DVec3 {
        self.local[node as usize]
    }

    /// Takes the nodes out for which `refused` is true.
    pub(crate) fn refuse(&mut self, mut refused: impl FnMut(u32) -> bool) {
        let mut kept = 0;
        for k in 0..self.nodes.len() {
            let node = self.nodes[k];
            if refused(node) {
                self.found[node as usize] = Rules::default();
            } else {
                self.nodes[kept] = node;
                self.rules[kept] = self.rules[k];
                kept += 1;
            }
        }
        self.nodes.truncate(kept);
        self.rules.truncate(kept);
    }

    fn clear(&mut self) {
        for &node in &self.nodes {
            self.found[node as usize] = Rules::default();
        }
        self.nodes.clear();
        self.rules.clear();
    }
}

/// Finds the grasp support of a volume at a pose (eq. `support_union` of the paper):
/// `I = I^n + I^e + I^f`, the nodes inside the volume, both nodes of each edge whose centre is
/// inside, and the nodes of each face whose centre is inside.
///
/// A centre is the mean of its nodes' positions in the gripper frame. The result replaces what
/// `support` held before.
///
/// # Errors
/// [`Error::Pose`] when the position of the gripper is not finite; [`Error::Position`] when that of
/// any node is not (it could be neither inside nor outside); [`Error::NodeOutOfRange`] when an edge
/// or a face names a node that does not exist. The support is then empty.
///
/// ```
/// use selvedge_grasp::{ClothView, DVec3, GraspVolume, Pose, Shape, Support, select};
/// // The volume lies between two nodes and catches both through the edge that joins them.
/// let cloth = ClothView { positions: &[DVec3::ZERO, DVec3::X], edges: &[[0, 1]], ..ClothView::default() };
/// let volume = GraspVolume::new(Shape::Box { size: DVec3::splat(0.1) }, DVec3::ZERO)?;
/// let mut support = Support::default();
/// select(&volume, &Pose::from_translation(DVec3::X * 0.5), cloth, &mut support)?;
/// assert_eq!(support.nodes(), [0, 1]);
/// assert!(support.rules()[0].edge && !support.rules()[0].node);
/// # Ok::<(), selvedge_grasp::Error>(())
/// ```
pub fn select(
    volume: &GraspVolume,
    pose: &Pose,
    cloth: ClothView<'_>,
    support: &mut Support,
) -> Result<(), Error> {
    support.clear();
    let result = search(volume, pose, cloth, support);
    if result.is_err() {
        support.clear();
        return result;
    }
    support.nodes.sort_unstable();
    for &node in &support.nodes {
        support.rules.push(support.found[node as usize]);
    }
    Ok(())
}

/// Marks the nodes of the support and lists them in no order.
fn search(
    volume: &GraspVolume,
    pose: &Pose,
    cloth: ClothView<'_>,
    support: &mut Support,
) -> Result<(), Error> {
    let ClothView {
        positions,
        edges,
        quads,
        triangles,
    } = cloth;

    // An edge or a face whose nodes all lie beyond one side of the bounding box is passed over
    // without arithmetic. No centre that `contains` would accept is lost: rounding is monotone, so
    // a computed mean lies below the smallest of its nodes (or above the largest) by a few roundings
    // of that coordinate at most, and the bounds are wider than the volume by more.
    let (low, high) = volume.bounds();
    let margin = 16.0 * f64::EPSILON * low.abs().max(high.abs());
    let (low, high) = (low - margin, high + margin);

    if !pose.position().is_finite() {
        return Err(Error::Pose(pose.position()));
    }
    support.found.resize(positions.len(), Rules::default());
    let Support {
        nodes,
        local,
        codes,
        found,
        ..
    } = support;
    let mut add = |node: u32, set: fn(&mut Rules)| {
        let rules = &mut found[node as usize];
        if *rules == Rules::default() {
            nodes.push(node);
        }
        set(rules);
    };

    // Nodes
    let (p_w, rotation) = (pose.position(), pose.rotation_matrix());
    local.clear();
    local.extend(
        positions
            .iter()
            .map(|&x_w| rotation.mul_transpose_vec3(x_w - p_w)),
    );
    let local = &local[..];
    // Zero times an infinity or a NaN is NaN, and one NaN in a sum makes the sum NaN.
    let mut zero = DVec3::ZERO;
    codes.clear();
    codes.extend(local.iter().map(|&p_g| {
        zero += 0.0 * p_g;
        outcode(p_g, low, high)
    }));
    let codes = &codes[..];
    if zero.is_nan() {
        return Err(not_finite(positions, local));
    }
    for (node, &code) in codes.iter().enumerate() {
        if code == 0 && volume.contains(local[node]) {
            add(node as u32, |rules| rules.node = true);
        }
    }

    // Edges
    for (number, edge) in edges.iter().enumerate() {
        let Some(code) = common_code(codes, edge) else {
            return Err(out_of_range("edge", number, edge, positions.len()));
        };
        if code == 0 {
            let [a, b] = edge.map(|node| local[node as usize]);
            if volume.contains((a + b) * 0.5) {
                for &node in edge {
                    add(node, |rules| rules.edge = true);
                }
            }
        }
    }

    // Faces
    for (number, quad) in quads.iter().enumerate() {
        let Some(code) = common_code(codes, quad) else {
            return Err(out_of_range("quad", number, quad, positions.len()));
        };
        if code == 0 {
            let [a, b, c, d] = quad.map(|node| local[node as usize]);
            if volume.contains(((a + b) + (c + d)) * 0.25) {
                for &node in quad {
                    add(node, |rules| rules.face = true);
                }
            }
        }
    }
    for (number, triangle) in triangles.iter().enumerate() {
        let Some(code) = common_code(codes, triangle) else {
            return Err(out_of_range("triangle", number, triangle, positions.len()));
        };
        if code == 0 {
            let [a, b, c] = triangle.map(|node| local[node as usize]);
            if volume.contains((a + b + c) / 3.0) {
                for &node in triangle {
                    add(node, |rules| rules.face = true);
                }
            }
        }
    }
    Ok(())
}

/// One bit for each side of the box that the point is strictly beyond.
fn outcode(p: DVec3, low: DVec3, high: DVec3) -> u8 {
    u8::from(p.x < low.x)
        | u8::from(p.x > high.x) << 1
        | u8::from(p.y < low.y) << 2
        | u8::from(p.y > high.y) << 3
        | u8::from(p.z < low.z) << 4
        | u8::from(p.z > high.z) << 5
}

/// The sides beyond which all nodes of an element lie, or nothing when one of them does not exist.
fn common_code<const N: usize>(codes: &[u8], nodes: &[u32; N]) -> Option<u8> {
    let mut common = u8::MAX;
    for &node in nodes {
        common &= codes.get(node as usize)?;
    }
    Some(common)
}

#[cold]
pub(crate) fn out_of_range(
    element: &'static str,
    number: usize,
    nodes: &[u32],
    node_count: usize,
) -> Error {
    let node = nodes.iter().copied().max().unwrap_or_default();
    Error::NodeOutOfRange {
        element,
        number,
        node,
        node_count,
    }
}

#[cold]
fn not_finite(positions: &[DVec3], local: &[DVec3]) -> Error {
    let node = local
        .iter()
        .position(|p| !p.is_finite())
        .unwrap_or_default();
    Error::Position {
        node,
        position: positions[node],
    }
}

#[cfg(test)]
mod tests {
    use alloc::string::ToString;

    use super::*;
    use crate::Shape;

    fn cube(side: f64) -> GraspVolume {
        let size = DVec3::splat(side);
        GraspVolume::new(Shape::Box { size }, DVec3::ZERO).unwrap()
    }

    /// A unit square of two triangles below a unit quad, nodes given out of order.
    const POSITIONS: [DVec3; 6] = [
        DVec3::new(1.0, 1.0, 0.0),
        DVec3::new(0.0, 0.0, 0.0),
        DVec3::new(1.0, 0.0, 0.0),
        DVec3::new(0.0, 1.0, 0.0),
        DVec3::new(0.0, -1.0, 0.0),
        DVec3::new(1.0, -1.0, 0.0),
    ];
    const EDGES: [[u32; 2]; 8] = [
        [0, 3],
        [1, 3],
        [0, 2],
        [1, 2],
        [1, 4],
        [2, 5],
        [4, 5],
        [2, 4],
    ];
    const CLOTH: ClothView<'static> = ClothView {
        positions: &POSITIONS,
        edges: &EDGES,
        quads: &[[1, 2, 0, 3]],
        triangles: &[[4, 2, 1], [4, 5, 2]],
    };

    fn found(side: f64, x: f64, y: f64) -> (Vec<u32>, Vec<Rules>) {
        let pose = Pose::from_translation(DVec3::new(x, y, 0.0));
        let mut support = Support::default();
        select(&cube(side), &pose, CLOTH, &mut support).unwrap();
        (support.nodes().to_vec(), support.rules().to_vec())
    }

    #[test]
    fn each_rule_finds_its_nodes() {
        let none = Rules::default();
        let node = Rules { node: true, ..none };
        let edge = Rules { edge: true, ..none };
        let face = Rules { face: true, ..none };
        assert_eq!(found(0.1, 1.0, 1.0), ([0].to_vec(), [node].to_vec()));
        assert_eq!(found(0.1, 0.0, 0.5), ([1, 3].to_vec(), [edge; 2].to_vec()));
        assert_eq!(
            found(0.1, 0.5, 0.5),
            ([0, 1, 2, 3].to_vec(), [face; 4].to_vec())
        );
        let (nodes, rules) = found(0.1, 1.0 / 3.0, -1.0 / 3.0);
        assert_eq!((nodes, rules), ([1, 2, 4].to_vec(), [face; 3].to_vec()));
        assert!(found(0.1, 0.25, 0.25).0.is_empty());
    }

    #[test]
    fn rules_add_up() {
        // Node 0, the middles of its two edges, and the middle of the quad.
        let (nodes, rules) = found(1.0, 1.0, 1.0);
        assert_eq!(nodes, [0, 1, 2, 3]);
        assert!(rules[0].node && rules[0].edge && rules[0].face);
        assert!(!rules[1].node && !rules[1].edge && rules[1].face);
        assert!(!rules[2].node && rules[2].edge && rules[2].face);
    }

    #[test]
    fn a_support_can_be_used_again() {
        let mut support = Support::default();
        let pose = Pose::from_translation(DVec3::new(1.0, 1.0, 0.0));
        select(&cube(9.0), &pose, CLOTH, &mut support).unwrap();
        support.refuse(|node| node % 2 == 0);
        assert_eq!(support.nodes(), [1, 3, 5]);
        select(&cube(0.1), &pose, CLOTH, &mut support).unwrap();
        assert_eq!((support.nodes(), support.rules().len()), (&[0][..], 1));
        assert!(!support.rules()[0].face);
        // A smaller cloth.
        let pose = Pose::IDENTITY;
        let cloth = ClothView {
            positions: &[DVec3::ZERO],
            ..ClothView::default()
        };
        select(&cube(0.1), &pose, cloth, &mut support).unwrap();
        assert_eq!(support.nodes(), [0]);
    }

    #[test]
    fn bad_input_is_named_and_leaves_nothing() {
        fn fails(support: &mut Support, cloth: ClothView<'_>) -> alloc::string::String {
            let error = select(&cube(9.0), &Pose::IDENTITY, cloth, support).unwrap_err();
            assert!(support.nodes().is_empty() && support.rules().is_empty());
            error.to_string()
        }
        let support = &mut Support::default();
        let error = select(
            &cube(9.0),
            &Pose::from_translation(DVec3::NAN),
            CLOTH,
            support,
        );
        assert!(matches!(error, Err(Error::Pose(_))));
        let quads = [[0, 1, 2, 3], [0, 1, 9, 3]];
        let text = fails(
            support,
            ClothView {
                quads: &quads,
                ..CLOTH
            },
        );
        assert_eq!(text, "node 9 of quad 1 must be below the node count 6");
        let text = fails(
            support,
            ClothView {
                triangles: &[[6, 0, 1]],
                ..CLOTH
            },
        );
        assert_eq!(text, "node 6 of triangle 0 must be below the node count 6");
        for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut positions = POSITIONS;
            positions[4].z = bad;
            let text = fails(
                support,
                ClothView {
                    positions: &positions,
                    ..CLOTH
                },
            );
            assert_eq!(
                text,
                alloc::format!("position (0, -1, {bad}) m of node 4 must be finite")
            );
        }
    }

    #[test]
    fn one_coordinate_more_or_less_far_out_changes_nothing() {
        // The centre of the triangle lies on the boundary of the volume, two nodes on it and one
        // beyond it by less than the sum can tell.
        let volume = cube(2.0);
        let beyond = f64::from_bits(1.0_f64.to_bits() + 1);
        let positions = [DVec3::X, DVec3::X, DVec3::X * beyond];
        let cloth = ClothView {
            positions: &positions,
            triangles: &[[0, 1, 2]],
            ..ClothView::default()
        };
        let mut support = Support::default();
        select(&volume, &Pose::IDENTITY, cloth, &mut support).unwrap();
        assert_eq!(support.nodes(), [0, 1, 2]);
    }
}
