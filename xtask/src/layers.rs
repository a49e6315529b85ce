//! Which crate may need which, and where a heavy package may be named.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use cargo_metadata::camino::{Utf8Path, Utf8PathBuf};
use cargo_metadata::{DependencyKind, Metadata};

use crate::workspace::{self, command};

/// Each crate of the workspace and the crates of it that it may need; no arrow runs back up.
const ARROWS: &[(&str, &[&str])] = &[
    ("selvedge-math", &[]),
    ("selvedge-grasp", &["selvedge-math"]),
    ("selvedge-trajectory", &["selvedge-math"]),
    ("selvedge-cloth", &["selvedge-math"]),
    ("selvedge-view", &["selvedge-math"]),
    ("selvedge-published", &["selvedge-math", "selvedge-cloth"]),
    // What its program shows.
    (
        "selvedge-franka",
        &["selvedge-math", "selvedge-trajectory", "selvedge-view"],
    ),
    (
        "selvedge-folding",
        &[
            "selvedge-math",
            "selvedge-grasp",
            "selvedge-trajectory",
            "selvedge-cloth",
            "selvedge-view",
            "selvedge-published",
        ],
    ),
    (
        "selvedge-ros2",
        &["selvedge-math", "selvedge-trajectory", "selvedge-franka"],
    ),
    ("selvedge-python", LIBRARIES),
    ("xtask", LIBRARIES),
];

const LIBRARIES: &[&str] = &[
    "selvedge-math",
    "selvedge-grasp",
    "selvedge-trajectory",
    "selvedge-cloth",
    "selvedge-view",
    "selvedge-published",
    "selvedge-franka",
    "selvedge-folding",
    "selvedge-ros2",
];

/// Packages that one source file of a crate may name, so that they can be swapped there.
const HEAVY: &[&str] = &[
    "faer",
    "parry3d_f64",
    "clarabel",
    "urdf_rs",
    "ros2_client",
    "pulp",
    "rayon",
    "plotters",
    "zip",
    "color_quant",
    "gif",
    "mcap",
    "minijinja",
    "png",
];

/// Everything that any crate of the workspace can need.
const ALL: &str = "--workspace --all-features";
/// The normal tree of the grasp crate, whole.
const GRASP_TREE: [&str; 3] = ["glam", "selvedge-grasp", "selvedge-math"];

pub(crate) fn run() -> Result<ExitCode> {
    let passed = check(&workspace::load()?)?;
    Ok(ExitCode::from(u8::from(!passed)))
}

/// Prints a line a check and what it found; true when nothing was found.
pub(crate) fn check(metadata: &Metadata) -> Result<bool> {
    let root = &metadata.workspace_root;
    let read = |path: &str| {
        let path = root.join(path);
        fs::read_to_string(&path).with_context(|| format!("cannot read {path}"))
    };
    let crates = crates(metadata);
    let sources = sources(metadata)?;
    let checks = [
        ("arrows between the crates", arrows(&crates)),
        ("tree of selvedge-grasp", grasp_tree(metadata)?),
        ("one version of glam", one_glam(&tree(metadata, ALL)?)),
        ("heavy packages in one file a crate", heavy(&sources)),
        ("unsafe code forbidden in libraries", unsafe_code(&sources)),
        (
            "dependencies in docs/ARCHITECTURE.md",
            documented(&crates, &read("docs/ARCHITECTURE.md")?),
        ),
    ];
    for (name, violations) in &checks {
        println!(
            "{name}: {}",
            if violations.is_empty() {
                "ok"
            } else {
                "FAILED"
            }
        );
        for violation in violations {
            println!("  {violation}");
        }
    }
    Ok(checks.iter().all(|(_, violations)| violations.is_empty()))
}

// ---- The arrows

/// What a crate of the workspace needs, by name.
#[derive(Default)]
struct Needs {
    /// Normal and build dependencies, of every feature and target.
    always: BTreeSet<String>,
    /// Those of its tests, examples and benches.
    tests: BTreeSet<String>,
}

type Crates = BTreeMap<String, Needs>;

fn crates(metadata: &Metadata) -> Crates {
    let mut crates = Crates::new();
    for package in metadata.workspace_packages() {
        let needs = crates.entry(package.name.to_string()).or_default();
        for dependency in &package.dependencies {
            let names = match dependency.kind {
                DependencyKind::Development => &mut needs.tests,
                _ => &mut needs.always,
            };
            names.insert(dependency.name.clone());
        }
    }
    crates
}

/// Normal dependencies follow the table. Tests may use any crate that does not need theirs in turn.
fn arrows(crates: &Crates) -> Vec<String> {
    let mut violations = Vec::new();
    for (name, needs) in crates {
        let Some((_, allowed)) = ARROWS.iter().find(|(from, _)| from == name) else {
            violations.push(format!("{name} is not in the table of arrows"));
            continue;
        };
        for other in needs
            .always
            .iter()
            .filter(|other| crates.contains_key(*other))
        {
            if !allowed.contains(&other.as_str()) {
                violations.push(format!("{name} must not need {other}"));
            }
        }
        for other in &needs.tests {
            if reaches(crates, other, name) {
                violations.push(format!(
                    "tests of {name} must not need {other}, which needs {name}"
                ));
            }
        }
    }
    violations
}

