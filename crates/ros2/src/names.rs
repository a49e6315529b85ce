//! Names of topics, services and actions, and what `--ros-args` says about them and about options.

use crate::error::Error;

/// The node's name and namespace, and the rules that turn names into others.
///
/// ```
/// use selvedge_ros2::names::Names;
///
/// let arguments = ["fold.csv", "--ros-args", "-r", "__ns:=/left", "-r", "/target_pose:=goal"];
/// let (names, rest, parameters) = Names::from_arguments(arguments.map(String::from)).unwrap();
/// assert_eq!(rest, ["fold.csv"]);
/// assert!(parameters.is_empty());
/// assert_eq!(names.resolve("/target_pose").unwrap(), "/left/goal");
/// assert_eq!(names.resolve("joint_states").unwrap(), "/left/joint_states");
/// assert_eq!(names.resolve("~/path").unwrap(), "/left/selvedge_play/path");
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Names {
    node: String,
    namespace: String,
    rules: Vec<(String, String)>,
}

impl Default for Names {
    /// `/selvedge_play`, no rules.
    fn default() -> Self {
        Self {
            node: "selvedge_play".into(),
            namespace: "/".into(),
            rules: Vec::new(),
        }
    }
}

/// Names and values of parameters.
pub type Parameters = Vec<(String, String)>;

/// Names, what is no argument of ROS, and parameters.
pub type Parsed = (Names, Vec<String>, Parameters);

impl Names {
    /// Takes what stands between `--ros-args` and `--` or the end out of a command line: remaps
    /// (`-r from:=to`, `__ns`, `__node`) and parameters (`-p name:=value`).
    ///
    /// # Errors
    /// [`Error::Value`] for what is not understood, or is no name.
    pub fn from_arguments(arguments: impl IntoIterator<Item = String>) -> Result<Parsed, Error> {
        let (mut names, mut rest, mut parameters) = (Self::default(), Vec::new(), Vec::new());
        let mut rules = Vec::new();
        let mut arguments = arguments.into_iter();
        while let Some(argument) = arguments.next() {
            if argument != "--ros-args" {
                rest.push(argument);
                continue;
            }
            while let Some(flag) = arguments.next() {
                if flag == "--" {
                    break;
                }
                let value = match flag.as_str() {
                    "-r" | "--remap" | "-p" | "--param" => arguments.next().unwrap_or_default(),
                    other => {
                        let bound =
                            "-r from:=to or -p name:=value; files and log levels are not read";
                        return Err(refused("argument", other, bound));
                    }
                };
                let pair = value.split_once(":=");
                let Some((from, to)) = pair.filter(|(a, b)| !a.is_empty() && !b.is_empty()) else {
                    return Err(refused("argument", &value, "of the form from:=to"));
                };
                if flag == "-p" || flag == "--param" {
                    parameters.push((from.to_owned(), to.to_owned()));
                    continue;
                }
                match from {
                    "__ns" => names.namespace = space(to)?,
                    "__node" | "__name" => names.node = token(to)?,
                    // Those with the name of a node are of that node alone.
                    _ => rules.push((from.to_owned(), to.to_owned())),
                }
            }
        }
        for (from, to) in rules {
            let from = match from.split_once(':') {
                Some((node, from)) if node == names.node => from.to_owned(),
                Some(_) => continue,
                None => from,
            };
            let rule = (names.expand(&from)?, names.expand(&to)?);
            names.rules.push(rule);
        }
        Ok((names, rest, parameters))
    }

    /// The same in another namespace.
    ///
    /// # Errors
    /// [`Error::Value`] for what is no namespace, or when `__ns` has given one already.
    pub fn within(mut self, namespace: &str) -> Result<Self, Error> {
        if self.namespace != "/" && self.namespace != space(namespace)? {
            let bound = format!("unset, or {} as __ns is", self.namespace);
            return Err(refused("--namespace", namespace, &bound));
        }
        self.namespace = space(namespace)?;
        Ok(self)
    }

