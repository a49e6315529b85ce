//! Solids with flat faces: a closed surface of triangles, its edges and its corners.
//!
//! The only file that names parry: its trees find what is near, its hull makes convex bodies, its
//! pseudonormals tell inside from outside.

use parry3d_f64::bounding_volume::Aabb;
use parry3d_f64::partitioning::{Bvh, BvhBuildStrategy};
use parry3d_f64::query::{PointQueryWithLocation, Ray, RayCast};
use parry3d_f64::shape::{TriMesh, TriMeshFlags, TrianglePointLocation};
use parry3d_f64::transformation::try_convex_hull;
use selvedge_math::{DMat3, DVec3};

use crate::Error;
use crate::broad::Bounds;

/// How deep edges and faces of the cloth may be inside for the length of a substep [m].
pub(crate) const DEPTH: f64 = 1e-4;
/// Faces whose normals differ by less are one plane: half the squared angle.
const FLAT: f64 = 1e-8;
/// The least volume, as a share of that of a cube of the body's diagonal.
const LEAST_VOLUME: f64 = 1e-9;
/// What is nearer to the surface has the normal of the surface [m].
const ON: f64 = 1e-9;
/// A node so near to a plane that it rested on still rests there [m].
const STILL_ON: f64 = 5e-5;
/// How far off an edge's or corner's normals a normal may be.
pub(crate) const SLACK: f64 = 0.02;

/// A closed surface with outward normals.
#[derive(Clone, Debug)]
pub(crate) struct Solid {
    surface: TriMesh,
    /// The surface moved inwards by [`DEPTH`].
    inner: TriMesh,
    normals: Vec<DVec3>,
    /// The triangles around each vertex.
    around: Vec<Vec<u32>>,
    features: Vec<Feature>,
    tree: Bvh,
    pub(crate) convex: bool,
}

/// Where edges and faces of the cloth can touch a solid.
#[derive(Clone, Debug)]
pub(crate) enum Feature {
    /// A convex edge.
    Edge {
        ends: [DVec3; 2],
        /// The ends of this edge of the surface that is moved inwards.
        inner: [DVec3; 2],
        /// Unit vector between the normals of the two faces; theirs along it.
        outward: DVec3,
        least: f64,
    },
    /// A corner, with the directions of its edges.
    Corner {
        point: DVec3,
        inner: DVec3,
        outward: DVec3,
        arms: Vec<DVec3>,
    },
}

/// The point of a surface that is nearest to a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Foot {
    pub(crate) point: DVec3,
    /// Away from the solid.
    pub(crate) normal: DVec3,
    /// Negative inside [m].
    pub(crate) distance: f64,
}

impl Foot {
    /// The same on a surface that is further out.
    pub(crate) fn lifted(self, lift: f64) -> Self {
        Self {
            point: self.point + self.normal * lift,
            distance: self.distance - lift,
            ..self
        }
    }
}

impl Solid {
    /// The convex hull of points.
    pub(crate) fn hull(points: &[DVec3]) -> Result<Self, Error> {
        check_points(points)?;
        let refused = || Error::Obstacle {
            what: format!("the hull of {} points is flat", points.len()),
            bound: "a body with a volume",
        };
        let (vertices, triangles) = try_convex_hull(points).map_err(|_| refused())?;
        let mut solid = Self::new(vertices, triangles).map_err(|_| refused())?;
        solid.convex = true;
        Ok(solid)
    }

