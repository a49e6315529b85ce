//! The table: one row a case.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;

use comfy_table::{CellAlignment, Table, presets};
use selvedge_grasp::Shape;
use serde::Deserialize;

use crate::{Case, Error, Scenario, Timing};

/// One row: what a case grasped and how far its end is from the ideal fold.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// The case.
    pub case: String,
    /// The grasping volume of each gripper.
    pub volumes: Vec<Shape>,
    /// How far each gripper turns on its way [rad].
    pub rotations: Vec<f64>,
    /// The published error, if there is one.
    pub published: Option<f64>,
    /// The case whose end is the ideal fold; none for the analytic half fold.
    pub reference: Option<String>,
    /// What came out, or why nothing did.
    pub outcome: Result<Measured, String>,
}

/// The numbers of a finished case; lengths in metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// The nodes held, all grippers together, ascending.
    pub support: Vec<u32>,
    /// Folding error at the end against the end of the reference case; none if that failed.
    pub error: Option<f64>,
    /// Folding error at the end against the analytic half fold.
    pub half_fold_error: f64,
    /// Largest edge strain and largest root mean square edge strain, see [`crate::Run`].
    pub strain: [f64; 2],
    /// Lowest and highest node over the run.
    pub height: [f64; 2],
    /// Largest distance between a held node and its target.
    pub held_error: f64,
    /// Nodes that a gripper closed on while another one held them, ascending.
    pub refused: Vec<u32>,
    /// Steps in which a solve ended at its iteration limit.
    pub unconverged_steps: usize,
    /// Whether held nodes were commanded further apart than the cloth is long.
    pub overstretched: bool,
}

/// Published errors by case.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expected {
    /// Where the numbers are from.
    pub source: String,
    /// The errors.
    pub error: BTreeMap<String, f64>,
}

impl Expected {
    /// The errors published for the scenario in the file `path`: `../expected/NAME.toml` seen from
    /// `NAME.toml`, or none if there is no such file.
    ///
    /// # Errors
    /// [`Error::File`], [`Error::Syntax`] or [`Error::Value`] when the file is there and cannot be
    /// used.
    pub fn beside(scenario: &Scenario, path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let (Some(folder), Some(name)) = (path.parent(), path.file_name()) else {
            return Ok(Self::default());
        };
        let path = folder.join("../expected").join(name);
        let text = match std::fs::read_to_string(&path) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Ok(Self::default());
            }
            Err(reason) => return Err(Error::File { path, reason }),
        };
        let file = path.display().to_string();
        let expected: Self = toml::from_str(&text).map_err(|error| Error::Syntax {
            file: file.clone(),
            message: error.to_string(),
        })?;
        for (case, &error) in &expected.error {
            let refuse = |value: String, bound: &str| Error::Value {
                file: file.clone(),
                key: format!("error.{case}"),
                value,
                bound: bound.to_owned(),
            };
            if scenario.case(case).is_none() {
                return Err(refuse(
                    error.to_string(),
                    "the error of a case of the scenario",
                ));
            }
            if !(error >= 0.0 && error.is_finite()) {
                return Err(refuse(error.to_string(), "at least 0 and finite"));
            }
        }
        Ok(expected)
    }
}

impl Row {
    pub(crate) fn new(case: &Case, expected: &Expected, outcome: Result<Measured, String>) -> Self {
        Self {
            case: case.name.clone(),
            volumes: case
                .grippers
                .iter()
                .map(|plan| plan.gripper.volume().shape())
                .collect(),
            rotations: case.grippers.iter().map(|plan| plan.rotation).collect(),
            reference: case.reference.clone(),
            published: expected.error.get(&case.name).copied(),
            outcome,
        }
    }

    /// Why the row has no error: the case failed, or its reference did.
    pub fn failure(&self) -> Option<String> {
        match &self.outcome {
            Err(reason) => Some(reason.clone()),
            Ok(Measured { error: None, .. }) => {
                let name = self.reference.as_deref().unwrap_or_default();
                Some(format!("its reference {name} failed"))
            }
            Ok(_) => None,
        }
    }

    /// Our error minus the published one.
    pub fn difference(&self) -> Option<f64> {
        Some(self.outcome.as_ref().ok()?.error? - self.published?)
    }

    fn volume(&self) -> String {
        let name = |shape: &Shape| match shape {
            Shape::Box { .. } => "box",
            Shape::Pyramid { .. } => "pyramid",
        };
        self.volumes
            .iter()
            .map(name)
            .collect::<Vec<_>>()
            .join(" + ")
    }

    fn orientation(&self) -> String {
        let name = |&angle: &f64| match angle.abs() < 1e-9 {
            true => "kept".to_owned(),
            false => format!("turns {:.0} deg", angle.to_degrees()),
        };
        self.rotations
            .iter()
            .map(name)
            .collect::<Vec<_>>()
            .join(" + ")
    }
}