/// Whether `from` needs `to`, itself or through others. The arrows have no cycles: cargo sees to it.
fn reaches(crates: &Crates, from: &str, to: &str) -> bool {
    let Some(needs) = crates.get(from) else {
        return false;
    };
    needs.always.contains(to) || needs.always.iter().any(|next| reaches(crates, next, to))
}

/// What `cargo tree` prints, a package a line.
fn tree(metadata: &Metadata, arguments: &str) -> Result<String> {
    let arguments = format!("tree {arguments} --target all --prefix none");
    let output = command(metadata, "cargo", &arguments).output()?;
    let errors = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "cargo tree: {errors}");
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

fn grasp_tree(metadata: &Metadata) -> Result<Vec<String>> {
    let tree = tree(metadata, "--package selvedge-grasp --edges normal")?;
    let names: BTreeSet<&str> = tree
        .lines()
        .filter_map(|line| line.split(' ').next())
        .collect();
    if names.iter().eq(&GRASP_TREE) {
        return Ok(Vec::new());
    }
    Ok(vec![format!("{names:?}, expected {GRASP_TREE:?}")])
}

/// The lock file names more: packages that a feature nobody asks for would need.
fn one_glam(tree: &str) -> Vec<String> {
    let glams: BTreeSet<&str> = tree
        .lines()
        .filter_map(|line| line.strip_prefix("glam v"))
        .filter_map(|rest| rest.split(' ').next())
        .collect();
    match glams.len() {
        1 => Vec::new(),
        count => vec![format!("there are {count} of them: {glams:?}")],
    }
}

// ---- The sources

/// A source file of a library; the path is that in the workspace.
struct Source {
    library: String,
    path: Utf8PathBuf,
    text: String,
}

fn sources(metadata: &Metadata) -> Result<Vec<Source>> {
    let root = &metadata.workspace_root;
    let mut sources = Vec::new();
    for package in metadata.workspace_packages() {
        if LIBRARIES.contains(&package.name.as_str()) {
            let mut files = Vec::new();
            rust_files(&package.manifest_path.with_file_name("src"), &mut files)?;
            files.sort();
            for file in files {
                let text =
                    fs::read_to_string(&file).with_context(|| format!("cannot read {file}"))?;
                let library = package.name.to_string();
                let path = file.strip_prefix(root)?.to_owned();
                sources.push(Source {
                    library,
                    path,
                    text,
                });
            }
        }
    }
    Ok(sources)
}

fn rust_files(folder: &Utf8Path, files: &mut Vec<Utf8PathBuf>) -> Result<()> {
    let entries = folder.read_dir_utf8();
    for entry in entries.with_context(|| format!("cannot read {folder}"))? {
        let path = entry?.into_path();
        if path.is_dir() {
            rust_files(&path, files)?;
        } else if path.extension() == Some("rs") {
            files.push(path);
        }
    }
    Ok(())
}

fn heavy(sources: &[Source]) -> Vec<String> {
    let mut files = BTreeMap::<_, Vec<&str>>::new();
    for source in sources {
        for name in HEAVY {
            if source.text.lines().any(|line| names_crate(line, name)) {
                files
                    .entry((&source.library, name))
                    .or_default()
                    .push(source.path.as_str());
            }
        }
    }
    files.retain(|_, files| files.len() > 1);
    let violation =
        |((_, name), files): (_, Vec<&str>)| format!("{name} is named in {}", files.join(", "));
    files.into_iter().map(violation).collect()
}

/// Whether a line names a crate outside a comment: `name::` in a path, or `use name`.
fn names_crate(line: &str, name: &str) -> bool {
    let code = line.split("//").next().unwrap_or_default();
    let in_word = |c: char| c.is_alphanumeric() || c == '_';
    code.match_indices(name).any(|(at, _)| {
        let (before, after) = (&code[..at], &code[at + name.len()..]);
        // `.zip::<...>()` is a method.
        let starts = !before.ends_with(in_word) && !before.ends_with('.');
        let used = before.ends_with("use ") && !after.starts_with(in_word);
        starts && (used || after.starts_with("::"))
    })
}

fn unsafe_code(sources: &[Source]) -> Vec<String> {
    let roots = sources
        .iter()
        .filter(|source| source.path.ends_with("src/lib.rs"));
    let forbids = |source: &Source| {
        let mut lines = source.text.lines();
        lines.any(|line| line == "#![forbid(unsafe_code)]")
    };
    let open = roots.filter(|source| !forbids(source));
    open.map(|source| format!("{} does not forbid it", source.path))
        .collect()
}

/// Every package from outside has a row in a table, with its name in the first cell.
fn documented(crates: &Crates, architecture: &str) -> Vec<String> {
    let mut violations = Vec::new();
    for (name, needs) in crates {
        for other in needs
            .always
            .iter()
            .filter(|other| !crates.contains_key(*other))
        {
            let row = format!("| `{other}` |");
            if !architecture.lines().any(|line| line.starts_with(&row)) {
                violations.push(format!("{other}, needed by {name}, has no row"));
            }
        }
    }
    violations
}

