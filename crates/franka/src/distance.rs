//! Distances between bodies: the only file that names parry.
//!
//! Capsules are segments with a radius, so two of them are as far apart as their segments less the
//! radii, which is exact and may be negative. Pairs with a box or a cylinder go through the
//! Gilbert-Johnson-Keerthi algorithm on the cores; where those overlap the distance is told as
//! minus the radii, not how deep the overlap is.

use parry3d_f64::math::{Pose as Motion, Vector};
use parry3d_f64::query::details::{
    closest_points_segment_segment_with_locations_nD, distance_support_map_support_map_with_params,
};
use parry3d_f64::query::gjk::VoronoiSimplex;
use parry3d_f64::shape::{SegmentPointLocation, SupportMap};
use selvedge_math::DVec3;

use crate::body::Solid;

/// The distance of two placed bodies [m]; negative where capsules overlap.
pub(crate) fn distance(a: &Solid, b: &Solid) -> f64 {
    if let (Solid::Capsule { ends: p, radius: r }, Solid::Capsule { ends: q, radius: s }) = (a, b) {
        let (on_a, on_b) =
            closest_points_segment_segment_with_locations_nD((&p[0], &p[1]), (&q[0], &q[1]));
        return point(p, on_a).distance(point(q, on_b)) - r - s;
    }
    let towards = b.ball().0 - a.ball().0;
    let start = (towards != DVec3::ZERO).then_some(towards);
    let cores = distance_support_map_support_map_with_params(
        &Motion::IDENTITY,
        &Core(a),
        &Core(b),
        &mut VoronoiSimplex::new(),
        start,
    );
    cores - rounding(a) - rounding(b)
}

fn point(ends: &[DVec3; 2], at: SegmentPointLocation) -> DVec3 {
    match at {
        SegmentPointLocation::OnVertex(k) => ends[usize::from(k != 0)],
        SegmentPointLocation::OnEdge([a, b]) => a * ends[0] + b * ends[1],
    }
}

/// A body without its rounding.
struct Core<'a>(&'a Solid);

fn rounding(solid: &Solid) -> f64 {
    match *solid {
        Solid::Capsule { radius, .. } => radius,
        Solid::Cylinder { .. } | Solid::Box { .. } => 0.0,
    }
}

impl SupportMap for Core<'_> {
    fn local_support_point(&self, direction: Vector) -> Vector {
        let further = |[a, b]: [DVec3; 2]| match a.dot(direction) >= b.dot(direction) {
            true => a,
            false => b,
        };
        match *self.0 {
            Solid::Capsule { ends, .. } => further(ends),
            Solid::Cylinder { ends, radius } => {
                let axis = (ends[1] - ends[0]).normalize_or_zero();
                let across = direction - direction.dot(axis) * axis;
                further(ends) + radius * across.normalize_or_zero()
            }
            Solid::Box { centre, halves } => {
                let along = |half: DVec3| half * half.dot(direction).signum();
                centre + along(halves.x_axis) + along(halves.y_axis) + along(halves.z_axis)
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use selvedge_math::{DMat3, DQuat, Pose};

    #[test]
    fn distances_by_hand() {
        let capsule = |a: DVec3, b: DVec3| Solid::Capsule {
            ends: [a, b],
            radius: 0.1,
        };
        let cube = Solid::Box {
            centre: DVec3::ZERO,
            halves: DMat3::from_diagonal(DVec3::splat(0.5)),
        };
        let rod = Solid::Cylinder {
            ends: [DVec3::new(2.0, 0.0, -1.0), DVec3::new(2.0, 0.0, 1.0)],
            radius: 0.25,
        };
        // Crossing at a distance of 1, and the same moved into one another.
        let along = capsule(-DVec3::X, DVec3::X);
        assert!(
            (distance(
                &along,
                &capsule(DVec3::new(0.3, -1.0, 1.0), DVec3::new(0.3, 1.0, 1.0))
            ) - 0.8)
                .abs()
                < 1e-15
        );
        assert!(
            (distance(
                &along,
                &capsule(DVec3::new(0.3, -1.0, 0.05), DVec3::new(0.3, 1.0, 0.05))
            ) + 0.15)
                .abs()
                < 1e-15
        );
        // A face, an edge, a corner of the cube, and the side of the rod.
        assert!(
            (distance(
                &cube,
                &capsule(DVec3::new(0.9, -2.0, 0.0), DVec3::new(0.9, 2.0, 0.0))
            ) - 0.3)
                .abs()
                < 1e-9
        );
        let corner = DVec3::splat(1.0);
        let expected = (corner - DVec3::splat(0.5)).length() - 0.1;
        assert!((distance(&cube, &capsule(corner, corner)) - expected).abs() < 1e-9);
        assert!((distance(&cube, &rod) - 1.25).abs() < 1e-9);
        let turn = Pose::new(
            DVec3::ZERO,
            DQuat::from_rotation_z(std::f64::consts::FRAC_PI_4),
        )
        .unwrap();
        assert!((distance(&cube.moved(&turn), &rod) - (1.75 - 0.5f64.sqrt())).abs() < 1e-9);
        // Cores that overlap.
        assert!((distance(&cube, &along) + 0.1).abs() < 1e-9);
    }
}
