//! What the robot tells about itself, read by threads of its own and asked for by the loop.

use std::sync::{Arc, Mutex};
use std::time::Instant;

use selvedge_franka::Arm;

use crate::arm::Measured;
use crate::clock::Clock;
use crate::dds::{Bus, Kept};
use crate::error::{Cause, Error};
use crate::limits::angle;
use crate::messages;
use crate::topic::Writers;
use crate::witness::Witness;

/// How far beyond its limits a joint may be measured [rad].
const BEYOND: f64 = 0.02;
/// How far a witness may be from the joints at rest [m], [rad].
const AGREE: (f64, f64) = (0.005, 0.035);

/// The newest joint positions of an arm, by their names, and what others say about its tip.
pub(crate) struct Robot {
    arm: Arm,
    topic: String,
    writers: Writers,
    state: Arc<Mutex<State>>,
    joints: Vec<f64>,
    age: f64,
    witnesses: Vec<Witness>,
    /// The time that messages are stamped with.
    pub(crate) clock: Clock,
    patience: f64,
}

struct State {
    joints: Vec<f64>,
    at: Option<Instant>,
}

impl Robot {
    /// Reads `topic`; the names of the joints are those of the plan.
    pub(crate) fn new(
        bus: &mut Bus,
        arm: &Arm,
        names: &[String],
        topic: &str,
        witnesses: Vec<Witness>,
        clock: Clock,
    ) -> Result<Self, Error> {
        let joints = vec![f64::NAN; names.len()];
        let state = Arc::new(Mutex::new(State {
            joints: joints.clone(),
            at: None,
        }));
        let (shared, names) = (Arc::clone(&state), names.to_vec());
        let take = move |message: messages::JointState| {
            let of = |name: &String| {
                let k = message.name.iter().position(|other| other == name)?;
                message.position.get(k).copied()
            };
            let mut state = shared.lock().unwrap_or_else(|e| e.into_inner());
            let mut found = 0;
            for (joint, name) in state.joints.iter_mut().zip(&names) {
                if let Some(q) = of(name) {
                    *joint = q;
                    found += 1;
                }
            }
            // Messages of other joints, such as the fingers, tell nothing about the arm.
            if found == names.len() {
                state.at = Some(Instant::now());
            }
        };
        bus.subscribe(topic, ("sensor_msgs", "JointState"), Kept::No, take)?;
        Ok(Self {
            arm: arm.clone(),
            topic: bus.resolve(topic)?,
            writers: Writers::new(bus, topic)?,
            state,
            joints,
            age: f64::INFINITY,
            witnesses,
            clock,
            patience: bus.patience,
        })
    }

    /// Waits for a first state of each source, and looks whether they tell the same.
    pub(crate) fn wait(&mut self) -> Result<(), Cause> {
        let start = Instant::now();
        loop {
            self.measured()?;
            let ages = self.witnesses.iter().map(|w| (&w.name, w.measured().age));
            let mut all = std::iter::once((&self.topic, self.age)).chain(ages);
            let Some((what, age)) = all.find(|(_, age)| age.is_infinite()) else {
                break;
            };
            if start.elapsed().as_secs_f64() > self.patience {
                return Err(Cause::Stale {
                    what: what.clone(),
                    age,
                    bound: self.patience,
                });
            }
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
        self.clock.wait(self.patience)?;
        self.writers.know();
        self.agree()
    }

    fn agree(&mut self) -> Result<(), Cause> {
        let here = self.measured()?.pose;
        for witness in &self.witnesses {
            let there = witness.measured().pose;
            let far = here.position().distance(there.position());
            for (what, off, bound) in [
                ("position [m]", far, AGREE.0),
                ("rotation [rad]", angle(&here, &there), AGREE.1),
            ] {
                if off.is_nan() || off > bound {
                    return Err(Cause::Disagree {
                        first: self.topic.clone(),
                        second: witness.name.clone(),
                        what,
                        off,
                        bound,
                        hint: "is --robot the right one, --frame its base and the tip between its \
                               fingers?",
                    });
                }
            }
        }
        Ok(())
    }

    /// The tip by the joints, as old as the oldest source.
    pub(crate) fn measured(&mut self) -> Result<Measured, Cause> {
        self.writers.check()?;
        // The reader holds the lock for a copy of seven numbers.
        if let Ok(state) = self.state.lock() {
            self.joints.copy_from_slice(&state.joints);
            self.age = state
                .at
                .map_or(f64::INFINITY, |at| at.elapsed().as_secs_f64());
        }
        if self.age.is_infinite() {
            return Ok(Measured::NEVER);
        }
        for (q, joint) in self.joints.iter().zip(self.arm.joints()) {
            let margin = joint.limits.margin(*q);
            if margin.is_nan() || margin < -BEYOND {
                let what = format!("{} in {}", joint.name, self.topic);
                return Err(Cause::Impossible {
                    what,
                    value: format!("{q} rad"),
                });
            }
        }
        let witnessed = self.witnesses.iter().map(|w| w.measured().age);
        Ok(Measured {
            pose: self.arm.forward(&self.joints),
            age: witnessed.fold(self.age, f64::max),
        })
    }

    /// The first witness, which a stream of poses is compared with.
    pub(crate) fn witness(&self) -> Option<&Witness> {
        self.witnesses.first()
    }

    pub(crate) fn joints(&self) -> &[f64] {
        &self.joints
    }
}