    /// A body between closed surfaces, whose triangles may be turned either way, but all the same.
    pub(crate) fn new(vertices: Vec<DVec3>, mut triangles: Vec<[u32; 3]>) -> Result<Self, Error> {
        check_points(&vertices)?;
        let sides = sides(&vertices, &triangles)?;
        let at = |k: u32| vertices[k as usize];
        let volume = |t: &[u32; 3]| at(t[0]).dot(at(t[1]).cross(at(t[2]))) / 6.0;
        let volume: f64 = triangles.iter().map(volume).sum();
        let around = |pick: fn(DVec3, DVec3) -> DVec3| vertices.iter().copied().reduce(pick);
        let size = around(DVec3::max)
            .zip(around(DVec3::min))
            .map_or(0.0, |(a, b)| a.distance(b));
        if volume.abs() <= LEAST_VOLUME * size * size * size {
            return Err(Error::Obstacle {
                what: format!("the volume within is {volume} m^3"),
                bound: "more",
            });
        }
        if volume < 0.0 {
            triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        let mut normals = Vec::with_capacity(triangles.len());
        for (k, t) in triangles.iter().enumerate() {
            let [a, b, c] = t.map(at);
            let normal = (b - a).cross(c - a).try_normalize();
            normals.push(normal.ok_or_else(|| Error::Obstacle {
                what: format!("triangle {k} has no area"),
                bound: "a triangle",
            })?);
        }
        let mut faces = vec![Vec::new(); vertices.len()];
        for (k, t) in triangles.iter().enumerate() {
            for &v in t {
                faces[v as usize].push(k as u32);
            }
        }
        let inner: Vec<DVec3> = (0..vertices.len())
            .map(|v| vertices[v] + inwards(faces[v].iter().map(|&k| normals[k as usize])))
            .collect();
        let mesh = |points: Vec<DVec3>| {
            TriMesh::with_flags(points, triangles.clone(), TriMeshFlags::ORIENTED).map_err(|e| {
                Error::Obstacle {
                    what: e.to_string(),
                    bound: "a closed surface",
                }
            })
        };
        let mut features = Vec::new();
        let mut arms = vec![Vec::new(); vertices.len()];
        for &(p, q, first, second) in &sides {
            let ([p, q], [a, b]) = (
                [p, q].map(|k| k as usize),
                [normals[first], normals[second]],
            );
            let along = (vertices[q] - vertices[p]).normalize();
            arms[p].push(along);
            arms[q].push(-along);
            // Where the face of the second triangle goes from the edge
            let away = triangles[second]
                .map(|k| vertices[k as usize] - vertices[p])
                .into_iter()
                .map(|v| v.dot(a))
                .fold(0.0, |m: f64, d| if d.abs() > m.abs() { d } else { m });
            let outward = (a + b).try_normalize();
            if let (true, Some(outward)) = (away < 0.0 && a.dot(b) < 1.0 - FLAT, outward) {
                features.push(Feature::Edge {
                    ends: [vertices[p], vertices[q]],
                    inner: [inner[p], inner[q]],
                    outward,
                    least: a.dot(outward),
                });
            }
        }
        for (v, arms) in arms.into_iter().enumerate() {
            let mut its = faces[v].iter().map(|&k| normals[k as usize]);
            let sum: DVec3 = its.clone().sum();
            let flat = its
                .next()
                .is_none_or(|first| its.all(|n| n.dot(first) > 1.0 - FLAT));
            let Some(outward) = sum.try_normalize().filter(|_| !flat) else {
                continue;
            };
            if arms.iter().all(|arm| arm.dot(outward) < SLACK) {
                features.push(Feature::Corner {
                    point: vertices[v],
                    inner: inner[v],
                    outward,
                    arms,
                });
            }
        }
        let boxes: Vec<Aabb> = features.iter().map(Feature::bounds).collect();
        Ok(Self {
            inner: mesh(inner)?,
            tree: Bvh::from_leaves(BvhBuildStrategy::Binned, &boxes),
            surface: mesh(vertices.clone())?,
            normals,
            around: faces,
            features,
            convex: false,
        })
    }

    pub(crate) fn bounds(&self) -> Bounds {
        let all = self.surface.local_aabb();
        Bounds {
            low: all.mins,
            high: all.maxs,
        }
    }

    pub(crate) fn feature(&self, k: u32) -> &Feature {
        &self.features[k as usize]
    }

    /// The features whose boxes overlap a box.
    pub(crate) fn near(&self, b: &Bounds) -> impl Iterator<Item = u32> + '_ {
        let (low, high) = (b.low, b.high);
        self.tree
            .leaves(move |node| node.mins().cmple(high).all() && low.cmple(node.maxs()).all())
    }

