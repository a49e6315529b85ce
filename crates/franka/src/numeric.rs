//! Inverse kinematics of any arm, by damped least squares from a start nearby.

use selvedge_math::{DVec3, Pose};

use crate::{Arm, Error};

/// How a numeric solve ended.
#[derive(Clone, Debug, PartialEq)]
pub struct NumericSolution {
    /// Joint positions, within the limits.
    pub q: Vec<f64>,
    /// What is left: metres and radians, as the length of one vector of both.
    pub residual: f64,
    /// Steps taken.
    pub iterations: u32,
    /// Whether the residual is below [`TOLERANCE`].
    pub converged: bool,
}

/// A solve has converged when metres and radians together are below this.
pub const TOLERANCE: f64 = 1e-10;

const MAX_ITERATIONS: u32 = 200;
/// Longest step of a joint [rad or m].
const MAX_STEP: f64 = 0.5;
/// A solve has stalled when damping has grown to this.
const MAX_DAMPING: f64 = 1e8;

impl Arm {
    /// Joint positions near `start` in which the tip has the pose `target`, within the limits.
    ///
    /// Damped least squares (Levenberg 1944, Marquardt 1963): in each step
    /// `dq = J^T (J J^T + lambda 1)^-1 e` with the error `e` in metres and radians; `lambda` falls
    /// when a step helps and grows when it does not. A joint at a limit that would be pushed beyond
    /// it is left out of the step. From a start that is far away the solve may end in a place from
    /// which no small step helps; it then says so, and another start may do better.
    ///
    /// ```
    /// use selvedge_franka::Arm;
    /// let arm = Arm::fr3();
    /// let q = [0.3, -0.4, 0.2, -2.1, 0.1, 1.8, 0.6];
    /// let near = q.map(|q| q + 0.05);
    /// let solution = arm.inverse_near(&arm.forward(&q), &near)?;
    /// assert!(solution.converged && solution.iterations < 10);
    /// # Ok::<(), selvedge_franka::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::NotFinite`] when `start` is not finite, [`Error::Start`] when it has not one entry a
    /// joint or is outside the limits.
    pub fn inverse_near(&self, target: &Pose, start: &[f64]) -> Result<NumericSolution, Error> {
        let joints = self.joints();
        if start.len() != joints.len() {
            let reason = format!(
                "has {} positions, the arm {} joints",
                start.len(),
                joints.len()
            );
            return Err(Error::Start(reason));
        }
        for (joint, &q) in joints.iter().zip(start) {
            if !q.is_finite() {
                return Err(Error::NotFinite("start"));
            }
            if !joint.limits.contain(q) {
                let (lower, upper) = (joint.limits.lower, joint.limits.upper);
                let reason = format!("has {} at {q}, limits are {lower} to {upper}", joint.name);
                return Err(Error::Start(reason));
            }
        }
        let n = joints.len();
        let mut q = start.to_vec();
        let mut columns = vec![[0.0; 6]; n];
        let mut trial = q.clone();
        let mut free = vec![true; n];
        let mut damping = 1e-3;
        let mut error = difference(target, &self.jacobian(&q, &mut columns));
        let mut iterations = 0;
        while length(&error) >= TOLERANCE && iterations < MAX_ITERATIONS && damping < MAX_DAMPING {
            iterations += 1;
            free.fill(true);
            // Leaving a joint out changes the step of the others: at most once for each joint.
            for _ in 0..=n {
                let Some(step) = damped_step(&columns, &free, &error, damping) else {
                    break;
                };
                let longest = step.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
                let scale = (MAX_STEP / longest).min(1.0);
                let mut stopped = false;
                for (k, joint) in joints.iter().enumerate() {
                    let wanted = q[k] + scale * step[k];
                    trial[k] = wanted.clamp(joint.limits.lower, joint.limits.upper);
                    if free[k] && trial[k] == q[k] && wanted != q[k] {
                        free[k] = false;
                        stopped = true;
                    }
                }
                if !stopped {
                    break;
                }
            }
            let after = difference(target, &self.forward(&trial));
            if length(&after) < length(&error) {
                q.copy_from_slice(&trial);
                error = difference(target, &self.jacobian(&q, &mut columns));
                damping = (damping * 0.1).max(1e-14);
            } else {
                damping *= 10.0;
            }
        }
        let residual = length(&error);
        Ok(NumericSolution {
            q,
            residual,
            iterations,
            converged: residual < TOLERANCE,
        })
    }
}

