//! `cargo xtask scenes`: recordings of scenes with a known answer.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, ensure};
use selvedge_folding::Scene;

use crate::workspace;

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Scenes to run; all of them if none is named.
    names: Vec<String>,
    /// Folder for the recordings [default: target/scenes].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let scenes = Scene::all()?;
    for name in &arguments.names {
        let known: Vec<&str> = scenes.iter().map(|scene| scene.name).collect();
        ensure!(
            known.contains(&name.as_str()),
            "no scene is called {name}; there are {}",
            known.join(", ")
        );
    }
    let out = match &arguments.out {
        Some(out) => out.clone(),
        None => {
            let target = std::env::var_os("CARGO_TARGET_DIR").map(PathBuf::from);
            let default = workspace::root()?.join("target");
            target.unwrap_or(default).join("scenes")
        }
    };
    std::fs::create_dir_all(&out).with_context(|| out.display().to_string())?;

    let mut failed = false;
    println!(
        "{:<16} {:<24} {:>10} {:>10} {:>9}",
        "scene", "quantity", "reference", "measured", "off"
    );
    let wanted = |scene: &&Scene| {
        arguments.names.is_empty() || arguments.names.iter().any(|name| name == scene.name)
    };
    for scene in scenes.iter().filter(wanted) {
        let recording = match scene.run() {
            Ok(recording) => recording,
            Err(reason) => {
                failed = true;
                println!("{:<16} failed: {reason}", scene.name);
                continue;
            }
        };
        recording.write(out.join(format!("{}.npz", scene.name)))?;
        for quantity in &scene.quantities {
            let measured = quantity.measured(scene, &recording);
            let (reference, off) = match quantity.reference {
                Some(reference) => (
                    format!("{reference:.6}"),
                    format!("{:.1e}", measured - reference),
                ),
                None => ("none".into(), String::new()),
            };
            println!(
                "{:<16} {:<24} {reference:>10} {measured:>10.6} {off:>9}",
                scene.name, quantity.name
            );
        }
    }
    Ok(ExitCode::from(if failed { 2 } else { 0 }))
}
