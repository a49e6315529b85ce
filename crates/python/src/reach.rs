//! Whether an arm can follow a command log.

use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;

use numpy::PyArray1;
use numpy::prelude::*;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use selvedge_franka::{Arm, Placement, best, either, search};
use selvedge_trajectory::log;

use crate::value_error;

/// Whether the robot "fr3" or "fer" can follow the command log at `path`, from `base` x y z [m] and
/// yaw [rad] in the frame of the log, or from the best one that a search finds; the table is at height
/// `table` [m]. Returns `feasible`; `base`; `flip`, whether the hand is turned by half a turn about
/// its approach; `joints` (T, 7) [rad] or None; `blocked`, what is in the way first, or None; `offers`,
/// what is possible instead.
#[pyfunction]
#[pyo3(signature = (path, robot="fr3", base=None, table=0.0))]
pub(crate) fn reach<'py>(
    py: Python<'py>,
    path: PathBuf,
    robot: &str,
    base: Option<[f64; 4]>,
    table: f64,
) -> PyResult<Bound<'py, PyDict>> {
    let arm = match robot {
        "fr3" => Arm::fr3(),
        "fer" => Arm::fer(),
        other => return Err(value_error(format!("robot: {other}, must be fr3 or fer"))),
    };
    let name = path.display().to_string();
    let file = File::open(&path).map_err(|error| value_error(format!("{name}: {error}")))?;
    let log = log::read(BufReader::new(file), &name).map_err(value_error)?;
    let found = py.detach(|| match base {
        Some(base) => {
            let placement = Placement::new(base, table).map_err(value_error)?;
            either(&arm, &log, &placement).map_err(value_error)
        }
        None => {
            let places = search(&arm, &log, table, table).map_err(value_error)?;
            let found = best(&arm, &log, &places).map_err(value_error)?;
            found.ok_or_else(|| value_error("base: every place of the search is on the cloth"))
        }
    })?;
    let fields = PyDict::new(py);
    let feasible = found.blocked.is_none() && found.timing.is_some();
    fields.set_item("feasible", feasible)?;
    fields.set_item("base", found.placement.numbers())?;
    fields.set_item("flip", found.placement.flip)?;
    fields.set_item("blocked", found.blocked.as_ref().map(ToString::to_string))?;
    let offers: Vec<String> = found.offers.iter().map(ToString::to_string).collect();
    fields.set_item("offers", offers)?;
    let postures = found.rows.iter().filter_map(|row| row.posture.as_ref());
    let joints: Vec<f64> = postures
        .flat_map(|posture| posture.q.iter().copied())
        .collect();
    let rows = found.rows.len();
    let joints = match feasible {
        true => Some(PyArray1::from_slice(py, &joints).reshape([rows, joints.len() / rows])?),
        false => None,
    };
    fields.set_item("joints", joints)?;
    Ok(fields)
}
