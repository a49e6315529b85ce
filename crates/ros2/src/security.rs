//! A keystore of SROS 2: who this program is and what it may do, from the environment.
//!
//! Topics alone: with the library and the versions of Fast DDS that were tried, goals and calls get no answer
//! when they are secured, so that whatever needs them is refused.

use std::path::{Path, PathBuf};

use crate::connect::Choice;
use crate::error::Error;

/// The files of an enclave, as `ros2 security create_enclave` names them.
const FILES: [&str; 6] = [
    "identity_ca.cert.pem",
    "cert.pem",
    "key.pem",
    "permissions_ca.cert.pem",
    "governance.p7s",
    "permissions.p7s",
];

/// A folder with the certificate, the key and the permissions of a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Enclave(PathBuf);

impl Enclave {
    /// Where the files are.
    pub fn folder(&self) -> &Path {
        &self.0
    }

    /// What `ROS_SECURITY_ENABLE`, `_STRATEGY`, `_KEYSTORE` and `_ENCLAVE_OVERRIDE` say; nothing where security
    /// is off, and where the strategy is not `Enforce` and there is no enclave, as in ROS.
    ///
    /// # Errors
    /// [`Error::Value`] for values that ROS has not, a keystore or files that are not there, and for
    /// `ROS_SECURITY_ENABLE=true` when this program was built without the feature `security`.
    pub fn from_environment(get: impl Fn(&str) -> Option<String>) -> Result<Option<Self>, Error> {
        let get = |name: &str| get(name).unwrap_or_default();
        let refuse = |field: &'static str, value: &str, bound: &str| {
            Error::value("the environment", field, format!("`{value}`"), bound)
        };
        match get("ROS_SECURITY_ENABLE").as_str() {
            "" | "false" => return Ok(None),
            "true" if cfg!(feature = "security") => {}
            "true" => {
                let bound = "unset or false: this program was built without the feature `security`";
                return Err(refuse("ROS_SECURITY_ENABLE", "true", bound));
            }
            other => return Err(refuse("ROS_SECURITY_ENABLE", other, "true or false")),
        }
        let strategy = get("ROS_SECURITY_STRATEGY");
        let enforced = match strategy.as_str() {
            "Enforce" => true,
            "" | "Permissive" => false,
            other => {
                return Err(refuse(
                    "ROS_SECURITY_STRATEGY",
                    other,
                    "Enforce or Permissive",
                ));
            }
        };
        let keystore = get("ROS_SECURITY_KEYSTORE");
        if keystore.is_empty() || !Path::new(&keystore).is_dir() {
            return Err(refuse(
                "ROS_SECURITY_KEYSTORE",
                &keystore,
                "the folder of a keystore",
            ));
        }
        let name = get("ROS_SECURITY_ENCLAVE_OVERRIDE");
        let name = if name.is_empty() { "/" } else { name.as_str() };
        let plain =
            |part: &str| part.is_empty() || part.chars().all(|c| c.is_alphanumeric() || c == '_');
        if !name.starts_with('/') || !name.split('/').all(plain) {
            let bound = "a slash and names of letters, digits and _";
            return Err(refuse("ROS_SECURITY_ENCLAVE_OVERRIDE", name, bound));
        }
        let folder = Path::new(&keystore).join("enclaves").join(&name[1..]);
        if let Some(missing) = FILES.into_iter().find(|file| !folder.join(file).is_file()) {
            // A folder with some of the files is a mistake, whatever the strategy.
            if !enforced && FILES.into_iter().all(|file| !folder.join(file).is_file()) {
                return Ok(None);
            }
            let bound = format!("an enclave with {missing} in {}", folder.display());
            return Err(refuse("ROS_SECURITY_ENCLAVE_OVERRIDE", name, &bound));
        }
        Ok(Some(Self(folder)))
    }
}

