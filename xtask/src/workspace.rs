//! Where the workspace is, and programs that run in it.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use cargo_metadata::{Metadata, MetadataCommand};

/// The folder that this program was built from.
pub(crate) fn root() -> Result<&'static Path> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    folder.parent().context("xtask has no parent")
}

/// The workspace around the current directory, without the packages it depends on.
pub(crate) fn load() -> Result<Metadata> {
    let metadata = MetadataCommand::new().no_deps().exec();
    metadata.context("cannot read the workspace")
}

/// The options that select every crate for a build that links; with `python` it would need the
/// interpreter's library.
pub(crate) fn all_crates(metadata: &Metadata) -> &'static str {
    let packages = metadata.workspace_packages();
    if packages
        .iter()
        .any(|package| package.name == "selvedge-python")
    {
        "--workspace --all-features --exclude selvedge-python"
    } else {
        "--workspace --all-features"
    }
}

/// `program` in the root of the workspace, with arguments that hold no spaces.
pub(crate) fn command(metadata: &Metadata, program: &str, arguments: &str) -> Command {
    let mut command = Command::new(program);
    command
        .current_dir(&metadata.workspace_root)
        .args(arguments.split_whitespace());
    command
}

/// Runs `command` to its end; an error when it does not start or does not succeed.
pub(crate) fn succeed(command: &mut Command) -> Result<()> {
    let program = command.get_program().display().to_string();
    let status = command
        .status()
        .with_context(|| format!("cannot start {program}"))?;
    ensure!(status.success(), "{program}: {status}");
    Ok(())
}
