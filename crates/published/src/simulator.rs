//! The scheme, told in its steps.

use selvedge_cloth::{Material, Mesh};
use selvedge_math::{ClothSimulator, DVec3, Held, SimulatorError, Status, StepReport};
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::constraints::{Family, Grasp};
use crate::contact::{Contact, Pass, mean_edge};
use crate::operators;
use crate::predictor::Predictor;

const PASS_LIMIT: usize = 100;
/// The shear matrix is rebuilt in every fifth substep of a frame only.
const SHEAR_REFRESH: usize = 5;
/// The shear residual is measured against this area [m^2].
const SHEAR_SCALE: f64 = 0.005;
/// Initial velocity of every component [m/s].
const NUDGE: f64 = 1e-12;

/// The parameters of the scheme.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Substeps in a step.
    pub substeps: u32,
    /// Relative residual at which the passes of a substep end.
    pub tolerance: f64,
    /// Compliance of the stretch rows; divided by the substep squared.
    pub compliance_stretch: f64,
    /// Compliance of the shear rows; divided by the substep squared.
    pub compliance_shear: f64,
    /// Compliance of the contacts; divided by the substep squared.
    pub compliance_contact: f64,
    /// Ball radius is this over 2.05 times the mean edge length.
    pub thickness_factor: f64,
    /// Longest move of a target in a substep, in mean edge lengths.
    pub move_limit: f64,
    /// Gravitational acceleration [m/s^2].
    pub gravity: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            substeps: 6,
            tolerance: 0.0075,
            compliance_stretch: 1e-6,
            compliance_shear: 5e-4,
            compliance_contact: 1e-4,
            thickness_factor: 0.95,
            move_limit: 0.1,
            gravity: 9.8,
        }
    }
}

impl Settings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Cloth`] names the first field outside its bounds.
    pub fn check(&self) -> Result<(), Error> {
        use selvedge_cloth::Error as Cloth;
        if !(1..=10_000).contains(&self.substeps) {
            let value = f64::from(self.substeps);
            return Err(Cloth::Value {
                field: "substeps",
                value,
                bound: "from 1 to 10000",
            }
            .into());
        }
        Cloth::check_positive("tolerance", self.tolerance)?;
        Cloth::check_positive("stretch compliance", self.compliance_stretch)?;
        Cloth::check_positive("shear compliance", self.compliance_shear)?;
        Cloth::check_positive("contact compliance", self.compliance_contact)?;
        Cloth::check_positive("thickness factor", self.thickness_factor)?;
        Cloth::check_positive("move limit", self.move_limit)?;
        Ok(Cloth::check_not_negative("gravity [m/s^2]", self.gravity)?)
    }
}

/// A cloth driven by the published scheme.
///
/// ```
/// use selvedge_cloth::{Material, Mesh};
/// use selvedge_math::{ClothSimulator, Held};
/// use selvedge_published::{Settings, Simulator};
///
/// let mesh = Mesh::grid([5, 6], [0.1, 0.12])?;
/// let mut cloth = Simulator::new(&mesh, Material::default(), Settings::default())?;
/// let report = cloth.step(Held::NONE, 1.0 / 60.0)?;
/// assert_eq!(report.iterations, 6); // one pass in each substep
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Simulator {
    mesh: Mesh,
    material: Material,
    settings: Settings,
    inverse_areas: Vec<f64>,
    face_counts: Vec<f64>,
    /// Squared rest lengths of the edges [m^2].
    rest_squared: Vec<f64>,
    /// For each node the ends of its two difference rows: x-, x+, y-, y+.
    shear_stencil: Vec<[u32; 4]>,
    shear_rest: Vec<f64>,
    longest_move: f64,
    /// Substep for which the matrices are built [s].
    substep: f64,
    predictor: Predictor,
    stretch: Family,
    shear: Family,
    contact: Contact,
    state: State,
    /// The state before the present step, to go back to when it fails.
    before: State,
    // Scratch.
    start: Vec<DVec3>,
    frame_start: Vec<DVec3>,
    values: Vec<f64>,
    stretch_multipliers: Vec<f64>,
    shear_multipliers: Vec<f64>,
    grasp_stretch: Vec<DVec3>,
    grasp_shear: Vec<DVec3>,
    targets: Vec<DVec3>,
}

