//! Where an obstacle's surface is, in the obstacle's own frame.

use selvedge_math::DVec3;

use crate::broad::Bounds;
use crate::distance::nearest_on_segment;
use crate::solid::{Foot, Solid};

/// A node that is nearer than this rests on the surface [m].
const ON: f64 = 2e-4;
/// Planes of one substep that are turned by more against each other belong to different sides: the
/// cosine of the angle.
const SAME_SIDE: f64 = 0.5;

#[derive(Clone, Debug)]
pub(crate) enum Shape {
    /// `normal . (x - point) <= 0`.
    HalfSpace { point: DVec3, normal: DVec3 },
    /// All points within `radius` of a segment, or of a point if its ends are the same.
    Round { core: [DVec3; 2], radius: f64 },
    /// A body with flat faces.
    Solid(Box<Solid>),
}

/// The plane that keeps a node out for one substep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Tangent {
    /// A point of the surface, on the plane.
    pub(crate) point: DVec3,
    /// The plane's normal, along which the surface pushes.
    pub(crate) normal: DVec3,
    /// The surface's normal at the end of the substep, along which the node has no velocity.
    pub(crate) end_normal: DVec3,
    /// Of the node at the start, negative inside [m].
    pub(crate) distance: f64,
}

impl Shape {
    /// None if it is unbounded.
    pub(crate) fn bounds(&self) -> Option<Bounds> {
        match self {
            Self::HalfSpace { .. } => None,
            Self::Round {
                core: [a, b],
                radius,
            } => Some(Bounds {
                low: a.min(*b) - *radius,
                high: a.max(*b) + *radius,
            }),
            Self::Solid(solid) => Some(solid.bounds()),
        }
    }

    /// The nearest point of the surface.
    pub(crate) fn foot(&self, p: DVec3) -> Foot {
        match self {
            Self::HalfSpace { point, normal } => {
                let distance = normal.dot(p - *point);
                Foot {
                    point: p - *normal * distance,
                    normal: *normal,
                    distance,
                }
            }
            Self::Round { core, radius } => {
                let centre = core[0].lerp(core[1], nearest_on_segment(p, *core));
                let away = p - centre;
                // On the core every way out is as long.
                let normal = away
                    .try_normalize()
                    .or_else(|| (core[1] - core[0]).any_orthogonal_vector().try_normalize())
                    .unwrap_or(DVec3::Z);
                Foot {
                    point: centre + normal * *radius,
                    normal,
                    distance: away.length() - radius,
                }
            }
            Self::Solid(solid) => solid.foot(p),
        }
    }

    /// The plane for a node at `start` that will be at about `end`.
    ///
    /// The plane of the point nearest to the start has a convex body on its other side, so no node
    /// that stays in front of it can be inside, however fast it is. The plane of the point nearest to
    /// the end is as safe if the node stays in front of it, and nearer to what is sought: the node
    /// ends on the surface rather than on a tangent. It serves unless it belongs to another side of
    /// the body. On a round body a node that rests slides along a chord, at right angles to the mean
    /// of the two normals: forces along that do no work, and the velocity `2 u/h - v_0` is along
    /// the surface again.
    ///
    /// A body that is not convex has many sides; there the way from start to end tells which one the
    /// node meets first.
    ///
    /// A node on an edge stays on the face it rested on, whose normal is `before`. On a round body the
    /// node stays by `lift` [m] above the surface, so that its edges and faces are not inside.
    pub(crate) fn tangent(
        &self,
        start: DVec3,
        end: DVec3,
        before: Option<DVec3>,
        lift: f64,
    ) -> Tangent {
        let (at_start, at_end) = match (self, before) {
            (Self::Solid(solid), Some(before)) => {
                (solid.foot_as_before(start, before), self.foot(end))
            }
            (Self::Round { .. }, _) => (self.foot(start).lifted(lift), self.foot(end).lifted(lift)),
            _ => (self.foot(start), self.foot(end)),
        };
        let distance = at_start.distance;
        let of = |foot: Foot, normal: DVec3| Tangent {
            point: foot.point,
            normal,
            end_normal: foot.normal,
            distance,
        };
        let same = at_start.normal.dot(at_end.normal) > SAME_SIDE;
        match self {
            Self::HalfSpace { .. } => of(at_start, at_start.normal),
            Self::Round { .. } if same && distance < ON => {
                of(at_end, (at_start.normal + at_end.normal).normalize())
            }
            Self::Solid(solid) if !solid.convex => {
                let entry = match distance > 0.0 {
                    true => solid.entry(start, end),
                    false => None,
                };
                match entry {
                    Some(entry) => of(entry, entry.normal),
                    None if distance > 0.0 && at_end.distance > 0.0 => of(at_end, at_end.normal),
                    None => of(at_start, at_start.normal),
                }
            }
            _ if same => of(at_end, at_end.normal),
            _ => of(at_start, at_start.normal),
        }
    }
}
