//! The default solver as its users see it.

use selvedge_math::{ClothSimulator, DVec3, Held, Pose, SimulatorError, Status, StepReport};

use crate::bending::{Matrix, bending_matrix};
use crate::contact::{Contact, Contacts};
use crate::hands::{Hands, Reach};
use crate::linear::Threads;
use crate::nodes::Nodes;
use crate::predictor::Predictor;
use crate::rows::Rows;
use crate::state::{Instant, State};
use crate::substep::Ended;
use crate::support::{Supports, Surface};
use crate::surroundings::Surroundings;
use crate::{Error, Material, Mesh, Obstacle, Settings};

/// A substep that fails is cut in two, at most so often.
const MAX_CUTS: u32 = 6;

/// A mesh is fine when in the longest substep bending resists a single node this many times as much as
/// its mass.
const FINE: f64 = 3.0;
/// On fine meshes, a substep with more than this share of the most iterations is hard: the next ones are cut in two
/// beforehand, since two of half the length need fewer together.
const HARD: f64 = 0.25;
/// One with at most this share is easy, ...
const EASY: f64 = 0.1;
/// ... and after so many of them the next are longer again, ...
pub(crate) const PATIENCE: u32 = 4;
/// ... after four times as many each time that longer ones turned out hard, but no more than this: one that is
/// costs as much as ten short ones.
const MOST_PATIENCE: u32 = 64;
/// Substeps are cut beforehand at most so often.
const MAX_CUTS_BEFOREHAND: u32 = 4;

/// After so many cuts, hands that want what the cloth cannot follow are taken for what fails, and held
/// back.
const CUTS_BEFORE_RETREAT: u32 = 2;
/// How they are: less and less of what each goes of its own, then altogether, in the end backwards.
const RETREATS: [Reach; 7] = [
    Reach::WHOLE,
    Reach {
        common: 1.0,
        own: 0.3,
    },
    Reach {
        common: 1.0,
        own: 0.03,
    },
    Reach {
        common: 1.0,
        own: 0.0,
    },
    Reach::even(0.5),
    Reach::even(0.0),
    Reach::even(-0.5),
];

/// Layers may come too near by this share of a thickness before a substep is cut.
const MOST_TOO_NEAR: f64 = 0.2;

/// A node may end so far below the table before a substep is cut [m].
const MOST_SUNK: f64 = 1e-5;

/// Tension may stretch edges by so much before it is taken for more than a cloth can bear.
const MOST_STRAIN: f64 = 5e-4;

/// An inextensible cloth.
///
/// ```
/// use selvedge_cloth::{Material, Mesh, Settings, Simulator};
/// use selvedge_math::{ClothSimulator, DVec3, Held};
///
/// let mesh = Mesh::grid([7, 9], [0.12, 0.16])?;
/// let mut cloth = Simulator::new(&mesh, Material::default(), Settings::default())?;
/// // Lift a corner by 3 mm in each of ten steps.
/// for step in 1..=10 {
///     let target = mesh.rest()[62] + DVec3::Z * 0.003 * f64::from(step);
///     let held = Held { nodes: &[62], targets: &[target], velocities: &[DVec3::Z * 0.18] };
///     let report = cloth.step(held, 1.0 / 60.0)?;
///     assert!(report.strain < Some(1e-4) && report.held_error < 1e-9);
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct Simulator {
    pub(crate) settings: Settings,
    pub(crate) material: Material,
    rest: Vec<DVec3>,
    pub(crate) areas: Vec<f64>,
    pub(crate) rest_lengths: Vec<f64>,
    pub(crate) bending: Matrix,
    pub(crate) rows: Rows,
    pub(crate) nodes: Nodes,
    pub(crate) supports: Supports,
    pub(crate) contacts: Contacts,
    pub(crate) surroundings: Surroundings,
    pub(crate) predictor: Predictor,
    pub(crate) now: Instant,
    pub(crate) hands: Hands,
    pub(crate) external: Vec<DVec3>,
    /// Whether the mesh is fine, see [`FINE`].
    pub(crate) fine: bool,
    /// Whether the factor of the rows is too old.
    pub(crate) stale: bool,
    saved: Vec<Instant>,
    pinned: Vec<u32>,
    pub(crate) scratch: Scratch,
}

/// Buffers of a substep.
#[derive(Clone, Debug)]
pub(crate) struct Scratch {
    pub(crate) start: Vec<DVec3>,
    /// Where the nodes would be at their present velocities.
    pub(crate) straight: Vec<DVec3>,
    pub(crate) load: Vec<DVec3>,
    pub(crate) forces: Vec<DVec3>,
    pub(crate) free: Vec<DVec3>,
    pub(crate) aimed: Vec<DVec3>,
    pub(crate) last: Vec<DVec3>,
    pub(crate) surfaces: Vec<Surface>,
    pub(crate) on_ground: Vec<Contact>,
    pub(crate) sines: Vec<f64>,
    pub(crate) end_sines: Vec<f64>,
    pub(crate) length_rates: Vec<f64>,
}

