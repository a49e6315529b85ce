//! The page of an experiment in a real browser. Skipped by name where there is no Chromium or no Python
//! with playwright (in `SELVEDGE_PYTHON`, else `python3`); in CI that fails.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

const XTASK: &str = env!("CARGO_BIN_EXE_xtask");

/// What the test needs and the machine may not have.
fn browser_and_python() -> Result<(PathBuf, OsString), String> {
    let paths = std::env::var_os("PATH").unwrap_or_default();
    let chromium = std::env::split_paths(&paths)
        .flat_map(|folder| ["chromium", "chromium-browser"].map(|name| folder.join(name)))
        .find(|program| program.is_file())
        .ok_or("there is no chromium (Debian package chromium)")?;
    let python = std::env::var_os("SELVEDGE_PYTHON").unwrap_or_else(|| OsString::from("python3"));
    let needs = ["-c", "import numpy, PIL, playwright"];
    let has = Command::new(&python).args(needs).output();
    if !has.is_ok_and(|output| output.status.success()) {
        return Err(format!(
            "{} has no numpy, pillow and playwright",
            python.display()
        ));
    }
    Ok((chromium, python))
}

#[test]
fn the_report_works_in_a_browser() {
    let (chromium, python) = match browser_and_python() {
        Ok(found) => found,
        Err(reason) if std::env::var_os("CI").is_some_and(|ci| ci == "true") => panic!("{reason}"),
        Err(reason) => {
            eprintln!("the_report_works_in_a_browser: skipped, {reason}");
            return;
        }
    };
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(XTASK)
        .args(["experiments", "C4", "--ensemble", "0", "--quiet", "--out"])
        .arg(folder.path())
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let report = folder.path().join("report.html");
    // A quarter of the paper's table: all of it stays below 8 MB.
    assert!(report.metadata().unwrap().len() < 2_000_000);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/page.py");
    let output = Command::new(python)
        .arg(script)
        .arg(chromium)
        .arg(report)
        .output()
        .unwrap();
    let text = [output.stdout, output.stderr].concat();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&text)
    );
}
