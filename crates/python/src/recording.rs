//! Recordings, their pictures and pages.

use std::path::PathBuf;

use glam::DVec3;
use numpy::prelude::*;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use selvedge_math::Command;
use selvedge_view as view;

use crate::arrays::{Points, points_out};
use crate::cloth::Mesh;
use crate::gripper::jaw;
use crate::value_error;
use crate::values::Pose;

/// A run, frame by frame; `numpy.load` reads the files it writes.
#[pyclass(module = "selvedge")]
pub(crate) struct Recording(pub(crate) view::Recording);

/// Faces and shape at rest of a mesh.
pub(crate) fn sheet(mesh: &selvedge_cloth::Mesh) -> view::Sheet {
    let rest = match mesh.as_grid() {
        Some(grid) => view::Rest::Grid {
            nodes: grid.nodes.map(|n| n as u32),
            sides: grid.sides,
        },
        None => view::Rest::Positions(mesh.rest().to_vec()),
    };
    view::Sheet {
        quads: mesh.quads().to_vec(),
        triangles: mesh.triangles().to_vec(),
        rest,
    }
}

#[pymethods]
impl Recording {
    /// An empty recording of a mesh and a number of grippers; `meta` is a JSON object.
    #[new]
    #[pyo3(signature = (mesh, grippers=1, meta="{}"))]
    fn new(mesh: &Mesh, grippers: usize, meta: &str) -> PyResult<Self> {
        let recording = view::Recording::new(sheet(&mesh.0), grippers, meta.to_owned());
        recording.map(Self).map_err(value_error)
    }

    #[staticmethod]
    fn read(path: PathBuf) -> PyResult<Self> {
        view::Recording::read(path).map(Self).map_err(value_error)
    }

    /// Adds the state at `time` [s]: positions (N, 3) [m], poses (G, 7) px py pz qx qy qz qw, closed
    /// (G), alphas (G) and holders (N): the gripper that holds each node, from 1, or 0.
    #[pyo3(signature = (time, positions, poses, closed, alphas, holders))]
    fn push(
        &mut self,
        time: f64,
        positions: &Bound<'_, PyAny>,
        poses: Vec<Vec<f64>>,
        closed: Vec<bool>,
        alphas: Vec<f64>,
        holders: Vec<u8>,
    ) -> PyResult<()> {
        let points = Points::read("positions", positions)?;
        let (nodes, grippers) = (self.0.node_count(), self.0.gripper_count());
        for (name, found, wanted) in [
            ("positions", points.get().len(), nodes),
            ("holders", holders.len(), nodes),
            ("poses", poses.len(), grippers),
            ("closed", closed.len(), grippers),
            ("alphas", alphas.len(), grippers),
        ] {
            if found != wanted {
                return Err(value_error(format!(
                    "{name}: {found} rows, must be {wanted}"
                )));
            }
        }
        let states = poses
            .iter()
            .zip(&closed)
            .zip(&alphas)
            .map(|((pose, &closed), &alpha)| {
                Ok(view::GripperState {
                    command: Command {
                        pose: Pose::from_seven(pose)?,
                        jaw: jaw(closed),
                    },
                    alpha,
                })
            });
        let states = states.collect::<PyResult<Vec<_>>>()?;
        self.0
            .push(time, points.get(), &states, &holders)
            .map_err(value_error)
    }

    fn write(&self, path: PathBuf) -> PyResult<()> {
        self.0.write(path).map_err(value_error)
    }

    /// For Foxglove and other robot tools.
    fn write_mcap(&self, path: PathBuf) -> PyResult<()> {
        self.0.write_mcap(path).map_err(value_error)
    }

    /// The times [s].
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.times())
    }

    /// The description, a JSON object.
    #[getter]
    fn meta(&self) -> &str {
        self.0.meta()
    }

    /// The positions (N, 3) [m] of a frame, negative from the end.
    #[pyo3(signature = (frame=-1))]
    fn positions<'py>(&self, py: Python<'py>, frame: isize) -> PyResult<Bound<'py, PyArray2<f64>>> {
        points_out(py, self.0.positions(self.index(frame)?))
    }

    /// A picture (height, width, 3) of a frame, drawn without a display.
    #[pyo3(signature = (frame=-1, width=640, height=480))]
    fn picture<'py>(
        &self,
        py: Python<'py>,
        frame: isize,
        width: u32,
        height: u32,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let camera = self.0.camera(width, height);
        let picture = self
            .0
            .picture(self.index(frame)?, &camera, width, height)
            .map_err(value_error)?;
        let shape = [picture.height as usize, picture.width as usize, 3];
        PyArray1::from_vec(py, picture.pixels).reshape(shape)
    }

    fn __len__(&self) -> usize {
        self.0.frame_count()
    }
}

impl Recording {
    fn index(&self, frame: isize) -> PyResult<usize> {
        let count = self.0.frame_count() as isize;
        let index = if frame < 0 { count + frame } else { frame };
        match (0..count).contains(&index) {
            true => Ok(index as usize),
            false => Err(value_error(format!(
                "frame: {frame}, must be within {count} frames"
            ))),
        }
    }
}

/// A recording on a page: its names, itself, what its end should be like, and a curve over time.
type ClipArguments<'py> = (
    String,
    String,
    PyRef<'py, Recording>,
    Option<Bound<'py, PyAny>>,
    Vec<(f64, f64)>,
);

/// A heading, and columns: header, whether it holds numbers, cells.
type TableArguments = (String, Vec<(String, bool, Vec<String>)>);

/// Writes a page with a 3D player of clips (case, solver, recording, ideal or None, curve), and a
/// table of columns (header, is_number, cells) whose first one names the rows.
#[pyfunction]
#[pyo3(signature = (path, title, clips, lead="", curves=("Folding error over time", "E"), table=None, facts=Vec::new(), command=""))]
#[expect(clippy::too_many_arguments, reason = "all named in Python")]
pub(crate) fn write_page(
    path: PathBuf,
    title: &str,
    clips: Vec<ClipArguments<'_>>,
    lead: &str,
    curves: (&str, &str),
    table: Option<TableArguments>,
    facts: Vec<(String, String)>,
    command: &str,
) -> PyResult<()> {
    let mut ideals: Vec<Option<Vec<DVec3>>> = Vec::with_capacity(clips.len());
    for (_, _, _, ideal, _) in &clips {
        let points = ideal.as_ref().filter(|ideal| !ideal.is_none());
        let points = points
            .map(|ideal| Points::read("ideal", ideal))
            .transpose()?;
        ideals.push(points.map(|points| points.get().to_vec()));
    }
    let clips: Vec<view::Clip<'_>> = clips
        .iter()
        .zip(&ideals)
        .map(|((case, solver, recording, _, curve), ideal)| view::Clip {
            case,
            solver,
            recording: &recording.0,
            ideal: ideal.as_deref(),
            curve,
        })
        .collect();
    let tables: Vec<view::Table> = table
        .into_iter()
        .map(|(title, columns)| view::Table {
            title,
            columns: columns
                .into_iter()
                .map(|(header, is_number, cells)| view::Column {
                    header,
                    is_number,
                    cells,
                })
                .collect(),
            ..view::Table::default()
        })
        .collect();
    let page = view::Page {
        title,
        lead,
        clips: &clips,
        tables: &tables,
        curves: [curves.0, curves.1],
        command,
        facts: &facts,
    };
    let html = page.html().map_err(value_error)?;
    let write = |writer: &mut std::io::BufWriter<std::fs::File>| {
        Ok(std::io::Write::write_all(writer, html.as_bytes())?)
    };
    view::write_whole(path, write).map_err(value_error)
}