impl Simulator {
    /// A cloth at rest in its mesh's positions.
    ///
    /// # Errors
    /// [`Error`] when a value is outside its bounds.
    pub fn new(mesh: &Mesh, material: Material, settings: Settings) -> Result<Self, Error> {
        material.check()?;
        settings.check()?;
        let (n, rest) = (mesh.node_count(), mesh.rest());
        let length = |e: &[u32; 2]| rest[e[0] as usize].distance(rest[e[1] as usize]);
        let bending = bending_matrix(mesh);
        let rows = Rows::new(mesh)?;
        let now = Instant::new(rest, mesh.edges().len(), rows.multipliers.len());
        let zero = vec![DVec3::ZERO; n];
        let fine = {
            let h = settings.substep;
            let mass = 2.0 * material.density / (h * h) + material.damping / h;
            let stiffness = material.bending * (0.5 + material.internal_damping / h);
            let area: f64 = areas(mesh).iter().sum();
            stiffness * bending.trace() > FINE * mass * area
        };
        Ok(Self {
            fine,
            rest: rest.to_vec(),
            areas: areas(mesh),
            rest_lengths: mesh.edges().iter().map(length).collect(),
            predictor: Predictor::new(n, &bending, mesh.edges())?,
            nodes: Nodes::new(n),
            supports: Supports::new(n),
            contacts: Contacts::new(mesh, material.thickness),
            surroundings: Surroundings::default(),
            saved: vec![now.clone(); MAX_CUTS as usize + 2],
            hands: Hands::new(n),
            external: zero.clone(),
            stale: true,
            pinned: Vec::new(),
            scratch: Scratch {
                start: zero.clone(),
                straight: zero.clone(),
                load: zero.clone(),
                forces: zero.clone(),
                free: zero.clone(),
                aimed: zero.clone(),
                last: zero,
                surfaces: vec![Surface::NONE; n],
                on_ground: Vec::new(),
                sines: vec![0.0; mesh.quads().len()],
                end_sines: vec![0.0; mesh.quads().len()],
                length_rates: vec![0.0; mesh.edges().len()],
            },
            bending,
            rows,
            now,
            settings,
            material,
        })
    }

    /// Time since the start [s].
    pub fn time(&self) -> f64 {
        self.now.time
    }

    /// The force [N] on each node of whatever keeps it, at the end of the last substep: hands, pins,
    /// and the surface it rests on, the friction of sliding nodes apart; zero for free nodes. The
    /// force on a gripper is the sum over its nodes with the opposite sign, the torque that of
    /// `(x - p) x f`.
    pub fn reactions(&self) -> &[DVec3] {
        &self.now.reactions
    }

    /// Forces from outside [N], one a node, constant until they are changed: wind, a magnet, a hand
    /// that pushes.
    pub fn forces_mut(&mut self) -> &mut [DVec3] {
        &mut self.external
    }

    /// From now on a step uses so many threads for what is large enough: factors and solves of some
    /// thousand nodes. The results are the same to the bit with any number.
    ///
    /// # Errors
    /// [`Error::Threads`] when there are none, or the system has no more.
    pub fn set_threads(&mut self, count: usize) -> Result<(), Error> {
        let threads = Threads::new(count)?;
        self.rows.set_threads(&threads);
        self.predictor.set_threads(&threads);
        Ok(())
    }

    /// Pins nodes where they are, instead of those pinned before.
    ///
    /// # Errors
    /// [`Error::NoSuchNode`] when one of them is no node of the cloth.
    pub fn pin(&mut self, nodes: &[u32]) -> Result<(), Error> {
        let node_count = self.areas.len();
        if let Some(&node) = nodes.iter().find(|&&node| node as usize >= node_count) {
            return Err(Error::NoSuchNode { node, node_count });
        }
        self.pinned.clear();
        self.pinned.extend_from_slice(nodes);
        self.pinned.sort_unstable();
        self.pinned.dedup();
        Ok(())
    }

    /// Puts an obstacle beside those there are, at its pose, and returns its number.
    ///
    /// What of the cloth is inside of it is moved out at 5 cm/s; the report's gap is negative until
    /// then.
    ///
    /// # Errors
    /// [`Error::Value`] when there are too many to be numbered.
    pub fn add_obstacle(&mut self, obstacle: Obstacle) -> Result<usize, Error> {
        self.forget();
        self.surroundings.add(obstacle)
    }

