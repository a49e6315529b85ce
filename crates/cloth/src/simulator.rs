//! The default solver, told in its steps.

use selvedge_math::{ClothSimulator, DVec3, Held, SimulatorError, Status, StepReport};
use serde::{Deserialize, Serialize};

use crate::bending::{Matrix, bending_matrix};
use crate::contact::Contacts;
use crate::linear::Cholesky;
use crate::nodes::{Kept, Nodes};
use crate::rows::{Rows, ShearLaw};
use crate::support::{Supports, Surface};
use crate::{Error, Material, Mesh};

/// Squeezed edges get their length back within this time after their release [s].
pub const RECOVERY: f64 = 0.5;

/// A substep that fails is cut in two, at most so often.
const MAX_CUTS: u32 = 6;

/// A substep has converged when its last iteration moved no node further [m].
const SETTLED: f64 = 1e-5;

/// What the solver is told next to mesh and material.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Settings {
    /// Longest substep [s]: a step of `dt` is cut into `ceil(dt / substep)` equal ones.
    pub substep: f64,
    /// Largest edge strain at the end of a substep.
    pub tolerance: f64,
    /// Iterations after which a substep ends whatever its residual.
    pub iterations: u32,
    /// Gravitational acceleration [m/s^2], along -z.
    pub gravity: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            substep: 1.0 / 120.0,
            tolerance: 5e-5,
            iterations: 20,
            gravity: 9.8,
        }
    }
}

