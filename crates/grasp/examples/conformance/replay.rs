//! Reads grasp cases and replays them; shared by the example and the test of the same name.

use std::io::Read;

use selvedge_grasp::{
    ClothView, Command, DQuat, DVec3, GraspVolume, Gripper, Jaw, Options, Pose, Shape, Squeeze,
};
use serde_json::Value;

/// One gripper, one cloth and what the gripper is told.
pub(crate) struct Case {
    pub(crate) id: String,
    gripper: Gripper,
    positions: Vec<DVec3>,
    edges: Vec<[u32; 2]>,
    quads: Vec<[u32; 4]>,
    triangles: Vec<[u32; 3]>,
    steps: Vec<Step>,
}

struct Step {
    command: Command,
    alpha: f64,
    /// Replaces the positions from this step on.
    positions: Option<Vec<DVec3>>,
    expected: Option<Value>,
}

impl Case {
    /// Takes all steps; `observe` is given what the case expects and the gripper after each.
    pub(crate) fn replay(
        &self,
        mut observe: impl FnMut(Option<&Value>, &Gripper) -> Result<(), String>,
    ) -> Result<(), String> {
        let mut gripper = self.gripper.clone();
        let mut positions = &self.positions;
        for (k, step) in self.steps.iter().enumerate() {
            positions = step.positions.as_ref().unwrap_or(positions);
            let cloth = ClothView {
                positions,
                edges: &self.edges,
                quads: &self.quads,
                triangles: &self.triangles,
            };
            let options = Options {
                alpha: Some(step.alpha),
                ..Options::default()
            };
            let in_step = |error: String| format!("case {}: steps[{k}]: {error}", self.id);
            gripper
                .step_with(step.command, 1.0 / 60.0, cloth, options)
                .map_err(|error| in_step(error.to_string()))?;
            observe(step.expected.as_ref(), &gripper).map_err(in_step)?;
        }
        Ok(())
    }
}

/// Reads cases from JSON, which may be compressed with gzip.
pub(crate) fn read(bytes: &[u8]) -> Result<Vec<Case>, String> {
    let mut text = Vec::new();
    let bytes = if bytes.starts_with(&[0x1f, 0x8b]) {
        flate2::read::GzDecoder::new(bytes)
            .read_to_end(&mut text)
            .map_err(|error| format!("not gzip: {error}"))?;
        &text[..]
    } else {
        bytes
    };
    let file: Value =
        serde_json::from_slice(bytes).map_err(|error| format!("not JSON: {error}"))?;
    let schema = member(&file, "schema")?;
    if schema != "grasp-cases/1" {
        return Err(format!("schema {schema} must be \"grasp-cases/1\""));
    }
    let mut cases = Vec::new();
    for (number, case) in list(&file, "cases")?.iter().enumerate() {
        let id = member(case, "id")?.as_str();
        let id = id.ok_or_else(|| format!("cases[{number}]: id must be a string"))?;
        cases.push(read_case(id, case).map_err(|error| format!("case {id}: {error}"))?);
    }
    Ok(cases)
}

fn read_case(id: &str, case: &Value) -> Result<Case, String> {
    let volume = member(case, "volume")?;
    let in_volume = |error| format!("volume: {error}");
    let squeeze = Squeeze {
        amount: number(case, "sigma")?,
        lift: number(case, "epsilon")?,
        steps: 1, // alpha is given in each step
    };
    let mesh = member(case, "mesh")?;
    let in_mesh = |error| format!("mesh: {error}");
    let mut steps = Vec::new();
    for (k, step) in list(case, "steps")?.iter().enumerate() {
        steps.push(read_step(step).map_err(|error| format!("steps[{k}]: {error}"))?);
    }
    Ok(Case {
        id: id.to_owned(),
        gripper: Gripper::new(read_volume(volume).map_err(in_volume)?, squeeze)
            .map_err(|error| error.to_string())?,
        positions: points(mesh, "positions").map_err(in_mesh)?,
        edges: elements(mesh, "edges").map_err(in_mesh)?,
        quads: elements(mesh, "quads").map_err(in_mesh)?,
        triangles: elements(mesh, "triangles").map_err(in_mesh)?,
        steps,
    })
}

