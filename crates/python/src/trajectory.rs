//! Paths in space and time, and command logs.

use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;

use glam::{DQuat, DVec3};
use numpy::prelude::*;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use selvedge_math::Command;
use selvedge_trajectory as trajectory;
use selvedge_trajectory::log;

use crate::gripper::jaw;
use crate::value_error;
use crate::values::{Pose, seven};

/// A way of the gripper: its tip along a quadratic Bezier curve through three control points [m], its
/// orientation from one quaternion (x y z w) to another by "slerp" or "nlerp".
#[pyclass(frozen, module = "selvedge")]
pub(crate) struct Sweep(trajectory::Sweep);

#[pymethods]
impl Sweep {
    #[new]
    #[pyo3(signature = (start, mid, end, start_xyzw, end_xyzw, orientation="slerp", tip=[0.0; 3]))]
    fn new(
        start: [f64; 3],
        mid: [f64; 3],
        end: [f64; 3],
        start_xyzw: [f64; 4],
        end_xyzw: [f64; 4],
        orientation: &str,
        tip: [f64; 3],
    ) -> PyResult<Self> {
        let [start, mid, end] = [start, mid, end].map(DVec3::from_array);
        let orientation = match orientation {
            "slerp" => trajectory::Orientation::Slerp,
            "nlerp" => trajectory::Orientation::Nlerp,
            other => {
                return Err(value_error(format!(
                    "orientation: {other}, must be slerp or nlerp"
                )));
            }
        };
        let [from, to] = [start_xyzw, end_xyzw].map(DQuat::from_array);
        let path = trajectory::QuadBezier { start, mid, end };
        trajectory::Sweep::new(path, from, to, orientation, DVec3::from_array(tip))
            .map(Self)
            .map_err(value_error)
    }

    /// The pose at `s` in [0, 1].
    fn pose(&self, s: f64) -> PyResult<Pose> {
        match s.is_finite() {
            true => Ok(Pose(self.0.pose(s))),
            false => Err(value_error(format!("s: {s}, must be finite"))),
        }
    }
}

/// Commands over time. `Schedule.fold` is the usual one: open at the start until `close`, closed there
/// until `start`, along the sweep until `open`, open at its end until `end` [s].
#[pyclass(frozen, module = "selvedge")]
pub(crate) struct Schedule(trajectory::Schedule);

#[pymethods]
impl Schedule {
    #[staticmethod]
    #[pyo3(signature = (sweep, close, start, open, end, law="quintic"))]
    fn fold(
        sweep: &Sweep,
        close: f64,
        start: f64,
        open: f64,
        end: f64,
        law: &str,
    ) -> PyResult<Self> {
        let law = match law {
            "linear" => trajectory::Law::Linear,
            "cubic" => trajectory::Law::Cubic,
            "quintic" => trajectory::Law::Quintic,
            other => {
                return Err(value_error(format!(
                    "law: {other}, must be linear, cubic or quintic"
                )));
            }
        };
        let times = trajectory::FoldTimes {
            close,
            start,
            open,
            end,
        };
        trajectory::Schedule::fold(sweep.0, law, times)
            .map(Self)
            .map_err(value_error)
    }

    /// [s]
    #[getter]
    fn duration(&self) -> f64 {
        self.0.duration()
    }

    /// The pose at a time [s], and whether the jaws are closed.
    fn command(&self, time: f64) -> (Pose, bool) {
        let command = self.0.command(time);
        (Pose(command.pose), command.jaw.is_closed())
    }
}

/// A command log: `t` (T) [s], `pose` (T, 7) px py pz qx qy qz qw, `closed` (T), `tip_offset` [m],
/// `frame` and `source`.
#[pyfunction]
pub(crate) fn read_log(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let file =
        File::open(&path).map_err(|error| value_error(format!("{}: {error}", path.display())))?;
    let name = path.display().to_string();
    let log = log::read(BufReader::new(file), &name).map_err(value_error)?;
    let times: Vec<f64> = log.samples.iter().map(|sample| sample.time).collect();
    let closed: Vec<bool> = log
        .samples
        .iter()
        .map(|sample| sample.command.jaw.is_closed())
        .collect();
    let poses = log
        .samples
        .iter()
        .flat_map(|sample| seven(&sample.command.pose));
    let poses: Bound<'_, PyArray2<f64>> =
        PyArray1::from_vec(py, poses.collect()).reshape([times.len(), 7])?;
    let fields = PyDict::new(py);
    fields.set_item("t", PyArray1::from_vec(py, times))?;
    fields.set_item("pose", poses)?;
    fields.set_item("closed", PyArray1::from_vec(py, closed))?;
    fields.set_item("tip_offset", log.tip_offset.to_array())?;
    fields.set_item("frame", log.frame)?;
    fields.set_item("source", log.source)?;
    Ok(fields)
}

/// Writes a command log that a robot can follow; see `read_log` for the arguments.
#[pyfunction]
#[pyo3(signature = (path, t, pose, closed, tip_offset=[0.0; 3], source="python"))]
pub(crate) fn write_log(
    path: PathBuf,
    t: Vec<f64>,
    pose: Vec<Vec<f64>>,
    closed: Vec<bool>,
    tip_offset: [f64; 3],
    source: &str,
) -> PyResult<()> {
    if t.len() != pose.len() || t.len() != closed.len() {
        let counts = format!("{}, {} and {}", t.len(), pose.len(), closed.len());
        return Err(value_error(format!(
            "t, pose and closed: {counts} rows, must be as many"
        )));
    }
    let mut all = log::Log::new(source);
    all.tip_offset = DVec3::from_array(tip_offset);
    for ((&time, pose), &closed) in t.iter().zip(&pose).zip(&closed) {
        let command = Command {
            pose: Pose::from_seven(pose)?,
            jaw: jaw(closed),
        };
        all.samples.push(log::Sample { time, command });
    }
    selvedge_view::write_whole(path, |writer| Ok(log::write(writer, &all)?)).map_err(value_error)
}
