#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod arm;
mod body;
mod cause;
mod clearance;
mod distance;
mod error;
mod fastest;
mod forward;
mod graph;
mod inverse;
mod limits;
mod motion;
mod numeric;
mod offers;
mod placement;
mod rates;
mod reach;
mod route;
mod search;
mod skin;
mod smooth;
mod spline;
mod task;
mod timing;
mod track;

pub use arm::{Arm, Joint, JointKind};
pub use cause::{Cause, LIMIT_MARGIN, OWN_MARGIN};
pub use clearance::Clearance;
pub use error::Error;
pub use forward::{manipulability, smallest_singular_value};
pub use inverse::{Joints, Solution, Solutions};
pub use limits::Limits;
pub use motion::{Motion, Timing};
pub use numeric::{NumericSolution, TOLERANCE};
pub use offers::Offer;
pub use placement::Placement;
pub use rates::{Rates, Window};
pub use reach::{Blocked, Part, Posture, Reach, Row, home, joint_path, reach};
pub use search::{PLACES, Place, SPACING, best, either, search};
pub use skin::Skin;
pub use task::LIFT;
pub use timing::{TICK, Usage, slow_down, usage};
