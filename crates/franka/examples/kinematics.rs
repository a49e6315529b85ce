//! Forward and inverse kinematics for other programs to check.
//!
//! `cargo run --release -p selvedge-franka --example kinematics -- IN.json OUT.json` reads
//! `{"robot": "fr3" | "fer", "queries": [{"q": [7]} | {"position": [3], "quaternion_xyzw": [4],
//! "q7": x}]}` and writes `{"results": [...]}`: for a configuration the pose of `*_hand_tcp` in
//! `*_link0` and the 6 x 7 Jacobian, linear rows first; for a pose all solutions.

use std::error::Error;
use std::process::ExitCode;

use selvedge_franka::Arm;
use selvedge_math::{DQuat, DVec3, Pose};
use serde_json::{Value, json};

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output] = arguments.as_slice() else {
        eprintln!("usage: kinematics IN.json OUT.json");
        return ExitCode::from(2);
    };
    match answer(input, output) {
        Ok(count) => {
            println!("{count} queries answered in {output}");
            ExitCode::SUCCESS
        }
        Err(error) => {
            eprintln!("error: {input}: {error}");
            ExitCode::from(2)
        }
    }
}

fn answer(input: &str, output: &str) -> Result<usize, Box<dyn Error>> {
    let request: Value = serde_json::from_str(&std::fs::read_to_string(input)?)?;
    let arm = match request["robot"].as_str() {
        Some("fr3") => Arm::fr3(),
        Some("fer") => Arm::fer(),
        _ => return Err(format!("robot is {}, must be fr3 or fer", request["robot"]).into()),
    };
    let queries = request["queries"]
        .as_array()
        .ok_or("queries must be a list")?;
    let mut results = Vec::with_capacity(queries.len());
    for (k, query) in queries.iter().enumerate() {
        let result = one(&arm, query).map_err(|error| format!("query {k}: {error}"))?;
        results.push(result);
    }
    std::fs::write(output, json!({ "results": results }).to_string())?;
    Ok(results.len())
}

fn one(arm: &Arm, query: &Value) -> Result<Value, Box<dyn Error>> {
    if query.get("q").is_some() {
        let q: [f64; 7] = numbers(query, "q")?;
        let mut columns = [[0.0; 6]; 7];
        let pose = arm.jacobian(&q, &mut columns);
        let rows: Vec<Vec<f64>> = (0..6)
            .map(|r| columns.iter().map(|column| column[r]).collect())
            .collect();
        return Ok(json!({
            "position": pose.position().to_array(),
            "quaternion_xyzw": pose.rotation().to_array(),
            "jacobian": rows,
        }));
    }
    let position = DVec3::from_array(numbers(query, "position")?);
    let rotation = DQuat::from_array(numbers(query, "quaternion_xyzw")?);
    let q7 = query["q7"].as_f64().ok_or("q7 must be a number")?;
    let solutions = arm.inverse(&Pose::new(position, rotation)?, q7, 0.0)?;
    let list: Vec<Value> = solutions
        .as_slice()
        .iter()
        .map(|solution| json!({ "q": solution.q, "in_limits": solution.in_limits }))
        .collect();
    Ok(json!({ "solutions": list }))
}

fn numbers<const N: usize>(query: &Value, key: &str) -> Result<[f64; N], String> {
    let list = query[key].as_array().filter(|list| list.len() == N);
    let list = list.ok_or_else(|| format!("{key} must be a list of {N} numbers"))?;
    let mut out = [0.0; N];
    for (out, value) in out.iter_mut().zip(list) {
        *out = value
            .as_f64()
            .ok_or_else(|| format!("{key} has {value}, must be a number"))?;
    }
    Ok(out)
}
