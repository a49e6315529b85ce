//! From joint positions to poses and velocities.

use selvedge_math::{DMat3, DQuat, DVec3, Pose};

use crate::arm::{Arm, Joint, JointKind};

/// A rotation matrix and an origin [m]: cheaper than a pose to chain.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Frame {
    pub(crate) rotation: DMat3,
    pub(crate) origin: DVec3,
}

impl Frame {
    pub(crate) const BASE: Self = Self {
        rotation: DMat3::IDENTITY,
        origin: DVec3::ZERO,
    };

    /// The frame of the next joint.
    #[inline]
    fn after(&self, joint: &Joint, q: f64) -> Self {
        let origin = self.origin + self.rotation * joint.origin.position();
        let rotation = self.rotation * joint.rotation;
        match joint.kind {
            JointKind::Prismatic => Self {
                origin: origin + q * (rotation * joint.axis),
                rotation,
            },
            // Nearly every joint turns about its z axis.
            _ if joint.axis == DVec3::Z => {
                let (sin, cos) = q.sin_cos();
                let (x, y) = (rotation.x_axis, rotation.y_axis);
                let rotation =
                    DMat3::from_cols(cos * x + sin * y, cos * y - sin * x, rotation.z_axis);
                Self { origin, rotation }
            }
            _ => Self {
                origin,
                rotation: rotation * DMat3::from_axis_angle(joint.axis, q),
            },
        }
    }

    fn pose(&self, offset: Pose) -> Pose {
        let rotation = DQuat::from_mat3(&self.rotation) * offset.rotation();
        Pose::from_unit(
            self.origin + self.rotation * offset.position(),
            rotation / rotation.length(),
        )
    }
}

impl Arm {
    /// The pose of the tip in the base link.
    ///
    /// # Panics
    /// When `q` has not one entry a joint.
    pub fn forward(&self, q: &[f64]) -> Pose {
        assert_eq!(q.len(), self.joints().len(), "one position a joint");
        let frame = self
            .joints()
            .iter()
            .zip(q)
            .fold(Frame::BASE, |f, (joint, &q)| f.after(joint, q));
        frame.pose(self.tool())
    }

    /// The base and the frame after each joint, so that entry `k` is what `k` joints move.
    pub(crate) fn frames(&self, q: &[f64], frames: &mut Vec<Frame>) {
        frames.clear();
        let mut frame = Frame::BASE;
        frames.push(frame);
        for (joint, &q) in self.joints().iter().zip(q) {
            frame = frame.after(joint, q);
            frames.push(frame);
        }
    }

    /// The pose of a link between base and tip in the base link, or none if there is no such link.
    ///
    /// # Panics
    /// When `q` has not one entry a joint.
    pub fn link_pose(&self, q: &[f64], link: &str) -> Option<Pose> {
        assert_eq!(q.len(), self.joints().len(), "one position a joint");
        let (count, offset) = self.link(link)?;
        let joints = self.joints().iter().zip(q).take(count);
        Some(
            joints
                .fold(Frame::BASE, |f, (joint, &q)| f.after(joint, q))
                .pose(offset),
        )
    }

    /// The pose of the tip and the geometric Jacobian: column `i` is the velocity of the tip for
    /// unit velocity of joint `i`, first the linear velocity of the tip's origin [m/s], then the
    /// angular velocity [rad/s], both along the axes of the base link.
    ///
    /// # Panics
    /// When `q` or `columns` has not one entry a joint.
    pub fn jacobian(&self, q: &[f64], columns: &mut [[f64; 6]]) -> Pose {
        let joints = self.joints();
        assert_eq!(q.len(), joints.len(), "one position a joint");
        assert_eq!(columns.len(), joints.len(), "one column a joint");
        let mut frame = Frame::BASE;
        // First pass: the axis and a point on it.
        for ((joint, &q), column) in joints.iter().zip(q).zip(&mut *columns) {
            frame = frame.after(joint, q);
            let axis = frame.rotation * joint.axis;
            *column = pair(frame.origin, axis);
        }
        let tip = frame.pose(self.tool());
        // Second pass, now that the tip is known: a turning joint moves it across its lever.
        for (joint, column) in joints.iter().zip(columns) {
            let [origin, axis] = [0, 3].map(|k| DVec3::from_slice(&column[k..k + 3]));
            *column = match joint.kind {
                JointKind::Prismatic => pair(axis, DVec3::ZERO),
                _ => pair(axis.cross(tip.position() - origin), axis),
            };
        }
        tip
    }
}

