//! What can be wrong with a recording or its file.

use std::path::PathBuf;

/// Any error, for what a closure may return.
pub(crate) type AnyError = Box<dyn std::error::Error + Send + Sync>;

/// Why a recording was refused or a file could not be read or written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A value of a recording cannot be used.
    #[error("{array}: {value}, must be {bound}")]
    Value {
        /// The array, as it is called in the file.
        array: &'static str,
        /// What was found.
        value: String,
        /// What must be there.
        bound: String,
    },
    /// A picture could not be drawn.
    #[error("the chart cannot be drawn: {0}")]
    Draw(String),
    /// A file could not be read, or holds no recording.
    #[error("{}: {reason}", .path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why, often an [`Error::Value`].
        reason: AnyError,
    },
    /// A file could not be written; it is as it was before.
    #[error("{} cannot be written: {reason}", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: AnyError,
    },
}

impl Error {
    pub(crate) fn value(
        array: &'static str,
        value: impl Into<String>,
        bound: impl Into<String>,
    ) -> Self {
        Self::Value {
            array,
            value: value.into(),
            bound: bound.into(),
        }
    }
}
