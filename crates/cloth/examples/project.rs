//! Projections onto the constraints for other programs to check.
//!
//! `cargo run --release -p selvedge-cloth --example project -- IN.json OUT.json` reads
//! `{"cases": [{"id", "grid": [na, nb], "sides": [a, b], "predicted": [[x, y, z]...],
//! "node_mass_area": [m...], "grasp": {"indices", "targets"}, "shear_compliance": c,
//! "table_z": z}]}`, the last three of them optional, and writes `{"cases": [{"id", "positions"}]}`.
//! `id` is a string or a number. `start` and `velocities` are checked, and not needed: the answer
//! depends on where the nodes were predicted only. Other keys are ignored. A case that has no answer gets
//! `error`, why, instead of `positions`, and the exit status is 2.

use std::process::ExitCode;

use selvedge_cloth::{Mesh, Projected, Projection, project};
use selvedge_math::DVec3;
use serde_json::{Value, json};

type Error = Box<dyn std::error::Error>;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [input, output] = arguments.as_slice() else {
        eprintln!("usage: project IN.json OUT.json");
        return ExitCode::from(2);
    };
    match answer(input, output) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {input}: {error}");
            ExitCode::from(2)
        }
    }
}

fn answer(input: &str, output: &str) -> Result<(), Error> {
    let request: Value = serde_json::from_str(&quote_nan(&std::fs::read_to_string(input)?))?;
    let cases = request["cases"].as_array().ok_or("cases must be a list")?;
    let mut answers = Vec::with_capacity(cases.len());
    let (mut miss, mut imbalance, mut failures) = (0.0, 0.0, 0);
    for (k, case) in cases.iter().enumerate() {
        let id = &case["id"];
        if !(id.is_string() || id.is_number()) {
            return Err(format!("case {k}: id is {id}, must be a string or a number").into());
        }
        let projected = match one(case) {
            Ok(projected) => projected,
            Err(error) => {
                eprintln!("case {id}: {error}");
                answers.push(json!({ "id": id, "error": error.to_string() }));
                failures += 1;
                continue;
            }
        };
        miss = projected.miss.max(miss);
        imbalance = projected.imbalance.max(imbalance);
        let positions: Vec<_> = projected.positions.iter().map(DVec3::to_array).collect();
        answers.push(json!({ "id": id, "positions": positions }));
    }
    std::fs::write(output, json!({ "cases": answers }).to_string())?;
    println!("{} cases in {output}", answers.len());
    println!(
        "largest distance from a constraint {miss:.1e} m, imbalance of a node {imbalance:.1e} m"
    );
    if failures > 0 {
        return Err(format!("{failures} cases have no answer, see above").into());
    }
    if miss > Projected::TOLERANCE || imbalance > Projected::TOLERANCE {
        return Err(format!("residuals must be at most {:e} m", Projected::TOLERANCE).into());
    }
    Ok(())
}

fn one(case: &Value) -> Result<Projected, Error> {
    let grid = list(&case["grid"], "grid", 2, Value::as_u64)?;
    let sides = list(&case["sides"], "sides", 2, Value::as_f64)?;
    let mesh = Mesh::grid([grid[0] as usize, grid[1] as usize], [sides[0], sides[1]])?;
    let n = mesh.node_count();
    for key in ["start", "velocities"] {
        if let Some(value) = given(case, key) {
            points(value, key, n)?;
        }
    }
    let predicted = points(&case["predicted"], "predicted", n)?;
    let masses = list(&case["node_mass_area"], "node_mass_area", n, Value::as_f64)?;
    let mut grasp = Vec::new();
    if let Some(value) = given(case, "grasp") {
        let indices = &value["indices"];
        let count = indices.as_array().map_or(0, Vec::len);
        let indices = list(indices, "grasp indices", count, Value::as_u64)?;
        let targets = points(&value["targets"], "grasp targets", count)?;
        for (index, target) in indices.into_iter().zip(targets) {
            grasp.push((u32::try_from(index)?, target));
        }
    }
    let projected = project(&Projection {
        mesh: &mesh,
        masses: &masses,
        predicted: &predicted,
        grasp: &grasp,
        shear_compliance: optional(case, "shear_compliance")?,
        table: optional(case, "table_z")?,
    })?;
    Ok(projected)
}

/// Python writes numbers that JSON has not, which would end the reading without the name of the
/// case; as strings they are refused where they are used.
fn quote_nan(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for (k, part) in text.split('"').enumerate() {
        // Every other part is inside of quotes; an escaped quote there only leaves numbers as they are.
        if k > 0 {
            out.push('"');
        }
        if k % 2 == 0 {
            let quoted = part.replace("NaN", "\"NaN\"");
            out += &quoted
                .replace("-Infinity", "\"-inf\"")
                .replace("Infinity", "\"inf\"");
        } else {
            out += part;
        }
    }
    out
}

/// A key that is there and not null.
fn given<'a>(case: &'a Value, key: &str) -> Option<&'a Value> {
    case.get(key).filter(|value| !value.is_null())
}

fn optional(case: &Value, key: &str) -> Result<Option<f64>, String> {
    let number = |value: &Value| {
        let number = value.as_f64();
        number.ok_or_else(|| format!("{key} is {value}, must be a number or null"))
    };
    given(case, key).map(number).transpose()
}

fn points(value: &Value, key: &str, count: usize) -> Result<Vec<DVec3>, String> {
    let rows = list(value, key, count, Value::as_array)?;
    let mut points = Vec::with_capacity(count);
    for (k, row) in rows.into_iter().enumerate() {
        let [x, y, z] = [0, 1, 2].map(|axis| row.get(axis).and_then(Value::as_f64));
        match (x, y, z, row.len()) {
            (Some(x), Some(y), Some(z), 3) => points.push(DVec3::new(x, y, z)),
            _ => {
                return Err(format!(
                    "{key}[{k}] is {}, must be 3 finite numbers",
                    json!(row)
                ));
            }
        }
    }
    Ok(points)
}

/// The entries of a list of known length.
fn list<'a, T>(
    value: &'a Value,
    key: &str,
    count: usize,
    entry: fn(&'a Value) -> Option<T>,
) -> Result<Vec<T>, String> {
    let values = value
        .as_array()
        .ok_or_else(|| format!("{key} is missing or no list"))?;
    if values.len() != count {
        return Err(format!(
            "{key} has {} entries, must have {count}",
            values.len()
        ));
    }
    let entries = values.iter().enumerate();
    entries
        .map(|(k, value)| {
            let refused = || format!("{key}[{k}] is {value}, which is of the wrong kind");
            entry(value).ok_or_else(refused)
        })
        .collect()
}
