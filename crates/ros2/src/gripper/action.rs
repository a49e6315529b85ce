//! Grippers behind actions: control_msgs GripperCommand, and franka_msgs Grasp and Move.

use selvedge_math::Jaw;

use crate::arm::cartesian::PATIENCE;
use crate::dds::{Action, Bus, GoalStatus};
use crate::error::{Cause, Error};
use crate::gripper::Gripper;
use crate::messages::{
    FrankaFeedback, FrankaResult, GraspGoal, GripperGoal, GripperState, MoveGoal,
};

/// How the jaws open and close.
#[derive(Clone, Copy, Debug)]
pub struct Jaws {
    /// Gap when open [m].
    pub open: f64,
    /// Gap to close to [m].
    pub closed: f64,
    /// How much wider or narrower than that is still a grasp: a cloth is in between [m].
    pub epsilon: f64,
    /// Speed [m/s].
    pub speed: f64,
    /// Force [N].
    pub force: f64,
    /// How long a command may take [s].
    pub deadline: f64,
}

impl Default for Jaws {
    /// The Franka hand and a cloth: 8 cm to 0, 5 mm, 0.1 m/s, 20 N, 10 s.
    fn default() -> Self {
        Self {
            open: 0.08,
            closed: 0.0,
            epsilon: 0.005,
            speed: 0.1,
            force: 20.0,
            deadline: 10.0,
        }
    }
}

impl Jaws {
    /// Refuses what no gripper does.
    ///
    /// # Errors
    /// [`Error::Value`]; a force of zero among it, with which `franka_gripper` does not answer.
    pub fn check(&self) -> Result<(), Error> {
        let within = |field, value: f64, low: f64, high: f64| match value > low && value <= high {
            true => Ok(()),
            false => Err(Error::value(
                "the gripper",
                field,
                value,
                format!("above {low}, at most {high}"),
            )),
        };
        within("force [N]", self.force, 0.0, 140.0)?;
        within("speed [m/s]", self.speed, 0.0, 0.2)?;
        within("open [m]", self.open, self.closed.max(0.0), 0.2)?;
        within("closed [m]", self.closed + 1e-9, 0.0, 0.2)?;
        within("epsilon [m]", self.epsilon, 0.0, 0.2)?;
        within("deadline [s]", self.deadline, 0.0, 120.0)
    }
}

fn failed(name: &str, status: GoalStatus, detail: String) -> Cause {
    Cause::Failed {
        name: name.into(),
        status: format!("{status:?}"),
        detail,
    }
}

/// control_msgs GripperCommand; `position` is half the gap, as `franka_gripper` has it.
pub(crate) struct GripperCommand {
    action: Action<GripperGoal, GripperState, GripperState>,
    name: String,
    jaws: Jaws,
    jaw: Jaw,
}

impl GripperCommand {
    pub(crate) fn new(bus: &mut Bus, name: &str, jaws: Jaws) -> Result<Self, Error> {
        let action = bus.action(name, "control_msgs", "GripperCommand")?;
        Ok(Self {
            action,
            name: name.into(),
            jaws,
            jaw: Jaw::Open,
        })
    }
}

impl Gripper for GripperCommand {
    fn prepare(&mut self) -> Result<(), Cause> {
        self.action.wait(PATIENCE)
    }

    fn command(&mut self, _now: f64, jaw: Jaw) -> Result<(), Cause> {
        let gap = if jaw.is_closed() {
            self.jaws.closed
        } else {
            self.jaws.open
        };
        let goal = GripperGoal {
            position: 0.5 * gap,
            max_effort: self.jaws.force,
        };
        self.jaw = jaw;
        self.action.send(goal, self.jaws.deadline);
        Ok(())
    }

    fn poll(&mut self, _now: f64) -> Result<bool, Cause> {
        let Some(ended) = self.action.poll()? else {
            return Ok(false);
        };
        let GripperState {
            position,
            stalled,
            reached_goal,
            ..
        } = ended.result;
        let detail = format!("position {position}, stalled {stalled}, reached_goal {reached_goal}");
        match ended.status {
            // Closed on a cloth is stalled, not arrived.
            GoalStatus::Succeeded if reached_goal || (stalled && self.jaw.is_closed()) => Ok(true),
            status => Err(failed(&self.name, status, detail)),
        }
    }

    fn cancel(&mut self, _now: f64) {
        self.action.cancel();
    }
}

/// franka_msgs: Grasp to close, Move to open.
pub(crate) struct Franka {
    grasp: Action<GraspGoal, FrankaResult, FrankaFeedback>,
    open: Action<MoveGoal, FrankaResult, FrankaFeedback>,
    node: String,
    jaws: Jaws,
    jaw: Jaw,
}

impl Franka {
    /// `node` is that of `franka_gripper`, for example `/fr3_gripper`.
    pub(crate) fn new(bus: &mut Bus, node: &str, jaws: Jaws) -> Result<Self, Error> {
        let grasp = bus.action(&format!("{node}/grasp"), "franka_msgs", "Grasp")?;
        let open = bus.action(&format!("{node}/move"), "franka_msgs", "Move")?;
        Ok(Self {
            grasp,
            open,
            node: node.into(),
            jaws,
            jaw: Jaw::Open,
        })
    }
}

impl Gripper for Franka {
    fn prepare(&mut self) -> Result<(), Cause> {
        self.grasp.wait(PATIENCE)?;
        self.open.wait(PATIENCE)
    }

    fn command(&mut self, _now: f64, jaw: Jaw) -> Result<(), Cause> {
        let Jaws {
            open,
            closed,
            epsilon,
            speed,
            force,
            deadline,
        } = self.jaws;
        self.jaw = jaw;
        match jaw {
            Jaw::Closed => {
                let goal = GraspGoal {
                    width: closed,
                    inner: epsilon,
                    outer: epsilon,
                    speed,
                    force,
                };
                self.grasp.send(goal, deadline);
            }
            Jaw::Open => self.open.send(MoveGoal { width: open, speed }, deadline),
        }
        Ok(())
    }

    fn poll(&mut self, _now: f64) -> Result<bool, Cause> {
        let polled = match self.jaw {
            Jaw::Closed => self.grasp.poll()?,
            Jaw::Open => self.open.poll()?,
        };
        let Some(ended) = polled else {
            return Ok(false);
        };
        match ended.status {
            GoalStatus::Succeeded if ended.result.success => Ok(true),
            status => {
                let what = if self.jaw.is_closed() {
                    "grasp"
                } else {
                    "move"
                };
                let name = format!("{}/{what}", self.node);
                Err(failed(&name, status, ended.result.error))
            }
        }
    }

    fn cancel(&mut self, _now: f64) {
        match self.jaw {
            Jaw::Closed => self.grasp.cancel(),
            Jaw::Open => self.open.cancel(),
        }
    }
}
