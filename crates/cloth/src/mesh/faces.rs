//! Meshes from faces, and what a cloth cannot be made of.

use std::collections::BTreeMap;

use selvedge_math::DVec3;

use super::Mesh;
use crate::Error;

/// Largest extent along an axis [m]; more is a matter of units.
const MAX_EXTENT: f64 = 100.0;
/// Shortest edge over the extent, and smallest area over the square of the longest side.
const MIN_RATIO: f64 = 1e-9;

/// What a mesh consists of, by number.
#[derive(Clone, Copy, Debug)]
pub(super) enum Element {
    Node(usize),
    Quad(usize),
    Triangle(usize),
}

impl Mesh {
    /// A cloth of quads and triangles over rest positions [m]; the nodes of a face in order around
    /// it.
    ///
    /// # Errors
    /// [`Error::Mesh`] names the first node or face that a cloth cannot have: a position that is
    /// not finite, a node of no face, a corner that is no node or comes twice, a face without area,
    /// an edge without length, an edge of three faces; and a cloth larger than 100 m.
    pub fn new(
        rest: Vec<DVec3>,
        quads: Vec<[u32; 4]>,
        triangles: Vec<[u32; 3]>,
    ) -> Result<Self, Error> {
        Self::checked(rest, quads, triangles, |element| match element {
            Element::Node(k) => format!("node {k}"),
            Element::Quad(k) => format!("quad {k}"),
            Element::Triangle(k) => format!("triangle {k}"),
        })
    }

    /// As [`Mesh::new`], with the caller's name for the place of an element.
    pub(super) fn checked(
        rest: Vec<DVec3>,
        quads: Vec<[u32; 4]>,
        triangles: Vec<[u32; 3]>,
        place: impl Fn(Element) -> String,
    ) -> Result<Self, Error> {
        let refuse = |element, what: String, bound: &str| {
            let place = place(element);
            let bound = bound.into();
            Err(Error::Mesh { place, what, bound })
        };
        let whole = |what: String, bound: &str| {
            let (place, bound) = ("mesh".into(), bound.into());
            Err(Error::Mesh { place, what, bound })
        };
        if rest.len() > Self::MAX_NODES {
            let bound = format!("at most {}", Self::MAX_NODES);
            return whole(format!("node count is {}", rest.len()), &bound);
        }
        if quads.is_empty() && triangles.is_empty() {
            return whole("face count is 0".into(), "at least 1");
        }
        for (k, p) in rest.iter().enumerate() {
            if !p.is_finite() {
                let what = format!("position is {p} m");
                return refuse(Element::Node(k), what, "finite");
            }
        }
        let extent = extent(&rest).max_element();
        if extent > MAX_EXTENT {
            return whole(
                format!("extent is {extent} m"),
                "at most 100 m (coordinates are in metres: is this a mesh in millimetres?)",
            );
        }

        // Corners, lengths and areas; faces by edge
        let mut faces_at: BTreeMap<[u32; 2], u32> = BTreeMap::new();
        let mut used = vec![false; rest.len()];
        let quad_faces = quads.iter().enumerate();
        let quad_faces = quad_faces.map(|(k, face)| (Element::Quad(k), &face[..]));
        let triangle_faces = triangles.iter().enumerate();
        let triangle_faces = triangle_faces.map(|(k, face)| (Element::Triangle(k), &face[..]));
        for (element, face) in quad_faces.chain(triangle_faces) {
            for (c, &node) in face.iter().enumerate() {
                if node as usize >= rest.len() {
                    let bound = format!("below the node count {}", rest.len());
                    return refuse(element, format!("corner {c} is node {node}"), &bound);
                }
                if face[..c].contains(&node) {
                    let what = format!("corner {c} is node {node} again");
                    return refuse(element, what, "another node");
                }
                used[node as usize] = true;
            }
            let corner = |c: usize| rest[face[c % face.len()] as usize];
            let mut longest: f64 = 0.0;
            for c in 0..face.len() {
                let (p, q) = (face[c], face[(c + 1) % face.len()]);
                let length = corner(c).distance(corner(c + 1));
                longest = longest.max(length);
                if length <= MIN_RATIO * extent {
                    let what = format!("edge from node {p} to {q} has the length {length} m");
                    return refuse(element, what, "positive");
                }
                let count = faces_at.entry([p.min(q), p.max(q)]).or_default();
                *count += 1;
                if *count > 2 {
                    let what = format!("edge from node {p} to {q} belongs to {count} faces");
                    return refuse(element, what, "of at most 2");
                }
            }
            // The diagonals span twice the area; of a triangle, two sides do.
            let across = corner(2) - corner(0);
            let area = across.cross(corner(face.len() - 1) - corner(1)).length() / 2.0;
            if area <= MIN_RATIO * longest * longest {
                let what = format!("area is {area} m^2");
                return refuse(
                    element,
                    what,
                    "positive, with the corners in order around it",
                );
            }
        }
        if let Some(k) = used.iter().position(|used| !used) {
            return refuse(
                Element::Node(k),
                "number of faces is 0".into(),
                "at least 1",
            );
        }
        Ok(Self {
            rest,
            edges: faces_at.into_keys().collect(),
            quads,
            triangles,
            grid: None,
        })
    }
}

