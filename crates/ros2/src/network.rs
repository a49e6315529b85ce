//! What the environment says about the network, as ROS 2 programs read it.

use crate::error::Error;
use crate::security::Enclave;

/// How requests and replies are told apart on the wire; it must be that of the other side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mapping {
    /// `rmw_fastrtps`, `rmw_connextdds`.
    Enhanced,
    /// `rmw_cyclonedds`.
    Cyclone,
}

impl Mapping {
    /// The RMW that has it.
    pub fn rmw(self) -> &'static str {
        match self {
            Self::Enhanced => "rmw_fastrtps_cpp",
            Self::Cyclone => "rmw_cyclonedds_cpp",
        }
    }
}

/// Whose messages MoveIt has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Distro {
    /// Humble.
    Humble,
    /// Jazzy and later.
    Jazzy,
}

impl Distro {
    /// From its name, or `ROS_DISTRO`, or Jazzy.
    ///
    /// # Errors
    /// [`Error::Value`] for a distribution whose messages are not known.
    pub fn named(name: Option<&str>, get: impl Fn(&str) -> Option<String>) -> Result<Self, Error> {
        let variable = get("ROS_DISTRO").filter(|value| !value.is_empty());
        let (place, field) = match name {
            Some(_) => ("the command line", "--distro"),
            None => ("the environment", "ROS_DISTRO"),
        };
        match name.map(String::from).or(variable).as_deref() {
            Some("humble") => Ok(Self::Humble),
            None | Some("jazzy" | "kilted" | "lyrical" | "rolling") => Ok(Self::Jazzy),
            Some(other) => {
                let bound = "humble, jazzy, kilted, lyrical or rolling";
                Err(Error::value(place, field, format!("`{other}`"), bound))
            }
        }
    }
}

/// Where to look for the robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    /// `ROS_DOMAIN_ID`.
    pub domain: u16,
    /// Announce and look on 127.0.0.1 only.
    pub loopback: bool,
    /// From `RMW_IMPLEMENTATION`.
    pub mapping: Mapping,
    /// Who we are, where the network is secured: from `ROS_SECURITY_*`.
    pub security: Option<Enclave>,
}

impl Network {
    /// Reads the variables that ROS 2 has for it.
    ///
    /// # Errors
    /// [`Error::Value`] for what this program does not do, such as Zenoh and static peers, and as
    /// [`Enclave::from_environment`].
    pub fn from_environment(get: impl Fn(&str) -> Option<String>) -> Result<Self, Error> {
        let security = Enclave::from_environment(&get)?;
        let get = |name: &str| get(name).unwrap_or_default();
        let refuse = |field, value: &str, bound: &str| {
            Err(Error::value(
                "the environment",
                field,
                format!("`{value}`"),
                bound,
            ))
        };
        let domain = get("ROS_DOMAIN_ID");
        let domain = match domain.as_str() {
            "" => 0,
            text => match text.parse::<u16>() {
                Ok(id) if id <= 232 => id,
                _ => return refuse("ROS_DOMAIN_ID", text, "a whole number from 0 to 232"),
            },
        };
        let range = get("ROS_AUTOMATIC_DISCOVERY_RANGE");
        let loopback = match range.as_str() {
            "" | "SUBNET" | "SYSTEM_DEFAULT" => get("ROS_LOCALHOST_ONLY") == "1",
            "LOCALHOST" => true,
            other => {
                let bound = "SUBNET, LOCALHOST or SYSTEM_DEFAULT";
                return refuse("ROS_AUTOMATIC_DISCOVERY_RANGE", other, bound);
            }
        };
        let rmw = get("RMW_IMPLEMENTATION");
        let mapping = match rmw.as_str() {
            "" | "rmw_fastrtps_cpp" | "rmw_fastrtps_dynamic_cpp" | "rmw_connextdds" => {
                Mapping::Enhanced
            }
            "rmw_cyclonedds_cpp" => Mapping::Cyclone,
            other => {
                let bound = "rmw_fastrtps_cpp, rmw_cyclonedds_cpp or rmw_connextdds: this program \
                             speaks DDS";
                return refuse("RMW_IMPLEMENTATION", other, bound);
            }
        };
        let peers = get("ROS_STATIC_PEERS");
        if !peers.is_empty() {
            let bound = "unset: there are no static peers here";
            return refuse("ROS_STATIC_PEERS", &peers, bound);
        }
        Ok(Self {
            domain,
            loopback,
            mapping,
            security,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(variables: &[(&str, &str)]) -> Result<Network, Error> {
        Network::from_environment(|name| {
            let found = variables.iter().find(|(n, _)| *n == name);
            found.map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn what_ros_understands_is_understood() {
        let plain = read(&[]).unwrap();
        let expected = Network {
            domain: 0,
            loopback: false,
            mapping: Mapping::Enhanced,
            security: None,
        };
        assert_eq!(plain, expected);
        let set = [
            ("ROS_DOMAIN_ID", "42"),
            ("ROS_LOCALHOST_ONLY", "1"),
            ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp"),
        ];
        let expected = Network {
            domain: 42,
            loopback: true,
            mapping: Mapping::Cyclone,
            security: None,
        };
        assert_eq!(read(&set).unwrap(), expected);
        assert!(
            read(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")])
                .unwrap()
                .loopback
        );
    }

    #[test]
    fn what_is_not_done_is_refused_by_name() {
        for (name, value) in [
            ("ROS_DOMAIN_ID", "233"),
            ("ROS_DOMAIN_ID", "-1"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "OFF"),
            ("RMW_IMPLEMENTATION", "rmw_zenoh_cpp"),
            ("ROS_STATIC_PEERS", "10.0.0.2"),
            ("ROS_SECURITY_ENABLE", "1"),
        ] {
            let error = read(&[(name, value)]).unwrap_err().to_string();
            assert!(error.contains(name) && error.contains(value), "{error}");
        }
    }

    #[test]
    fn the_distribution_is_that_of_the_command_line_then_of_the_environment() {
        let humble = |_: &str| Some("humble".to_owned());
        let none = |_: &str| None;
        assert_eq!(Distro::named(None, none).unwrap(), Distro::Jazzy);
        assert_eq!(Distro::named(None, humble).unwrap(), Distro::Humble);
        assert_eq!(
            Distro::named(Some("kilted"), humble).unwrap(),
            Distro::Jazzy
        );
        let old = Distro::named(Some("foxy"), none).unwrap_err().to_string();
        assert!(
            old.starts_with("the command line: --distro is `foxy`"),
            "{old}"
        );
    }
}
