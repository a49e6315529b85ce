//! The mesh and the default solver.

use std::sync::{Mutex, MutexGuard};

use glam::DVec3;
use numpy::PyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use selvedge_cloth as cloth;
use selvedge_math::{ClothSimulator, Held, Status, StepReport};
use serde_json::{Map, Value};

use crate::arrays::{Points, faces, points_out, rows_out};
use crate::value_error;

/// A cloth at rest: nodes, edges and faces.
#[pyclass(frozen, module = "selvedge")]
pub(crate) struct Mesh(pub(crate) cloth::Mesh);

#[pymethods]
impl Mesh {
    /// Rest positions (N, 3) [m] and faces (F, 3) or (F, 4).
    #[new]
    fn new(rest: &Bound<'_, PyAny>, face_array: &Bound<'_, PyAny>) -> PyResult<Self> {
        let points = Points::read("rest", rest)?;
        let (quads, triangles) = faces("faces", Some(face_array))?;
        let rest = points.get().to_vec();
        cloth::Mesh::new(rest, quads, triangles)
            .map(Self)
            .map_err(value_error)
    }

    /// A rectangle of `nodes` (along x and y) and `sides` [m] around the origin, at z = 0.
    #[staticmethod]
    fn grid(nodes: [usize; 2], sides: [f64; 2]) -> PyResult<Self> {
        cloth::Mesh::grid(nodes, sides)
            .map(Self)
            .map_err(value_error)
    }

    /// The mesh of a Wavefront OBJ file.
    #[staticmethod]
    fn from_obj(path: std::path::PathBuf) -> PyResult<Self> {
        cloth::Mesh::from_obj(path).map(Self).map_err(value_error)
    }

    /// (N, 3) [m]
    #[getter]
    fn rest<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        points_out(py, self.0.rest())
    }

    /// (E, 2)
    #[getter]
    fn edges<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        rows_out(py, self.0.edges())
    }

    /// (F, 4)
    #[getter]
    fn quads<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        rows_out(py, self.0.quads())
    }

    /// (F, 3)
    #[getter]
    fn triangles<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        rows_out(py, self.0.triangles())
    }

    /// The scale of the folding error [m].
    #[getter]
    fn diagonal(&self) -> f64 {
        self.0.diagonal()
    }

    #[getter]
    fn node_count(&self) -> usize {
        self.0.node_count()
    }
}

/// The inextensible cloth. `material` and `settings` are dictionaries of the fields that differ from
/// the default (SI units). A large one is faster on several threads, with the same bits.
#[pyclass(frozen, module = "selvedge")]
pub(crate) struct Cloth(pub(crate) Mutex<Box<dyn ClothSimulator + Send>>);

/// Held nodes as they come from Python.
pub(crate) struct Grasp {
    nodes: Vec<u32>,
    targets: Vec<DVec3>,
    velocities: Vec<DVec3>,
}

impl Grasp {
    /// Reads (nodes, targets, velocities), or nothing.
    pub(crate) fn read(held: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let Some(held) = held.filter(|held| !held.is_none()) else {
            return Ok(Self {
                nodes: Vec::new(),
                targets: Vec::new(),
                velocities: Vec::new(),
            });
        };
        let (nodes, targets, velocities): (Vec<u32>, Bound<'_, PyAny>, Bound<'_, PyAny>) =
            held.extract().map_err(|error| {
                value_error(format!(
                    "held: must be (nodes, targets, velocities): {error}"
                ))
            })?;
        Ok(Self {
            nodes,
            targets: Points::read("targets", &targets)?.get().to_vec(),
            velocities: Points::read("velocities", &velocities)?.get().to_vec(),
        })
    }

    pub(crate) fn held(&self) -> Held<'_> {
        Held {
            nodes: &self.nodes,
            targets: &self.targets,
            velocities: &self.velocities,
        }
    }
}

/// A default with the fields of a dictionary in place of its own.
fn merged<T: serde::Serialize + serde::de::DeserializeOwned>(
    name: &str,
    default: T,
    fields: Option<&Bound<'_, PyDict>>,
) -> PyResult<T> {
    let Some(fields) = fields else {
        return Ok(default);
    };
    let mut all: Map<String, Value> = match serde_json::to_value(default) {
        Ok(Value::Object(all)) => all,
        _ => return Err(value_error(format!("{name}: no fields"))),
    };
    for (key, value) in fields {
        let key: String = key.extract()?;
        let Some(place) = all.get_mut(&key) else {
            let known: Vec<&String> = all.keys().collect();
            return Err(value_error(format!(
                "{name}: {key} is not one of {known:?}"
            )));
        };
        *place = match place {
            Value::Bool(_) => Value::Bool(value.extract()?),
            Value::Number(number) if number.is_u64() => Value::from(value.extract::<u64>()?),
            _ => {
                let number: f64 = value.extract()?;
                let json = serde_json::Number::from_f64(number);
                let error = || value_error(format!("{name}: {key} is {number}, must be finite"));
                Value::Number(json.ok_or_else(error)?)
            }
        };
    }
    serde_json::from_value(Value::Object(all))
        .map_err(|error| value_error(format!("{name}: {error}")))
}

/// The default solver on a mesh.
pub(crate) fn simulator(
    mesh: &Mesh,
    material: Option<&Bound<'_, PyDict>>,
    settings: Option<&Bound<'_, PyDict>>,
) -> PyResult<cloth::Simulator> {
    let material = merged("material", cloth::Material::default(), material)?;
    let settings = merged("settings", cloth::Settings::default(), settings)?;
    cloth::Simulator::new(&mesh.0, material, settings).map_err(value_error)
}

