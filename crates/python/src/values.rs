//! Poses, grasping volumes and the squeeze.

use glam::{DQuat, DVec3};
use numpy::PyArray2;
use pyo3::prelude::*;
use selvedge_grasp as grasp;
use selvedge_math as math;

use crate::arrays::{Points, points_out};
use crate::value_error;

/// A position [m] and a rotation as a quaternion x y z w, normalised; maps the gripper's
/// coordinates to the world's: p_w = position + R p_g.
#[pyclass(frozen, from_py_object, module = "selvedge")]
#[derive(Clone, Copy)]
pub(crate) struct Pose(pub(crate) math::Pose);

#[pymethods]
impl Pose {
    #[new]
    #[pyo3(signature = (position=[0.0; 3], quaternion_xyzw=[0.0, 0.0, 0.0, 1.0]))]
    fn new(position: [f64; 3], quaternion_xyzw: [f64; 4]) -> PyResult<Self> {
        let rotation = DQuat::from_array(quaternion_xyzw);
        let pose = math::Pose::new(DVec3::from_array(position), rotation).map_err(value_error)?;
        Ok(Self(pose))
    }

    /// [m]
    #[getter]
    fn position(&self) -> [f64; 3] {
        self.0.position().to_array()
    }

    /// x y z w, of length 1.
    #[getter]
    fn quaternion_xyzw(&self) -> [f64; 4] {
        self.0.rotation().to_array()
    }

    /// The inverse transform.
    fn inverse(&self) -> Self {
        Self(self.0.inverse())
    }

    /// Points (N, 3) from the frame of the pose to the world.
    fn transform<'py>(
        &self,
        py: Python<'py>,
        points: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = Points::read("points", points)?;
        let moved: Vec<DVec3> = points.get().iter().map(|p| self.0.transform(*p)).collect();
        points_out(py, &moved)
    }

    fn __mul__(&self, other: &Self) -> Self {
        Self(self.0 * other.0)
    }

    fn __repr__(&self) -> String {
        format!(
            "Pose(position={:?}, quaternion_xyzw={:?})",
            self.position(),
            self.quaternion_xyzw()
        )
    }
}

impl Pose {
    /// px py pz qx qy qz qw.
    pub(crate) fn from_seven(values: &[f64]) -> PyResult<math::Pose> {
        let [x, y, z, i, j, k, w] = *values else {
            let count = values.len();
            return Err(value_error(format!(
                "pose: {count} numbers, must be 7: px py pz qx qy qz qw"
            )));
        };
        math::Pose::new(DVec3::new(x, y, z), DQuat::from_xyzw(i, j, k, w)).map_err(value_error)
    }
}

/// px py pz qx qy qz qw of a pose.
pub(crate) fn seven(pose: &math::Pose) -> [f64; 7] {
    let (p, q) = (pose.position(), pose.rotation());
    [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
}

/// The pinch grasp: a box of sides `size` [m] with its middle at `offset` [m, gripper frame].
#[pyclass(frozen, module = "selvedge")]
pub(crate) struct BoxVolume(grasp::GraspVolume);

#[pymethods]
impl BoxVolume {
    #[new]
    #[pyo3(signature = (size, offset=[0.0; 3]))]
    fn new(size: [f64; 3], offset: [f64; 3]) -> PyResult<Self> {
        let shape = grasp::Shape::Box {
            size: DVec3::from_array(size),
        };
        volume(shape, offset).map(Self)
    }

    /// Whether each of the points (N, 3) [m, gripper frame] is inside; the boundary is.
    fn contains(&self, points: &Bound<'_, PyAny>) -> PyResult<Vec<bool>> {
        contains(&self.0, points)
    }
}

/// The point grasp: a square pyramid, its base of side `side` [m] at `offset` [m, gripper frame], its
/// apex at z = `height` above it, which may be negative.
#[pyclass(frozen, module = "selvedge")]
pub(crate) struct PyramidVolume(grasp::GraspVolume);

#[pymethods]
impl PyramidVolume {
    #[new]
    #[pyo3(signature = (side, height, offset=[0.0; 3]))]
    fn new(side: f64, height: f64, offset: [f64; 3]) -> PyResult<Self> {
        volume(grasp::Shape::Pyramid { side, height }, offset).map(Self)
    }

    /// Whether each of the points (N, 3) [m, gripper frame] is inside; the boundary is.
    fn contains(&self, points: &Bound<'_, PyAny>) -> PyResult<Vec<bool>> {
        contains(&self.0, points)
    }
}

fn volume(shape: grasp::Shape, offset: [f64; 3]) -> PyResult<grasp::GraspVolume> {
    grasp::GraspVolume::new(shape, DVec3::from_array(offset)).map_err(value_error)
}

fn contains(volume: &grasp::GraspVolume, points: &Bound<'_, PyAny>) -> PyResult<Vec<bool>> {
    let points = Points::read("points", points)?;
    Ok(points.get().iter().map(|p| volume.contains(*p)).collect())
}

/// Either volume.
#[derive(FromPyObject)]
pub(crate) enum AnyVolume<'py> {
    Box(PyRef<'py, BoxVolume>),
    Pyramid(PyRef<'py, PyramidVolume>),
}

impl AnyVolume<'_> {
    pub(crate) fn get(&self) -> grasp::GraspVolume {
        match self {
            Self::Box(volume) => volume.0,
            Self::Pyramid(volume) => volume.0,
        }
    }
}

/// How closed jaws pull what they hold to their middle over `steps` steps: the share `amount` of the
/// distance along x, and `lift` [m] along z.
#[pyclass(frozen, module = "selvedge")]
pub(crate) struct Squeeze(pub(crate) grasp::Squeeze);

#[pymethods]
impl Squeeze {
    #[new]
    #[pyo3(signature = (amount=0.5, lift=2e-4, steps=10))]
    fn new(amount: f64, lift: f64, steps: u32) -> PyResult<Self> {
        let squeeze = grasp::Squeeze {
            amount,
            lift,
            steps,
        };
        squeeze.check().map_err(value_error)?;
        Ok(Self(squeeze))
    }
}
