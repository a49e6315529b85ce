#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod arm;
mod body;
mod clearance;
mod distance;
mod error;
mod forward;
mod inverse;
mod limits;
mod numeric;
mod rates;
mod spline;

pub use arm::{Arm, Joint, JointKind};
pub use clearance::Clearance;
pub use error::Error;
pub use forward::manipulability;
pub use inverse::{Joints, Solution, Solutions};
pub use limits::Limits;
pub use numeric::{NumericSolution, TOLERANCE};
pub use rates::{Rates, Window};
