//! What an arm is made of, for distances: capsules, cylinders and boxes on its links.

use selvedge_math::{DMat3, DVec3, Pose};

use crate::forward::Frame;

/// A convex body on a link.
#[derive(Clone, Debug)]
pub(crate) struct Body {
    /// The link it belongs to.
    pub(crate) link: String,
    /// How many joints of the arm move it.
    pub(crate) joints: usize,
    /// In the frame of the last of them, with the jaws closed and with the jaws open.
    pub(crate) solids: [Solid; 2],
    /// Whether it is drawn around fingers that have bodies of their own, see [`mark_envelopes`].
    pub(crate) envelope: bool,
}

/// Marks the body of the last link that stands for its fingers as a whole: the one about the middle
/// of a fingertip, which is the body furthest from the link's frame among those that the jaws move.
/// FR3's hand has one, rounded 7 mm further out than the fingertips: next to a table the fingers' own
/// boxes say more.
pub(crate) fn mark_envelopes(bodies: &mut [Body]) {
    let far = |body: &&Body| body.solids[0].ball().0.length();
    let moves = |body: &&Body| body.solids[0] != body.solids[1];
    let fingers = bodies.iter().filter(moves);
    let Some(tip) = fingers.max_by(|a, b| far(a).total_cmp(&far(b))) else {
        return;
    };
    let (joints, link) = (tip.joints, tip.link.clone());
    let middles = tip.solids.map(|solid| solid.ball().0);
    // How far the middles are from the axis of a body that holds them, at most.
    let holds = |body: &Body| {
        let Solid::Capsule { ends, radius } = body.solids[0] else {
            return None;
        };
        let along = ends[1] - ends[0];
        let off = middles.map(|p| {
            let share = (p - ends[0]).dot(along) / along.length_squared().max(1e-12);
            p.distance(ends[0] + share.clamp(0.0, 1.0) * along)
        });
        let off = off[0].max(off[1]);
        (body.joints == joints && body.link != link && off < radius).then_some(off)
    };
    let held = bodies.iter().enumerate();
    let held = held.filter_map(|(k, body)| Some((holds(body)?, k)));
    if let Some((_, k)) = held.min_by(|a, b| a.0.total_cmp(&b.0)) {
        bodies[k].envelope = true;
    }
}

/// A convex shape [m].
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Solid {
    /// What is within `radius` of the segment; a sphere where the ends are one point.
    Capsule { ends: [DVec3; 2], radius: f64 },
    /// A cylinder with flat ends.
    Cylinder { ends: [DVec3; 2], radius: f64 },
    /// A box; the columns are half edges.
    Box { centre: DVec3, halves: DMat3 },
}

impl Solid {
    pub(crate) fn moved(&self, pose: &Pose) -> Self {
        let rotation = pose.rotation_matrix();
        self.placed(&Frame {
            rotation,
            origin: pose.position(),
        })
    }

    #[inline]
    pub(crate) fn placed(&self, frame: &Frame) -> Self {
        let at = |p: DVec3| frame.origin + frame.rotation * p;
        match *self {
            Self::Capsule { ends, radius } => Self::Capsule {
                ends: ends.map(at),
                radius,
            },
            Self::Cylinder { ends, radius } => Self::Cylinder {
                ends: ends.map(at),
                radius,
            },
            Self::Box { centre, halves } => Self::Box {
                centre: at(centre),
                halves: frame.rotation * halves,
            },
        }
    }

    /// The height of its lowest point.
    #[inline]
    pub(crate) fn bottom(&self) -> f64 {
        match *self {
            Self::Capsule {
                ends: [a, b],
                radius,
            } => a.z.min(b.z) - radius,
            Self::Cylinder {
                ends: [a, b],
                radius,
            } => {
                // The rim hangs below the end by the part of the radius that is vertical.
                let axis = (b - a).normalize_or_zero();
                a.z.min(b.z) - radius * (1.0 - axis.z * axis.z).max(0.0).sqrt()
            }
            Self::Box { centre, halves } => {
                let [x, y, z] = [halves.x_axis, halves.y_axis, halves.z_axis];
                centre.z - (x.z.abs() + y.z.abs() + z.z.abs())
            }
        }
    }

    /// Centre and radius of a sphere around it.
    #[inline]
    pub(crate) fn ball(&self) -> (DVec3, f64) {
        match *self {
            Self::Capsule {
                ends: [a, b],
                radius,
            } => (0.5 * (a + b), 0.5 * a.distance(b) + radius),
            Self::Cylinder {
                ends: [a, b],
                radius,
            } => (0.5 * (a + b), (0.5 * a.distance(b)).hypot(radius)),
            Self::Box { centre, halves } => {
                let [x, y, z] = [halves.x_axis, halves.y_axis, halves.z_axis];
                let squared = x.length_squared() + y.length_squared() + z.length_squared();
                (centre, squared.sqrt())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use selvedge_math::DQuat;

    #[test]
    fn bottoms_by_hand() {
        let up = [DVec3::ZERO, DVec3::Z];
        let capsule = Solid::Capsule {
            ends: up,
            radius: 0.1,
        };
        let cylinder = Solid::Cylinder {
            ends: up,
            radius: 0.1,
        };
        let cube = Solid::Box {
            centre: DVec3::ZERO,
            halves: DMat3::from_diagonal(DVec3::splat(0.5)),
        };
        let turn =
            |angle| Pose::new(DVec3::ZERO, DQuat::from_rotation_x(f64::to_radians(angle))).unwrap();
        let bottom = |solid: &Solid, angle| solid.moved(&turn(angle)).bottom();
        assert!((bottom(&capsule, 0.0) + 0.1).abs() < 1e-15);
        assert!((bottom(&cylinder, 0.0)).abs() < 1e-15);
        // Lying, both are as low as their radius; upside down the cylinder is a metre down.
        assert!((bottom(&capsule, 90.0) + 0.1).abs() < 1e-15);
        assert!((bottom(&cylinder, 90.0) + 0.1).abs() < 1e-15);
        assert!((bottom(&cylinder, 180.0) + 1.0).abs() < 1e-12);
        assert!((bottom(&cube, 45.0) + 0.5f64.sqrt()).abs() < 1e-15);
        assert!((cube.ball().1 - 0.75f64.sqrt()).abs() < 1e-15);
    }
}