impl Settings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::Value`] names the first field outside its bounds.
    pub fn check(&self) -> Result<(), Error> {
        Error::check_positive("substep [s]", self.substep)?;
        Error::check_positive("tolerance", self.tolerance)?;
        Error::check_positive("iterations", f64::from(self.iterations))?;
        Error::check_not_negative("gravity [m/s^2]", self.gravity)
    }
}

/// An inextensible cloth on the table `z = 0`.
#[derive(Debug)]
pub struct Simulator {
    settings: Settings,
    material: Material,
    /// Mass without drag and area of each node [kg, m^2].
    masses: Vec<f64>,
    areas: Vec<f64>,
    rest_lengths: Vec<f64>,
    bending: Matrix,
    rows: Rows,
    nodes: Nodes,
    supports: Supports,
    contacts: Contacts,
    predictor: Predictor,
    state: State,
    saved: Vec<State>,
    held: Hold,
    // Scratch
    start: Vec<DVec3>,
    load: Vec<DVec3>,
    forces: Vec<DVec3>,
    /// Whether the factor of the rows is too old.
    stale: bool,
    before: Vec<DVec3>,
    aimed: Vec<DVec3>,
    sines: Vec<f64>,
    ends: Vec<f64>,
    rates: Vec<f64>,
}

/// What a substep changes and a failed one gives back.
#[derive(Clone, Debug)]
struct State {
    time: f64,
    positions: Vec<DVec3>,
    velocities: Vec<DVec3>,
    multipliers: Vec<f64>,
    reactions: Vec<DVec3>,
    supports: Supports,
    /// Length of each edge when it was released, and when that was; not a number for edges that have
    /// their rest length.
    released: Vec<[f64; 2]>,
}

/// `E = 2 M/h^2 + D/h + (1/2 + b/h) kappa K`, the matrix of an implicit midpoint substep without
/// constraints.
#[derive(Debug)]
struct Predictor {
    cholesky: Cholesky,
    entries: Vec<(u32, u32, f64)>,
    values: Vec<f64>,
    /// The values without tension.
    constant: Vec<f64>,
    /// The entries that an edge adds to.
    places: Vec<[u32; 3]>,
    column: Vec<f64>,
    h: f64,
    /// Masses for this `h`, which make the decay by drag exact.
    masses: Vec<f64>,
}

/// The held nodes of the present step.
#[derive(Clone, Debug, Default)]
struct Hold {
    nodes: Vec<u32>,
    from: Vec<DVec3>,
    to: Vec<DVec3>,
    is_held: Vec<bool>,
}

impl State {
    fn copy_from(&mut self, other: &Self) {
        self.time = other.time;
        self.positions.copy_from_slice(&other.positions);
        self.velocities.copy_from_slice(&other.velocities);
        self.multipliers.copy_from_slice(&other.multipliers);
        self.reactions.copy_from_slice(&other.reactions);
        self.supports.copy_from(&other.supports);
        self.released.copy_from_slice(&other.released);
    }
}

impl Predictor {
    fn new(n: usize, bending: &Matrix, edges: &[[u32; 2]]) -> Result<Self, Error> {
        let mut entries: Vec<(u32, u32, f64)> = bending.lower().collect();
        entries.extend(edges.iter().map(|&[p, q]| (q, p, 0.0)));
        entries.sort_by_key(|&(r, c, _)| (r, c));
        entries.dedup_by(|extra, kept| {
            let same = (extra.0, extra.1) == (kept.0, kept.1);
            kept.2 += if same { extra.2 } else { 0.0 };
            same
        });
        let place = |r, c| {
            let found = entries.binary_search_by_key(&(r, c), |&(r, c, _)| (r, c));
            found.unwrap_or_default() as u32
        };
        let places = edges
            .iter()
            .map(|&[p, q]| [place(p, p), place(q, q), place(q, p)])
            .collect();
        let pattern: Vec<(u32, u32)> = entries.iter().map(|&(r, c, _)| (r, c)).collect();
        Ok(Self {
            cholesky: Cholesky::analyse(n, &pattern)?,
            values: vec![0.0; entries.len()],
            constant: vec![0.0; entries.len()],
            places,
            entries,
            column: vec![0.0; n],
            h: 0.0,
            masses: vec![0.0; n],
        })
    }

    fn factor(&mut self, tautness: &[f64]) -> Result<(), Error> {
        self.values.copy_from_slice(&self.constant);
        for (&[p, q, pq], stiffness) in self.places.iter().zip(tautness) {
            self.values[p as usize] += stiffness;
            self.values[q as usize] += stiffness;
            self.values[pq as usize] -= stiffness;
        }
        self.cholesky.factor(&self.values)
    }

    fn solve(&mut self, load: &[DVec3], start: &[DVec3], x: &mut [DVec3]) {
        for axis in 0..3 {
            for (value, load) in self.column.iter_mut().zip(load) {
                *value = load[axis];
            }
            self.cholesky.solve(&mut self.column);
            for ((x, start), value) in x.iter_mut().zip(start).zip(&self.column) {
                x[axis] = start[axis] + value;
            }
        }
    }
}

/// How a substep ended.
#[derive(Clone, Copy, Debug, Default)]
struct Ended {
    iterations: u32,
    strain: f64,
    shear: f64,
    gap: Option<f64>,
    residual: f64,
    /// Share of the way without collisions.
    free: f64,
}

impl Simulator {
    /// A sheet at rest.
    ///
    /// # Errors
    /// [`Error`] when a value is outside its bounds.
    pub fn new(mesh: &Mesh, material: Material, settings: Settings) -> Result<Self, Error> {
        material.check()?;
        settings.check()?;
        let n = mesh.node_count();
        let bending = bending_matrix(mesh);
        let areas = areas(mesh);
        let rest = mesh.rest();
        let length = |e: &[u32; 2]| rest[e[0] as usize].distance(rest[e[1] as usize]);
        let rows = Rows::new(mesh)?;
        let state = State {
            time: 0.0,
            positions: rest.to_vec(),
            velocities: vec![DVec3::ZERO; n],
            multipliers: rows.multipliers.clone(),
            reactions: vec![DVec3::ZERO; n],
            supports: Supports::new(n),
            released: vec![[f64::NAN; 2]; mesh.edges().len()],
        };
        Ok(Self {
            masses: areas.iter().map(|a| a * material.density).collect(),
            rest_lengths: mesh.edges().iter().map(length).collect(),
            predictor: Predictor::new(n, &bending, mesh.edges())?,
            nodes: Nodes::new(n),
            supports: state.supports.clone(),
            contacts: Contacts::new(mesh, material.thickness),
            saved: vec![state.clone(); MAX_CUTS as usize + 2],
            held: Hold {
                is_held: vec![false; n],
                ..Hold::default()
            },
            start: rest.to_vec(),
            load: vec![DVec3::ZERO; n],
            forces: vec![DVec3::ZERO; n],
            stale: true,
            before: vec![DVec3::ZERO; n],
            aimed: vec![DVec3::ZERO; n],
            sines: vec![0.0; mesh.quads().len()],
            ends: vec![0.0; mesh.quads().len()],
            rates: vec![0.0; mesh.edges().len()],
            areas,
            bending,
            rows,
            state,
            settings,
            material,
        })
    }

    /// Forces that keep the held nodes where they are [N], one a node; zero where nothing is held.
    pub fn reactions(&self) -> &[DVec3] {
        &self.state.reactions
    }

    fn prepare(&mut self, h: f64) -> Result<bool, Error> {
        let predictor = &mut self.predictor;
        if predictor.h == h {
            return Ok(false);
        }
        let Material {
            density,
            damping,
            bending,
            internal_damping,
            ..
        } = self.material;
        // With this mass the midpoint rule decays by exp(-alpha h / rho), as drag does.
        let turn = 0.5 * h * damping / density;
        let exact = if turn > 0.0 { turn / turn.tanh() } else { 1.0 };
        let stiffness = bending * (0.5 + internal_damping / h);
        for (k, mass) in predictor.masses.iter_mut().enumerate() {
            *mass = self.masses[k] * exact;
            let diagonal = 2.0 * *mass / (h * h) + damping * self.areas[k] / h;
            self.nodes.set_inverse(k, 1.0 / diagonal);
        }
        for (value, &(r, c, k)) in predictor.constant.iter_mut().zip(&predictor.entries) {
            *value = stiffness * k;
            if r == c {
                *value += 1.0 / self.nodes.inverse(r as usize);
            }
        }
        predictor.h = h;
        Ok(true)
    }

    /// One substep from `time` to `time + h`, with the held nodes at `share` of their way at its end.
    fn substep(&mut self, h: f64, share: f64) -> Result<Ended, Error> {
        let new_length = self.prepare(h)?;
        let material = self.material;
        let n = self.masses.len();
        let law = ShearLaw {
            end: material.shear * (0.5 + material.internal_damping / h),
            start: material.shear * (0.5 - material.internal_damping / h),
        };
        let table = Surface {
            normal: DVec3::Z,
            offset: 0.0,
            motion: DVec3::ZERO,
            friction: material.friction_table,
        };
        self.start.copy_from_slice(&self.state.positions);
        self.nodes.reactions.copy_from_slice(&self.state.reactions);
        self.rows
            .multipliers
            .copy_from_slice(&self.state.multipliers);
        self.supports.copy_from(&self.state.supports);
        self.set_lengths(h);
        self.rows.sines(&self.start, &mut self.sines);
        for node in 0..n {
            self.nodes.kept[node] = match self.held.is_held[node] {
                true => Kept::Fixed,
                false => self.supports.tie(node, &table),
            };
            if self.nodes.kept[node] == Kept::Free {
                self.nodes.reactions[node] = DVec3::ZERO;
            }
        }

        // Load without the forces that are sought
        let weight = DVec3::NEG_Z * (material.gravitational_density * self.settings.gravity);
        for k in 0..n {
            self.load[k] = self.state.velocities[k] * (2.0 * self.predictor.masses[k] / h)
                + weight * self.areas[k]
                - self.bending.multiply_row(k, &self.start) * material.bending;
        }

        let slack = 0.1 / self.nodes.inverse(0);
        let taut = self.rows.tauten(slack);
        if taut || new_length {
            self.predictor.factor(self.rows.tautness())?;
        }
        let mut ended = Ended::default();
        let mut last_strain = f64::INFINITY;
        if self.nodes.looseness < 1.0 {
            self.nodes.looseness = 1.0;
            self.stale = true;
        }
        self.stale |= new_length;
        let (mut aim, mut last_moved, mut least) = (true, f64::INFINITY, f64::INFINITY);
        for iteration in 0..self.settings.iterations {
            ended.iterations += 1;
            // All forces, with gradients at the middle of the way
            if iteration == 0 {
                self.rows.set_gradients(&self.start, &self.start);
                self.aimed.copy_from_slice(&self.start);
            }
            self.forces.copy_from_slice(&self.load);
            self.rows.add_forces(&mut self.forces);
            self.rows
                .add_tautness(&self.start, &self.aimed, &mut self.forces);
            self.contacts.add_forces(&mut self.forces);
            self.supports.add_forces(&mut self.forces);
            for (force, reaction) in self.forces.iter_mut().zip(&self.nodes.reactions) {
                *force += *reaction;
            }
            let x = &mut self.state.positions;
            self.predictor.solve(&self.forces, &self.start, x);
            self.before.copy_from_slice(x);
            if iteration == 0 {
                let found = (self.contacts.covers(&self.start) && self.contacts.covers(x))
                    || self.contacts.find(&self.start, x);
                self.contacts.begin(&self.start, x, h);
                if !found {
                    return Err(Error::Crowded);
                }
            }

            // Hands and supports
            let mut changed = false;
            for (k, &node) in self.held.nodes.iter().enumerate() {
                let target = self.held.from[k].lerp(self.held.to[k], share);
                self.nodes
                    .place(node as usize, target, &mut x[node as usize]);
            }
            for node in 0..n {
                if !self.held.is_held[node] {
                    changed |= self.supports.update(
                        node,
                        &table,
                        self.start[node],
                        &mut x[node],
                        &mut self.nodes,
                        h,
                    );
                }
            }

            // Layers
            for _ in 0..2 {
                self.contacts
                    .sweep(x, &self.start, &mut self.nodes, material.friction_cloth);
            }

            // Stretch and shear
            if aim {
                self.aimed.copy_from_slice(x);
                self.rows.set_gradients(&self.start, x);
            }
            if changed || self.stale {
                self.rows.factor(&self.nodes, law)?;
                self.stale = false;
            }
            self.rows.correct(x, &self.sines, law, &mut self.forces);
            for (node, (x, force)) in x.iter_mut().zip(&self.forces).enumerate() {
                self.nodes.push(node, *force, x);
            }

            // How good that is
            ended.strain = self.rows.strain(x);
            let moved = x
                .iter()
                .zip(&self.before)
                .map(|(x, b)| x.distance_squared(*b))
                .fold(0.0, f64::max)
                .sqrt();
            let mut lack = self.contacts.lack(x) * 1e-3;
            for node in 0..n {
                if !self.held.is_held[node] {
                    lack = lack.max(
                        self.supports
                            .lack(node, &table, self.start[node], x[node], h),
                    );
                }
            }
            if ended.strain > 0.5 || (iteration > 2 && moved > 3.0 * least && moved > 1e-3) {
                return Err(Error::Diverged);
            }
            least = least.min(moved);
            aim = iteration < 2 || moved < 0.3 * last_moved;
            last_moved = moved;
            self.stale |=
                ended.strain > 0.3 * last_strain && ended.strain > 0.3 * self.settings.tolerance;
            // Only edges between sticking nodes are left: pull harder
            if ended.strain > 0.7 * last_strain && moved < SETTLED && iteration > 1 {
                self.nodes.looseness = (0.25 * self.nodes.looseness).max(0.01);
                self.stale = true;
            } else if self.nodes.looseness < 1.0 && moved > SETTLED {
                self.nodes.looseness = 1.0;
                self.stale = true;
            }
            last_strain = ended.strain;
            ended.residual = ended.strain;
            if std::env::var_os("TRACE").is_some() {
                eprintln!("   pairs {:?}", self.contacts.counts());
                let e = self.rest_lengths.len();
                let mx = |v: &[f64]| {
                    v.iter().enumerate().fold((0, 0.0f64), |m, (k, a)| {
                        if a.abs() > m.1 { (k, a.abs()) } else { m }
                    })
                };
                eprintln!(
                    "   lam e {:?} q {:?} R {:?}",
                    mx(&self.rows.multipliers[..e]),
                    mx(&self.rows.multipliers[e..]),
                    mx(&self
                        .nodes
                        .reactions
                        .iter()
                        .map(|r| r.length())
                        .collect::<Vec<_>>())
                );
                eprintln!(
                    "   it {iteration} strain {:.2e} moved {:.2e} lack {:.2e} changed {changed} contacts {}",
                    ended.strain,
                    moved,
                    lack,
                    self.contacts.active_count()
                );
            }
            if !x.iter().all(|x| x.is_finite()) {
                return Err(Error::Diverged);
            }
            if ended.strain <= self.settings.tolerance && lack <= 1e-7 && moved <= 1e-5 {
                break;
            }
        }

        // The way there must be free
        let x = &self.state.positions;
        if !self.contacts.covers(x) && !self.contacts.find(&self.start, x) {
            return Err(Error::Crowded);
        }
        let passage = self.contacts.passage(&self.start, x);
        ended.free = passage.free;
        ended.gap = passage.gap;
        self.rows.sines(x, &mut self.ends);
        ended.shear = self.ends.iter().fold(0.0, |m: f64, s| m.max(s.abs()));
        self.set_velocities(h, &table)?;
        self.state
            .multipliers
            .copy_from_slice(&self.rows.multipliers);
        self.state.reactions.copy_from_slice(&self.nodes.reactions);
        self.state.supports.copy_from(&self.supports);
        self.state.time += h;
        Ok(ended)
    }

    /// `v_1 = 2 (x_1 - x_0)/h - v_0`, then impacts, then no velocity along the edges.
    fn set_velocities(&mut self, h: f64, table: &Surface) -> Result<(), Error> {
        let State {
            positions,
            velocities,
            ..
        } = &mut self.state;
        for ((v, x), start) in velocities.iter_mut().zip(&*positions).zip(&self.start) {
            *v = (*x - *start) * (2.0 / h) - *v;
        }
        for (node, v) in velocities.iter_mut().enumerate() {
            *v = match self.held.is_held[node] {
                true => (positions[node] - self.start[node]) / h,
                false => self.supports.impact(node, table, *v, h),
            };
        }
        for _ in 0..2 {
            self.contacts.impact(velocities, &mut self.nodes);
        }
        self.rows
            .correct_velocities(positions, velocities, &self.rates, &mut self.forces);
        for (node, (v, impulse)) in velocities.iter_mut().zip(&self.forces).enumerate() {
            *v += self.nodes.respond(node, *impulse);
        }
        Ok(())
    }

    /// Which edges are imposed and how long they are to be at the end of a substep.
    fn set_lengths(&mut self, h: f64) {
        let end = self.state.time + h;
        let held = &self.held.is_held;
        for e in 0..self.rest_lengths.len() {
            let [p, q] = self.rows.edges()[e].map(|k| k as usize);
            let exempt = held[p] && held[q];
            self.rows.set_exempt(e, exempt);
            self.rates[e] = 0.0;
            let rest = self.rest_lengths[e];
            let released = &mut self.state.released[e];
            if exempt {
                let length = self.start[p].distance(self.start[q]);
                *released = [length, self.state.time];
                continue;
            }
            let [length, since] = *released;
            if length.is_nan() {
                continue;
            }
            let part = |time: f64| ((time - since) / RECOVERY).clamp(0.0, 1.0);
            let smooth = |s: f64| s * s * s * (10.0 + s * (6.0 * s - 15.0));
            let at = |time: f64| length + (rest - length) * smooth(part(time));
            self.rows.set_length(e, at(end));
            self.rates[e] = (at(end) - at(end - h)) / h;
            if part(end) >= 1.0 {
                self.rows.set_length(e, rest);
                *released = [f64::NAN; 2];
            }
        }
        for k in 0..self.rows.quads().len() {
            let number = self.rows.quads()[k]
                .iter()
                .filter(|&&n| held[n as usize])
                .count();
            self.rows
                .set_exempt(self.rest_lengths.len() + k, number > 2);
        }
    }

    /// A substep, cut in two as often as it fails.
    fn advance(
        &mut self,
        h: f64,
        from: f64,
        to: f64,
        cuts: u32,
        report: &mut StepReport,
    ) -> Result<(), Error> {
        let depth = cuts as usize;
        let mut saved = std::mem::take(&mut self.saved);
        saved[depth].copy_from(&self.state);
        self.saved = saved;
        let outcome = self.substep(h, to);
        let good =
            matches!(&outcome, Ok(e) if e.free >= 1.0 && e.strain <= 2.0 * self.settings.tolerance);
        if std::env::var_os("TRACE").is_some() {
            eprintln!("h {h:.2e} t {:.4} {outcome:?}", self.state.time);
        }
        if let Ok(e) = &outcome {
            report.iterations += e.iterations;
            if good || cuts >= MAX_CUTS {
                let most = |a: Option<f64>, b: f64| Some(a.map_or(b, |a| a.max(b)));
                report.strain = most(report.strain, e.strain);
                report.shear = most(report.shear, e.shear);
                if let Some(gap) = e.gap {
                    report.gap = Some(report.gap.map_or(gap, |g| g.min(gap)));
                }
                if !good {
                    report.status = Status::IterationLimit {
                        residual: e.residual,
                        tolerance: self.settings.tolerance,
                    };
                }
                return Ok(());
            }
        }
        self.contacts.restore();
        if cuts >= MAX_CUTS {
            outcome?;
        }
        let saved = std::mem::take(&mut self.saved);
        self.state.copy_from(&saved[depth]);
        self.saved = saved;
        self.stale = true;
        let middle = 0.5 * (from + to);
        self.advance(0.5 * h, from, middle, cuts + 1, report)?;
        self.advance(0.5 * h, middle, to, cuts + 1, report)
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
        held.check(self.state.positions.len())?;
        SimulatorError::check_time_step(dt)?;
        let mut report = StepReport::default();
        self.stale |= self.held.nodes != held.nodes;
        self.held.is_held.fill(false);
        self.held.nodes.clear();
        self.held.from.clear();
        self.held.to.clear();
        for (&node, &target) in held.nodes.iter().zip(held.targets) {
            self.held.is_held[node as usize] = true;
            self.held.nodes.push(node);
            self.held.from.push(self.state.positions[node as usize]);
            self.held
                .to
                .push(target.max(DVec3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, 0.0)));
            self.state.supports.release(node as usize);
        }
        let count = (dt / self.settings.substep - 1e-9).ceil().max(1.0);
        let h = dt / count;
        for k in 0..count as u32 {
            let (from, to) = (f64::from(k) / count, f64::from(k + 1) / count);
            self.advance(h, from, to, 0, &mut report)
                .map_err(|e| SimulatorError::Failed(e.into()))?;
        }
        report.contacts = self.contacts.active_count() as u32;
        report.held_error = held
            .nodes
            .iter()
            .zip(held.targets)
            .map(|(&node, target)| self.state.positions[node as usize].distance(*target))
            .fold(0.0, f64::max);
        Ok(report)
    }

    fn reset(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<(), SimulatorError> {
        SimulatorError::check_state(self.state.positions.len(), positions, velocities)?;
        self.state.positions.copy_from_slice(positions);
        self.state.velocities.copy_from_slice(velocities);
        self.state.multipliers.fill(0.0);
        self.state.reactions.fill(DVec3::ZERO);
        self.state.supports.clear();
        self.state.released.fill([f64::NAN; 2]);
        self.state.time = 0.0;
        self.contacts.clear();
        Ok(())
    }
}

/// Area share of each node [m^2]: a quarter of every quad and a third of every triangle around it.
fn areas(mesh: &Mesh) -> Vec<f64> {
    let rest = mesh.rest();
    let mut areas = vec![0.0; mesh.node_count()];
    for quad in mesh.quads() {
        let [a, b, c, d] = quad.map(|k| rest[k as usize]);
        let area = 0.5 * (c - a).cross(d - b).length();
        for &node in quad {
            areas[node as usize] += area / 4.0;
        }
    }
    areas
}