/// A report as a dictionary; what was not measured is None.
fn report_out<'py>(py: Python<'py>, report: &StepReport) -> PyResult<Bound<'py, PyDict>> {
    let fields = PyDict::new(py);
    fields.set_item("converged", report.status == Status::Converged)?;
    fields.set_item("iterations", report.iterations)?;
    fields.set_item("contacts", report.contacts)?;
    fields.set_item("held_error", report.held_error)?;
    fields.set_item("strain", report.strain)?;
    fields.set_item("shear", report.shear)?;
    fields.set_item("gap", report.gap)?;
    Ok(fields)
}

impl Cloth {
    fn locked(&self) -> PyResult<MutexGuard<'_, Box<dyn ClothSimulator + Send>>> {
        self.0
            .lock()
            .map_err(|_| value_error("the cloth failed in an earlier step"))
    }
}

#[pymethods]
impl Cloth {
    #[new]
    #[pyo3(signature = (mesh, material=None, settings=None, threads=1))]
    fn new(
        mesh: &Mesh,
        material: Option<&Bound<'_, PyDict>>,
        settings: Option<&Bound<'_, PyDict>>,
        threads: usize,
    ) -> PyResult<Self> {
        let mut simulator = simulator(mesh, material, settings)?;
        simulator.set_threads(threads).map_err(value_error)?;
        Ok(Self(Mutex::new(Box::new(simulator))))
    }

    /// (N, 3) [m], a copy.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        points_out(py, self.locked()?.positions())
    }

    /// (N, 3) [m/s], a copy.
    #[getter]
    fn velocities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        points_out(py, self.locked()?.velocities())
    }

    /// Advances by `dt` [s] with the held nodes (nodes, targets, velocities) of a gripper, or none.
    /// Other Python threads run meanwhile. Returns what was measured.
    #[pyo3(signature = (held=None, dt=1.0 / 60.0))]
    fn step<'py>(
        &self,
        py: Python<'py>,
        held: Option<&Bound<'py, PyAny>>,
        dt: f64,
    ) -> PyResult<Bound<'py, PyDict>> {
        let grasp = Grasp::read(held)?;
        let report = py.detach(|| -> PyResult<StepReport> {
            let mut simulator = self.locked()?;
            simulator.step(grasp.held(), dt).map_err(value_error)
        })?;
        report_out(py, &report)
    }

    /// Starts anew from positions (N, 3) [m] and velocities (N, 3) [m/s], zero if not given.
    #[pyo3(signature = (positions, velocities=None))]
    fn reset(
        &self,
        positions: &Bound<'_, PyAny>,
        velocities: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let positions = Points::read("positions", positions)?;
        let velocities = match velocities.filter(|velocities| !velocities.is_none()) {
            Some(velocities) => Points::read("velocities", velocities)?.get().to_vec(),
            None => vec![DVec3::ZERO; positions.get().len()],
        };
        self.locked()?
            .reset(positions.get(), &velocities)
            .map_err(value_error)
    }
}

/// A cloth and what its gripper holds.
type Job<'a> = (&'a Mutex<Box<dyn ClothSimulator + Send>>, &'a Grasp);

/// Steps several cloths on `threads` threads, with the held nodes of each; other Python threads run
/// meanwhile. The same bits with any number of threads.
#[pyfunction]
#[pyo3(signature = (cloths, held, dt=1.0 / 60.0, threads=1))]
pub(crate) fn step_all<'py>(
    py: Python<'py>,
    cloths: Vec<PyRef<'py, Cloth>>,
    held: Vec<Bound<'py, PyAny>>,
    dt: f64,
    threads: usize,
) -> PyResult<Vec<Bound<'py, PyDict>>> {
    if cloths.len() != held.len() {
        let counts = format!("{} cloths, {} held", cloths.len(), held.len());
        return Err(value_error(format!("held: {counts}, must be as many")));
    }
    let grasps = held.iter().map(|held| Grasp::read(Some(held)));
    let grasps = grasps.collect::<PyResult<Vec<_>>>()?;
    let jobs: Vec<Job<'_>> = cloths.iter().map(|cloth| &cloth.0).zip(&grasps).collect();
    let share = jobs.len().div_ceil(threads.max(1)).max(1);
    let reports = py.detach(|| {
        std::thread::scope(|scope| {
            let run = |jobs: &[Job<'_>]| {
                let one = |(cloth, grasp): &Job<'_>| {
                    let mut cloth = cloth
                        .lock()
                        .map_err(|_| "it failed in an earlier step".to_owned())?;
                    cloth
                        .step(grasp.held(), dt)
                        .map_err(|error| error.to_string())
                };
                jobs.iter()
                    .map(one)
                    .collect::<Vec<Result<StepReport, String>>>()
            };
            let parts: Vec<_> = jobs
                .chunks(share)
                .map(|jobs| scope.spawn(move || run(jobs)))
                .collect();
            let join = |part: std::thread::ScopedJoinHandle<
                '_,
                Vec<Result<StepReport, String>>,
            >| { part.join().unwrap_or_default() };
            parts.into_iter().flat_map(join).collect::<Vec<_>>()
        })
    });
    if reports.len() != cloths.len() {
        return Err(value_error("a thread failed"));
    }
    let each = reports.into_iter().enumerate();
    each.map(|(number, report)| match report {
        Ok(report) => report_out(py, &report),
        Err(error) => Err(value_error(format!("cloth {number}: {error}"))),
    })
    .collect()
}
