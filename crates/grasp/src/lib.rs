#![doc = include_str!("../README.md")]
#![no_std]
#![forbid(unsafe_code)]

extern crate alloc;

mod error;
mod gripper;
mod grippers;
mod guard;
mod select;
mod squeeze;
mod view;
mod volume;

pub use error::Error;
pub use gripper::{Event, Gripper, Options};
pub use grippers::Grippers;
pub use guard::{Guard, Overstretch};
pub use select::{Rules, Support, select};
pub use squeeze::Squeeze;
pub use view::ClothView;
pub use volume::{GraspVolume, Shape};

// What goes in and comes out is said in the words of `selvedge-math`; with these, a simulator that
// only wants the gripper needs no second dependency.
pub use selvedge_math::{Command, DMat3, DQuat, DVec3, Held, HeldError, Jaw, Pose, PoseError};
