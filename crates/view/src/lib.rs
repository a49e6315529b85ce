#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod chart;
mod error;
mod mcap_file;
mod mesh_file;
mod npz;
mod page;
mod picture;
mod recording;
mod sheet;
mod surface;
#[cfg(test)]
mod testing;
mod volume;
mod whole;

pub use chart::{Chart, HeatMap};
pub use error::Error;
pub use npz::MAX_BYTES;
pub use page::{Clip, Column, Page, Table};
pub use picture::{Camera, Picture};
pub use recording::{GripperState, Recording};
pub use sheet::{Rest, Sheet};
pub use whole::write_whole;
