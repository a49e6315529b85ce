//! Every test of the project: unit tests, integration tests, doctests and the examples, which check
//! their own results. Tests against Python programs get an environment under the target folder.

use std::fs;
use std::io::BufReader;
use std::process::{ExitCode, Stdio};

use anyhow::{Context, Result, ensure};
use cargo_metadata::camino::Utf8PathBuf;
use cargo_metadata::{Message, Metadata};

use crate::report::{Outcome, Report, lacking};
use crate::workspace::{self, all_crates, command, succeed};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Make no Python environment; its tests run only where python3 has the packages.
    #[arg(long)]
    no_python: bool,
}

/// Examples that are run with arguments, in the root of the workspace; what they write goes into the
/// target folder, `{target}`, and is checked by the tests of the code they call.
const ARGUMENTS: &[(&str, &str)] = &[
    (
        "conformance",
        "fixtures/grasp/cases.json.gz {target}/conformance.json",
    ),
    (
        "kinematics",
        "fixtures/tests/kinematics.json {target}/kinematics.json",
    ),
    (
        "project",
        "fixtures/tests/project.json {target}/project.json",
    ),
];

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode> {
    let metadata = workspace::load()?;
    let mut report = Report::default();
    steps(&metadata, !arguments.no_python, &mut report);
    Ok(report.finish())
}

pub(crate) fn steps(metadata: &Metadata, with_python: bool, report: &mut Report) {
    let mut python = None;
    report.step("Python for the numpy tests", || {
        if !with_python {
            return Ok(Outcome::Skipped("--no-python".into()));
        }
        match python_environment(metadata) {
            Ok(path) => python = Some(path),
            Err(error) => return lacking(format!("{error:#}")),
        }
        Ok(Outcome::Passed)
    });

    report.step("tests and doctests", || {
        let mut test = command(metadata, "cargo", "test --no-fail-fast");
        test.args(all_crates(metadata).split_whitespace());
        if let Some(python) = &python {
            test.env("SELVEDGE_PYTHON", python);
        }
        succeed(&mut test)?;
        Ok(Outcome::Passed)
    });

    report.step("tests of a secured network", || {
        let openssl = succeed(&mut command(metadata, "pkg-config", "--exists openssl"));
        if openssl.is_err() {
            return lacking("OpenSSL has no headers here (libssl-dev, pkg-config)");
        }
        let test = "test -p selvedge-ros2 --features security --test security --lib";
        succeed(&mut command(metadata, "cargo", test))?;
        Ok(Outcome::Passed)
    });

    python_package(metadata, python.as_ref(), report);

    let mut examples = Vec::new();
    report.step("examples built", || {
        examples = build_examples(metadata)?;
        Ok(Outcome::Passed)
    });
    for (name, program) in examples {
        report.step(&format!("example {name}"), || {
            let arguments = ARGUMENTS.iter().find(|(example, _)| *example == name);
            let arguments = arguments.map_or("", |(_, arguments)| arguments);
            let mut example = command(metadata, program.as_str(), "");
            if let Some(python) = &python {
                example.env("SELVEDGE_PYTHON", python);
            }
            let target = metadata.target_directory.as_str();
            for argument in arguments.split_whitespace() {
                example.arg(argument.replace("{target}", target));
            }
            succeed(&mut example)?;
            Ok(Outcome::Passed)
        });
    }
}

/// The Python package, installed into the environment, its tests, types and example.
fn python_package(metadata: &Metadata, python: Option<&Utf8PathBuf>, report: &mut Report) {
    let folder = metadata.workspace_root.join("crates/python");
    let mut installed = false;
    report.step("Python package", || {
        let Some(python) = python else {
            return lacking("no Python environment");
        };
        install_package(metadata, python)?;
        installed = true;
        Ok(Outcome::Passed)
    });
    for (name, arguments) in [
        ("Python tests", "-m pytest -q -ra -p no:cacheprovider"),
        ("Python types", "-m mypy --cache-dir /dev/null"),
        ("Python example plan_fold", "examples/plan_fold.py"),
    ] {
        report.step(name, || {
            let Some(python) = python.filter(|_| installed) else {
                return lacking("the Python package is not installed");
            };
            let mut run = command(metadata, python.as_str(), arguments);
            succeed(run.current_dir(&folder))?;
            Ok(Outcome::Passed)
        });
    }
}

/// Builds the Python package and puts it into an environment.
pub(crate) fn install_package(metadata: &Metadata, python: &Utf8PathBuf) -> Result<()> {
    let arguments = "-m pip install --quiet --no-deps --no-build-isolation --force-reinstall";
    let mut install = command(metadata, python.as_str(), arguments);
    // The build finds maturin beside the interpreter.
    let tools = python.parent().context("Python has no folder")?;
    let path = std::env::var("PATH").unwrap_or_default();
    install.env("PATH", format!("{tools}:{path}"));
    install.env("CARGO_TARGET_DIR", &metadata.target_directory);
    succeed(install.arg("./crates/python")).context("the Python package could not be built")
}

/// Names and programs of all examples.
fn build_examples(metadata: &Metadata) -> Result<Vec<(String, Utf8PathBuf)>> {
    let mut build = command(
        metadata,
        "cargo",
        "build --examples --message-format=json-render-diagnostics",
    );
    build.args(all_crates(metadata).split_whitespace());
    let mut build = build.stdout(Stdio::piped()).spawn()?;
    let output = build.stdout.take().context("cargo has no output")?;
    let mut examples = Vec::new();
    for message in Message::parse_stream(BufReader::new(output)) {
        if let Message::CompilerArtifact(artifact) = message?
            && artifact.target.is_example()
        {
            let name = artifact.target.name;
            let program = artifact.executable;
            let program = program.with_context(|| format!("example {name} is no program"))?;
            examples.push((name, program));
        }
    }
    let status = build.wait()?;
    ensure!(status.success(), "cargo: {status}");
    examples.sort();
    Ok(examples)
}

/// The Python of an environment that holds what `python-requirements.txt` asks for. It is made anew
/// when that file has changed or its Python has gone.
pub(crate) fn python_environment(metadata: &Metadata) -> Result<Utf8PathBuf> {
    let requirements = metadata
        .workspace_root
        .join("xtask/python-requirements.txt");
    let environment = metadata.target_directory.join("python");
    let python = environment.join("bin/python");
    let stamp = environment.join("requirements.txt");
    let wanted = fs::read(&requirements).with_context(|| format!("cannot read {requirements}"))?;
    let current = fs::read(&stamp).is_ok_and(|installed| installed == wanted);
    if !current || succeed(&mut command(metadata, python.as_str(), "--version")).is_err() {
        let mut make = command(metadata, "python3", "-m venv --clear");
        succeed(make.arg(&environment)).context("no virtual environment")?;
        let mut install = command(metadata, python.as_str(), "-m pip install --quiet");
        install.arg("--requirement").arg(&requirements);
        succeed(&mut install).context("packages not installed")?;
        // Last, so that an environment made in part is made again.
        fs::write(&stamp, wanted)?;
    }
    Ok(python)
}