    /// The node's name.
    pub fn node(&self) -> &str {
        &self.node
    }

    /// The namespace, beginning with `/`.
    pub fn namespace(&self) -> &str {
        &self.namespace
    }

    /// The full name: `~` is the node, what does not begin with `/` is in the namespace, and the first
    /// rule that fits is applied.
    ///
    /// # Errors
    /// [`Error::Value`] for what is no name.
    pub fn resolve(&self, name: &str) -> Result<String, Error> {
        let full = self.expand(name)?;
        let rule = self.rules.iter().find(|(from, _)| *from == full);
        Ok(rule.map_or(full, |(_, to)| to.clone()))
    }

    fn expand(&self, name: &str) -> Result<String, Error> {
        let root = self.namespace.trim_end_matches('/');
        let full = match name.strip_prefix("~/") {
            Some(own) => format!("{root}/{}/{own}", self.node),
            None if name.starts_with('/') => name.to_owned(),
            None => format!("{root}/{name}"),
        };
        for part in full.split('/').skip(1) {
            token(part).map_err(|_| refused("name", name, WORDS))?;
        }
        Ok(full)
    }
}

const WORDS: &str = "words of letters, digits and _ between slashes, none of which begins with a \
                     digit or has two _ in a row";

fn refused(field: &'static str, value: &str, bound: &str) -> Error {
    Error::value("the names", field, format!("`{value}`"), bound)
}

fn token(text: &str) -> Result<String, Error> {
    let word = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let first = text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
    match first && text.chars().all(word) && !text.contains("__") {
        true => Ok(text.to_owned()),
        false => Err(refused("name", text, WORDS)),
    }
}

fn space(text: &str) -> Result<String, Error> {
    let inner = text.strip_prefix('/').unwrap_or(text);
    if inner.is_empty() {
        return Ok("/".into());
    }
    for part in inner.split('/') {
        token(part).map_err(|_| refused("namespace", text, WORDS))?;
    }
    Ok(format!("/{inner}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Parsed, Error> {
        Names::from_arguments(text.split_whitespace().map(String::from))
    }

    #[test]
    fn remaps_namespaces_and_parameters_are_those_of_ros() {
        let (names, rest, parameters) = parse(
            "log.csv --ros-args -r a:=/b -r selvedge_play:c:=d -r other:e:=f -r __ns:=left \
             -p speed:=0.2 -- --execute",
        )
        .unwrap();
        assert_eq!(rest, ["log.csv", "--execute"]);
        assert_eq!(parameters, [("speed".into(), "0.2".into())]);
        for (name, full) in [
            ("a", "/b"),
            ("/a", "/a"),
            ("/left/a", "/b"),
            ("c", "/left/d"),
            ("e", "/left/e"),
            ("~/x", "/left/selvedge_play/x"),
        ] {
            assert_eq!(names.resolve(name).unwrap(), full, "{name}");
        }
        let (names, ..) = parse("--ros-args -r __node:=fold").unwrap();
        assert_eq!(names.resolve("~/x").unwrap(), "/fold/x");
        let inside = names.within("/cell/one").unwrap();
        assert_eq!(inside.resolve("x").unwrap(), "/cell/one/x");
        assert!(inside.clone().within("/cell/one/").is_err());
        assert!(inside.within("/elsewhere").is_err());
    }

    #[test]
    fn what_is_not_understood_is_refused_by_name() {
        for (text, word) in [
            ("--ros-args --params-file x.yaml", "--params-file"),
            ("--ros-args --log-level debug", "--log-level"),
            ("--ros-args -r a", "`a`"),
            ("--ros-args -p :=1", "`:=1`"),
            ("--ros-args -r a:=b//c", "b//c"),
            ("--ros-args -r __ns:=/1x", "/1x"),
            ("--ros-args -r __node:=a/b", "a/b"),
        ] {
            let error = parse(text).unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
        for name in ["/a b", "a__b", "", "/", "~", "/3d"] {
            assert!(Names::default().resolve(name).is_err(), "{name}");
        }
    }
}
