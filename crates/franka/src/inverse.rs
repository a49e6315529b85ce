//! All configurations of a Franka arm that reach a pose, exactly.
//!
//! Given `q7` the rest is a chain of triangles. With the frame of link 7 known, so is the wrist
//! centre, at `v` from the shoulder. The lengths `B1` (shoulder to elbow) and `B2` (elbow to wrist)
//! and `L = |v|` make a triangle: its angle at the elbow gives `q4`, in two ways because upper arm
//! and forearm are bent by the elbow's offset `a`. The forearm's axis lies in the plane across the
//! axis of joint 6 and at a known angle from `v`: two ways, giving `q6`. Then the elbow is known,
//! and the shoulder's three axes meet in a point: two ways again.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use selvedge_math::{DVec3, Pose};

use crate::Error;
use crate::arm::{Arm, Joint, JointKind};

/// Seven joint positions [rad].
pub type Joints = [f64; 7];

/// What the exact inverse needs to know of the arm.
#[derive(Clone, Debug)]
pub(crate) struct Geometry {
    /// Frame of joint 1 at zero, moved up to the shoulder.
    shoulder: Pose,
    /// Elbow offset, upper arm, forearm, wrist offset [m].
    a: f64,
    d3: f64,
    d5: f64,
    a7: f64,
}

/// How far a description may be from the Franka's pattern [m and unit quaternions].
const PATTERN: f64 = 1e-6;

impl Geometry {
    /// The lengths, if the joints follow the pattern of the Franka arms: every axis is z, and each
    /// frame is turned by a quarter about x from the one before.
    pub(crate) fn of(joints: &[Joint]) -> Option<Self> {
        if joints.len() != 7 {
            return None;
        }
        let position = |k: usize| joints[k].origin.position();
        let (d3, a, d5, a7) = (-position(2).y, position(3).x, position(4).y, position(6).x);
        let pattern = [
            (DVec3::ZERO, -FRAC_PI_2),
            (DVec3::new(0.0, -d3, 0.0), FRAC_PI_2),
            (DVec3::new(a, 0.0, 0.0), FRAC_PI_2),
            (DVec3::new(-a, d5, 0.0), -FRAC_PI_2),
            (DVec3::ZERO, FRAC_PI_2),
            (DVec3::new(a7, 0.0, 0.0), FRAC_PI_2),
        ];
        let fits = joints[1..]
            .iter()
            .zip(pattern)
            .all(|(joint, (position, turn))| {
                let quarter = selvedge_math::DQuat::from_rotation_x(turn);
                joint.origin.position().distance(position) < PATTERN
                    && joint.origin.rotation().dot(quarter).abs() > 1.0 - PATTERN * PATTERN
            });
        let turns = joints
            .iter()
            .all(|joint| joint.axis == DVec3::Z && joint.kind != JointKind::Prismatic);
        let sizes = a > 0.0 && d3 > 0.0 && d5 > 0.0 && a7 > 0.0;
        (fits && turns && sizes).then(|| Self {
            shoulder: joints[0].origin,
            a,
            d3,
            d5,
            a7,
        })
    }
}

/// One configuration that reaches the pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// Joint positions [rad], each wrapped into its limits where that is possible.
    pub q: Joints,
    /// Whether all are within the limits of the joints.
    pub in_limits: bool,
    /// The upper arm stands on the axis of joint 1, so that only `q1 + q3` is determined: `q1` is
    /// the caller's, and every other choice with the same sum reaches the pose as well.
    pub free_shoulder: bool,
}

/// Up to eight configurations.
#[derive(Clone, Copy, Debug)]
pub struct Solutions {
    list: [Solution; 8],
    count: usize,
}

impl Solutions {
    /// The configurations, whether within limits or not.
    pub fn as_slice(&self) -> &[Solution] {
        &self.list[..self.count]
    }