/// What a step changes, next to the contact candidates.
#[derive(Clone, Debug)]
struct State {
    positions: Vec<DVec3>,
    velocities: Vec<DVec3>,
    held: Vec<u32>,
    first: bool,
}

impl State {
    fn copy_from(&mut self, other: &Self) {
        self.positions.copy_from_slice(&other.positions);
        self.velocities.copy_from_slice(&other.velocities);
        self.held.clone_from(&other.held);
        self.first = other.first;
    }
}

impl Simulator {
    /// A sheet at rest.
    ///
    /// # Errors
    /// [`Error::Cloth`] when a value is outside its bounds or the mesh is no grid.
    pub fn new(mesh: &Mesh, material: Material, settings: Settings) -> Result<Self, Error> {
        material.check()?;
        settings.check()?;
        let grid = mesh.as_grid();
        let grid = grid.ok_or(selvedge_cloth::Error::NoGrid("the published scheme"))?;
        let (n, rest) = (mesh.node_count(), mesh.rest());
        let areas = operators::lumped_areas(grid);
        let inverse_areas: Vec<f64> = areas.iter().map(|m| 1.0 / m).collect();
        let stretch_entries: Vec<(u32, u32)> = (0u32..)
            .zip(mesh.edges())
            .flat_map(|(row, &[p, q])| [(row, p), (row, q)])
            .collect();
        let shear_stencil = shear_stencil(grid.nodes);
        let shear_entries: Vec<(u32, u32)> = (0u32..)
            .zip(&shear_stencil)
            .flat_map(|(row, stencil)| stencil.map(|node| (row, node)))
            .collect();
        let state = State {
            positions: rest.to_vec(),
            velocities: vec![DVec3::splat(NUDGE); n],
            held: Vec::new(),
            first: true,
        };
        Ok(Self {
            rest_squared: mesh
                .edges()
                .iter()
                .map(|&[p, q]| rest[p as usize].distance_squared(rest[q as usize]))
                .collect(),
            shear_rest: shear_stencil.iter().map(|s| shear_value(s, rest)).collect(),
            longest_move: settings.move_limit * mean_edge(mesh),
            face_counts: operators::face_counts(grid),
            substep: 0.0,
            predictor: Predictor::new(grid),
            stretch: Family::new(n, mesh.edges().len(), &stretch_entries)?,
            shear: Family::new(n, n, &shear_entries)?,
            contact: Contact::new(mesh, &inverse_areas, settings.thickness_factor),
            before: state.clone(),
            start: rest.to_vec(),
            frame_start: rest.to_vec(),
            values: Vec::with_capacity(mesh.edges().len()),
            stretch_multipliers: vec![0.0; mesh.edges().len()],
            shear_multipliers: vec![0.0; n],
            grasp_stretch: Vec::new(),
            grasp_shear: Vec::new(),
            targets: Vec::new(),
            mesh: mesh.clone(),
            material,
            settings,
            inverse_areas,
            shear_stencil,
            state,
        })
    }

    /// Builds what depends on the length of the substep `h` [s].
    fn prepare(&mut self, h: f64) {
        if self.substep != h {
            self.predictor
                .prepare(&self.material, self.settings.gravity, h);
            self.stretch
                .set_compliance(self.settings.compliance_stretch / (h * h));
            self.shear
                .set_compliance(self.settings.compliance_shear / (h * h));
            self.substep = h;
        }
    }