/// From `pose` to `target`: translation [m] and rotation vector [rad] along the base's axes.
fn difference(target: &Pose, pose: &Pose) -> [f64; 6] {
    let p = target.position() - pose.position();
    let turn = target.rotation() * pose.rotation().conjugate();
    let turn = if turn.w < 0.0 { -turn } else { turn };
    let axis = DVec3::new(turn.x, turn.y, turn.z);
    let sine = axis.length();
    // angle / sine tends to 2 where both vanish.
    let factor = if sine > 1e-12 {
        2.0 * sine.atan2(turn.w) / sine
    } else {
        2.0
    };
    let r = factor * axis;
    [p.x, p.y, p.z, r.x, r.y, r.z]
}

fn length(error: &[f64; 6]) -> f64 {
    error.iter().map(|e| e * e).sum::<f64>().sqrt()
}

/// `J^T (J J^T + damping 1)^-1 e` over the free joints; none when the matrix cannot be factored.
fn damped_step(
    columns: &[[f64; 6]],
    free: &[bool],
    error: &[f64; 6],
    damping: f64,
) -> Option<Vec<f64>> {
    let mut lower = [[0.0; 6]; 6];
    for (r, row) in lower.iter_mut().enumerate() {
        for (c, value) in row.iter_mut().enumerate().take(r + 1) {
            let free_columns = columns.iter().zip(free).filter(|(_, free)| **free);
            *value = free_columns.map(|(column, _)| column[r] * column[c]).sum();
        }
        row[r] += damping;
    }
    // Cholesky, then two triangular solves
    let mut y = *error;
    for k in 0..6 {
        for c in 0..k {
            let known: f64 = (0..c).map(|t| lower[k][t] * lower[c][t]).sum();
            lower[k][c] = (lower[k][c] - known) / lower[c][c];
        }
        let known: f64 = (0..k).map(|t| lower[k][t] * lower[k][t]).sum();
        let pivot = lower[k][k] - known;
        if pivot.is_nan() || pivot <= 0.0 {
            return None;
        }
        lower[k][k] = pivot.sqrt();
        let known: f64 = (0..k).map(|t| lower[k][t] * y[t]).sum();
        y[k] = (y[k] - known) / lower[k][k];
    }
    for k in (0..6).rev() {
        let known: f64 = (k + 1..6).map(|t| lower[t][k] * y[t]).sum();
        y[k] = (y[k] - known) / lower[k][k];
    }
    let step = columns.iter().zip(free).map(|(column, &free)| match free {
        true => column.iter().zip(&y).map(|(a, b)| a * b).sum(),
        false => 0.0,
    });
    Some(step.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Configurations within the limits from a fixed generator.
    fn configurations(arm: &Arm, count: usize) -> Vec<Vec<f64>> {
        let mut state = 5u64;
        let mut next = || {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut one = || {
            let limits = arm.joints().iter().map(|joint| joint.limits);
            limits
                .map(|l| l.lower + (l.upper - l.lower) * next())
                .collect()
        };
        (0..count).map(|_| one()).collect()
    }

    #[test]
    fn a_start_nearby_always_converges() {
        let arm = Arm::fr3();
        for q in configurations(&arm, 500) {
            let joints = arm.joints().iter().enumerate();
            let near: Vec<f64> = joints
                .map(|(k, joint)| {
                    let shift = if k % 2 == 0 { 0.02 } else { -0.02 };
                    (q[k] + shift).clamp(joint.limits.lower, joint.limits.upper)
                })
                .collect();
            let solution = arm.inverse_near(&arm.forward(&q), &near).unwrap();
            assert!(solution.converged, "{q:?}: {}", solution.residual);
        }
    }

    #[test]
    fn what_is_told_is_true_from_any_start() {
        let arm = Arm::fr3();
        let all = configurations(&arm, 400);
        let mut converged = 0;
        for (q, start) in all.iter().zip(all.iter().skip(200)) {
            let target = arm.forward(q);
            let solution = arm.inverse_near(&target, start).unwrap();
            let left = length(&difference(&target, &arm.forward(&solution.q)));
            assert!((left - solution.residual).abs() < 1e-14);
            assert_eq!(solution.converged, left < TOLERANCE);
            let within = |(q, joint): (&f64, &crate::Joint)| joint.limits.contain(*q);
            assert!(solution.q.iter().zip(arm.joints()).all(within));
            converged += usize::from(solution.converged);
        }
        assert!(converged > 60, "{converged} of 200");
    }

    #[test]
    fn starts_that_cannot_be_used_are_named() {
        let arm = Arm::fr3();
        let refusal = |start: &[f64]| {
            arm.inverse_near(&Pose::IDENTITY, start)
                .unwrap_err()
                .to_string()
        };
        assert!(refusal(&[0.0; 6]).contains("has 6 positions, the arm 7 joints"));
        assert!(refusal(&[0.0; 7]).contains("fr3_joint4 at 0, limits are -3.0421 to -0.1518"));
        assert!(refusal(&[f64::NAN; 7]).contains("start must be finite"));
    }
}
