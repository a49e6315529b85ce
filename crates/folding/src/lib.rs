#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod error;
mod experiment;
mod files;
mod metric;
mod run;
mod scenario;
mod solver;
mod table;

pub use error::Error;
pub use experiment::{Event, Experiment, Options, experiment};
pub use metric::{fold_error, half_fold};
pub use run::{Run, Timing, run};
pub use scenario::{Case, GripperPlan, Scenario};
pub use solver::Solver;
pub use table::{Expected, Measured, Row, terminal};
