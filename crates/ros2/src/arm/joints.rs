//! Joint trajectories for `joint_trajectory_controller`: one goal of FollowJointTrajectory a segment.

use std::sync::Arc;

use selvedge_math::Pose;

use crate::arm::cartesian::PATIENCE;
use crate::arm::{Arm, Measured};
use crate::dds::{Action, Bus, GoalStatus};
use crate::error::{Cause, Error};
use crate::journal::Journal;
use crate::messages::{
    Duration, FollowFeedback, FollowGoal, FollowResult, Header, JointTrajectory,
    JointTrajectoryPoint, Name, NoMultiDof, Time,
};
use crate::robot::Robot;
use crate::segment::Segment;

/// A controller of joint trajectories.
pub(crate) struct Joints {
    action: Action<FollowGoal, FollowResult, FollowFeedback>,
    name: String,
    names: Vec<Name>,
    robot: Robot,
    journal: Journal,
    busy: bool,
}

impl Joints {
    pub(crate) fn new(
        bus: &mut Bus,
        name: &str,
        names: &[String],
        robot: Robot,
        journal: Journal,
    ) -> Result<Self, Error> {
        let action = bus.action(name, "control_msgs", "FollowJointTrajectory")?;
        let names = names.iter().map(|name| Name::new(name)).collect();
        Ok(Self {
            action,
            name: name.into(),
            names,
            robot,
            journal,
            busy: false,
        })
    }
}

/// The trajectory of a segment: its rows at the times of its law, with velocities, so that the
/// controller's own splines meet ours in position and velocity.
pub(crate) fn trajectory(segment: &Segment, names: &[Name]) -> JointTrajectory {
    let n = names.len();
    let rows: Vec<&[f64]> = segment.joints.chunks(n).collect();
    let times: Vec<f64> = segment
        .tau
        .iter()
        .map(|tau| segment.law.time(*tau))
        .collect();
    let last = rows.len().saturating_sub(1);
    let points = rows.iter().enumerate().map(|(k, row)| {
        let velocities = (0..n).map(|j| match k == 0 || k == last {
            true => 0.0,
            // The slope of the parabola through three rows.
            false => {
                let (h, g) = (times[k] - times[k - 1], times[k + 1] - times[k]);
                let before = (row[j] - rows[k - 1][j]) / h;
                let after = (rows[k + 1][j] - row[j]) / g;
                (before * g + after * h) / (h + g)
            }
        });
        JointTrajectoryPoint {
            positions: row.to_vec(),
            velocities: velocities.collect(),
            accelerations: Vec::new(),
            effort: Vec::new(),
            time_from_start: Duration::from_seconds(times[k]),
        }
    });
    JointTrajectory {
        header: now(),
        joint_names: names.to_vec(),
        points: points.collect(),
    }
}

/// A stamp of zero: begin at once.
fn now() -> Header {
    Header {
        stamp: Time { sec: 0, nanosec: 0 },
        frame_id: Name::new(""),
    }
}

impl Arm for Joints {
    fn prepare(&mut self) -> Result<(), Cause> {
        self.robot.wait(PATIENCE)?;
        self.action.wait(PATIENCE)
    }

    fn measured(&mut self) -> Result<Measured, Cause> {
        self.robot.measured()
    }

    fn joints(&self) -> &[f64] {
        self.robot.joints()
    }

    fn hold(&mut self, _now: f64, _pose: &Pose) -> Result<(), Cause> {
        // The controller holds by itself.
        Ok(())
    }

    fn start(&mut self, now: f64, segment: &Arc<Segment>) -> Result<(), Cause> {
        let trajectory = trajectory(segment, &self.names);
        let points = trajectory.points.len();
        self.journal.event(
            now,
            "trajectory",
            format!("{points} points, {:.3} s", segment.law.duration()),
        );
        let none = || Duration { sec: 0, nanosec: 0 };
        let goal = FollowGoal {
            trajectory,
            multi_dof_trajectory: NoMultiDof {
                header: self::now(),
                joint_names: Vec::new(),
                points: Vec::new(),
            },
            path_tolerance: Vec::new(),
            component_path_tolerance: Vec::new(),
            goal_tolerance: Vec::new(),
            component_goal_tolerance: Vec::new(),
            goal_time_tolerance: none(),
        };
        self.action.send(goal, 1.5 * segment.law.duration() + 5.0);
        self.busy = true;
        Ok(())
    }

    fn poll(&mut self, now: f64) -> Result<bool, Cause> {
        if !self.busy {
            return Ok(true);
        }
        let polled = self.action.poll();
        self.busy = matches!(polled, Ok(None));
        let Some(ended) = polled? else {
            return Ok(false);
        };
        let detail = format!(
            "code {}: {}",
            ended.result.error_code, ended.result.error_string
        );
        self.journal.event(
            now,
            "trajectory ended",
            format!("{:?}, {detail}", ended.status),
        );
        match ended.status {
            GoalStatus::Succeeded if ended.result.error_code == 0 => Ok(true),
            status => {
                let (name, status) = (self.name.clone(), format!("{status:?}"));
                Err(Cause::Failed {
                    name,
                    status,
                    detail,
                })
            }
        }
    }

    fn stop(&mut self, _now: f64) {
        self.action.cancel();
    }
}