    fn frame(&mut self, held: Held<'_>, dt: f64) -> Result<StepReport, Error> {
        let substeps = self.settings.substeps as usize;
        self.prepare(dt / substeps as f64);
        let rebuild = self.state.first || self.state.held != held.nodes;
        self.state.first = false;
        self.state.held.clear();
        self.state.held.extend_from_slice(held.nodes);
        self.frame_start.copy_from_slice(&self.state.positions);
        let mut report = StepReport::default();
        for s in 0..substeps {
            self.set_targets(held, (s + 1) as f64 / substeps as f64);
            self.substep(s, rebuild, &mut report)?;
        }
        report.contacts = self.contact.active_count() as u32;
        report.held_error = held
            .nodes
            .iter()
            .zip(held.targets)
            .map(|(&node, target)| self.state.positions[node as usize].distance(*target))
            .fold(0.0, f64::max);
        Ok(report)
    }

    /// Interpolated over the frame, not below the floor, and no further from the node than the
    /// move limit, each node on its own.
    fn set_targets(&mut self, held: Held<'_>, share: f64) {
        self.targets.clear();
        for (&node, &target) in held.nodes.iter().zip(held.targets) {
            let from = self.frame_start[node as usize];
            let target = DVec3::new(target.x, target.y, target.z.max(0.0));
            let now = self.state.positions[node as usize];
            let way = from + share * (target - from) - now;
            let factor = (self.longest_move / (way.length() + 1e-12)).min(1.0);
            self.targets.push(now + factor * way);
        }
    }

    fn substep(&mut self, s: usize, rebuild: bool, report: &mut StepReport) -> Result<(), Error> {
        let h = self.substep;
        let State {
            positions: x,
            velocities,
            ..
        } = &mut self.state;
        self.start.copy_from_slice(x);
        self.predictor.predict(x, velocities);

        // Passes over shear, stretch and self-collision
        self.stretch_multipliers.fill(0.0);
        self.shear_multipliers.fill(0.0);
        self.grasp_stretch.clear();
        self.grasp_stretch.resize(self.targets.len(), DVec3::ZERO);
        self.grasp_shear.clear();
        self.grasp_shear.resize(self.targets.len(), DVec3::ZERO);
        let mut residual = f64::INFINITY;
        let mut number = 0;
        while residual > self.settings.tolerance && number < PASS_LIMIT {
            let shear = self.solve_shear(s.is_multiple_of(SHEAR_REFRESH))?;
            let stretch = self.solve_stretch()?;
            residual = shear.max(stretch);
            let pass = Pass {
                number,
                force_rebuild: rebuild,
                start: &self.start,
                held: &self.state.held,
                compliance: self.settings.compliance_contact / (h * h),
                tolerance: self.settings.tolerance,
                friction: self.material.friction_cloth,
            };
            self.contact.pass(&pass, &mut self.state.positions);
            number += 1;
        }
        self.contact.end_substep(&self.state.positions);
        report.iterations += number as u32;
        if residual > self.settings.tolerance {
            let tolerance = self.settings.tolerance;
            report.status = Status::IterationLimit {
                residual,
                tolerance,
            };
        }

        self.land();
        let State {
            positions,
            velocities,
            ..
        } = &mut self.state;
        for ((v, &x), &x0) in velocities.iter_mut().zip(&*positions).zip(&self.start) {
            // Not physics: the predictor is trapezoidal, whose velocity would be 2 (x - x0)/h - v.
            // This pairing doubles the effective inertia.
            *v = (x - x0) / h;
        }
        match positions.iter().position(|x| !x.is_finite()) {
            Some(node) => Err(Error::Diverged { node }),
            None => Ok(()),
        }
    }

