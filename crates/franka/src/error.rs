//! What can be wrong with a description of an arm.

use std::path::PathBuf;

/// Why an arm could not be read or asked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file could not be read.
    #[error("{}: {reason}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: std::io::Error,
    },
    /// The text is not URDF.
    #[error("the text is not URDF: {0}")]
    Urdf(String),
    /// The text has xacro macros.
    #[error("the text has xacro macros; expand them first (`xacro FILE > robot.urdf`)")]
    Xacro,
    /// A link is named that is not there.
    #[error("there is no link {0}")]
    NoLink(String),
    /// The tip does not hang on the base, or no joint between them moves.
    #[error("link {tip} is not carried by link {base} over at least one joint that moves")]
    NoChain {
        /// The base link.
        base: String,
        /// The tip link.
        tip: String,
    },
    /// A link has two parents or is its own ancestor.
    #[error("link {0} closes a loop; a serial arm has none")]
    Loop(String),
    /// A joint of the chain cannot be used.
    #[error("joint {joint} {reason}")]
    Joint {
        /// The joint.
        joint: String,
        /// Why.
        reason: String,
    },
    /// The exact inverse was asked of an arm of another shape.
    #[error("{0} has not the shape of a Franka arm, for which alone the exact inverse is")]
    NotFranka(String),
    /// The start of a numeric solve cannot be used.
    #[error("the start {0}")]
    Start(String),
    /// A value of a task cannot be used.
    #[error("{place}: {field} is {value}, must be {bound}")]
    Value {
        /// File, row or argument.
        place: String,
        /// Which part of it.
        field: &'static str,
        /// What was found.
        value: String,
        /// What must be there.
        bound: &'static str,
    },
    /// A joint position is infinite or not a number.
    #[error("{0} must be finite")]
    NotFinite(&'static str),
}

impl Error {
    pub(crate) fn value(
        place: impl Into<String>,
        field: &'static str,
        value: impl ToString,
        bound: &'static str,
    ) -> Self {
        Self::Value {
            place: place.into(),
            field,
            value: value.to_string(),
            bound,
        }
    }
}
