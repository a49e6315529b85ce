//! What the robot tells about itself, read by a thread of its own and asked for by the loop.

use std::sync::{Arc, Mutex};
use std::time::Instant;

use selvedge_franka::Arm;

use crate::arm::Measured;
use crate::dds::Bus;
use crate::error::{Cause, Error};
use crate::messages;

/// How far beyond its limits a joint may be measured [rad].
const BEYOND: f64 = 0.02;

/// The newest joint positions of an arm, by their names.
pub(crate) struct Robot {
    arm: Arm,
    topic: String,
    state: Arc<Mutex<State>>,
    joints: Vec<f64>,
    age: f64,
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
        bus.subscribe(topic, "sensor_msgs", "JointState", take)?;
        Ok(Self {
            arm: arm.clone(),
            topic: topic.into(),
            state,
            joints,
            age: f64::INFINITY,
        })
    }

    /// Waits for a first state.
    pub(crate) fn wait(&mut self, seconds: f64) -> Result<(), Cause> {
        let start = Instant::now();
        while self.measured()?.age.is_infinite() {
            if start.elapsed().as_secs_f64() > seconds {
                return Err(Cause::Stale {
                    what: self.topic.clone(),
                    age: f64::INFINITY,
                    bound: seconds,
                });
            }
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
        Ok(())
    }

    pub(crate) fn measured(&mut self) -> Result<Measured, Cause> {
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
        Ok(Measured {
            pose: self.arm.forward(&self.joints),
            age: self.age,
        })
    }

    pub(crate) fn joints(&self) -> &[f64] {
        &self.joints
    }
}
