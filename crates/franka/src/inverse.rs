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
    /// Shoulder to elbow and elbow to wrist [m], and their angles to upper arm and forearm [rad].
    b1: f64,
    b2: f64,
    bend1: f64,
    bend2: f64,
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
            b1: d3.hypot(a),
            b2: d5.hypot(a),
            bend1: a.atan2(d3),
            bend2: a.atan2(d5),
        })
    }

    /// How far the elbow is turned from its stretch when the triangle has `angle` at the wrist
    /// [rad], and how much longer than `l` its third side then is [m]. None if there is no such
    /// triangle.
    fn turn(&self, angle: f64, l: f64) -> Option<(f64, f64)> {
        let &Self { b1, b2, .. } = self;
        let (sin, cos) = angle.sin_cos();
        let sin_shoulder = b2 * sin / b1;
        if sin_shoulder.abs() > 1.0 {
            return None;
        }
        let cos_shoulder = (1.0 - sin_shoulder * sin_shoulder)
            .sqrt()
            .copysign(l * l + b1 * b1 - b2 * b2);
        let third = b1 * cos_shoulder + b2 * cos;
        Some((angle + sin_shoulder.atan2(cos_shoulder), third - l))
    }
}

/// One configuration that reaches the pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// Joint positions [rad], each wrapped into its limits where that is possible, and put on a limit
    /// that it misses by rounding.
    pub q: Joints,
    /// Whether all are within the limits of the joints.
    pub in_limits: bool,
    /// The upper arm stands on the axis of joint 1, so that only `q1 + q3` is determined: `q1` is
    /// the caller's, and every other choice with the same sum reaches the pose as well.
    pub free_shoulder: bool,
    /// The forearm's axis passes through the shoulder (on a Franka `q4 = 0`, outside its limits), so
    /// that the elbow turns freely about it: `q5 = 0` stands for every other choice, which reaches
    /// the pose with another upper arm; where `q4 = 0` those have the same sum `q3 + q5`.
    pub free_elbow: bool,
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
const FREE_SHOULDER: f64 = 1e-11;
/// The elbow counts as free when the forearm's axis passes so near to the shoulder [sine].
const FREE_ELBOW: f64 = 1e-12;
/// What rounding may do to a length, against the sum of the lengths it comes from.
const ROUNDED: f64 = 32.0 * f64::EPSILON;
/// So near to a fold or a singular posture [m against m, or sine] a solution is tried out before it
/// is told.
const POOR: f64 = 1e-6;
/// A joint beyond its limit by no more than this is put on it [rad].
const AT_LIMIT: f64 = 1e-12;
/// A solution that is tried out must reach the pose as well as this [m and rad].
const REACHED: f64 = 1e-10;