    /// Says where an obstacle is at the end of the next step. It goes there along a straight line at
    /// constant speed, turning about one axis at a constant rate, and rests then.
    ///
    /// # Errors
    /// [`Error::NoSuchObstacle`] when there is no obstacle of this number.
    pub fn move_obstacle(&mut self, k: usize, pose: Pose) -> Result<(), Error> {
        self.surroundings.set_target(k, pose)
    }

    /// The obstacles, with their poses at the end of the last step.
    pub fn obstacles(&self) -> &[Obstacle] {
        self.surroundings.obstacles()
    }

    /// The present state, whole.
    pub fn save(&mut self) -> State {
        self.forget();
        State {
            instant: self.now.clone(),
            contacts: self.contacts.list().to_vec(),
            poses: self.surroundings.poses(),
        }
    }

    /// Goes back to a state of a cloth of this mesh. Obstacles that it does not know stay where they
    /// are.
    ///
    /// # Errors
    /// [`SimulatorError::StateLength`] when it is of another mesh.
    pub fn restore(&mut self, state: &State) -> Result<(), SimulatorError> {
        let Instant {
            positions,
            velocities,
            multipliers,
            ..
        } = &state.instant;
        SimulatorError::check_state(self.areas.len(), positions, velocities)?;
        if multipliers.len() != self.now.multipliers.len() {
            return Err(SimulatorError::StateLength {
                node_count: self.areas.len(),
                positions: positions.len(),
                velocities: velocities.len(),
            });
        }
        self.now.copy_from(&state.instant);
        self.contacts.set_list(&state.contacts);
        self.surroundings.set_poses(&state.poses);
        self.forget();
        Ok(())
    }

    /// Factors and pairs are made anew, so that what comes next depends on the state only.
    fn forget(&mut self) {
        self.stale = true;
        self.rows.forget();
        self.predictor.forget();
        self.contacts.forget();
    }

    fn set_hands(&mut self, held: Held<'_>, dt: f64) {
        let hands = &mut self.hands;
        let same = hands.take(held, &self.pinned, &self.now.positions, dt);
        self.stale |= !same;
        if !same {
            self.rows.forget();
        }
        for &node in &hands.nodes {
            self.now.supports.release(node as usize);
        }
        let tolerance = self.settings.tolerance;
        hands.draw_in(&self.rest, self.rows.edges(), &self.rest_lengths, tolerance);
    }

    /// A substep from the share `from` of the step to `to`, cut in two as often as it fails, and
    /// beforehand as often as the last ones had to be.
    fn advance(
        &mut self,
        h: f64,
        [from, to]: [f64; 2],
        cuts: u32,
        report: &mut StepReport,
    ) -> Result<(), Error> {
        if cuts < self.now.cuts {
            return self.halves(h, [from, to], cuts, report);
        }
        self.saved[cuts as usize].copy_from(&self.now);
        self.surroundings.set_way([from, to]);
        // Once a substep of the step is lost, the others are not cut to the last either.
        let lost = report.status != Status::Converged;
        let last = cuts >= if lost { CUTS_BEFORE_RETREAT } else { MAX_CUTS };
        let retreats = match cuts >= CUTS_BEFORE_RETREAT && !self.hands.nodes.is_empty() {
            true => &RETREATS[..],
            false => &RETREATS[..1],
        };
        let tolerance = self.settings.tolerance;
        let (mut failure, mut residual) = (None, f64::INFINITY);
        for &reach in retreats {
            let outcome = self.substep(h, to, reach, last);
            if let Ok(Some(ended)) = &outcome {
                report.iterations += ended.iterations;
                residual = residual.min(ended.strain);
                let good = self.is_good(ended, cuts, reach);
                if good || (last && ended.strain <= self.bearable(cuts)) {
                    self.plan(cuts, ended.iterations);
                    add(report, ended);
                    if !good {
                        let residual = ended.strain;
                        report.status = Status::IterationLimit {
                            residual,
                            tolerance,
                        };
                    }
                    return Ok(());
                }
            }
            failure = outcome.err();
            self.now.copy_from(&self.saved[cuts as usize]);
            self.contacts.restore();
            self.stale = true;
        }
        if !last {
            self.plan(cuts, u32::MAX);
            return self.halves(h, [from, to], cuts, report);
        }
        if let Some(error) = failure {
            return Err(error);
        }
        // Nothing goes: the cloth stands still for once, and forgets its forces.
        self.now.velocities.fill(DVec3::ZERO);
        self.now.multipliers.fill(0.0);
        self.now.reactions.fill(DVec3::ZERO);
        self.now.time += h;
        self.contacts.clear();
        report.status = Status::IterationLimit {
            residual,
            tolerance,
        };
        Ok(())
    }

