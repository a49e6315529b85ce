//! Scenario files and the folding error.

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Mutex;

use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use selvedge_folding as folding;
use selvedge_folding::{Case, Solver};

use crate::arrays::{Points, cube_out, points_out};
use crate::cloth::{Cloth, Mesh};
use crate::gripper::{Gripper, Grippers, poses_out};
use crate::recording::Recording;
use crate::value_error;

/// A folding experiment: one cloth, one timeline, several cases.
#[pyclass(frozen, module = "selvedge")]
pub(crate) struct Scenario(folding::Scenario);

#[pymethods]
impl Scenario {
    /// Loads and checks a scenario file.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Self> {
        folding::Scenario::load(path).map(Self).map_err(value_error)
    }

    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// The names of the cases.
    #[getter]
    fn cases(&self) -> Vec<&str> {
        self.0.cases.iter().map(|case| case.name.as_str()).collect()
    }

    #[getter]
    fn mesh(&self) -> Mesh {
        Mesh(self.0.mesh.clone())
    }

    /// The period of the commands [s].
    #[getter]
    fn dt(&self) -> f64 {
        self.0.frame
    }

    /// The time [s] after a number of steps.
    fn time(&self, steps: usize) -> f64 {
        self.0.time(steps)
    }

    #[getter]
    fn steps(&self) -> usize {
        self.0.steps
    }

    /// SI units.
    #[getter]
    fn material<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let material = &self.0.material;
        let fields = PyDict::new(py);
        for (name, value) in [
            ("density", material.density),
            ("gravitational_density", material.gravitational_density),
            ("damping", material.damping),
            ("bending", material.bending),
            ("shear", material.shear),
            ("internal_damping", material.internal_damping),
            ("friction_table", material.friction_table),
            ("friction_cloth", material.friction_cloth),
            ("thickness", material.thickness),
        ] {
            fields.set_item(name, value)?;
        }
        Ok(fields)
    }

    /// Gravitational acceleration [m/s^2].
    #[getter]
    fn gravity(&self) -> f64 {
        self.0.default.gravity
    }

    /// The case whose end is the ideal fold of this one; None for the analytic half fold.
    fn reference(&self, case: &str) -> PyResult<Option<&str>> {
        Ok(self.case(case)?.reference.as_deref())
    }

    /// The commands of a case: t (T) [s], poses (T, G, 7) px py pz qx qy qz qw, closed (T, G).
    #[allow(clippy::type_complexity, reason = "three arrays")]
    fn commands<'py>(
        &self,
        py: Python<'py>,
        case: &str,
    ) -> PyResult<(
        Bound<'py, PyArray1<f64>>,
        Bound<'py, PyArray3<f64>>,
        Bound<'py, PyArray2<bool>>,
    )> {
        let plans = &self.case(case)?.grippers;
        let times: Vec<f64> = (0..self.0.steps).map(|step| self.0.time(step)).collect();
        let (mut poses, mut closed) = (Vec::new(), Vec::new());
        for &time in &times {
            let commands: Vec<_> = plans
                .iter()
                .map(|plan| plan.commands.command(time))
                .collect();
            closed.extend(commands.iter().map(|command| command.jaw.is_closed()));
            poses.extend(poses_out(&commands));
        }
        let shape = [times.len(), plans.len()];
        use numpy::prelude::*;
        Ok((
            PyArray1::from_vec(py, times),
            cube_out(py, poses, [shape[0], shape[1], 7])?,
            PyArray1::from_vec(py, closed).reshape(shape)?,
        ))
    }

    /// The open grippers of a case.
    fn grippers(&self, case: &str) -> PyResult<Grippers> {
        let plans = self.case(case)?.grippers.iter();
        let grippers = plans.map(|plan| plan.gripper.clone());
        Ok(Grippers {
            inner: selvedge_grasp::Grippers::new(grippers.collect()),
        })
    }

    /// The open gripper of a case that has one.
    fn gripper(&self, case: &str) -> PyResult<Gripper> {
        match &self.case(case)?.grippers[..] {
            [plan] => Ok(Gripper(plan.gripper.clone())),
            plans => Err(value_error(format!("{case} has {} grippers", plans.len()))),
        }
    }

    /// Where the tip of each gripper of a case is in its frame [m].
    fn tip_offsets(&self, case: &str) -> PyResult<Vec<[f64; 3]>> {
        let plans = self.case(case)?.grippers.iter();
        Ok(plans.map(|plan| plan.tip_offset.to_array()).collect())
    }

    /// Runs a case on the solver "default" or "published"; other Python threads run meanwhile.
    fn run(&self, py: Python<'_>, case: &str, solver: &str) -> PyResult<Recording> {
        let case = self.case(case)?;
        let solver = solver_named(solver)?;
        let run = py.detach(|| folding::run(&self.0, case, solver, |_| ControlFlow::Continue(())));
        Ok(Recording(run.map_err(value_error)?.recording))
    }

    /// The cloth at rest on the solver "default" or "published", with the settings of the file.
    #[pyo3(signature = (solver="default"))]
    fn cloth(&self, solver: &str) -> PyResult<Cloth> {
        let cloth = solver_named(solver)?.build(&self.0).map_err(value_error)?;
        Ok(Cloth(Mutex::new(cloth)))
    }

    /// The positions (N, 3) [m] that a closing gripper stores on the solver; None where they are
    /// those of the nodes. The published scheme reads its cloth through a smoother.
    fn anchors<'py>(
        &self,
        py: Python<'py>,
        solver: &str,
        positions: &Bound<'py, PyAny>,
    ) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let points = Points::read("positions", positions)?;
        let (count, wanted) = (points.get().len(), self.0.mesh.node_count());
        if count != wanted {
            return Err(value_error(format!(
                "positions: {count} rows, must be {wanted}"
            )));
        }
        let anchors = solver_named(solver)?.anchors(&self.0, points.get());
        anchors.map(|anchors| points_out(py, &anchors)).transpose()
    }

    /// The description of a case's grasping volumes for `Recording`: an entry a gripper.
    fn volumes<'py>(&self, py: Python<'py>, case: &str) -> PyResult<Bound<'py, PyAny>> {
        let text = self.case(case)?.volumes_json();
        py.import("json")?.call_method1("loads", (text,))
    }
}

