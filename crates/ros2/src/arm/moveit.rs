//! Plans of MoveIt: GetCartesianPath finds joint positions along the path, our own law says when to be
//! where, ExecuteTrajectory follows.
//!
//! MoveIt's own times are thrown away: jaws must act where the path says, not when.

use std::sync::Arc;

use selvedge_franka::{Arm as Model, Rates, usage};
use selvedge_math::Pose;

use crate::arm::joints::Trajectories;
use crate::arm::layout::{Answer, Ask, Layout};
use crate::arm::{Arm, Measured};
use crate::call::Call;
use crate::dds::Bus;
use crate::error::{Cause, Error};
use crate::journal::Journal;
use crate::limits::angle;
use crate::messages::moveit::{NoMultiDofState, RobotState, code};
use crate::messages::{self, Header, JointState, Name, Nothing};
use crate::robot::Robot;
use crate::segment::Segment;

/// How far a joint may be from one of MoveIt's points to the next [rad].
const JUMP: f64 = 0.2;
/// How far MoveIt's path may be from ours [m], [rad].
const OFF: (f64, f64) = (0.001, 0.01);
/// What counts as the same pose when waypoints are chosen [m], [rad].
const SAME: (f64, f64) = (1e-4, 1e-3);

/// Names that MoveIt asks for.
#[derive(Clone, Debug)]
pub(crate) struct Group {
    /// The planning group.
    pub(crate) name: String,
    /// The link between the fingers.
    pub(crate) link: String,
    /// The frame of the waypoints.
    pub(crate) frame: String,
}

/// A `move_group`.
pub(crate) struct MoveIt<L: Layout> {
    path: Call<L::Request, L::Reply>,
    execute: Trajectories<L>,
    model: Model,
    joint_names: Vec<String>,
    group: Group,
    /// Planning may take twice that [s].
    patience: f64,
}

impl<L: Layout> MoveIt<L> {
    /// `root` is the namespace of `move_group`, empty for our own.
    pub(crate) fn new(
        bus: &mut Bus,
        root: &str,
        group: Group,
        model: &Model,
        joint_names: &[String],
        robot: Robot,
        journal: Journal,
    ) -> Result<Self, Error> {
        let path = under(root, "compute_cartesian_path");
        let execute = under(root, "execute_trajectory");
        Ok(Self {
            path: Call::new(bus, &path, ("moveit_msgs", "GetCartesianPath"))?,
            execute: Trajectories::new(bus, &execute, joint_names, robot, journal)?,
            model: model.clone(),
            joint_names: joint_names.to_vec(),
            group,
            patience: bus.patience,
        })
    }

    /// Joint positions of the rows of a segment, from `start` on.
    fn plan(&mut self, segment: &Segment, start: &[f64]) -> Result<Vec<f64>, String> {
        let rows: Vec<Pose> = segment.tau.iter().map(|tau| segment.pose(*tau)).collect();
        let waypoints = waypoints(&rows);
        if waypoints.is_empty() {
            // At rest all the time.
            return Ok(start.repeat(rows.len()));
        }
        let start_state = RobotState {
            joint_state: JointState {
                name: self.joint_names.clone(),
                position: start.to_vec(),
                ..JointState::empty()
            },
            multi_dof_joint_state: NoMultiDofState {
                header: Header::none(),
                joint_names: Vec::new(),
                transforms: Nothing,
                twist: Nothing,
                wrench: Nothing,
            },
            attached_collision_objects: Nothing,
            is_diff: true,
        };
        let ask = Ask {
            header: Header {
                stamp: self.execute.robot.clock.now().map_err(|e| e.to_string())?,
                frame_id: Name::new(&self.group.frame),
            },
            start_state,
            group_name: self.group.name.clone(),
            link_name: self.group.link.clone(),
            waypoints: waypoints.iter().map(messages::Pose::from).collect(),
        };
        let reply = self.path.call(L::request(ask), 2.0 * self.patience);
        let answer = L::answer(reply.map_err(|e| e.to_string())?);
        let points = points(&answer, &self.joint_names, start)?;
        let joints = along(&self.model, &rows, &points);
        self.check(segment, &rows, joints)
    }

