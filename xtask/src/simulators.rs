//! The same scenario on every simulator that there is an adapter for: those of the Python package, and
//! rapier3d, which is in Rust and an example of its own.

use std::fmt::Write as _;
use std::fs;
use std::process::ExitCode;

use anyhow::{Context, Result};
use cargo_metadata::camino::{Utf8Path, Utf8PathBuf};

use crate::test::{install_package, python_environment};
use crate::workspace::{self, command, succeed};

/// Where the lines of an adapter are counted; those inside the package have none.
const ADAPTERS: &str = "crates/python/python/selvedge/adapters";
/// The example, and what its adapter is between.
const RAPIER: &str = "crates/folding/examples/rapier.rs";
const SECTION: [&str; 2] = ["// The adapter\n", "// The fold\n"];
const HEADER: &str = "\
| simulator | case | support | E [%] | strain [%] | times real time | lines of adapter |
|---|---|---|---|---|---|---|
";

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Cases; all if none is named.
    cases: Vec<String>,
    /// The scenario.
    #[arg(long, default_value = "fixtures/scenarios/corner_fold.toml")]
    scenario: Utf8PathBuf,
    /// Simulators, separated by commas.
    #[arg(
        long,
        value_delimiter = ',',
        default_value = "default,published,xpbd,mujoco,newton,rapier"
    )]
    simulators: Vec<String>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let metadata = workspace::load()?;
    let mut python = None;
    if arguments.simulators.iter().any(|name| name != "rapier") {
        let path = python_environment(&metadata)?;
        install_package(&metadata, &path)?;
        python = Some(path);
    }
    let out = metadata.target_directory.join("simulators");
    let mut table = HEADER.to_owned();
    let mut code = ExitCode::SUCCESS;
    for name in &arguments.simulators {
        let folder = out.join(name);
        let mut fold = match &python {
            Some(python) if name != "rapier" => {
                let mut fold = command(&metadata, python.as_str(), "-m selvedge.fold --simulator");
                fold.arg(name).arg(&arguments.scenario);
                fold.args(&arguments.cases).arg("--out");
                fold
            }
            _ => {
                let example = "run --quiet --release -p selvedge-folding --example rapier";
                let mut fold = command(&metadata, "cargo", example);
                fold.arg("--").arg(&arguments.scenario);
                fold.args(&arguments.cases).arg("--out");
                fold
            }
        };
        fold.arg(&folder);
        if let Err(error) = succeed(&mut fold) {
            writeln!(table, "| {name} | {error:#} | | | | | |")?;
            code = ExitCode::from(2);
            continue;
        }
        let lines = lines(&metadata.workspace_root, name);
        table += &rows(name, &folder.join("table.csv"), &lines)?;
    }
    print!("{table}");
    fs::write(out.join("table.md"), table)?;
    println!("written: {out}/table.md");
    Ok(code)
}

/// How many lines of code an adapter has; nothing for a simulator without one.
fn lines(root: &Utf8Path, name: &str) -> String {
    let (path, comment) = match name {
        "rapier" => (root.join(RAPIER), "//"),
        _ => (root.join(ADAPTERS).join(format!("{name}.py")), "#"),
    };
    let text = fs::read_to_string(path).unwrap_or_default();
    let [start, end] = SECTION;
    let section = text.split_once(start).map_or(&*text, |(_, rest)| rest);
    let section = section.split_once(end).map_or(section, |(start, _)| start);
    match code_lines(section, comment) {
        0 => String::new(),
        count => count.to_string(),
    }
}

/// Lines that are neither empty nor comments nor in docstrings, which stand alone.
fn code_lines(text: &str, comment: &str) -> usize {
    const QUOTES: &str = "\"\"\"";
    let (mut count, mut in_docstring) = (0, false);
    for line in text.lines().map(str::trim) {
        if in_docstring || line.starts_with(QUOTES) {
            let closes = line.matches(QUOTES).count() % 2 == 1;
            in_docstring ^= closes;
        } else if !line.is_empty() && !line.starts_with(comment) {
            count += 1;
        }
    }
    count
}

/// The lines of a table that the Python program has written.
fn rows(name: &str, path: &Utf8Path, lines: &str) -> Result<String> {
    let text = fs::read_to_string(path).with_context(|| format!("cannot read {path}"))?;
    Ok(table_rows(name, &text, lines))
}

fn table_rows(name: &str, csv: &str, lines: &str) -> String {
    let row = |line: &str| format!("| {name} | {} | {lines} |\n", line.replace(',', " | "));
    csv.lines().skip(1).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_code_are_without_docs() {
        let quotes = "\"\"\"";
        let text = format!(
            "{quotes}What\nit is.\n{quotes}\n\nimport a  # why\n\n\ndef b():\n    {quotes}One.{quotes}\n    # so\n    c = f({quotes}x\n    y{quotes})\n"
        );
        assert_eq!(code_lines(&text, "#"), 4);
        assert_eq!(code_lines("//! A\n#[b]\n    // c\nfn d() {}\n", "//"), 2);
    }

    #[test]
    fn a_row_of_the_csv_file_is_a_row_of_the_table() {
        let csv =
            "case,support,E [%],strain [%],speed\r\nC1,1,0.5,1.25,1.90\r\nC8,4,0.0,1.5,1.8\r\n";
        let wanted = "| xpbd | C1 | 1 | 0.5 | 1.25 | 1.90 | 82 |\n| xpbd | C8 | 4 | 0.0 | 1.5 | 1.8 | 82 |\n";
        assert_eq!(table_rows("xpbd", csv, "82"), wanted);
        let columns = |line: &str| line.matches('|').count();
        assert!(
            HEADER
                .lines()
                .chain(wanted.lines())
                .all(|line| columns(line) == 8)
        );
    }
}
