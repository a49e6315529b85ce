//! What the paper printed.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;

use crate::{Error, Scenario};

/// Published errors by case.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expected {
    /// Where the numbers are from.
    pub source: String,
    /// The errors.
    pub error: BTreeMap<String, f64>,
}

impl Expected {
    /// The errors published for the scenario in the file `path`: `../expected/NAME.toml` seen from
    /// `NAME.toml`, or none if there is no such file.
    ///
    /// # Errors
    /// [`Error::File`], [`Error::Syntax`] or [`Error::Value`] when the file is there and cannot be
    /// used.
    pub fn beside(scenario: &Scenario, path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let (Some(folder), Some(name)) = (path.parent(), path.file_name()) else {
            return Ok(Self::default());
        };
        let path = folder.join("../expected").join(name);
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Ok(Self::default());
            }
            Err(reason) => return Err(Error::File { path, reason }),
        };
        let file = path.display().to_string();
        let expected: Self = toml::from_str(&text).map_err(|error| Error::Syntax {
            file: file.clone(),
            message: error.to_string(),
        })?;
        for (case, &error) in &expected.error {
            let refuse = |value: String, bound: &str| Error::Value {
                file: file.clone(),
                key: format!("error.{case}"),
                value,
                bound: bound.to_owned(),
            };
            if scenario.case(case).is_none() {
                return Err(refuse(
                    error.to_string(),
                    "the error of a case of the scenario",
                ));
            }
            if !(error >= 0.0 && error.is_finite()) {
                return Err(refuse(error.to_string(), "at least 0 and finite"));
            }
        }
        Ok(expected)
    }
}
