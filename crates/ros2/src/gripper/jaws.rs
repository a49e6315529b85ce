//! How far, how fast and how hard jaws go.

use selvedge_math::Jaw;

use crate::error::Error;

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
    /// Whether the Franka hand finds its ends first: it opens and closes whole.
    pub homing: bool,
    /// How long jaws that tell nothing are given [s].
    pub blind: f64,
}

impl Default for Jaws {
    /// The Franka hand and a cloth: 8 cm to 0, 5 mm, 0.1 m/s, 20 N, 10 s; 1.5 s.
    fn default() -> Self {
        Self {
            open: 0.08,
            closed: 0.0,
            epsilon: 0.005,
            speed: 0.1,
            force: 20.0,
            deadline: 10.0,
            homing: false,
            blind: 1.5,
        }
    }
}

impl Jaws {
    /// The gap that the jaws are told [m].
    pub fn gap(&self, jaw: Jaw) -> f64 {
        match jaw.is_closed() {
            true => self.closed,
            false => self.open,
        }
    }

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
        within("deadline [s]", self.deadline, 0.0, 120.0)?;
        within("blind [s]", self.blind, 0.0, self.deadline)
    }
}
