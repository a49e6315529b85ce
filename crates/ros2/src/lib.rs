//! A command log moves a robot over ROS 2: checked first, stopped safely.
//!
//! [`plan::Plan`] turns a log into motions from rest to rest that have passed every check,
//! [`play::play`] plays them on an [`arm::Arm`] and a [`gripper::Gripper`]. Through the poses goes a
//! spline `x(tau)`, and `tau(t)` rises smoothly to the speed asked for and back to rest:
//!
//! ```text
//! v = x' tau',   a = x'' tau'^2 + x' tau'',   both continuous, both zero at the ends
//! ```
//!
//! A stop brings `tau'` to zero within the same bounds, so a robot that stops stays on the path that
//! was checked. `docs/ROBOT.md` tells how to move a robot with it.
#![forbid(unsafe_code)]

mod action;
pub mod arm;
mod bag;
mod call;
mod clock;
pub mod connect;
mod dds;
pub mod error;
pub mod gripper;
pub mod journal;
pub mod limits;
pub mod live;
pub mod messages;
pub mod names;
pub mod network;
mod outbox;
pub mod plan;
pub mod play;
mod report;
mod robot;
pub mod security;
pub mod segment;
pub mod state;
mod topic;
mod witness;
