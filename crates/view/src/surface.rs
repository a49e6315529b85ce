//! The sheet as triangles and lines, and its normals.

use selvedge_math::DVec3;

use crate::Sheet;

impl Sheet {
    /// All faces as triangles; a quad is cut along the diagonal from its first corner.
    pub(crate) fn all_triangles(&self) -> Vec<[u32; 3]> {
        let halves = |&[a, b, c, d]: &[u32; 4]| [[a, b, c], [a, c, d]];
        let quads = self.quads.iter().flat_map(halves);
        quads.chain(self.triangles.iter().copied()).collect()
    }

    /// The sides of all faces, each once, ascending.
    pub(crate) fn sides(&self) -> Vec<[u32; 2]> {
        fn around<const K: usize>(face: &[u32; K]) -> impl Iterator<Item = [u32; 2]> + '_ {
            (0..K).map(|k| {
                let (a, b) = (face[k], face[(k + 1) % K]);
                [a.min(b), a.max(b)]
            })
        }
        let quads = self.quads.iter().flat_map(around);
        let mut sides: Vec<[u32; 2]> = quads
            .chain(self.triangles.iter().flat_map(around))
            .collect();
        sides.sort_unstable();
        sides.dedup();
        sides
    }
}

/// Unit normals, one a node: the mean of the triangles around it, weighted by their areas. A node
/// without area has the normal z.
pub(crate) fn normals(positions: &[DVec3], triangles: &[[u32; 3]]) -> Vec<DVec3> {
    let mut normals = vec![DVec3::ZERO; positions.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|node| positions[node as usize]);
        let area = (b - a).cross(c - a);
        for &node in triangle {
            normals[node as usize] += area;
        }
    }
    for normal in &mut normals {
        *normal = normal.try_normalize().unwrap_or(DVec3::Z);
    }
    normals
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Rest;

    #[test]
    fn a_quad_and_a_triangle_that_share_a_side() {
        let rest =
            [[0., 0.], [1., 0.], [1., 1.], [0., 1.], [2., 0.]].map(|[x, y]| DVec3::new(x, y, 0.));
        let sheet = Sheet {
            quads: vec![[0, 1, 2, 3]],
            triangles: vec![[1, 4, 2]],
            rest: Rest::Positions(rest.to_vec()),
        };
        let triangles = sheet.all_triangles();
        assert_eq!(triangles, [[0, 1, 2], [0, 2, 3], [1, 4, 2]]);
        let sides = [[0, 1], [0, 3], [1, 2], [1, 4], [2, 3], [2, 4]];
        assert_eq!(sheet.sides(), sides);
        assert_eq!(normals(&rest, &triangles), [DVec3::Z; 5]);
        let folded = rest.map(|p| DVec3::new(p.x.min(1.0), p.y, (p.x - 1.0).max(0.0)));
        assert_eq!(normals(&folded, &triangles)[4], -DVec3::X);
    }
}