    /// Whether a substep ended on its constraints.
    fn is_good(&self, ended: &Ended, cuts: u32, reach: Reach) -> bool {
        let thickness = self.material.thickness;
        let worse = self.saved[cuts as usize].gap - 1e-2 * thickness;
        let near = ended
            .gap
            .is_some_and(|gap| gap < -MOST_TOO_NEAR * thickness && gap < worse);
        // The less hands go of their own, the more there must be a way on.
        let most_strain = MOST_STRAIN * (1.8 - 0.8 * reach.own.max(0.0));
        let solved = ended.unsolved <= 2.0 * self.settings.tolerance && ended.strain <= most_strain;
        ended.free >= 1.0 && solved && !near && ended.sunk <= MOST_SUNK
    }

    /// Strain that a substep may end with as a last resort: what it started with may be more.
    fn bearable(&self, cuts: u32) -> f64 {
        let before = &self.saved[cuts as usize].positions;
        let before = self.rows.strain(before, &self.nodes).largest;
        before.max(2.0 * MOST_STRAIN)
    }

    /// The same as two substeps of half the length.
    fn halves(
        &mut self,
        h: f64,
        [from, to]: [f64; 2],
        cuts: u32,
        report: &mut StepReport,
    ) -> Result<(), Error> {
        let middle = 0.5 * (from + to);
        self.advance(0.5 * h, [from, middle], cuts + 1, report)?;
        self.advance(0.5 * h, [middle, to], cuts + 1, report)
    }

    /// Decides how often the next substeps are cut beforehand, after one that was cut `cuts` times.
    fn plan(&mut self, cuts: u32, iterations: u32) {
        let now = &mut self.now;
        let share = f64::from(iterations) / f64::from(self.settings.iterations);
        now.easy = if share <= EASY { now.easy + 1 } else { 0 };
        if share > HARD && self.fine {
            if cuts < now.hard {
                now.patience = (4 * now.patience).min(MOST_PATIENCE);
            }
            now.cuts = (cuts + 1).min(MAX_CUTS_BEFOREHAND);
            now.hard = now.cuts;
        } else if now.easy >= now.patience {
            now.cuts = cuts.saturating_sub(1).min(MAX_CUTS_BEFOREHAND);
            now.easy = 0;
        }
    }
}

/// Adds what a substep ended with to the report of its step.
fn add(report: &mut StepReport, ended: &Ended) {
    let most = |a: Option<f64>, b: f64| Some(a.map_or(b, |a| a.max(b)));
    report.strain = most(report.strain, ended.strain);
    report.shear = most(report.shear, ended.shear);
    if let Some(gap) = ended.gap {
        report.gap = Some(report.gap.map_or(gap, |g| g.min(gap)));
    }
}

impl ClothSimulator for Simulator {
    fn positions(&self) -> &[DVec3] {
        &self.now.positions
    }

    fn velocities(&self) -> &[DVec3] {
        &self.now.velocities
    }

    fn step(&mut self, held: Held<'_>, dt: f64) -> Result<StepReport, SimulatorError> {
        held.check(self.now.positions.len())?;
        SimulatorError::check_time_step(dt)?;
        if let Some(node) = self.external.iter().position(|f| !f.is_finite()) {
            return Err(SimulatorError::NotFinite { node });
        }
        self.saved[MAX_CUTS as usize + 1].copy_from(&self.now);
        self.set_hands(held, dt);
        let mut report = StepReport::default();
        let count = (dt / self.settings.substep - 1e-9).ceil().max(1.0);
        for k in 0..count as u32 {
            let way = [f64::from(k) / count, f64::from(k + 1) / count];
            if let Err(error) = self.advance(dt / count, way, 0, &mut report) {
                self.now.copy_from(&self.saved[MAX_CUTS as usize + 1]);
                self.contacts.clear();
                self.forget();
                return Err(SimulatorError::Failed(error.into()));
            }
        }
        self.surroundings.arrive();
        report.contacts = self.contacts.active_count() as u32;
        report.held_error = held
            .nodes
            .iter()
            .zip(held.targets)
            .map(|(&node, target)| self.now.positions[node as usize].distance(*target))
            .fold(0.0, f64::max);
        Ok(report)
    }

    fn reset(&mut self, positions: &[DVec3], velocities: &[DVec3]) -> Result<(), SimulatorError> {
        SimulatorError::check_state(self.now.positions.len(), positions, velocities)?;
        let (edges, rows) = (self.rest_lengths.len(), self.now.multipliers.len());
        let mut start = Instant::new(positions, edges, rows);
        start.velocities.copy_from_slice(velocities);
        self.now = start;
        self.contacts.clear();
        self.hands.release();
        self.rows.set_lengths(&self.rest_lengths);
        self.forget();
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
    for triangle in mesh.triangles() {
        let [a, b, c] = triangle.map(|k| rest[k as usize]);
        let area = 0.5 * (b - a).cross(c - a).length();
        for &node in triangle {
            areas[node as usize] += area / 3.0;
        }
    }
    areas
}
