//! All that CI runs: cheap checks first, and each one whatever the others found.

use std::process::{Command, ExitCode};

use anyhow::{Result, ensure};
use cargo_metadata::Metadata;

use crate::report::{Outcome, Report, lacking};
use crate::workspace::{self, command, succeed};
use crate::{layers, test};

/// A tool from crates.io and its version.
type Tool = (&'static str, &'static str);
const DENY: Tool = ("cargo-deny", "0.20.2");
const MACHETE: Tool = ("cargo-machete", "0.9.2");

pub(crate) fn run() -> Result<ExitCode> {
    let metadata = workspace::load()?;
    let mut report = Report::default();
    let cargo = |arguments: &str| command(&metadata, "cargo", arguments);

    report.step("formatting", || passes(&mut cargo("fmt --all --check")));
    report.step("layers", || {
        ensure!(layers::check(&metadata)?, "see above");
        Ok(Outcome::Passed)
    });
    report.step("unused dependencies", || {
        with_tool(&metadata, MACHETE, |machete| {
            passes(&mut command(&metadata, machete, ""))
        })
    });
    report.step("licences, bans, sources", || {
        with_tool(&metadata, DENY, |deny| {
            passes(&mut command(&metadata, deny, "check licenses bans sources"))
        })
    });
    report.step("advisories", || {
        with_tool(&metadata, DENY, |deny| {
            if succeed(&mut command(&metadata, deny, "fetch db")).is_err() {
                // Even in CI: the data base is on a server that others run.
                let reason = "the data base could not be fetched";
                return Ok(Outcome::Skipped(reason.into()));
            }
            passes(&mut command(&metadata, deny, "--offline check advisories"))
        })
    });
    report.step("no_std", || {
        let mut build = cargo("build --manifest-path fixtures/no_std/Cargo.toml --target-dir");
        passes(build.arg(metadata.target_directory.join("no_std")))
    });
    report.step("clippy", || {
        let arguments = "clippy --workspace --all-targets --all-features -- -D warnings";
        passes(&mut cargo(arguments))
    });
    report.step("documentation", || {
        let mut doc = cargo("doc --workspace --no-deps --all-features");
        passes(doc.env("RUSTDOCFLAGS", "-D warnings"))
    });
    test::steps(&metadata, true, &mut report);
    Ok(report.finish())
}

fn passes(command: &mut Command) -> Result<Outcome> {
    succeed(command)?;
    Ok(Outcome::Passed)
}

/// Runs a step with a tool below the target folder, where it is installed unless that version is
/// there.
fn with_tool(
    metadata: &Metadata,
    (name, version): Tool,
    step: impl FnOnce(&str) -> Result<Outcome>,
) -> Result<Outcome> {
    let folder = metadata.target_directory.join("tools");
    let program = folder.join("bin").join(name);
    let found = Command::new(&program).arg("--version").output();
    let is_version = |text: Vec<u8>| String::from_utf8_lossy(&text).trim().ends_with(version);
    if !found.is_ok_and(|output| is_version(output.stdout)) {
        let mut install = command(metadata, "cargo", "install --locked --force --version");
        install.arg(version).arg("--root").arg(&folder).arg(name);
        if let Err(error) = succeed(&mut install) {
            return lacking(format!(
                "{name} {version} could not be installed: {error:#}"
            ));
        }
    }
    step(program.as_str())
}
