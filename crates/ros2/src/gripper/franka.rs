//! franka_msgs: Grasp to close, Move to open, Homing if that is asked for; the node's service `stop`
//! when a command is taken back, for a running Move is not stopped by a cancel alone.

use selvedge_math::Jaw;

use crate::action::Action;
use crate::call::Call;
use crate::dds::{Bus, GoalStatus};
use crate::error::{Cause, Error};
use crate::gripper::Gripper;
use crate::gripper::jaws::Jaws;
use crate::journal::Journal;
use crate::messages::franka::{FrankaFeedback, FrankaResult, GraspGoal, MoveGoal};
use crate::messages::{Empty, SetBoolReply};

/// How long homing may take [s].
const HOMING: f64 = 30.0;
/// How long an answer to `stop` is waited for [s].
const STOP: f64 = 2.0;
const EMPTY: Empty = Empty {
    structure_needs_at_least_one_member: 0,
};

/// `franka_gripper`, under the name of its node.
pub(crate) struct Franka {
    grasp: Action<GraspGoal, FrankaResult, FrankaFeedback>,
    open: Action<MoveGoal, FrankaResult, FrankaFeedback>,
    home: Action<Empty, FrankaResult, FrankaFeedback>,
    stop: Call<Empty, SetBoolReply>,
    /// Whether an answer of `stop` is waited for.
    stopping: bool,
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
            home: Action::new(bus, &format!("{node}/homing"), ("franka_msgs", "Homing"))?,
            stop: Call::new(bus, &format!("{node}/stop"), ("std_srvs", "Trigger"))?,
            stopping: false,
            jaws,
            jaw: Jaw::Open,
            journal,
        })
    }
}

impl Gripper for Franka {
    fn prepare(&mut self) -> Result<(), Cause> {
        self.grasp.wait()?;
        self.open.wait()?;
        self.stop.wait()?;
        if !self.jaws.homing {
            return Ok(());
        }
        self.home.wait()?;
        self.home.send(EMPTY, HOMING);
        self.jaws.homing = false;
        loop {
            if let Some(goal) = self.home.poll()? {
                return done(self.home.name(), goal.status, goal.result).map(drop);
            }
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
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
        if self.stopping {
            let Some(reply) = self.stop.poll()? else {
                return Ok(false);
            };
            self.stopping = false;
            let told = format!("success {} {}", reply.success, reply.message);
            self.journal.event(now, "gripper stop", told);
        }
        let (polled, name) = match self.jaw {
            Jaw::Closed => (self.grasp.poll()?, self.grasp.name()),
            Jaw::Open => (self.open.poll()?, self.open.name()),
        };
        let Some(goal) = polled else {
            return Ok(false);
        };
        let FrankaResult { success, error } = &goal.result;
        let told = format!("{:?}, success {success} {error}", goal.status);
        self.journal.event(now, "gripper ended", told);
        done(name, goal.status, goal.result)
    }

    fn cancel(&mut self, _now: f64) {
        match self.jaw {
            Jaw::Closed => self.grasp.cancel(),
            Jaw::Open => self.open.cancel(),
        }
        self.stop.send(EMPTY, STOP);
        self.stopping = true;
    }
}

fn done(name: &str, status: GoalStatus, result: FrankaResult) -> Result<bool, Cause> {
    match status {
        GoalStatus::Succeeded if result.success => Ok(true),
        status => Err(Cause::Failed {
            name: name.into(),
            status: format!("{status:?}"),
            detail: result.error,
        }),
    }
}
