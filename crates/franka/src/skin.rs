//! The shapes of an arm as triangles, to be looked at.

use selvedge_math::DVec3;

use crate::Arm;
use crate::body::Solid;

/// Corners around a round body.
const SIDES: u32 = 14;

/// The collision shapes of an arm as one surface of triangles, outside to the front. Bodies stand for
/// themselves: where two overlap both surfaces are there.
#[derive(Clone, Debug)]
pub struct Skin<'a> {
    arm: &'a Arm,
    /// Three points each.
    pub triangles: Vec<[u32; 3]>,
}

impl Arm {
    /// The arm's shapes as triangles.
    ///
    /// ```
    /// let arm = selvedge_franka::Arm::fr3();
    /// let skin = arm.skin();
    /// let points = skin.points(&selvedge_franka::home(&arm), true);
    /// assert!(skin.triangles.iter().flatten().all(|k| (*k as usize) < points.len()));
    /// ```
    pub fn skin(&self) -> Skin<'_> {
        let mut triangles = Vec::new();
        let mut first = 0;
        for body in self.bodies() {
            let own = match body.solids[0] {
                Solid::Box { .. } => BOX.to_vec(),
                ref round => around(profile(round).len() as u32),
            };
            triangles.extend(own.iter().map(|corners| corners.map(|k| first + k)));
            first += points(&body.solids[0]).len() as u32;
        }
        Skin {
            arm: self,
            triangles,
        }
    }
}

impl Skin<'_> {
    /// The points [m, base link] at joint positions `q` [rad or m], with the jaws open or closed.
    ///
    /// # Panics
    /// When there is not one position a joint.
    pub fn points(&self, q: &[f64], open: bool) -> Vec<DVec3> {
        assert_eq!(q.len(), self.arm.joints().len(), "one position a joint");
        let mut frames = Vec::new();
        self.arm.frames(q, &mut frames);
        let bodies = self.arm.bodies().iter();
        let placed = bodies.map(|body| body.solids[usize::from(open)].placed(&frames[body.joints]));
        placed.flat_map(|solid| points(&solid)).collect()
    }
}

/// Half a section of a round body from end to end: at which end, and how far along the axis and from
/// it, in radii.
fn profile(solid: &Solid) -> Vec<(usize, f64, f64)> {
    /// Steps from the pole of a cap to its rim.
    const STEPS: u32 = 3;
    match solid {
        Solid::Cylinder { .. } => vec![(0, 0.0, 0.0), (0, 0.0, 1.0), (1, 0.0, 1.0), (1, 0.0, 0.0)],
        _ => {
            let angle = |k: u32| std::f64::consts::FRAC_PI_2 * f64::from(k) / f64::from(STEPS);
            let start = (0..=STEPS).map(|k| (0, -angle(STEPS - k).sin(), angle(STEPS - k).cos()));
            let end = (0..=STEPS).map(|k| (1, angle(k).sin(), angle(k).cos()));
            start.chain(end).collect()
        }
    }
}

/// Corners of a box, two bits of which are x and y.
const BOX: [[u32; 3]; 12] = [
    [0, 2, 1],
    [1, 2, 3],
    [4, 5, 6],
    [5, 7, 6], // below and above
    [0, 1, 4],
    [1, 5, 4],
    [2, 6, 3],
    [3, 6, 7], // front and back
    [0, 4, 2],
    [2, 4, 6],
    [1, 3, 5],
    [3, 7, 5], // left and right
];

fn points(solid: &Solid) -> Vec<DVec3> {
    let (ends, radius) = match *solid {
        Solid::Box { centre, halves } => {
            let corner = |k: u32| {
                let sign = |bit: u32| if k >> bit & 1 == 1 { 1.0 } else { -1.0 };
                centre + halves * DVec3::new(sign(0), sign(1), sign(2))
            };
            return (0..8).map(corner).collect();
        }
        Solid::Capsule { ends, radius } | Solid::Cylinder { ends, radius } => (ends, radius),
    };
    let axis = (ends[1] - ends[0]).try_normalize().unwrap_or(DVec3::Z);
    let (x, y) = axis.any_orthonormal_pair();
    let ring = |(end, along, out): (usize, f64, f64)| {
        (0..SIDES).map(move |k| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(SIDES)).sin_cos();
            ends[end] + radius * (along * axis + out * (cos * x + sin * y))
        })
    };
    profile(solid).into_iter().flat_map(ring).collect()
}

/// Triangles between rings of [`SIDES`] points; those at a pole have no area.
fn around(rings: u32) -> Vec<[u32; 3]> {
    let mut triangles = Vec::new();
    for ring in 1..rings {
        for k in 0..SIDES {
            let next = (k + 1) % SIDES;
            let [a, b] = [(ring - 1) * SIDES + k, (ring - 1) * SIDES + next];
            let [c, d] = [a + SIDES, b + SIDES];
            triangles.extend([[a, b, d], [a, d, c]]);
        }
    }
    triangles
}

#[cfg(test)]
mod tests {
    use super::*;
    use selvedge_math::DMat3;

    /// The volume inside a closed surface whose front is outside, by the divergence theorem.
    fn volume(points: &[DVec3], triangles: &[[u32; 3]]) -> f64 {
        let six = |corners: &[u32; 3]| {
            let [a, b, c] = corners.map(|k| points[k as usize]);
            a.dot(b.cross(c))
        };
        triangles.iter().map(six).sum::<f64>() / 6.0
    }

    #[test]
    fn surfaces_enclose_their_bodies() {
        use std::f64::consts::PI;
        let ends = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.3, 2.4, 3.0)]; // half a metre
        let radius = 0.2;
        let cuboid = Solid::Box {
            centre: DVec3::ONE,
            halves: DMat3::from_diagonal(DVec3::new(0.1, 0.2, 0.3)),
        };
        let of = |solid: &Solid| volume(&points(solid), &around(profile(solid).len() as u32));
        assert!((volume(&points(&cuboid), &BOX) - 0.048).abs() < 1e-12);
        // A polygon of 14 sides has 0.967 of the circle's area.
        let share = f64::from(SIDES) / (2.0 * PI) * (2.0 * PI / f64::from(SIDES)).sin();
        let rod = PI * radius * radius * 0.5 * share;
        assert!((of(&Solid::Cylinder { ends, radius }) - rod).abs() < 1e-12);
        let capsule = of(&Solid::Capsule { ends, radius });
        let round = rod + 4.0 / 3.0 * PI * radius.powi(3);
        assert!(
            capsule > 0.9 * round && capsule < round,
            "{capsule} of {round}"
        );
    }

    #[test]
    fn the_skin_is_where_the_arm_is() {
        let arm = Arm::fr3();
        let (skin, q) = (arm.skin(), crate::home(&arm));
        let closed = skin.points(&q, false);
        assert_eq!(
            skin.triangles.iter().flatten().max(),
            Some(&(closed.len() as u32 - 1))
        );
        // The tip lies between the fingers, and they are further apart when open.
        let tip = arm.forward(&q).position();
        let near = |points: &[DVec3]| {
            let distances = points.iter().map(|p| p.distance(tip));
            distances.fold(f64::INFINITY, f64::min)
        };
        assert!(near(&closed) < 0.02);
        assert!(near(&skin.points(&q, true)) > near(&closed) + 0.01);
        let lowest = closed.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
        assert!(lowest > -0.1 && lowest < 0.05, "{lowest}");
    }
}
