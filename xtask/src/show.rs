//! `cargo xtask show`: the player page of any recording.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::ensure;
use selvedge_view::{Clip, Page, Recording, write_whole};
use serde_json::{Map, Value};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// The recordings (.npz); of several the page lets one choose.
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// The page to write [default: beside the first recording, ending in .html].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// A recording and what it is called.
struct Shown {
    case: String,
    solver: String,
    recording: Recording,
    meta: Map<String, Value>,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let paths = &arguments.recordings;
    let beside = || paths[0].with_extension("html");
    let out = arguments.out.clone().unwrap_or_else(beside);
    ensure!(
        !paths.contains(&out),
        "{} is a recording: the page needs another name",
        out.display()
    );
    let mut all = Vec::with_capacity(paths.len());
    for path in paths {
        let shown = named(path, Recording::read(path)?)?;
        all.push(shown);
    }
    // Two of one name cannot be told apart.
    let names: Vec<String> = all
        .iter()
        .map(|s| format!("{} {}", s.case, s.solver))
        .collect();
    for (number, shown) in all.iter_mut().enumerate() {
        let alike = names.iter().filter(|name| **name == names[number]);
        if alike.count() > 1 {
            shown.case = paths[number].display().to_string();
        }
    }

    let clips: Vec<Clip<'_>> = all
        .iter()
        .map(|shown| Clip {
            case: &shown.case,
            solver: &shown.solver,
            recording: &shown.recording,
            ideal: None,
            curve: &[],
        })
        .collect();
    let mut cases: Vec<&str> = all.iter().map(|shown| shown.case.as_str()).collect();
    cases.dedup();
    let title = cases.join(", ");
    let facts: Vec<(String, String)> = all.iter().flat_map(facts).collect();
    let page = Page {
        title: &title,
        lead: "A recording of cloth and gripper.",
        clips: &clips,
        facts: &facts,
        ..Page::default()
    };
    let html = page.html()?;
    write_whole(&out, |writer| Ok(writer.write_all(html.as_bytes())?))?;
    println!("{}", out.display());
    Ok(ExitCode::SUCCESS)
}

/// Case and solver by the description, else the name of the file.
fn named(path: &Path, recording: Recording) -> anyhow::Result<Shown> {
    let meta: Map<String, Value> = serde_json::from_str(recording.meta())?;
    let text = |field: &str| meta.get(field).and_then(Value::as_str).map(str::to_owned);
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    Ok(Shown {
        case: text("case").unwrap_or_else(|| stem.into_owned()),
        solver: text("solver").unwrap_or_default(),
        recording,
        meta,
    })
}

/// The description, field by field.
fn facts(shown: &Shown) -> Vec<(String, String)> {
    let name = [shown.case.as_str(), shown.solver.as_str()].join(" ");
    let field = |(key, value): (&String, &Value)| {
        let text = value
            .as_str()
            .map_or_else(|| value.to_string(), str::to_owned);
        (format!("{}: {key}", name.trim()), text)
    };
    shown.meta.iter().map(field).collect()
}