/// The rows as CSV, numbers to the last digit; the same bytes for the same run.
pub(crate) fn write_csv(rows: &[Row], writer: impl Write) -> Result<(), csv::Error> {
    let mut csv = csv::Writer::from_writer(writer);
    csv.write_record([
        "case",
        "support",
        "volume",
        "orientation",
        "published_error",
        "error",
        "difference",
        "half_fold_error",
        "strain_max",
        "strain_rms",
        "z_min_m",
        "z_max_m",
        "held_error_m",
        "refused",
        "unconverged_steps",
        "overstretched",
        "failure",
    ])?;
    let number = |value: Option<f64>| value.map(|v| v.to_string()).unwrap_or_default();
    for row in rows {
        let measured = row.outcome.as_ref().ok();
        let field = |f: &dyn Fn(&Measured) -> String| measured.map(f).unwrap_or_default();
        csv.write_record([
            row.case.clone(),
            field(&|m| node_text(&m.support)),
            row.volume(),
            row.orientation(),
            number(row.published),
            number(measured.and_then(|m| m.error)),
            number(row.difference()),
            field(&|m| m.half_fold_error.to_string()),
            field(&|m| m.strain[0].to_string()),
            field(&|m| m.strain[1].to_string()),
            field(&|m| m.height[0].to_string()),
            field(&|m| m.height[1].to_string()),
            field(&|m| m.held_error.to_string()),
            field(&|m| node_text(&m.refused)),
            field(&|m| m.unconverged_steps.to_string()),
            field(&|m| m.overstretched.to_string()),
            row.failure().unwrap_or_default(),
        ])?;
    }
    csv.flush()?;
    Ok(())
}

/// The times as CSV.
pub(crate) fn write_timings(
    rows: &[(Row, Option<Timing>)],
    writer: impl Write,
) -> Result<(), csv::Error> {
    let mut csv = csv::Writer::from_writer(writer);
    csv.write_record([
        "case",
        "gripper_step_ns",
        "selection_us",
        "solver_step_ms",
        "solver_substep_ms",
        "real_time_factor",
    ])?;
    for (row, timing) in rows {
        let Some(timing) = timing else { continue };
        csv.write_record([
            row.case.clone(),
            timing.gripper_step.as_nanos().to_string(),
            format!("{:.2}", timing.selection.as_secs_f64() * 1e6),
            format!("{:.4}", timing.solver_step.as_secs_f64() * 1e3),
            format!("{:.4}", timing.solver_substep.as_secs_f64() * 1e3),
            format!("{:.2}", timing.real_time_factor),
        ])?;
    }
    csv.flush()?;
    Ok(())
}

/// The rows as a Markdown table, without times.
pub(crate) fn markdown(rows: &[Row]) -> String {
    let mut table = start(false);
    for row in rows {
        table.add_row(cells(row));
    }
    format!("{table}\n")
}

/// The rows for a terminal, with the cost of gripper and cloth.
pub fn terminal(rows: &[(Row, Option<Timing>)]) -> String {
    let mut table = start(true);
    for (row, timing) in rows {
        let mut cells = cells(row);
        match timing {
            Some(timing) => cells.extend([
                format!("{} ns", timing.gripper_step.as_nanos()),
                format!("{:.2} ms", timing.solver_step.as_secs_f64() * 1e3),
                format!("{:.1}", timing.real_time_factor),
            ]),
            None => cells.extend([String::new(), String::new(), String::new()]),
        }
        table.add_row(cells);
    }
    table.to_string()
}

fn start(times: bool) -> Table {
    let mut table = Table::new();
    table.load_style(presets::ASCII_MARKDOWN);
    let mut header = vec![
        "Case",
        "Support",
        "Volume",
        "Orientation",
        "Paper",
        "Ours",
        "Difference",
        "Half fold",
        "Strain",
    ];
    if times {
        header.extend(["Gripper/step", "Cloth/step", "x real time"]);
    }
    let columns = header.len();
    table.set_header(header);
    for index in 4..columns {
        if let Some(column) = table.column_mut(index) {
            column.set_cell_alignment(CellAlignment::Right);
        }
    }
    table
}

fn cells(row: &Row) -> Vec<String> {
    let error = |value: Option<f64>| value.map(|v| format!("{v:.8}")).unwrap_or("-".to_owned());
    let mut cells = vec![row.case.clone()];
    match &row.outcome {
        Ok(measured) => {
            let number = measured.support.len();
            let plural = if number == 1 { "node" } else { "nodes" };
            cells.push(format!(
                "{number} {plural}: {}",
                node_list(&measured.support)
            ));
            cells.extend([row.volume(), row.orientation()]);
            cells.extend([error(row.published), error(measured.error)]);
            cells.push(
                row.difference()
                    .map(|d| format!("{d:+.1e}"))
                    .unwrap_or("-".to_owned()),
            );
            cells.push(format!("{:.4}", measured.half_fold_error));
            cells.push(format!("{:.2} %", measured.strain[0] * 100.0));
        }
        Err(reason) => {
            cells.push(reason.clone());
            cells.extend([row.volume(), row.orientation(), error(row.published)]);
            cells.extend(["-", "-", "-", "-"].map(str::to_owned));
        }
    }
    cells
}

fn node_text(nodes: &[u32]) -> String {
    nodes
        .iter()
        .map(u32::to_string)
        .collect::<Vec<_>>()
        .join(" ")
}

/// Nodes for a cell: all of a few, the first of many.
fn node_list(nodes: &[u32]) -> String {
    const SHOWN: usize = 8;
    let shown: Vec<String> = nodes.iter().take(SHOWN).map(u32::to_string).collect();
    let more = if nodes.len() > SHOWN { " ..." } else { "" };
    format!("{}{more}", shown.join(" "))
}