/// Sides of the box along the axes [m].
pub(super) fn extent(positions: &[DVec3]) -> DVec3 {
    let low = positions.iter().copied().reduce(DVec3::min);
    let high = positions.iter().copied().reduce(DVec3::max);
    high.unwrap_or_default() - low.unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square, and beyond its side x = 1 a triangle.
    fn house() -> (Vec<DVec3>, Vec<[u32; 4]>, Vec<[u32; 3]>) {
        let rest = [[0., 0.], [1., 0.], [1., 1.], [0., 1.], [2., 0.5]];
        let rest = rest.map(|[x, y]| DVec3::new(x, y, 0.0)).to_vec();
        (rest, vec![[0, 1, 2, 3]], vec![[2, 1, 4]])
    }

    #[test]
    fn quads_and_triangles_share_edges() {
        let (rest, quads, triangles) = house();
        let mesh = Mesh::new(rest, quads, triangles).unwrap();
        let edges = [[0, 1], [0, 3], [1, 2], [1, 4], [2, 3], [2, 4]];
        assert_eq!(mesh.edges(), edges);
        assert_eq!(mesh.triangles(), [[2, 1, 4]]);
        assert_eq!(mesh.as_grid(), None);
        assert_eq!(mesh.diagonal(), 5f64.sqrt());
    }

    #[test]
    fn the_faces_of_a_grid_have_its_edges() {
        let grid = Mesh::grid([5, 4], [0.4, 0.3]).unwrap();
        let mesh = Mesh::new(grid.rest().to_vec(), grid.quads().to_vec(), vec![]).unwrap();
        assert_eq!(mesh.edges(), grid.edges());
        assert!((mesh.diagonal() - grid.diagonal()).abs() < 1e-15);
    }

    #[test]
    fn what_is_no_cloth_is_refused_by_name() {
        type Change = fn(&mut Vec<DVec3>, &mut Vec<[u32; 4]>, &mut Vec<[u32; 3]>);
        let cases: [(Change, &str); 9] = [
            (
                |rest, _, _| rest[3].z = f64::NAN,
                "node 3: position is [0, 1, NaN] m, must be finite",
            ),
            (
                |_, _, triangles| triangles[0][1] = 5,
                "triangle 0: corner 1 is node 5, must be below the node count 5",
            ),
            (
                |_, quads, _| quads[0][3] = 1,
                "quad 0: corner 3 is node 1 again, must be another node",
            ),
            (
                |rest, _, _| rest[4] = DVec3::new(1.0, 0.5, 0.0),
                "triangle 0: area is 0 m^2, must be positive, with the corners in order around it",
            ),
            (
                |_, quads, _| quads[0] = [0, 2, 1, 3],
                "quad 0: area is 0 m^2, must be positive, with the corners in order around it",
            ),
            (
                |rest, _, _| rest[4] = rest[1],
                "triangle 0: edge from node 1 to 4 has the length 0 m, must be positive",
            ),
            (
                |_, _, triangles| triangles.extend([[1, 2, 4], [1, 2, 0]]),
                "triangle 1: edge from node 1 to 2 belongs to 3 faces, must be of at most 2",
            ),
            (
                |rest, _, _| rest.push(DVec3::ZERO),
                "node 5: number of faces is 0, must be at least 1",
            ),
            (
                |rest, _, _| rest.iter_mut().for_each(|p| *p *= 420.0),
                "mesh: extent is 840 m, must be at most 100 m \
                 (coordinates are in metres: is this a mesh in millimetres?)",
            ),
        ];
        for (change, message) in cases {
            let (mut rest, mut quads, mut triangles) = house();
            change(&mut rest, &mut quads, &mut triangles);
            let error = Mesh::new(rest, quads, triangles).unwrap_err();
            assert_eq!(error.to_string(), message);
        }
        let error = Mesh::new(vec![], vec![], vec![]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "mesh: face count is 0, must be at least 1"
        );
    }
}
