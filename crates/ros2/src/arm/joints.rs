//! Joint trajectories, a goal a segment: FollowJointTrajectory of `joint_trajectory_controller`, and
//! whatever else executes them.

use std::sync::Arc;

use selvedge_math::Pose;

use crate::action::Action;
use crate::arm::{Arm, Measured};
use crate::dds::{Bus, GoalStatus, Kind, Message};
use crate::error::{Cause, Error};
use crate::journal::Journal;
use crate::messages::{
    Duration, FollowFeedback, FollowGoal, FollowResult, Header, JointTrajectory,
    JointTrajectoryPoint, Name, NoMultiDof, Nothing,
};
use crate::robot::Robot;
use crate::segment::Segment;

/// An action that executes trajectories.
pub(crate) trait Execute {
    type Goal: Message + Clone + 'static;
    type Result: Message + Clone + 'static;
    type Feedback: Message + 'static;
    const KIND: Kind;
    fn goal(trajectory: JointTrajectory) -> Self::Goal;
    /// Whether that is success, and what it says.
    fn outcome(result: Self::Result) -> (bool, String);
}

/// FollowJointTrajectory, which is alike in all distributions.
pub(crate) struct Follow;

impl Execute for Follow {
    type Goal = FollowGoal;
    type Result = FollowResult;
    type Feedback = FollowFeedback;
    const KIND: Kind = ("control_msgs", "FollowJointTrajectory");

    fn goal(trajectory: JointTrajectory) -> FollowGoal {
        FollowGoal {
            trajectory,
            multi_dof_trajectory: no_multi_dof(),
            path_tolerance: Nothing,
            component_path_tolerance: Nothing,
            goal_tolerance: Nothing,
            component_goal_tolerance: Nothing,
            goal_time_tolerance: Duration { sec: 0, nanosec: 0 },
        }
    }

    fn outcome(result: FollowResult) -> (bool, String) {
        let name = match result.error_code {
            0 => "SUCCESSFUL",
            -1 => "INVALID_GOAL",
            -2 => "INVALID_JOINTS",
            -3 => "OLD_HEADER_TIMESTAMP",
            -4 => "PATH_TOLERANCE_VIOLATED",
            -5 => "GOAL_TOLERANCE_VIOLATED",
            _ => "an unknown code",
        };
        let (code, text) = (result.error_code, result.error_string);
        (code == 0, format!("code {code}, {name}: {text}"))
    }
}

pub(crate) fn no_multi_dof() -> NoMultiDof {
    NoMultiDof {
        header: Header::none(),
        joint_names: Vec::new(),
        points: Nothing,
    }
}

/// An arm behind such an action.
pub(crate) struct Trajectories<E: Execute> {
    action: Action<E::Goal, E::Result, E::Feedback>,
    names: Vec<Name>,
    pub(crate) robot: Robot,
    journal: Journal,
    busy: bool,
}

impl<E: Execute> Trajectories<E> {
    pub(crate) fn new(
        bus: &mut Bus,
        name: &str,
        names: &[String],
        robot: Robot,
        journal: Journal,
    ) -> Result<Self, Error> {
        Ok(Self {
            action: Action::new(bus, name, E::KIND)?,
            names: names.iter().map(|name| Name::new(name)).collect(),
            robot,
            journal,
            busy: false,
        })
    }
}

/// The trajectory of a segment: its rows at the times of its law, with velocities, so that the
/// controller's own splines meet ours in position and velocity. Its stamp is zero: begin at once.
pub(crate) fn trajectory(segment: &Segment, names: &[Name]) -> JointTrajectory {
    let n = names.len();
    let rows: Vec<&[f64]> = segment.joints.chunks(n).collect();
    let times = segment.times();
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
        header: Header::none(),
        joint_names: names.to_vec(),
        points: points.collect(),
    }
}

impl<E: Execute> Arm for Trajectories<E> {
    fn prepare(&mut self) -> Result<(), Cause> {
        self.robot.wait()?;
        self.action.wait()
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
        self.journal
            .trajectory(now, self.action.name(), &trajectory);
        let goal = E::goal(trajectory);
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
        let (success, detail) = E::outcome(ended.result);
        let status = ended.status;
        self.journal
            .event(now, "trajectory ended", format!("{status:?}, {detail}"));
        match status {
            GoalStatus::Succeeded if success => Ok(true),
            status => Err(Cause::Failed {
                name: self.action.name().into(),
                status: format!("{status:?}"),
                detail,
            }),
        }
    }

    fn stop(&mut self, _now: f64) {
        self.action.cancel();
    }
}