#[cfg(test)]
mod tests {
    use super::*;

    fn needs(always: &[&str], tests: &[&str]) -> Needs {
        let set = |names: &[&str]| names.iter().map(ToString::to_string).collect();
        Needs {
            always: set(always),
            tests: set(tests),
        }
    }

    /// Normal dependencies of three crates, and those of the tests of `grasp`.
    fn three(math: &[&str], grasp: &[&str], tests: &[&str]) -> Crates {
        Crates::from([
            ("selvedge-math".into(), needs(math, &[])),
            ("selvedge-grasp".into(), needs(grasp, tests)),
            (
                "selvedge-trajectory".into(),
                needs(&["selvedge-math", "csv"], &[]),
            ),
        ])
    }

    #[test]
    fn arrows_of_the_table_pass() {
        let grasp = ["selvedge-math", "serde"];
        let crates = three(&["glam"], &grasp, &["selvedge-trajectory", "criterion"]);
        assert!(arrows(&crates).is_empty());
    }

    #[test]
    fn an_arrow_that_is_not_in_the_table_is_found() {
        let crates = three(&["glam"], &["selvedge-math", "selvedge-trajectory"], &[]);
        let expected = ["selvedge-grasp must not need selvedge-trajectory"];
        assert_eq!(arrows(&crates), expected);
    }

    #[test]
    fn a_crate_that_is_not_in_the_table_is_found() {
        let mut crates = three(&[], &[], &[]);
        crates.insert("selvedge-extra".into(), needs(&[], &[]));
        assert_eq!(
            arrows(&crates),
            ["selvedge-extra is not in the table of arrows"]
        );
    }

    #[test]
    fn tests_that_need_a_crate_above_their_own_are_found() {
        let mut crates = three(&[], &["selvedge-math"], &["selvedge-folding"]);
        crates.insert("selvedge-folding".into(), needs(&["selvedge-grasp"], &[]));
        let expected =
            "tests of selvedge-grasp must not need selvedge-folding, which needs selvedge-grasp";
        assert_eq!(arrows(&crates), [expected]);
    }

    #[test]
    fn two_versions_of_glam_are_found() {
        let one = "selvedge-math v0.1.0 (/a)\nglam v0.33.1\nglamx v0.3.0\nglam v0.33.1 (*)\n";
        assert!(one_glam(one).is_empty());
        let two = format!("{one}glam v0.30.0\n");
        let expected = "there are 2 of them: {\"0.30.0\", \"0.33.1\"}";
        assert_eq!(one_glam(&two), [expected]);
    }

    fn source(library: &str, path: &str, text: &str) -> Source {
        Source {
            library: library.into(),
            path: format!("crates/{library}/src/{path}").into(),
            text: text.into(),
        }
    }

    #[test]
    fn a_heavy_package_in_two_files_of_a_crate_is_found() {
        let mut sources = vec![
            source("cloth", "linear.rs", "use faer::Side;\n"),
            source("cloth", "qp.rs", "// not faer::Side\nuse clarabel;\n"),
            source("published", "linear.rs", "fn f(m: &faer::Mat<f64>) {}\n"),
        ];
        assert!(heavy(&sources).is_empty());
        sources.push(source("cloth", "simulator.rs", "    use faer as f;\n"));
        let expected = "faer is named in crates/cloth/src/linear.rs, crates/cloth/src/simulator.rs";
        assert_eq!(heavy(&sources), [expected]);
    }

    #[test]
    fn only_crates_are_taken_for_crates() {
        for line in [
            "use zip::ZipWriter;",
            "use zip;",
            "let a = zip::A;",
            "x(::zip::A)",
        ] {
            assert!(names_crate(line, "zip"), "{line}");
        }
        for line in [
            "a.iter().zip(b)",
            "a.zip::<B>(b)",
            "unzip::a()",
            "use zipper;",
            "/// zip::A",
        ] {
            assert!(!names_crate(line, "zip"), "{line}");
        }
    }

    #[test]
    fn a_library_that_allows_unsafe_code_is_found() {
        let sources = [
            source("math", "lib.rs", "//! Math\n#![forbid(unsafe_code)]\n"),
            source("math", "pose.rs", ""),
            source("view", "lib.rs", "#![deny(unsafe_code)]\n"),
        ];
        assert_eq!(
            unsafe_code(&sources),
            ["crates/view/src/lib.rs does not forbid it"]
        );
    }

    #[test]
    fn a_dependency_without_a_row_is_found() {
        let crates = three(&["glam"], &["selvedge-math", "serde"], &["criterion"]);
        let text = "Of `serde`.\n\n| `glam` | math | vectors |\n| `csv` | trajectory | `serde` |\n";
        let expected = ["serde, needed by selvedge-grasp, has no row"];
        assert_eq!(documented(&crates, text), expected);
    }
}