    fn push(&mut self, solution: Solution) {
        if let Some(place) = self.list.get_mut(self.count) {
            *place = solution;
            self.count += 1;
        }
    }
}

/// The shoulder counts as singular when the upper arm is so near to the axis of joint 1 [sine].
const SHOULDER: f64 = 1e-12;
/// A square below zero by no more than this, against its largest term, is a rounded zero.
const ROUNDED: f64 = 1e-14;

impl Arm {
    /// All configurations of a Franka arm in which the tip has the pose `target` (in the base link)
    /// and joint 7 stands at `q7` [rad]. `q1` is what joint 1 gets where it is free, see
    /// [`Solution::free_shoulder`].
    ///
    /// None is left out: both bends of the elbow, the stretched one included, both forearms and
    /// both shoulders; limits do not drop solutions but are reported with each. A pose out of reach
    /// gives none.
    ///
    /// ```
    /// use selvedge_franka::Arm;
    /// let arm = Arm::fr3();
    /// let q = [0.3, -0.4, 0.2, -2.1, 0.1, 1.8, 0.6];
    /// let solutions = arm.inverse(&arm.forward(&q), q[6], 0.0)?;
    /// let recovered = |s: &selvedge_franka::Solution| {
    ///     s.in_limits && s.q.iter().zip(&q).all(|(a, b)| (a - b).abs() < 1e-9)
    /// };
    /// assert!(solutions.as_slice().iter().any(recovered));
    /// # Ok::<(), selvedge_franka::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::NotFranka`] for an arm of another shape, [`Error::NotFinite`] for a `q7` or `q1`
    /// that is not finite.
    pub fn inverse(&self, target: &Pose, q7: f64, q1: f64) -> Result<Solutions, Error> {
        let Some(geometry) = self.geometry() else {
            return Err(Error::NotFranka(self.name().to_owned()));
        };
        if !q7.is_finite() || !q1.is_finite() {
            return Err(Error::NotFinite(if q7.is_finite() { "q1" } else { "q7" }));
        }
        let none = Solution {
            q: [0.0; 7],
            in_limits: false,
            free_shoulder: false,
        };
        let mut solutions = Solutions {
            list: [none; 8],
            count: 0,
        };
        let link7 = geometry.shoulder.inverse() * (*target * self.tool().inverse());
        self.elbows(geometry, &link7, q7, q1, &mut solutions);
        Ok(solutions)
    }

    fn elbows(&self, g: &Geometry, link7: &Pose, q7: f64, q1: f64, solutions: &mut Solutions) {
        // Axes of link 6, and the wrist centre seen from the shoulder
        let rotation = link7.rotation_matrix();
        let (sin7, cos7) = q7.sin_cos();
        let x6 = cos7 * rotation.x_axis - sin7 * rotation.y_axis;
        let y6 = -rotation.z_axis;
        let z6 = rotation.z_axis.cross(x6);
        let v = link7.position() - g.a7 * x6;

        // The triangle shoulder - elbow - wrist; its angles by half tangents with common factors,
        // which stay consistent when the arm is nearly stretched
        let (b1, b2, l) = (g.d3.hypot(g.a), g.d5.hypot(g.a), v.length());
        let (bend1, bend2) = (g.a.atan2(g.d3), g.a.atan2(g.d5));
        let slack = b1 + b2 - l;
        let (near, far) = (l - (b1 - b2), l + (b1 - b2));
        if slack < 0.0 || near <= 0.0 || far <= 0.0 {
            return;
        }
        let whole = b1 + b2 + l;
        let elbow = 2.0 * (near * far).sqrt().atan2((slack * whole).sqrt());
        let wrist = 2.0 * (slack * far).sqrt().atan2((whole * near).sqrt());

        let wrist_plane = (v.dot(x6), v.dot(y6));
        let in_plane = wrist_plane.0 * wrist_plane.0 + wrist_plane.1 * wrist_plane.1;
        let bent = (elbow - PI - bend1 - bend2, bend2 + wrist);
        let stretched = (PI - bend1 - bend2 - elbow, bend2 - wrist);
        for (q4, from_v) in [bent, stretched] {
            // The forearm's axis z5 is at the angle `from_v` from v, and across z6.
            let along = l * from_v.cos();
            let square = in_plane - along * along;
            if square < -ROUNDED * l * l || in_plane == 0.0 {
                continue;
            }
            let root = square.max(0.0).sqrt();
            // Which side of v the elbow is on must agree with the sign of the angle.
            for across in [root, -root] {
                let (vx, vy) = wrist_plane;
                let sin6 = (vx * along + vy * across) / in_plane;
                let cos6 = (vy * along - vx * across) / in_plane;
                let z5 = sin6 * x6 + cos6 * y6;
                let q6 = sin6.atan2(cos6);
                let partial = Partial {
                    v,
                    z5,
                    z6,
                    from_v,
                    q4,
                    q6,
                    q7,
                };
                self.shoulders(g, &partial, q1, solutions);
                if root == 0.0 {
                    break;
                }
            }
        }
    }

