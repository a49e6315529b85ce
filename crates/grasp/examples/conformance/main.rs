//! Answers a file of grasp cases: which nodes are held in each step, and where they must be.
//!
//! ```text
//! cargo run --release -p selvedge-grasp --example conformance -- CASES.json[.gz] ANSWERS.json
//! ```
//!
//! `fixtures/grasp/README.md` describes the cases. The answers are
//! `{"cases": [{"id", "steps": [{"indices", "local", "world"}]}]}`, in metres. Bad input is named by
//! file, case and field, and the exit status is then 2.

use std::process::ExitCode;

use serde_json::{Value, json};

mod replay;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output] = &arguments[..] else {
        eprintln!("usage: conformance CASES.json[.gz] ANSWERS.json");
        return ExitCode::from(2);
    };
    match answer(input, output) {
        Ok(count) => {
            println!("{count} cases answered in {output}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(2)
        }
    }
}

fn answer(input: &str, output: &str) -> Result<usize, String> {
    let in_file = |error| format!("{input}: {error}");
    let bytes = std::fs::read(input).map_err(|error| in_file(error.to_string()))?;
    let cases = replay::read(&bytes).map_err(in_file)?;
    let mut answers = Vec::new();
    for case in &cases {
        answers.push(answer_case(case).map_err(in_file)?);
    }
    let text = json!({ "cases": answers }).to_string();
    std::fs::write(output, text).map_err(|error| format!("{output}: {error}"))?;
    Ok(cases.len())
}

fn answer_case(case: &replay::Case) -> Result<Value, String> {
    let mut steps = Vec::new();
    case.replay(|_, gripper| {
        let rows = |points: &[selvedge_grasp::DVec3]| -> Vec<[f64; 3]> {
            points.iter().map(|p| p.to_array()).collect()
        };
        steps.push(json!({
            "indices": gripper.nodes(),
            "local": rows(gripper.local()),
            "world": rows(gripper.held().targets),
        }));
        Ok(())
    })?;
    Ok(json!({ "id": case.id, "steps": steps }))
}
