//! What can be wrong with a path, a schedule or a log.

use std::io;

use selvedge_math::{DVec3, PoseError};

/// Why a path, a schedule or a log was refused.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A point of a sweep is infinite or not a number.
    #[error("sweep {field} ({}, {}, {}) m must be finite", .value.x, .value.y, .value.z)]
    Point {
        /// Which point.
        field: &'static str,
        /// Its value [m].
        value: DVec3,
    },
    /// An orientation of a sweep is no rotation.
    #[error("sweep {field}: {error}")]
    Orientation {
        /// Which orientation.
        field: &'static str,
        /// What is wrong with it.
        error: PoseError,
    },
    /// A schedule without phases.
    #[error("a schedule must have at least one phase")]
    NoPhase,
    /// A phase whose duration cannot be used.
    #[error("phase {phase}: duration {duration} s must be {bound}")]
    Duration {
        /// Index of the phase, from 0.
        phase: usize,
        /// Its duration [s].
        duration: f64,
        /// What the duration must be.
        bound: &'static str,
    },
    /// A phase does not start where the one before ends.
    #[error(
        "phase {phase} must start where phase {} ends: position off by {distance} m (at most \
         {max_distance}), rotation by {angle} rad (at most {max_angle})",
        .phase - 1
    )]
    Jump {
        /// Index of the later phase, from 0.
        phase: usize,
        /// Distance of the positions [m].
        distance: f64,
        /// The bound of the distance [m].
        max_distance: f64,
        /// Angle between the rotations [rad].
        angle: f64,
        /// The bound of the angle [rad].
        max_angle: f64,
    },
    /// A time of a fold breaks the order `0 <= close <= start < open <= end`.
    #[error("fold time {field} = {value} s must be finite and {bound} {limit} s")]
    FoldTime {
        /// Which time.
        field: &'static str,
        /// Its value [s].
        value: f64,
        /// How it must compare with `limit`.
        bound: &'static str,
        /// The time it is compared with [s].
        limit: f64,
    },
    /// A value of a command log cannot be used.
    #[error("{place}: {field} is {value}, must be {bound}")]
    Log {
        /// File and line, or the sample that was to be written.
        place: String,
        /// Which part of the line.
        field: &'static str,
        /// What was found.
        value: String,
        /// What must be there.
        bound: &'static str,
    },
    /// A log could not be read.
    #[error("{name} cannot be read")]
    Read {
        /// The name given by the caller.
        name: String,
        /// Why.
        source: io::Error,
    },
    /// A log could not be written.
    #[error("the command log cannot be written")]
    Write(#[source] io::Error),
}
