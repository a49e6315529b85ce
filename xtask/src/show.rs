//! `cargo xtask show`: the player page of any recording.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::ensure;
use selvedge_view::{Clip, Page, Recording, write_whole};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// The recordings (.npz); of several the page lets one choose.
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// The page to write [default: beside the first recording, ending in .html].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let paths = &arguments.recordings;
    let mut recordings = Vec::with_capacity(paths.len());
    for path in paths {
        recordings.push((name(path, paths), Recording::read(path)?));
    }
    let clips: Vec<Clip<'_>> = recordings
        .iter()
        .map(|(name, recording)| Clip {
            case: name,
            solver: "",
            recording,
            ideal: None,
            curve: &[],
        })
        .collect();
    let names: Vec<&str> = recordings.iter().map(|(name, _)| name.as_str()).collect();
    let title = names.join(", ");
    let facts: Vec<(String, String)> = recordings
        .iter()
        .map(|(name, recording)| (name.clone(), recording.meta().to_owned()))
        .collect();
    let page = Page {
        title: &title,
        lead: "A recording of cloth and gripper.",
        clips: &clips,
        facts: &facts,
        ..Page::default()
    };
    let beside = || paths[0].with_extension("html");
    let out = arguments.out.clone().unwrap_or_else(beside);
    ensure!(
        !paths.contains(&out),
        "{} is a recording: the page needs another name",
        out.display()
    );
    let html = page.html()?;
    write_whole(&out, |writer| Ok(writer.write_all(html.as_bytes())?))?;
    println!("{}", out.display());
    Ok(ExitCode::SUCCESS)
}

/// The file's name without its ending; the whole path where two have the same.
fn name(path: &Path, all: &[PathBuf]) -> String {
    let stem = path.file_stem().unwrap_or_default();
    let alike = all.iter().filter(|other| other.file_stem() == Some(stem));
    match alike.count() {
        1 => stem.to_string_lossy().into_owned(),
        _ => path.display().to_string(),
    }
}
