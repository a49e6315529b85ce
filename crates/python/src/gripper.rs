//! The gripper, alone or several on one cloth.

use glam::DVec3;
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use selvedge_grasp as grasp;
use selvedge_math::{Command, Held, Jaw};

use crate::arrays::{Points, faces, indices, node_count, points_out};
use crate::value_error;
use crate::values::{AnyVolume, Pose, Squeeze, seven};

/// A gripper with a grasping volume, and what it holds. It starts open.
///
/// In the step in which the jaws close it takes the nodes in the volume, and those of edges and faces
/// whose centre is in it. While closed it says where they must be; when it opens it forgets them.
#[pyclass(module = "selvedge")]
pub(crate) struct Gripper(pub(crate) grasp::Gripper);

/// Nodes (K), targets (K, 3) [m] and velocities (K, 3) [m/s].
pub(crate) fn held_out<'py>(py: Python<'py>, held: Held<'_>) -> PyResult<Bound<'py, PyTuple>> {
    let nodes: Bound<'py, PyArray1<u32>> = PyArray1::from_slice(py, held.nodes);
    let targets: Bound<'py, PyArray2<f64>> = points_out(py, held.targets)?;
    (nodes, targets, points_out(py, held.velocities)?).into_pyobject(py)
}

pub(crate) fn jaw(closed: bool) -> Jaw {
    if closed { Jaw::Closed } else { Jaw::Open }
}

/// A cloth as a step wants it: looked at only when jaws close, counted otherwise.
struct View<'py> {
    points: Option<Points<'py>>,
    /// Stands for positions that are not read.
    blank: Vec<DVec3>,
    edges: Vec<[u32; 2]>,
    quads: Vec<[u32; 4]>,
    triangles: Vec<[u32; 3]>,
}

impl<'py> View<'py> {
    fn read(
        closing: bool,
        positions: &Bound<'py, PyAny>,
        face_array: Option<&Bound<'py, PyAny>>,
        edge_array: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Self> {
        let mut view = Self {
            points: None,
            blank: Vec::new(),
            edges: Vec::new(),
            quads: Vec::new(),
            triangles: Vec::new(),
        };
        if closing {
            view.points = Some(Points::read("positions", positions)?);
            (view.quads, view.triangles) = faces("faces", face_array)?;
            if let Some(edges) = edge_array.filter(|edges| !edges.is_none()) {
                view.edges = indices("edges", edges)?;
            }
        } else {
            view.blank
                .resize(node_count("positions", positions)?, DVec3::ZERO);
        }
        Ok(view)
    }

    fn get(&self) -> grasp::ClothView<'_> {
        grasp::ClothView {
            positions: self
                .points
                .as_ref()
                .map_or(&self.blank, |points| points.get()),
            edges: &self.edges,
            quads: &self.quads,
            triangles: &self.triangles,
        }
    }
}

#[pymethods]
impl Gripper {
    #[new]
    #[pyo3(signature = (volume, squeeze=None))]
    fn new(volume: AnyVolume<'_>, squeeze: Option<&Squeeze>) -> PyResult<Self> {
        let default = grasp::Squeeze {
            amount: 0.5,
            lift: 2e-4,
            steps: 10,
        };
        let squeeze = squeeze.map_or(default, |squeeze| squeeze.0);
        grasp::Gripper::new(volume.get(), squeeze)
            .map(Self)
            .map_err(value_error)
    }

    /// One step of `dt` [s]: the jaws are closed or not, and the gripper at `pose`, at its end;
    /// `positions` (N, 3) [m] are those at its beginning, `faces` (F, 3) or (F, 4), `edges` (E, 2).
    /// `alpha` in [0, 1] is used in place of the squeeze's own count. Returns nodes (K), targets
    /// (K, 3) [m] and velocities (K, 3) [m/s].
    #[pyo3(signature = (pose, closed, positions, faces=None, edges=None, dt=1.0 / 60.0, alpha=None))]
    #[expect(
        clippy::too_many_arguments,
        reason = "one call a step, named in Python"
    )]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        pose: &Pose,
        closed: bool,
        positions: &Bound<'py, PyAny>,
        faces: Option<&Bound<'py, PyAny>>,
        edges: Option<&Bound<'py, PyAny>>,
        dt: f64,
        alpha: Option<f64>,
    ) -> PyResult<Bound<'py, PyTuple>> {
        let closing = closed && !self.0.jaw().is_closed();
        let view = View::read(closing, positions, faces, edges)?;
        let command = Command {
            pose: pose.0,
            jaw: jaw(closed),
        };
        let options = grasp::Options {
            alpha,
            ..grasp::Options::default()
        };
        let held = self
            .0
            .step_with(command, dt, view.get(), options)
            .map_err(value_error)?;
        held_out(py, held)
    }

    /// Opens the jaws and forgets what was held.
    fn reset(&mut self) {
        self.0.reset();
    }

    /// The held nodes, ascending.
    #[getter]
    fn nodes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, self.0.nodes())
    }

    /// Whether the jaws are closed.
    #[getter]
    fn closed(&self) -> bool {
        self.0.jaw().is_closed()
    }

    /// How much of the squeeze is done, 0 to 1.
    #[getter]
    fn alpha(&self) -> f64 {
        self.0.alpha()
    }

    /// What happened in the last step: "none", "captured", "empty", "opened" or "reset".
    #[getter]
    fn event(&self) -> &'static str {
        match self.0.event() {
            grasp::Event::None => "none",
            grasp::Event::Captured => "captured",
            grasp::Event::Empty => "empty",
            grasp::Event::Opened { .. } => "opened",
            grasp::Event::Reset => "reset",
        }
    }
}

