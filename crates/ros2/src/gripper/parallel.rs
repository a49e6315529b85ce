//! control_msgs ParallelGripperCommand, as `parallel_gripper_action_controller` serves it.

use selvedge_math::Jaw;

use crate::action::Action;
use crate::dds::Bus;
use crate::error::{Cause, Error};
use crate::gripper::jaws::Jaws;
use crate::gripper::{Gripper, ended};
use crate::journal::Journal;
use crate::messages::{JointState, ParallelFeedback, ParallelGoal, ParallelResult};

/// The position of one joint, half the gap; its effort is the force.
pub(crate) struct Parallel {
    action: Action<ParallelGoal, ParallelResult, ParallelFeedback>,
    joint: String,
    jaws: Jaws,
    jaw: Jaw,
    journal: Journal,
}

impl Parallel {
    pub(crate) fn new(
        bus: &mut Bus,
        name: &str,
        joint: &str,
        jaws: Jaws,
        journal: Journal,
    ) -> Result<Self, Error> {
        Ok(Self {
            action: Action::new(bus, name, ("control_msgs", "ParallelGripperCommand"))?,
            joint: joint.into(),
            jaws,
            jaw: Jaw::Open,
            journal,
        })
    }
}

impl Gripper for Parallel {
    fn prepare(&mut self) -> Result<(), Cause> {
        self.action.wait()
    }

    fn command(&mut self, now: f64, jaw: Jaw) -> Result<(), Cause> {
        let (position, effort) = (0.5 * self.jaws.gap(jaw), self.jaws.force);
        let command = JointState {
            name: vec![self.joint.clone()],
            position: vec![position],
            effort: vec![effort],
            ..JointState::empty()
        };
        self.jaw = jaw;
        let told = format!("{} at {position}, effort {effort}", self.joint);
        self.journal.event(now, "gripper goal", told);
        self.action
            .send(ParallelGoal { command }, self.jaws.deadline);
        Ok(())
    }

    fn poll(&mut self, now: f64) -> Result<bool, Cause> {
        let Some(goal) = self.action.poll()? else {
            return Ok(false);
        };
        let ParallelResult {
            state,
            stalled,
            reached_goal,
        } = goal.result;
        let at = &state.position;
        let detail = format!("position {at:?}, stalled {stalled}, reached_goal {reached_goal}");
        self.journal.event(now, "gripper ended", detail.clone());
        let said = (reached_goal, stalled);
        ended(self.action.name(), self.jaw, goal.status, said, detail)
    }

    fn cancel(&mut self, _now: f64) {
        self.action.cancel();
    }
}