impl Arm {
    /// All configurations of a Franka arm in which the tip has the pose `target` (in the base link)
    /// and joint 7 stands at `q7` [rad]. `q1` is what joint 1 gets where it is free, see
    /// [`Solution::free_shoulder`].
    ///
    /// None is left out: both bends of the elbow, the stretched one included, both forearms and
    /// both shoulders; limits do not drop solutions but are reported with each. A pose out of reach
    /// gives none. Where two solutions meet (the elbow at its stretch, `q5` at a quarter turn) the
    /// pose determines them to half the digits only; there is then at least one, and it reaches the
    /// pose as exactly as elsewhere.
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
            free_elbow: false,
        };
        let mut solutions = Solutions {
            list: [none; 8],
            count: 0,
        };
        let aim = Aim {
            tip: *target,
            link7: geometry.shoulder.inverse() * (*target * self.tool().inverse()),
            q7,
            q1,
        };
        self.elbows(geometry, &aim, &mut solutions);
        Ok(solutions)
    }

    /// How far the wrist centre is beyond the reach of the elbow [m] when the tip has the pose
    /// `target` and joint 7 stands at `q7`: negative within reach. None for an arm of another shape.
    pub(crate) fn beyond_reach(&self, target: &Pose, q7: f64) -> Option<f64> {
        let g = self.geometry()?;
        let link7 = g.shoulder.inverse() * (*target * self.tool().inverse());
        let x6 = link7.rotation() * DVec3::new(q7.cos(), -q7.sin(), 0.0);
        let l = (link7.position() - g.a7 * x6).length();
        Some((l - g.b1 - g.b2).max((g.b1 - g.b2).abs() - l))
    }

    fn elbows(&self, g: &Geometry, aim: &Aim, solutions: &mut Solutions) {
        let link7 = &aim.link7;
        // Axes of link 6, and the wrist centre seen from the shoulder
        let rotation = link7.rotation_matrix();
        let (sin7, cos7) = aim.q7.sin_cos();
        let x6 = cos7 * rotation.x_axis - sin7 * rotation.y_axis;
        let y6 = -rotation.z_axis;
        let z6 = rotation.z_axis.cross(x6);
        let v = link7.position() - g.a7 * x6;

        // The triangle shoulder - elbow - wrist; its angles by half tangents with common factors,
        // which stay consistent when the arm is nearly stretched. Where rounding has made the wrist
        // centre lie just out of reach, the triangle is the stretched (or folded) one.
        let &Geometry { b1, b2, .. } = g;
        let l = v.length();
        let whole = b1 + b2 + l;
        let rounding = ROUNDED * (whole + link7.position().length());
        let sides = [b1 + b2 - l, l - (b1 - b2), l + (b1 - b2)];
        let least = sides[0].min(sides[1]).min(sides[2]);
        let (vx, vy, vz) = (v.dot(x6), v.dot(y6), v.dot(z6));
        let in_plane = (vx * vx + vy * vy).sqrt();
        if least < -rounding || in_plane == 0.0 {
            return;
        }
        let [slack, near, far] = sides.map(|side| side.max(0.0));
        let turn = 2.0 * (slack * whole).sqrt().atan2((near * far).sqrt());
        // Of the angle at the wrist
        let (tall, wide) = (slack * far, whole * near);
        let sin_wrist = 2.0 * (tall * wide).sqrt() / (wide + tall);
        let cos_wrist = (wide - tall) / (wide + tall);

        let mut last_fold = None;
        for side in [1.0, -1.0] {
            // Bent, then stretched; where the triangle is flat the two are one.
            if side < 0.0 && least <= 0.0 {
                break;
            }
            // The forearm's axis z5 is at a known angle from v, and across z6. Of v, `along` is
            // along z5, `aside` across it on the elbow's side or against, `across` along z6 x z5.
            // That one comes from a difference of squares, of which the smaller pair is taken, so
            // that it keeps its digits when v is nearly along z5 or z6.
            let mut turn = side * turn;
            let sin = (g.a * cos_wrist + side * g.d5 * sin_wrist) / b2;
            let cos = (g.d5 * cos_wrist - side * g.a * sin_wrist) / b2;
            let (mut along, mut aside) = (l * cos, l * sin);
            let (large, small) = match sin.abs() <= cos.abs() {
                true => (aside.abs(), vz.abs()),
                false => (in_plane, along.abs()),
            };
            let mut across = 0.0;
            let free_elbow = large.max(small) < FREE_ELBOW * l;
            let folded = large <= small || free_elbow;
            if !folded {
                across = ((large - small) * (large + small)).sqrt();
            } else if !free_elbow {
                // The two places of the forearm have met. That is where the angle is the one of v
                // from the plane, if the triangle allows that angle up to rounding: it may be far
                // from the angle found, as a nearly stretched triangle determines its angles to
                // half the digits only.
                along = in_plane.copysign(along);
                aside = vz.abs().copysign(aside);
                let turned = g.turn(aside.atan2(along) - g.bend2, l);
                if let Some((turned, _)) = turned.filter(|(_, gap)| gap.abs() <= rounding) {
                    if last_fold == Some(aside) {
                        break;
                    }
                    last_fold = Some(aside);
                    turn = turned;
                } else if small - large > rounding {
                    continue;
                }
            }
            let poor = folded
                || least < POOR * l
                || aside.abs() < POOR * l
                || across < POOR * l
                || in_plane < POOR * l;
            // Of z5 in the plane (x6, y6), and of z4 in the plane (x5, z6), x5 being across z5.
            let length = in_plane * (along * along + across * across).sqrt();
            let mut place = |across: f64| {
                let (sin6, cos6) = (
                    (vx * along + vy * across) / length,
                    (vy * along - vx * across) / length,
                );
                let z5 = sin6 * x6 + cos6 * y6;
                let x5 = cos6 * x6 - sin6 * y6;
                // Which side of v the elbow is on must agree with the sign of the angle.
                let (on_x5, on_z6) = if free_elbow {
                    (0.0, 1.0)
                } else {
                    let scale = (vz * vz + across * across).sqrt().copysign(aside);
                    (vz / scale, across / scale)
                };
                let z4 = on_x5 * x5 + on_z6 * z6;
                let x4 = on_z6 * x5 - on_x5 * z6;
                let partial = Partial {
                    elbow: v - g.d5 * z5 + g.a * x4,
                    z4,
                    rest: [
                        -g.bend1 - g.bend2 - turn,
                        (-on_x5).atan2(on_z6),
                        sin6.atan2(cos6),
                        aim.q7,
                    ],
                    free_elbow,
                    poor,
                };
                self.shoulders(g, &partial, aim, solutions);
            };
            place(across);
            if !folded {
                place(-across);
            }
        }
    }

    fn shoulders(&self, g: &Geometry, partial: &Partial, aim: &Aim, solutions: &mut Solutions) {
        let &Partial { elbow, z4, .. } = partial;
        let u = (g.d3 * elbow + g.a * z4.cross(elbow)) / (g.b1 * g.b1);
        let x3 = u.cross(z4);
        let r = (u.x * u.x + u.y * u.y).sqrt();
        let free_shoulder = r < FREE_SHOULDER;
        let (q1, (sin1, cos1)) = if free_shoulder {
            (aim.q1, aim.q1.sin_cos())
        } else {
            (u.y.atan2(u.x), (u.y / r, u.x / r))
        };
        let lean = cos1 * u.x + sin1 * u.y;
        let q2 = lean.atan2(u.z);
        let q3 = (cos1 * x3.y - sin1 * x3.x).atan2(u.z * (cos1 * x3.x + sin1 * x3.y) - lean * x3.z);
        let poor = partial.poor || r < POOR;
        let [q4, q5, q6, q7] = partial.rest;
        let mut add = |q: Joints| {
            let mut q = q;
            let mut in_limits = true;
            for (q, joint) in q.iter_mut().zip(self.joints()) {
                *q = wrapped(*q, joint);
                in_limits &= joint.limits.contain(*q);
            }
            if !poor || self.reaches(&q, &aim.tip) {
                solutions.push(Solution {
                    q,
                    in_limits,
                    free_shoulder,
                    free_elbow: partial.free_elbow,
                });
            }
        };
        add([q1, q2, q3, q4, q5, q6, q7]);
        if !free_shoulder {
            add([q1 + PI, -q2, q3 + PI, q4, q5, q6, q7]);
        }
    }

    /// Whether the tip is where it should be, in metres and in radians.
    fn reaches(&self, q: &Joints, target: &Pose) -> bool {
        let pose = self.forward(q);
        let turn = pose.rotation().conjugate() * target.rotation();
        let angle = 2.0 * DVec3::new(turn.x, turn.y, turn.z).length();
        pose.position().distance(target.position()) < REACHED && angle < REACHED
    }
}

/// What is to be reached, and what the caller chose.
struct Aim {
    /// Pose of the tip in the base link, and the pose of link 7 it asks for, from the shoulder.
    tip: Pose,
    link7: Pose,
    q7: f64,
    /// For a free shoulder.
    q1: f64,
}

/// What is known once the forearm has been placed.
struct Partial {
    /// Origin of link 4, seen from the shoulder, and its axis.
    elbow: DVec3,
    z4: DVec3,
    /// Joints 4 to 7.
    rest: [f64; 4],
    free_elbow: bool,
    /// Near a fold or a singular posture.
    poor: bool,
}

/// The angle in the joint's limits that differs by whole turns, up to rounding, or the one nearest
/// to zero.
fn wrapped(angle: f64, joint: &Joint) -> f64 {
    let limits = joint.limits;
    if angle.abs() <= PI && limits.contain(angle) {
        return angle;
    }
    let near = angle - TAU * (angle / TAU).round();
    [near, near + TAU, near - TAU]
        .into_iter()
        .find(|&candidate| limits.margin(candidate) >= -AT_LIMIT)
        .map_or(near, |candidate| {
            candidate.max(limits.lower).min(limits.upper)
        })
}