fn read_volume(volume: &Value) -> Result<GraspVolume, String> {
    let shape = match member(volume, "type")?.as_str() {
        Some("box") => Shape::Box {
            size: DVec3::from_array(numbers(volume, "size")?),
        },
        Some("pyramid") => Shape::Pyramid {
            side: number(volume, "side")?,
            height: number(volume, "height")?,
        },
        _ => return Err("type must be \"box\" or \"pyramid\"".to_owned()),
    };
    let offset = DVec3::from_array(numbers(volume, "center")?);
    GraspVolume::new(shape, offset).map_err(|error| error.to_string())
}

fn read_step(step: &Value) -> Result<Step, String> {
    let pose = member(step, "pose")?;
    let in_pose = |error| format!("pose: {error}");
    let p = numbers(pose, "p").map_err(in_pose)?;
    let q = numbers(pose, "q_xyzw").map_err(in_pose)?;
    let pose = Pose::new(DVec3::from_array(p), DQuat::from_array(q))
        .map_err(|error| in_pose(error.to_string()))?;
    let jaw = match member(step, "jaw")?.as_u64() {
        Some(0) => Jaw::Open,
        Some(1) => Jaw::Closed,
        _ => return Err("jaw must be 0 or 1".to_owned()),
    };
    let positions = match step.get("positions") {
        Some(_) => Some(points(step, "positions")?),
        None => None,
    };
    Ok(Step {
        command: Command { pose, jaw },
        alpha: number(step, "alpha")?,
        positions,
        expected: step.get("expected").cloned(),
    })
}

fn member<'a>(value: &'a Value, field: &str) -> Result<&'a Value, String> {
    let found = value.get(field);
    found.ok_or_else(|| format!("field {field} is missing"))
}

pub(crate) fn list<'a>(value: &'a Value, field: &str) -> Result<&'a Vec<Value>, String> {
    let found = member(value, field)?.as_array();
    found.ok_or_else(|| format!("{field} must be a list"))
}

fn number(value: &Value, field: &str) -> Result<f64, String> {
    let found = member(value, field)?.as_f64();
    found.ok_or_else(|| format!("{field} must be a number"))
}

fn numbers<const N: usize>(value: &Value, field: &str) -> Result<[f64; N], String> {
    row(member(value, field)?, Value::as_f64)
        .ok_or_else(|| format!("{field} must be a list of {N} numbers"))
}

pub(crate) fn points(value: &Value, field: &str) -> Result<Vec<DVec3>, String> {
    let mut points = Vec::new();
    for (k, point) in list(value, field)?.iter().enumerate() {
        let point = row(point, Value::as_f64);
        let point = point.ok_or_else(|| format!("{field}[{k}] must be a list of 3 numbers"))?;
        points.push(DVec3::from_array(point));
    }
    Ok(points)
}

/// Node indices; none when the field is missing.
fn elements<const N: usize>(value: &Value, field: &str) -> Result<Vec<[u32; N]>, String> {
    let mut elements = Vec::new();
    if value.get(field).is_some() {
        let index = |value: &Value| value.as_u64().and_then(|node| node.try_into().ok());
        for (k, element) in list(value, field)?.iter().enumerate() {
            let element = row(element, index);
            elements.push(
                element.ok_or_else(|| format!("{field}[{k}] must be a list of {N} indices"))?,
            );
        }
    }
    Ok(elements)
}

fn row<T, const N: usize>(value: &Value, entry: impl Fn(&Value) -> Option<T>) -> Option<[T; N]> {
    let entries: Option<Vec<T>> = value.as_array()?.iter().map(entry).collect();
    entries?.try_into().ok()
}