    /// The nearest point of the surface.
    pub(crate) fn foot(&self, p: DVec3) -> Foot {
        let (nearest, (face, place)) = self.surface.project_local_point_and_get_location(p, false);
        let away = p - nearest.point;
        let length = away.length();
        let sign = if nearest.is_inside { -1.0 } else { 1.0 };
        let normal = match place {
            TrianglePointLocation::OnFace(..) | TrianglePointLocation::OnSolid => None,
            _ if length > ON => Some(away * (sign / length)),
            TrianglePointLocation::OnEdge(side, _) => self
                .surface
                .pseudo_normals()
                .map(|n| n.edges_pseudo_normal[face as usize][side as usize]),
            TrianglePointLocation::OnVertex(corner) => {
                let vertex = self.surface.indices()[face as usize][corner as usize];
                self.surface
                    .pseudo_normals()
                    .map(|n| n.vertices_pseudo_normal[vertex as usize])
            }
        };
        Foot {
            point: nearest.point,
            normal: normal
                .and_then(DVec3::try_normalize)
                .unwrap_or(self.normals[face as usize]),
            distance: sign * length,
        }
    }

    /// The nearest point for a node that rested on a plane with the normal `before`, perhaps of
    /// another body: on an edge it belongs to the face that looks most that way. So it stays on the
    /// face that it was on, and does not get below a box that stands on a table.
    pub(crate) fn foot_as_before(&self, p: DVec3, before: DVec3) -> Foot {
        let mut foot = self.foot(p);
        if foot.distance.abs() > STILL_ON {
            return foot;
        }
        let (_, (nearest, _)) = self.surface.project_local_point_and_get_location(p, false);
        let corners = self.surface.indices()[nearest as usize];
        let mut most = f64::NEG_INFINITY;
        for &face in corners.iter().flat_map(|&v| &self.around[v as usize]) {
            let normal = self.normals[face as usize];
            let corner = self.surface.indices()[face as usize][0];
            let distance = normal.dot(p - self.surface.vertices()[corner as usize]);
            if normal.dot(before) > most && distance.abs() < STILL_ON {
                most = normal.dot(before);
                foot = Foot {
                    point: p - normal * distance,
                    normal,
                    distance,
                };
            }
        }
        foot
    }

    /// Where the way from `a`, outside, to `b` first enters the solid.
    pub(crate) fn entry(&self, a: DVec3, b: DVec3) -> Option<Foot> {
        let ray = Ray::new(a, b - a);
        let hit = self
            .surface
            .cast_local_ray_and_get_normal(&ray, 1.0, false)?;
        let normal = self.normals[hit.subshape as usize];
        (normal.dot(b - a) < 0.0).then(|| Foot {
            point: a + (b - a) * hit.time_of_impact,
            normal,
            distance: 0.0,
        })
    }

    /// The share of the way from `a` to `b` after which it is deeper inside than [`DEPTH`].
    pub(crate) fn deep_entry(&self, a: DVec3, b: DVec3) -> Option<f64> {
        self.inner.cast_local_ray(&Ray::new(a, b - a), 1.0, false)
    }
}

impl Feature {
    fn bounds(&self) -> Aabb {
        let [a, b] = match self {
            Self::Edge { ends, .. } => *ends,
            Self::Corner { point, .. } => [*point; 2],
        };
        Aabb::new(a.min(b), a.max(b))
    }
}

fn check_points(points: &[DVec3]) -> Result<(), Error> {
    match points.iter().position(|p| !p.is_finite()) {
        None => Ok(()),
        Some(k) => Err(Error::Obstacle {
            what: format!("point {k} is {}", points[k]),
            bound: "finite",
        }),
    }
}

