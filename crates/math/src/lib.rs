#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]

extern crate alloc;

mod command;
mod held;
mod pose;
mod simulator;

pub use command::{Command, Jaw};
pub use glam::{DMat3, DQuat, DVec3};
pub use held::{Held, HeldError};
pub use pose::{Pose, PoseError};
pub use simulator::{ClothSimulator, SimulatorError, Status, StepReport};