fn solver_named(name: &str) -> PyResult<Solver> {
    match name {
        "default" => Ok(Solver::Default),
        "published" => Ok(Solver::Published),
        other => {
            let text = format!("solver: {other}, must be default or published");
            Err(value_error(text))
        }
    }
}

impl Scenario {
    fn case(&self, name: &str) -> PyResult<&Case> {
        let known = self.cases();
        let unknown = || value_error(format!("case: {name}, must be one of {known:?}"));
        self.0.case(name).ok_or_else(unknown)
    }
}

/// Root mean square distance of positions (N, 3) to a reference (N, 3), as a share of `diagonal` [m].
#[pyfunction]
pub(crate) fn fold_error(
    positions: &Bound<'_, PyAny>,
    reference: &Bound<'_, PyAny>,
    diagonal: f64,
) -> PyResult<f64> {
    let (points, wanted) = (
        Points::read("positions", positions)?,
        Points::read("reference", reference)?,
    );
    let counts = [points.get().len(), wanted.get().len()];
    if counts[0] != counts[1] || counts[0] == 0 {
        let text = format!(
            "reference: {} rows for {} positions, must be as many",
            counts[1], counts[0]
        );
        return Err(value_error(text));
    }
    if !(diagonal > 0.0 && diagonal.is_finite()) {
        return Err(value_error(format!(
            "diagonal: {diagonal} m, must be positive and finite"
        )));
    }
    Ok(folding::fold_error(points.get(), wanted.get(), diagonal))
}

/// The ideal half fold (N, 3) [m] of a mesh: nodes with y > 0 mirrored to -y at `thickness` [m].
#[pyfunction]
pub(crate) fn half_fold<'py>(
    py: Python<'py>,
    mesh: &Mesh,
    thickness: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    points_out(py, &folding::half_fold(&mesh.0, thickness))
}