/// Every edge once, `(p, q, first triangle, second triangle)`, `p < q`.
fn sides(
    vertices: &[DVec3],
    triangles: &[[u32; 3]],
) -> Result<Vec<(u32, u32, usize, usize)>, Error> {
    let mut all = Vec::with_capacity(3 * triangles.len());
    for (k, &[a, b, c]) in triangles.iter().enumerate() {
        if let Some(v) = [a, b, c]
            .into_iter()
            .find(|&v| v as usize >= vertices.len())
        {
            return Err(Error::Obstacle {
                what: format!(
                    "triangle {k} has the corner {v} of {} points",
                    vertices.len()
                ),
                bound: "below the number of points",
            });
        }
        for (p, q) in [(a, b), (b, c), (c, a)] {
            all.push((p.min(q), p.max(q), p > q, k));
        }
    }
    all.sort_unstable();
    let closed = |pair: &[(u32, u32, bool, usize)]| match pair {
        [a, b] => (a.0, a.1) == (b.0, b.1) && a.2 != b.2,
        _ => false,
    };
    let mut pairs = all.chunks(2);
    if let Some(pair) = pairs.find(|pair| !closed(pair)) {
        let (p, q, ..) = pair[0];
        return Err(Error::Obstacle {
            what: format!("the side from {p} to {q} is not that of two triangles turned alike"),
            bound: "part of a closed surface",
        });
    }
    if all.is_empty() {
        return Err(Error::Obstacle {
            what: "there are no triangles".into(),
            bound: "a closed surface",
        });
    }
    Ok(all
        .chunks_exact(2)
        .map(|pair| (pair[0].0, pair[0].1, pair[0].3, pair[1].3))
        .collect())
}

/// The way that brings a corner by [`DEPTH`] below each of its faces, or nearly so.
fn inwards(normals: impl Iterator<Item = DVec3>) -> DVec3 {
    let (mut matrix, mut sum) = (DMat3::IDENTITY * 1e-3, DVec3::ZERO);
    for n in normals {
        matrix += DMat3::from_cols(n * n.x, n * n.y, n * n.z);
        sum += n;
    }
    (matrix.inverse() * sum * -DEPTH).clamp_length_max(4.0 * DEPTH)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube() -> Solid {
        let points: Vec<DVec3> = (0..8)
            .map(|k| DVec3::new(f64::from(k & 1), f64::from(k >> 1 & 1), f64::from(k >> 2)))
            .collect();
        Solid::hull(&points).unwrap()
    }

    #[test]
    fn a_cube_has_twelve_edges_and_eight_corners() {
        let cube = cube();
        let is_edge = |f: &&Feature| matches!(f, Feature::Edge { .. });
        assert_eq!(cube.features.iter().filter(is_edge).count(), 12);
        assert_eq!(cube.features.len(), 20);
        for feature in &cube.features {
            match feature {
                Feature::Edge { outward, least, .. } => {
                    assert!((least - 0.5_f64.sqrt()).abs() < 1e-12);
                    assert!((outward.length() - 1.0).abs() < 1e-12);
                }
                Feature::Corner {
                    point, inner, arms, ..
                } => {
                    let moved = (*inner - *point).abs() - DVec3::splat(DEPTH);
                    assert!(moved.length() < 1e-2 * DEPTH, "{moved}");
                    assert!(arms.len() >= 3);
                }
            }
        }
    }

    #[test]
    fn feet_inside_and_outside() {
        let cube = cube();
        for (p, distance, normal) in [
            (DVec3::new(0.5, 0.4, 1.2), 0.2, DVec3::Z),
            (DVec3::new(0.5, 0.4, 0.9), -0.1, DVec3::Z),
            (DVec3::new(1.3, 0.4, 1.4), 0.5, DVec3::new(0.6, 0.0, 0.8)),
            (DVec3::new(0.3, 0.4, 1.0), 0.0, DVec3::Z),
        ] {
            let foot = cube.foot(p);
            assert!((foot.distance - distance).abs() < 1e-12, "{foot:?}");
            assert!((foot.normal - normal).length() < 1e-9, "{foot:?}");
        }
        let (a, b) = (DVec3::new(0.5, 0.5, 2.0), DVec3::new(0.5, 0.6, 0.0));
        let entry = cube.entry(a, b).unwrap();
        assert!((entry.point - DVec3::new(0.5, 0.55, 1.0)).length() < 1e-12);
        assert!(cube.entry(a, DVec3::new(3.0, 0.5, 0.0)).is_none());
    }
}
