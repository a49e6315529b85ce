#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod bezier;
mod error;
pub mod log;
mod schedule;
mod sweep;
mod timing;

pub use bezier::QuadBezier;
pub use error::Error;
pub use schedule::{FoldTimes, Movement, Phase, Schedule};
pub use sweep::{Motion, Orientation, Rates, Sweep};
pub use timing::Law;