fn pair(a: DVec3, b: DVec3) -> [f64; 6] {
    [a.x, a.y, a.z, b.x, b.y, b.z]
}

/// Yoshikawa's manipulability `sqrt(det(J J^T))`; 0 where some tip velocity is out of reach. Its unit
/// is a mixture, so compare it between configurations of one arm only.
pub fn manipulability(columns: &[[f64; 6]]) -> f64 {
    let mut gram = [[0.0; 6]; 6];
    for column in columns {
        for (r, row) in gram.iter_mut().enumerate() {
            for (c, value) in row.iter_mut().enumerate() {
                *value += column[r] * column[c];
            }
        }
    }
    // The determinant is the product of the pivots of the Cholesky factorisation.
    let mut determinant = 1.0;
    for k in 0..6 {
        let pivot = gram[k][k];
        if pivot.is_nan() || pivot <= 0.0 {
            return 0.0;
        }
        determinant *= pivot;
        let pivot_row = gram[k];
        for row in &mut gram[k + 1..] {
            let factor = row[k] / pivot;
            for (value, above) in row[k..].iter_mut().zip(&pivot_row[k..]) {
                *value -= factor * above;
            }
        }
    }
    f64::sqrt(determinant)
}

/// The smallest singular value of the Jacobian: the least speed of the tip, metres and radians as one
/// length, that joint velocities of length 1 can have in the direction that is hardest. 0 at a
/// singular posture, and for arms with fewer than six joints.
///
/// The root of the smallest eigenvalue of `J J^T`, by Jacobi's rotations.
pub fn smallest_singular_value(columns: &[[f64; 6]]) -> f64 {
    let mut a = [[0.0; 6]; 6];
    for column in columns {
        for (r, row) in a.iter_mut().enumerate() {
            for (c, value) in row.iter_mut().enumerate() {
                *value += column[r] * column[c];
            }
        }
    }
    for _ in 0..30 {
        let off: f64 = (0..6)
            .flat_map(|r| (0..r).map(move |c| (r, c)))
            .map(|(r, c)| a[r][c] * a[r][c])
            .sum();
        if off < 1e-28 {
            break;
        }
        for p in 0..6 {
            for q in p + 1..6 {
                if a[p][q] == 0.0 {
                    continue;
                }
                let half = 0.5 * (a[q][q] - a[p][p]) / a[p][q];
                let tan = 1.0f64.copysign(half) / (half.abs() + half.hypot(1.0));
                let cos = 1.0 / tan.hypot(1.0);
                let sin = tan * cos;
                for row in &mut a {
                    let (x, y) = (row[p], row[q]);
                    (row[p], row[q]) = (cos * x - sin * y, sin * x + cos * y);
                }
                let (x, y) = (a[p], a[q]);
                for k in 0..6 {
                    a[p][k] = cos * x[k] - sin * y[k];
                    a[q][k] = sin * x[k] + cos * y[k];
                }
            }
        }
    }
    let least = (0..6).map(|k| a[k][k]).fold(f64::INFINITY, f64::min);
    least.max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn singular_values_by_hand() {
        let mut columns = [[0.0; 6]; 6];
        for (k, column) in columns.iter_mut().enumerate() {
            column[(k + 2) % 6] = 0.5 + k as f64;
        }
        assert!((smallest_singular_value(&columns) - 0.5).abs() < 1e-14);
        assert!(smallest_singular_value(&columns[..5]) < 1e-7);
        // The product of all of them is the manipulability; with equal ones each is its sixth root.
        let arm = Arm::fr3();
        let mut columns = [[0.0; 6]; 7];
        arm.jacobian(&[0.3, -0.4, 0.2, -2.1, 0.1, 1.8, 0.6], &mut columns);
        let least = smallest_singular_value(&columns);
        assert!(least > 0.0 && least < manipulability(&columns).powf(1.0 / 6.0));
    }
}