/// Several grippers on one cloth: no node is held by two.
#[pyclass(module = "selvedge")]
pub(crate) struct Grippers {
    pub(crate) inner: grasp::Grippers,
}

#[pymethods]
impl Grippers {
    #[new]
    fn new(grippers: Vec<PyRef<'_, Gripper>>) -> Self {
        let grippers = grippers.iter().map(|gripper| gripper.0.clone()).collect();
        Self {
            inner: grasp::Grippers::new(grippers),
        }
    }

    /// One step of all grippers: `poses` (G, 7) px py pz qx qy qz qw and `closed` (G) at its end, the
    /// rest as in `Gripper.step`. Closing jaws store `anchors` (N, 3) [m], if given, in place of the
    /// positions.
    #[pyo3(signature = (poses, closed, positions, faces=None, edges=None, dt=1.0 / 60.0, anchors=None))]
    #[expect(
        clippy::too_many_arguments,
        reason = "one call a step, named in Python"
    )]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        poses: Vec<Vec<f64>>,
        closed: Vec<bool>,
        positions: &Bound<'py, PyAny>,
        faces: Option<&Bound<'py, PyAny>>,
        edges: Option<&Bound<'py, PyAny>>,
        dt: f64,
        anchors: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyTuple>> {
        let count = self.inner.grippers().len();
        if poses.len() != count || closed.len() != count {
            return Err(value_error(format!(
                "poses and closed: {} and {} rows, must be {count}, one a gripper",
                poses.len(),
                closed.len()
            )));
        }
        let commands = poses.iter().zip(&closed).map(|(pose, &closed)| {
            Ok(Command {
                pose: Pose::from_seven(pose)?,
                jaw: jaw(closed),
            })
        });
        let commands = commands.collect::<PyResult<Vec<Command>>>()?;
        let mut pairs = self.inner.grippers().iter().zip(&closed);
        let closing = pairs.any(|(gripper, &closed)| closed && !gripper.jaw().is_closed());
        let view = View::read(closing, positions, faces, edges)?;
        let anchors = anchors.filter(|anchors| !anchors.is_none());
        let anchors = anchors
            .map(|anchors| Points::read("anchors", anchors))
            .transpose()?;
        let options = grasp::Options {
            anchors: anchors.as_ref().map(Points::get),
            ..grasp::Options::default()
        };
        let held = self
            .inner
            .step_with(&commands, dt, view.get(), options)
            .map_err(value_error)?;
        held_out(py, held)
    }

    /// Opens all jaws and forgets what was held.
    fn reset(&mut self) {
        self.inner.reset();
    }

    /// For each of `node_count` nodes the number of the gripper that holds it, from 1, or 0.
    fn holders<'py>(
        &self,
        py: Python<'py>,
        node_count: usize,
    ) -> PyResult<Bound<'py, PyArray1<u8>>> {
        let mut holders = vec![0; node_count];
        for (number, gripper) in self.inner.grippers().iter().enumerate() {
            for &node in gripper.nodes() {
                let holder = holders.get_mut(node as usize);
                *holder.ok_or_else(|| {
                    value_error(format!("node_count: {node_count}, node {node} is held"))
                })? = number as u8 + 1;
            }
        }
        Ok(PyArray1::from_vec(py, holders))
    }

    /// How much of each squeeze is done, 0 to 1.
    #[getter]
    fn alphas(&self) -> Vec<f64> {
        self.inner
            .grippers()
            .iter()
            .map(grasp::Gripper::alpha)
            .collect()
    }
}

/// px py pz qx qy qz qw of each command.
pub(crate) fn poses_out(commands: &[Command]) -> Vec<f64> {
    commands
        .iter()
        .flat_map(|command| seven(&command.pose))
        .collect()
}
