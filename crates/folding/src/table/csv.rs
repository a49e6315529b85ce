//! The table for programs.

use std::io::Write;

use csv::{Error, Writer};

use super::{Measured, Row, node_text};
use crate::Timing;

const COLUMNS: [&str; 25] = [
    "case",
    "solver",
    "support",
    "volume",
    "orientation",
    "published_error",
    "error",
    "difference",
    "ensemble",
    "e_median",
    "e_min",
    "e_max",
    "ensemble_failures",
    "half_fold_error",
    "strain_max",
    "strain_rms",
    "shear_max",
    "gap_min_m",
    "z_min_m",
    "z_max_m",
    "held_error_m",
    "refused",
    "unconverged_steps",
    "overstretched",
    "failure",
];

/// The rows as CSV, numbers to the last digit; the same bytes for the same run.
pub(crate) fn write_csv(rows: &[Row], writer: impl Write) -> Result<(), Error> {
    let mut csv = Writer::from_writer(writer);
    csv.write_record(COLUMNS)?;
    let number = |value: Option<f64>| value.map(|v| v.to_string()).unwrap_or_default();
    for row in rows {
        let measured = row.outcome.as_ref().ok();
        let ensemble = row.ensemble();
        let range = ensemble.and_then(|e| e.range());
        let field = |f: &dyn Fn(&Measured) -> String| measured.map(f).unwrap_or_default();
        csv.write_record([
            row.case.clone(),
            row.solver.to_string(),
            field(&|m| node_text(&m.support)),
            row.volume(),
            row.orientation(),
            number(row.published),
            number(measured.and_then(|m| m.error)),
            number(row.difference()),
            ensemble.map_or("0".to_owned(), |e| e.errors.len().to_string()),
            number(ensemble.and_then(|e| e.median())),
            number(range.map(|[min, _]| min)),
            number(range.map(|[_, max]| max)),
            ensemble.map_or("0".to_owned(), |e| e.failures.to_string()),
            field(&|m| m.half_fold_error.to_string()),
            field(&|m| m.worst.strain.to_string()),
            field(&|m| m.worst.strain_rms.to_string()),
            number(measured.and_then(|m| m.worst.shear)),
            number(measured.and_then(|m| m.worst.gap)),
            field(&|m| m.worst.height[0].to_string()),
            field(&|m| m.worst.height[1].to_string()),
            field(&|m| m.worst.held_error.to_string()),
            field(&|m| node_text(&m.refused)),
            field(&|m| m.worst.unconverged_steps.to_string()),
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
) -> Result<(), Error> {
    let mut csv = Writer::from_writer(writer);
    csv.write_record([
        "case",
        "solver",
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
            row.solver.to_string(),
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
