#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod error;
mod npz;
mod recording;
mod whole;

pub use error::Error;
pub use recording::{GripperState, Recording, Rest, Sheet};
pub use whole::write_whole;