    fn shoulders(&self, g: &Geometry, partial: &Partial, seed: f64, solutions: &mut Solutions) {
        let &Partial {
            v,
            z5,
            z6,
            from_v,
            q4,
            q6,
            q7,
        } = partial;
        // Elbow axis z4, forearm and upper arm frames
        let across = z5.cross(v);
        if across.length_squared() == 0.0 {
            return;
        }
        let z4 = across.normalize() * from_v.signum();
        let x4 = z5.cross(z4);
        let elbow = v - g.d5 * z5 + g.a * x4;
        let (b1, bend1) = (g.d3.hypot(g.a), g.a.atan2(g.d3));
        let (sin, cos) = bend1.sin_cos();
        let u = (cos * elbow + sin * z4.cross(elbow)) / b1;
        let x3 = u.cross(z4);
        let x5 = z5.cross(z6);
        let q5 = (-x5.dot(z4)).atan2(x5.dot(x4));

        let r = u.x.hypot(u.y);
        let free_shoulder = r < SHOULDER;
        let (sin1, cos1) = if free_shoulder {
            seed.sin_cos()
        } else {
            (u.y / r, u.x / r)
        };
        let q1 = if free_shoulder {
            seed
        } else {
            sin1.atan2(cos1)
        };
        let q2 = r.atan2(u.z);
        let q3 = (cos1 * x3.y - sin1 * x3.x).atan2(u.z * (cos1 * x3.x + sin1 * x3.y) - r * x3.z);
        let mut add = |q: Joints| {
            let mut q = q;
            let mut in_limits = true;
            for (q, joint) in q.iter_mut().zip(self.joints()) {
                *q = wrapped(*q, joint);
                in_limits &= joint.limits.contain(*q);
            }
            solutions.push(Solution {
                q,
                in_limits,
                free_shoulder,
            });
        };
        add([q1, q2, q3, q4, q5, q6, q7]);
        if !free_shoulder {
            add([q1 + PI, -q2, q3 + PI, q4, q5, q6, q7]);
        }
    }
}

/// What is known once the forearm has been placed.
struct Partial {
    v: DVec3,
    z5: DVec3,
    z6: DVec3,
    /// Angle from `v` to the forearm's axis, signed by the side of the elbow.
    from_v: f64,
    q4: f64,
    q6: f64,
    q7: f64,
}

/// The angle in the joint's limits that differs by whole turns, or the one nearest to zero.
fn wrapped(angle: f64, joint: &Joint) -> f64 {
    let near = angle - TAU * (angle / TAU).round();
    let in_limits = |candidate: &f64| joint.limits.contain(*candidate);
    [near, near + TAU, near - TAU]
        .into_iter()
        .find(in_limits)
        .unwrap_or(near)
}
