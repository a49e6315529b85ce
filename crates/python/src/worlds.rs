//! Many cloths with grippers, stepped together: what a vectorised environment runs on.

use glam::DVec3;
use numpy::prelude::*;
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use selvedge_cloth as cloth;
use selvedge_grasp as grasp;
use selvedge_math::{ClothSimulator, Command, DVec3 as Point};

use crate::arrays::{Points, cube_out};
use crate::cloth::{Mesh, simulator};
use crate::gripper::{Grippers, jaw};
use crate::value_error;
use crate::values::Pose;

/// W worlds, each with the same cloth and the same grippers. Steps run on `threads` threads with other
/// Python threads running meanwhile; the same bits with any number.
#[pyclass(module = "selvedge")]
pub(crate) struct Worlds {
    mesh: cloth::Mesh,
    worlds: Vec<World>,
    threads: usize,
}

struct World {
    cloth: cloth::Simulator,
    grippers: grasp::Grippers,
    strain: f64,
    /// Why its last step failed.
    failure: Option<String>,
}

impl World {
    fn step(&mut self, mesh: &cloth::Mesh, commands: &[Command], dt: f64) -> Result<(), String> {
        let view = grasp::ClothView {
            positions: self.cloth.positions(),
            edges: mesh.edges(),
            quads: mesh.quads(),
            triangles: mesh.triangles(),
        };
        let held = self
            .grippers
            .step(commands, dt, view)
            .map_err(|error| error.to_string())?;
        let report = self
            .cloth
            .step(held, dt)
            .map_err(|error| error.to_string())?;
        self.strain = report.strain.unwrap_or(0.0);
        Ok(())
    }
}

#[pymethods]
impl Worlds {
    #[new]
    #[pyo3(signature = (count, mesh, grippers, material=None, settings=None, threads=1))]
    fn new(
        count: usize,
        mesh: &Mesh,
        grippers: &Grippers,
        material: Option<&Bound<'_, PyDict>>,
        settings: Option<&Bound<'_, PyDict>>,
        threads: usize,
    ) -> PyResult<Self> {
        let world = || -> PyResult<World> {
            Ok(World {
                cloth: simulator(mesh, material, settings)?,
                grippers: grippers.inner.clone(),
                strain: 0.0,
                failure: None,
            })
        };
        if count == 0 || threads == 0 {
            return Err(value_error(format!(
                "{count} worlds on {threads} threads, must be one each"
            )));
        }
        Ok(Self {
            mesh: mesh.0.clone(),
            worlds: (0..count).map(|_| world()).collect::<PyResult<_>>()?,
            threads,
        })
    }

    /// One step of `dt` [s] with poses (W, G, 7) and closed (W, G).
    #[pyo3(signature = (poses, closed, dt=1.0 / 60.0))]
    fn step(
        &mut self,
        py: Python<'_>,
        poses: Vec<Vec<Vec<f64>>>,
        closed: Vec<Vec<bool>>,
        dt: f64,
    ) -> PyResult<()> {
        let wanted = self.worlds.len();
        if poses.len() != wanted || closed.len() != wanted {
            let counts = format!("{} and {} worlds", poses.len(), closed.len());
            return Err(value_error(format!(
                "poses and closed: {counts}, must be {wanted}"
            )));
        }
        let mut commands: Vec<Vec<Command>> = Vec::with_capacity(wanted);
        for (number, (poses, closed)) in poses.iter().zip(&closed).enumerate() {
            let count = self.worlds[number].grippers.grippers().len();
            if poses.len() != count || closed.len() != count {
                let text = format!(
                    "world {number}: {} poses, {} jaws, must be {count}",
                    poses.len(),
                    closed.len()
                );
                return Err(value_error(text));
            }
            let command = |(pose, &closed): (&Vec<f64>, &bool)| -> PyResult<Command> {
                Ok(Command {
                    pose: Pose::from_seven(pose)?,
                    jaw: jaw(closed),
                })
            };
            commands.push(
                poses
                    .iter()
                    .zip(closed)
                    .map(command)
                    .collect::<PyResult<_>>()?,
            );
        }
        let share = wanted.div_ceil(self.threads);
        let (mesh, worlds) = (&self.mesh, &mut self.worlds);
        let results: Vec<Result<(), String>> = py.detach(|| {
            std::thread::scope(|scope| {
                let run = |(worlds, commands): (&mut [World], &[Vec<Command>])| {
                    let pairs = worlds.iter_mut().zip(commands);
                    let steps = pairs.map(|(world, commands)| world.step(mesh, commands, dt));
                    steps.collect::<Vec<_>>()
                };
                let mut parts = worlds.chunks_mut(share).zip(commands.chunks(share));
                // The first part on this thread.
                let first = parts.next();
                let others: Vec<_> = parts.map(|part| scope.spawn(move || run(part))).collect();
                let mut results = first.map(run).unwrap_or_default();
                for other in others {
                    results.extend(other.join().unwrap_or_default());
                }
                results
            })
        });
        if results.len() != wanted {
            return Err(value_error("a thread failed"));
        }
        for (world, result) in self.worlds.iter_mut().zip(results) {
            world.failure = result.err();
        }
        Ok(())
    }

    /// Why the last step of each world failed, or None. A cloth that failed stays as it was.
    #[getter]
    fn failures(&self) -> Vec<Option<&str>> {
        let worlds = self.worlds.iter();
        worlds.map(|world| world.failure.as_deref()).collect()
    }

    /// Starts a world anew: its cloth at `positions` (N, 3) [m] at rest, or as the mesh lies, its
    /// grippers open.
    #[pyo3(signature = (world, positions=None))]
    fn reset(&mut self, world: usize, positions: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let count = self.worlds.len();
        let bound = || value_error(format!("world: {world}, must be below {count}"));
        let target = self.worlds.get_mut(world).ok_or_else(bound)?;
        let points = positions.filter(|points| !points.is_none());
        let points = points
            .map(|points| Points::read("positions", points))
            .transpose()?;
        let start: &[Point] = points
            .as_ref()
            .map_or(self.mesh.rest(), |points| points.get());
        let still = vec![DVec3::ZERO; start.len()];
        target.cloth.reset(start, &still).map_err(value_error)?;
        target.grippers.reset();
        target.strain = 0.0;
        target.failure = None;
        Ok(())
    }

    /// (W, N, 3) [m], a copy.
    #[getter]
    fn positions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let nodes = self.mesh.node_count();
        let all = self.worlds.iter().flat_map(|world| world.cloth.positions());
        let flat: Vec<f64> = all.flat_map(|p| p.to_array()).collect();
        cube_out(py, flat, [self.worlds.len(), nodes, 3])
    }

    /// Largest edge strain of the last step of each world (W).
    #[getter]
    fn strains<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.worlds.iter().map(|world| world.strain).collect())
    }

    /// How many nodes each gripper of each world holds (W, G).
    #[getter]
    fn held_counts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<u32>>> {
        let grippers = self.worlds[0].grippers.grippers().len();
        let counts = self
            .worlds
            .iter()
            .flat_map(|world| world.grippers.grippers());
        let counts: Vec<u32> = counts.map(|gripper| gripper.nodes().len() as u32).collect();
        PyArray1::from_vec(py, counts).reshape([self.worlds.len(), grippers])
    }
}