/// Refuses robots that need more than topics.
///
/// # Errors
/// [`Error::Value`] names the option and what it may be.
pub(crate) fn only_topics(choice: &Choice) -> Result<(), Error> {
    for (option, value, allowed) in [
        ("--arm", &choice.arm, &["cartesian", "record"]),
        ("--gripper", &choice.gripper, &["bool", "none"]),
    ] {
        if !allowed.contains(&value.as_str()) {
            let bound = format!(
                "{} with ROS_SECURITY_ENABLE: services and actions get no answer when they are secured",
                allowed.join(" or ")
            );
            return Err(Error::value(
                "the command line",
                option,
                format!("`{value}`"),
                &bound,
            ));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(variables: &[(&str, &str)]) -> Result<Option<Enclave>, String> {
        let found = Enclave::from_environment(|name| {
            let found = variables.iter().find(|(n, _)| *n == name);
            found.map(|(_, value)| (*value).to_owned())
        });
        found.map_err(|error| error.to_string())
    }

    #[test]
    fn security_is_off_unless_it_is_asked_for() {
        assert_eq!(read(&[]), Ok(None));
        let off = [
            ("ROS_SECURITY_ENABLE", "false"),
            ("ROS_SECURITY_STRATEGY", "Enforce"),
        ];
        assert_eq!(read(&off), Ok(None));
        let error = read(&[("ROS_SECURITY_ENABLE", "TRUE")]).unwrap_err();
        assert!(
            error.contains("ROS_SECURITY_ENABLE is `TRUE`, must be true or false"),
            "{error}"
        );
    }

    #[cfg(not(feature = "security"))]
    #[test]
    fn without_the_feature_it_is_refused_with_the_reason() {
        let error = read(&[("ROS_SECURITY_ENABLE", "true")]).unwrap_err();
        assert!(
            error.contains("built without the feature `security`"),
            "{error}"
        );
    }

    #[cfg(feature = "security")]
    #[test]
    fn an_enclave_is_found_or_its_missing_file_is_named() {
        let keystore = tempfile::tempdir().unwrap();
        let root = keystore.path().to_str().unwrap();
        let with = |more: &[(&'static str, &str)]| {
            let base = [
                ("ROS_SECURITY_ENABLE", "true"),
                ("ROS_SECURITY_KEYSTORE", root),
            ];
            read(&[&base[..], more].concat())
        };
        let play = ("ROS_SECURITY_ENCLAVE_OVERRIDE", "/arms/play");
        let enforce = ("ROS_SECURITY_STRATEGY", "Enforce");
        assert_eq!(with(&[play]), Ok(None));
        assert!(
            with(&[play, enforce])
                .unwrap_err()
                .contains("identity_ca.cert.pem")
        );
        let folder = keystore.path().join("enclaves/arms/play");
        std::fs::create_dir_all(&folder).unwrap();
        for file in &FILES[..5] {
            std::fs::write(folder.join(file), "").unwrap();
        }
        for more in [&[play][..], &[play, enforce]] {
            assert!(with(more).unwrap_err().contains("permissions.p7s"));
        }
        std::fs::write(folder.join(FILES[5]), "").unwrap();
        assert_eq!(with(&[play, enforce]).unwrap().unwrap().folder(), folder);
        for (name, value, text) in [
            (
                "ROS_SECURITY_ENCLAVE_OVERRIDE",
                "/../other",
                "names of letters",
            ),
            ("ROS_SECURITY_STRATEGY", "enforce", "Enforce or Permissive"),
            ("ROS_SECURITY_KEYSTORE", "/nowhere", "folder of a keystore"),
        ] {
            let base = [("ROS_SECURITY_ENABLE", "true"), (name, value)];
            let more = [("ROS_SECURITY_KEYSTORE", root)];
            let error = read(&[&base[..], &more].concat()).unwrap_err();
            assert!(error.contains(name) && error.contains(text), "{error}");
        }
    }
}