    /// One shear solve; the relative residual after it.
    ///
    /// **Not physics**: the differences are not divided by the cells they span, so one compliance
    /// makes the interior stiffest; and between refreshes the matrix and the gradients are stale.
    fn solve_shear(&mut self, refresh: bool) -> Result<f64, Error> {
        let x = &mut self.state.positions;
        if refresh {
            let gradients = self.shear.gradients_mut().chunks_exact_mut(4);
            for (gradient, &[left, right, down, up]) in gradients.zip(&self.shear_stencil) {
                let u = x[right as usize] - x[left as usize];
                let v = x[up as usize] - x[down as usize];
                gradient.copy_from_slice(&[-v, v, -u, u]);
            }
            self.shear.factor(&self.inverse_areas, &self.state.held)?;
        }
        self.values.clear();
        let rows = self.shear_stencil.iter().zip(&self.shear_rest);
        self.values
            .extend(rows.map(|(stencil, rest)| shear_value(stencil, x) - rest));
        let mut grasp = Grasp {
            nodes: &self.state.held,
            targets: &self.targets,
            multipliers: &mut self.grasp_shear,
        };
        let multipliers = &mut self.shear_multipliers;
        self.shear.solve(
            &self.values,
            multipliers,
            &mut grasp,
            &self.inverse_areas,
            x,
        );
        // Not physics: the compliance term is part of the residual, so a small one does not bound
        // the violation.
        let c = self.shear.compliance();
        let rows = self
            .shear_stencil
            .iter()
            .zip(&self.shear_rest)
            .zip(multipliers);
        Ok(rows
            .map(|((stencil, rest), lambda)| {
                let value = shear_value(stencil, x) - rest + c * *lambda;
                value.abs() / (rest.abs() + SHEAR_SCALE)
            })
            .fold(0.0, f64::max))
    }

    /// One stretch solve; the relative residual after it.
    fn solve_stretch(&mut self) -> Result<f64, Error> {
        let x = &mut self.state.positions;
        let edges = self.mesh.edges();
        let gradients = self.stretch.gradients_mut().chunks_exact_mut(2);
        self.values.clear();
        for ((gradient, &[p, q]), rest) in gradients.zip(edges).zip(&self.rest_squared) {
            let between = x[q as usize] - x[p as usize];
            gradient.copy_from_slice(&[-2.0 * between, 2.0 * between]);
            self.values.push(between.length_squared() - rest);
        }
        self.stretch.factor(&self.inverse_areas, &self.state.held)?;
        let mut grasp = Grasp {
            nodes: &self.state.held,
            targets: &self.targets,
            multipliers: &mut self.grasp_stretch,
        };
        let multipliers = &mut self.stretch_multipliers;
        self.stretch.solve(
            &self.values,
            multipliers,
            &mut grasp,
            &self.inverse_areas,
            x,
        );
        // Not physics: as for shear, the compliance term is part of the residual, so edges stretch
        // by far more than the tolerance.
        let c = self.stretch.compliance();
        let rows = edges.iter().zip(&self.rest_squared).zip(multipliers);
        Ok(rows
            .map(|((&[p, q], rest), lambda)| {
                let value = x[p as usize].distance_squared(x[q as usize]) - rest + c * *lambda;
                value.abs() / rest
            })
            .fold(0.0, f64::max))
    }

    /// The floor `z = 0` with its friction, after and apart from the constraints.
    ///
    /// **Not physics**: this undoes part of the solve, and the number of faces around a node
    /// multiplies the Coulomb limit, so inside the sheet friction is four times the coefficient.
    fn land(&mut self) {
        let nodes = self
            .state
            .positions
            .iter_mut()
            .zip(&self.start)
            .zip(&self.face_counts);
        for ((x, start), faces) in nodes {
            if x.z < 0.0 {
                let depth = -x.z;
                x.z = 0.0;
                let mut back = *start - *x;
                back.z = 0.0;
                let limit = self.material.friction_table * faces * depth;
                *x += (limit / (back.length() + 1e-12)).min(1.0) * back;
            }
        }
    }
}

impl ClothSimulator for Simulator {
    fn positions(&self) -> &[DVec3] {
        &self.state.positions
    }

    fn velocities(&self) -> &[DVec3] {
        &self.state.velocities
    }

