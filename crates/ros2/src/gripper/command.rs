//! control_msgs GripperCommand.

use selvedge_math::Jaw;

use crate::action::Action;
use crate::dds::Bus;
use crate::error::{Cause, Error};
use crate::gripper::jaws::Jaws;
use crate::gripper::{Gripper, ended};
use crate::journal::Journal;
use crate::messages::{GripperGoal, GripperState};

/// `position` is half the gap, as `franka_gripper` has it.
pub(crate) struct GripperCommand {
    action: Action<GripperGoal, GripperState, GripperState>,
    jaws: Jaws,
    jaw: Jaw,
    journal: Journal,
}

impl GripperCommand {
    pub(crate) fn new(
        bus: &mut Bus,
        name: &str,
        jaws: Jaws,
        journal: Journal,
    ) -> Result<Self, Error> {
        Ok(Self {
            action: Action::new(bus, name, ("control_msgs", "GripperCommand"))?,
            jaws,
            jaw: Jaw::Open,
            journal,
        })
    }
}

impl Gripper for GripperCommand {
    fn prepare(&mut self) -> Result<(), Cause> {
        self.action.wait()
    }

    fn command(&mut self, now: f64, jaw: Jaw) -> Result<(), Cause> {
        let goal = GripperGoal {
            position: 0.5 * self.jaws.gap(jaw),
            max_effort: self.jaws.force,
        };
        self.jaw = jaw;
        self.journal.event(now, "gripper goal", format!("{goal:?}"));
        self.action.send(goal, self.jaws.deadline);
        Ok(())
    }

    fn poll(&mut self, now: f64) -> Result<bool, Cause> {
        let Some(goal) = self.action.poll()? else {
            return Ok(false);
        };
        let GripperState {
            position,
            stalled,
            reached_goal,
            ..
        } = goal.result;
        let detail = format!("position {position}, stalled {stalled}, reached_goal {reached_goal}");
        self.journal.event(now, "gripper ended", detail.clone());
        let said = (reached_goal, stalled);
        ended(self.action.name(), self.jaw, goal.status, said, detail)
    }

    fn cancel(&mut self, _now: f64) {
        self.action.cancel();
    }
}
