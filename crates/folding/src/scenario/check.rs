//! Errors that name file, key, value and bound.

use selvedge_math::{DQuat, DVec3, Pose};

use crate::Error;

/// Makes errors that name the file.
pub(super) struct Check<'a> {
    pub(super) file: &'a str,
}

impl Check<'_> {
    pub(super) fn value(
        &self,
        key: impl Into<String>,
        value: impl ToString,
        bound: impl Into<String>,
    ) -> Error {
        Error::Value {
            file: self.file.to_owned(),
            key: key.into(),
            value: value.to_string(),
            bound: bound.into(),
        }
    }

    pub(super) fn within(&self, key: &str, value: f64, low: f64, high: f64) -> Result<(), Error> {
        if value >= low && value <= high {
            Ok(())
        } else {
            Err(self.value(key, value, format!("from {low} to {high}")))
        }
    }

    pub(super) fn above(&self, key: &str, value: f64, low: f64, high: f64) -> Result<(), Error> {
        if value > low && value <= high {
            Ok(())
        } else {
            Err(self.value(key, value, format!("above {low} and at most {high}")))
        }
    }

    pub(super) fn point(&self, key: &str, value: [f64; 3]) -> Result<DVec3, Error> {
        match value.iter().all(|c| c.is_finite()) {
            true => Ok(DVec3::from_array(value)),
            false => Err(self.value(key, format!("{value:?}"), "finite")),
        }
    }

    pub(super) fn rotation(&self, key: &str, value: [f64; 4]) -> Result<DQuat, Error> {
        let pose = Pose::new(DVec3::ZERO, DQuat::from_array(value));
        pose.map(|pose| pose.rotation()).map_err(|_| {
            self.value(
                key,
                format!("{value:?}"),
                "a quaternion x y z w, finite and not zero",
            )
        })
    }
}
