#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod bench;
mod compare;
mod ensemble;
mod error;
mod expected;
mod experiment;
mod files;
mod fold;
mod metric;
mod report;
mod resume;
mod run;
mod scenario;
mod scenes;
mod solver;
mod table;
mod timing;
mod worst;

pub use bench::{Bench, BenchRow, bench};
pub use ensemble::Ensemble;
pub use error::Error;
pub use expected::Expected;
pub use experiment::{Event, Experiment, Export, FoldName, Options, experiment};
pub use metric::{fold_error, half_fold};
pub use run::{Run, run, run_on};
pub use scenario::{Case, Commands, GripperPlan, Scenario};
pub use scenes::{Quantity, Scene};
pub use solver::Solver;
pub use table::{Measured, Row, terminal};
pub use timing::Timing;
pub use worst::Worst;