    fn step(&mut self, held: Held<'_>, dt: f64) -> Result<StepReport, SimulatorError> {
        SimulatorError::check_time_step(dt)?;
        held.check(self.mesh.node_count())?;
        self.before.copy_from(&self.state);
        // The next step will copy these nodes there, and is not to allocate.
        let more = held.nodes.len().saturating_sub(self.before.held.len());
        self.before.held.reserve(more);
        self.contact.remember();
        self.frame(held, dt).map_err(|error| {
            self.state.copy_from(&self.before);
            self.contact.recall();
            SimulatorError::Failed(Box::new(error))
        })
    }

    fn reset(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<(), SimulatorError> {
        SimulatorError::check_state(self.mesh.node_count(), positions, velocities)?;
        self.state.positions.copy_from_slice(positions);
        self.state.velocities.copy_from_slice(velocities);
        self.state.held.clear();
        self.state.first = true;
        self.contact.reset(&self.mesh);
        Ok(())
    }
}

impl std::fmt::Debug for Simulator {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Simulator")
            .field("nodes", &self.mesh.node_count())
            .field("material", &self.material)
            .field("settings", &self.settings)
            .finish_non_exhaustive()
    }
}

/// `U . V` of one node, `U` and `V` the differences along x and along y.
fn shear_value(&[left, right, down, up]: &[u32; 4], x: &[DVec3]) -> f64 {
    (x[right as usize] - x[left as usize]).dot(x[up as usize] - x[down as usize])
}

/// The neighbours of each node along x and y; on the border the node itself stands in.
fn shear_stencil([na, nb]: [usize; 2]) -> Vec<[u32; 4]> {
    let mut stencil = Vec::with_capacity(na * nb);
    for j in 0..nb {
        for i in 0..na {
            let at = |i: usize, j: usize| (j * na + i) as u32;
            stencil.push([
                at(i.saturating_sub(1), j),
                at((i + 1).min(na - 1), j),
                at(i, j.saturating_sub(1)),
                at(i, (j + 1).min(nb - 1)),
            ]);
        }
    }
    stencil
}

#[cfg(test)]
mod tests {
    use super::*;

    fn simulator(settings: Settings) -> Simulator {
        let mesh = Mesh::grid([3, 3], [0.2, 0.2]).unwrap();
        Simulator::new(&mesh, Material::default(), settings).unwrap()
    }

    /// Edges of 0.1 m and the limit of a tenth of them: 0.01 m.
    #[test]
    fn each_target_is_limited_on_its_own_and_not_below_the_floor() {
        let mut cloth = simulator(Settings::default());
        // Nodes 4 and 8 lie at the origin and at (0.1, 0.1, 0).
        let targets = [DVec3::new(3.0, 0.0, -4.0), DVec3::new(0.1, 0.104, 0.0)];
        let held = Held {
            nodes: &[4, 8],
            targets: &targets,
            velocities: &[DVec3::ZERO; 2],
        };
        cloth.set_targets(held, 0.5);
        assert!(cloth.targets[0].distance(DVec3::new(0.01, 0.0, 0.0)) < 1e-12);
        assert!(cloth.targets[1].distance(DVec3::new(0.1, 0.102, 0.0)) < 1e-12);
    }

    #[test]
    fn a_mesh_that_is_no_grid_is_refused() {
        let rest = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
        let mesh = Mesh::new(rest, vec![], vec![[0, 1, 2]]).unwrap();
        let error = Simulator::new(&mesh, Material::default(), Settings::default()).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the mesh is no grid, as Mesh::grid makes it, which the published scheme needs"
        );
    }

    #[test]
    fn passes_end_at_their_limit() {
        let mut cloth = simulator(Settings {
            tolerance: 1e-300,
            ..Settings::default()
        });
        let report = cloth.step(Held::NONE, 1.0 / 60.0).unwrap();
        assert_eq!(report.iterations, 600);
        assert!(
            matches!(report.status, Status::IterationLimit { residual, .. } if residual > 1e-300)
        );
    }
}
