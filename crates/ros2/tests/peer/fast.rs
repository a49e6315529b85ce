//! The peer on Fast DDS, `fast.cpp`, built where its packages are.

use std::path::{Path, PathBuf};
use std::process::{Command as Process, Stdio};
use std::sync::OnceLock;

use serde_json::Value;

use super::Domain;

/// The program, or why there is none.
fn built() -> Result<PathBuf, String> {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peer/fast.cpp");
    // Examples have no folder for what they make.
    let folder = option_env!("CARGO_TARGET_TMPDIR").map_or_else(std::env::temp_dir, PathBuf::from);
    let program = folder.join("fast-peer");
    let age = |path: &Path| path.metadata().and_then(|data| data.modified()).ok();
    if age(&program) > age(&source) {
        return Ok(program);
    }
    // Tests run as programs of their own: each builds its own and puts it there whole.
    let part = program.with_extension(std::process::id().to_string());
    let output = Process::new("g++")
        .args(["-std=c++17", "-O1", "-pthread", "-o"])
        .args([&part, &source])
        .args(["-lfastrtps", "-lfastcdr"])
        .output()
        .map_err(|error| format!("no g++: {error}"))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let error = said.lines().find(|line| line.contains("error"));
        return match error {
            Some(line) if line.contains("No such file") => {
                Err(format!("no libfastrtps-dev: {line}"))
            }
            // A peer that is wrong is not one that is missing.
            _ => panic!("{said}"),
        };
    }
    std::fs::rename(&part, &program).map_err(|error| error.to_string())?;
    Ok(program)
}

/// How the peer is started, or nothing when it cannot be.
pub(crate) fn process(
    test: &str,
    domain: &Domain,
    joints: &[f64],
    names: &[String],
    told: &Value,
) -> Option<Process> {
    static BUILT: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    let program = match BUILT.get_or_init(built) {
        Ok(program) => program,
        Err(reason) => {
            eprintln!("{test}: skipped, {reason}");
            return None;
        }
    };
    let mut process = Process::new(program);
    let joints: Vec<String> = joints.iter().map(f64::to_string).collect();
    process.arg(format!("domain={}", domain.id));
    process.arg(format!("joints={}", joints.join(",")));
    process.arg(format!("names={}", names.join(",")));
    for (key, value) in told.as_object().unwrap() {
        let text = value.as_str().map_or(value.to_string(), str::to_owned);
        process.arg(format!("{key}={text}"));
    }
    process.stdin(Stdio::piped()).stdout(Stdio::piped());
    Some(process)
}
