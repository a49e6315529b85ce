//! What every gripper does.

pub(crate) mod command;
pub(crate) mod franka;
pub mod jaws;
pub(crate) mod parallel;
pub(crate) mod switch;

use selvedge_math::Jaw;

use crate::dds::GoalStatus;
use crate::error::Cause;

/// A gripper that takes one command at a time. No call but `prepare` waits.
pub trait Gripper {
    /// Finds the gripper; may take seconds.
    ///
    /// # Errors
    /// Why it cannot be commanded.
    fn prepare(&mut self) -> Result<(), Cause>;

    /// Begins to open or close.
    ///
    /// # Errors
    /// Why not.
    fn command(&mut self, now: f64, jaw: Jaw) -> Result<(), Cause>;

    /// Goes on; true when the jaws are where they were told to be.
    ///
    /// # Errors
    /// How the command failed.
    fn poll(&mut self, now: f64) -> Result<bool, Cause>;

    /// Takes a running command back; [`Gripper::poll`] says when that is answered. The jaws stay where
    /// they are.
    fn cancel(&mut self, now: f64);
}

/// No gripper: commands are taken and done at once.
#[derive(Clone, Debug, Default)]
pub struct RecordedJaws {
    /// What was commanded, and when [s].
    pub commands: Vec<(f64, Jaw)>,
}

impl Gripper for RecordedJaws {
    fn prepare(&mut self) -> Result<(), Cause> {
        Ok(())
    }

    fn command(&mut self, now: f64, jaw: Jaw) -> Result<(), Cause> {
        self.commands.push((now, jaw));
        Ok(())
    }

    fn poll(&mut self, _now: f64) -> Result<bool, Cause> {
        Ok(true)
    }

    fn cancel(&mut self, _now: f64) {}
}

/// Whether a goal that has ended has done what it was for: closed on a cloth is stalled, not arrived.
fn ended(
    name: &str,
    jaw: Jaw,
    status: GoalStatus,
    (reached, stalled): (bool, bool),
    detail: String,
) -> Result<bool, Cause> {
    match status {
        GoalStatus::Succeeded if reached || (stalled && jaw.is_closed()) => Ok(true),
        status => Err(Cause::Failed {
            name: name.into(),
            status: format!("{status:?}"),
            detail,
        }),
    }
}