    /// The tip where it should be, the joints no faster than they may.
    fn check(
        &self,
        segment: &Segment,
        rows: &[Pose],
        joints: Vec<f64>,
    ) -> Result<Vec<f64>, String> {
        for (k, (row, q)) in rows
            .iter()
            .zip(joints.chunks(self.joint_names.len()))
            .enumerate()
        {
            let tip = self.model.forward(q);
            let (far, turned) = (tip.position().distance(row.position()), angle(&tip, row));
            if far.is_nan() || far > OFF.0 || turned > OFF.1 {
                return Err(format!(
                    "it leaves the path by {:.2} mm and {turned:.4} rad {:.3} s into it, at most {} \
                     mm and {} rad: are group, link and --robot right?",
                    1e3 * far,
                    segment.tau[k],
                    1e3 * OFF.0,
                    OFF.1
                ));
            }
        }
        let usages = usage(
            &self.model,
            &Rates::of(&self.model),
            &segment.times(),
            &joints,
        );
        match usages.iter().find(|usage| usage.slow_down() > 1.0) {
            Some(worst) => Err(format!(
                "{} would be {:.4}, at most {:.4}; a lower --speed helps",
                worst.bound, worst.value, worst.limit
            )),
            None => Ok(joints),
        }
    }
}

/// A name in a namespace.
fn under(root: &str, name: &str) -> String {
    match root {
        "" => name.into(),
        root => format!("{}/{name}", root.trim_end_matches('/')),
    }
}

/// Poses that differ from the one before, none when all are the first.
fn waypoints(rows: &[Pose]) -> Vec<Pose> {
    let same =
        |a: &Pose, b: &Pose| a.position().distance(b.position()) < SAME.0 && angle(a, b) < SAME.1;
    let mut chosen: Vec<Pose> = Vec::new();
    for row in rows {
        if !same(chosen.last().unwrap_or(&rows[0]), row) {
            chosen.push(*row);
        }
    }
    // The end itself, not something near it.
    if let (Some(last), Some(end)) = (chosen.last_mut(), rows.last()) {
        if same(last, end) {
            *last = *end;
        } else {
            chosen.push(*end);
        }
    }
    chosen
}

/// MoveIt's joint positions in our order, unless they are refused.
fn points(answer: &Answer, names: &[String], start: &[f64]) -> Result<Vec<Vec<f64>>, String> {
    let Answer {
        solution,
        fraction,
        code: number,
        text,
    } = answer;
    if *number != 1 || fraction.is_nan() || *fraction < 1.0 {
        let share = 100.0 * fraction.max(0.0);
        let said = code(*number);
        return Err(format!(
            "only {share:.1} % of the path were found, code {number}, {said} {text}"
        ));
    }
    let place = |name: &String| solution.joint_names.iter().position(|n| *n.0 == **name);
    let order: Option<Vec<usize>> = names.iter().map(place).collect();
    let Some(order) = order else {
        let theirs: Vec<&str> = solution.joint_names.iter().map(|n| &*n.0).collect();
        return Err(format!("its joints are {theirs:?}, ours {names:?}"));
    };
    let mut points = vec![start.to_vec()];
    for point in &solution.points {
        let q: Option<Vec<f64>> = order
            .iter()
            .map(|k| point.positions.get(*k).copied())
            .collect();
        let q = q.ok_or("a point has fewer positions than there are joints")?;
        let last = &points[points.len() - 1];
        for ((a, b), name) in q.iter().zip(last).zip(names) {
            let jump = (a - b).abs();
            if jump.is_nan() || jump > JUMP {
                return Err(format!(
                    "{name} jumps by {jump:.3} rad at point {} of {}, at most {JUMP}",
                    points.len(),
                    solution.points.len()
                ));
            }
        }
        points.push(q);
    }
    if points.len() < 2 {
        return Err("it has no points".into());
    }
    Ok(points)
}

