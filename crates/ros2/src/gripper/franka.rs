//! franka_msgs: Grasp to close, Move to open.

use selvedge_math::Jaw;

use crate::action::Action;
use crate::dds::{Bus, GoalStatus};
use crate::error::{Cause, Error};
use crate::gripper::Gripper;
use crate::gripper::jaws::Jaws;
use crate::journal::Journal;
use crate::messages::franka::{FrankaFeedback, FrankaResult, GraspGoal, MoveGoal};

/// `franka_gripper`, under the name of its node.
pub(crate) struct Franka {
    grasp: Action<GraspGoal, FrankaResult, FrankaFeedback>,
    open: Action<MoveGoal, FrankaResult, FrankaFeedback>,
    jaws: Jaws,
    jaw: Jaw,
    journal: Journal,
}

impl Franka {
    /// `node` is for example `/fr3_gripper`.
    pub(crate) fn new(
        bus: &mut Bus,
        node: &str,
        jaws: Jaws,
        journal: Journal,
    ) -> Result<Self, Error> {
        Ok(Self {
            grasp: Action::new(bus, &format!("{node}/grasp"), ("franka_msgs", "Grasp"))?,
            open: Action::new(bus, &format!("{node}/move"), ("franka_msgs", "Move"))?,
            jaws,
            jaw: Jaw::Open,
            journal,
        })
    }
}

impl Gripper for Franka {
    fn prepare(&mut self) -> Result<(), Cause> {
        self.grasp.wait()?;
        self.open.wait()
    }

    fn command(&mut self, now: f64, jaw: Jaw) -> Result<(), Cause> {
        let (width, deadline) = (self.jaws.gap(jaw), self.jaws.deadline);
        self.jaw = jaw;
        match jaw {
            Jaw::Closed => {
                let goal = GraspGoal {
                    width,
                    inner: self.jaws.epsilon,
                    outer: self.jaws.epsilon,
                    speed: self.jaws.speed,
                    force: self.jaws.force,
                };
                self.journal.event(now, "gripper goal", format!("{goal:?}"));
                self.grasp.send(goal, deadline);
            }
            Jaw::Open => {
                let speed = self.jaws.speed;
                let goal = MoveGoal { width, speed };
                self.journal.event(now, "gripper goal", format!("{goal:?}"));
                self.open.send(goal, deadline);
            }
        }
        Ok(())
    }

    fn poll(&mut self, now: f64) -> Result<bool, Cause> {
        let (polled, name) = match self.jaw {
            Jaw::Closed => (self.grasp.poll()?, self.grasp.name()),
            Jaw::Open => (self.open.poll()?, self.open.name()),
        };
        let Some(goal) = polled else {
            return Ok(false);
        };
        let FrankaResult { success, error } = goal.result;
        let told = format!("{:?}, success {success} {error}", goal.status);
        self.journal.event(now, "gripper ended", told);
        match goal.status {
            GoalStatus::Succeeded if success => Ok(true),
            status => Err(Cause::Failed {
                name: name.into(),
                status: format!("{status:?}"),
                detail: error,
            }),
        }
    }

    fn cancel(&mut self, _now: f64) {
        match self.jaw {
            Jaw::Closed => self.grasp.cancel(),
            Jaw::Open => self.open.cancel(),
        }
    }
}