/// For each row the place on MoveIt's path where the tip is nearest, never going back.
fn along(model: &Model, rows: &[Pose], points: &[Vec<f64>]) -> Vec<f64> {
    let between = |k: usize, u: f64| -> Vec<f64> {
        let pair = points[k].iter().zip(&points[k + 1]);
        pair.map(|(a, b)| a + u * (b - a)).collect()
    };
    // The nearest place from `from` on between a point and the next: how far, and where.
    let nearest = |row: &Pose, k: usize, from: f64| {
        let off = |u: f64| {
            let tip = model.forward(&between(k, u));
            // 0.1 m, about the length of a finger, makes an angle a length.
            let turned = 0.1 * angle(&tip, row);
            tip.position().distance(row.position()).hypot(turned)
        };
        let (mut low, mut high) = (from, 1.0);
        for _ in 0..40 {
            let third = (high - low) / 3.0;
            match off(low + third) < off(high - third) {
                true => high -= third,
                false => low += third,
            }
        }
        let u = 0.5 * (low + high);
        (off(u), u)
    };
    let mut joints = Vec::with_capacity(rows.len() * points[0].len());
    let (mut k, mut from) = (0, 0.0);
    for row in rows {
        loop {
            let (off, u) = nearest(row, k, from);
            from = u;
            if u < 1.0 - 1e-6 || k + 2 == points.len() {
                break;
            }
            // At its end: the next may be nearer.
            if nearest(row, k + 1, 0.0).0 > off + 1e-12 {
                break;
            }
            (k, from) = (k + 1, 0.0);
        }
        joints.extend(between(k, from));
    }
    joints
}

impl<L: Layout> Arm for MoveIt<L> {
    fn prepare(&mut self) -> Result<(), Cause> {
        self.execute.prepare()?;
        self.path.wait()
    }

    fn measured(&mut self) -> Result<Measured, Cause> {
        self.execute.measured()
    }

    fn path(&mut self, segments: &mut [Arc<Segment>], _brake: f64) -> Result<(), Cause> {
        let mut q = self.execute.joints().to_vec();
        for (motion, segment) in segments.iter_mut().enumerate() {
            let joints = self.plan(segment, &q).map_err(|reason| Cause::Plan {
                name: self.path.name().into(),
                motion,
                reason,
            })?;
            q = joints[joints.len() - q.len()..].to_vec();
            let mut planned = Segment::clone(segment);
            planned.joints = joints;
            *segment = Arc::new(planned);
        }
        Ok(())
    }

    fn hold(&mut self, now: f64, pose: &Pose) -> Result<(), Cause> {
        self.execute.hold(now, pose)
    }

    fn start(&mut self, now: f64, segment: &Arc<Segment>) -> Result<(), Cause> {
        self.execute.start(now, segment)
    }

    fn poll(&mut self, now: f64) -> Result<bool, Cause> {
        self.execute.poll(now)
    }

    fn stop(&mut self, now: f64) {
        self.execute.stop(now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use selvedge_math::{DQuat, DVec3};

    #[test]
    fn names_are_in_a_namespace_or_relative_to_ours() {
        assert_eq!(under("", "a"), "a");
        assert_eq!(under("/", "a"), "/a");
        assert_eq!(under("/left/", "a"), "/left/a");
    }

    #[test]
    fn waypoints_are_poses_that_differ_and_end_at_the_end() {
        let at = |x: f64| Pose::from_translation(DVec3::X * x);
        let rows = [0.0, 0.0, 5e-5, 2e-4, 2.5e-4, 1e-3, 1.02e-3, 1.02e-3];
        let rows: Vec<Pose> = rows.into_iter().map(at).collect();
        assert_eq!(waypoints(&rows), [at(2e-4), at(1.02e-3)]);
        assert!(waypoints(&[at(0.0); 4]).is_empty());
        // A turn on the spot is a way, too.
        let turned = Pose::from_unit(DVec3::ZERO, DQuat::from_rotation_z(0.01));
        assert_eq!(waypoints(&[at(0.0), turned]), [turned]);
    }

    #[test]
    fn rows_get_their_places_on_a_path_that_goes_there_and_back() {
        let model = Model::fr3();
        let start: Vec<f64> = model
            .joints()
            .iter()
            .map(|j| 0.5 * (j.limits.lower + j.limits.upper))
            .collect();
        // The first joint goes out and back; rows dwell in the middle and at the turn.
        let q = |a: f64| {
            let mut q = start.clone();
            q[0] += a;
            q
        };
        let points: Vec<Vec<f64>> = [0.0, 0.0, 0.02, 0.04, 0.06, 0.06, 0.05, 0.03, 0.0]
            .map(q)
            .into();
        let wanted = [0.0, 0.01, 0.025, 0.025, 0.05, 0.06, 0.06, 0.04, 0.02, 0.0];
        let rows: Vec<Pose> = wanted.iter().map(|a| model.forward(&q(*a))).collect();
        let joints = along(&model, &rows, &points);
        for (found, a) in joints.chunks(7).zip(wanted) {
            assert!(
                (found[0] - start[0] - a).abs() < 1e-5,
                "{a}: {}",
                found[0] - start[0]
            );
        }
    }
}
