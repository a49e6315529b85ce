//! One substep, told in its steps.
//!
//! With `u = x_1 - x_0` and `v_1 = 2 u/h - v_0` the implicit midpoint rule is
//!
//! `E u = 2 M v_0/h - delta g A e_z - kappa K x_0 + J(x_m)^T lambda + contact forces`,
//! `E = 2 M/h^2 + alpha A/h + (1/2 + b/h) kappa K`, `x_m = (x_0 + x_1)/2`,
//!
//! with forces such that at the end edges have their length, hands have what they hold where they
//! want it, nothing is below a surface or nearer to another layer than a thickness, and friction is
//! Coulomb's.
//!
//! An iteration solves for `u - h v_0` with the present forces (`E` is factored once), then corrects the
//! forces: ties of hands and supports first, contacts between layers by a sweep, stretch and shear by
//! one Newton step of all rows together. The corrections see the masses only; what bending makes of
//! them comes with the next solve. So every substep ends on its constraints, and the iterations are
//! there to make the forces right.

use selvedge_math::DVec3;

use crate::hands::Reach;
use crate::nodes::Kept;
use crate::rows::{ShearLaw, Strain};
use crate::support::Surface;
use crate::{Error, RECOVERY, Simulator};

/// The iterations have converged when no free node is so far below a surface [m] ...
const SUNK: f64 = 1e-7;
/// ... and no layers are so much too near, which are a thickness apart [m].
const TOO_NEAR: f64 = 1e-4;

/// The factor of the rows is too old when an iteration leaves more than this share of the strain.
const OLD: f64 = 0.3;
/// Corrections of the rows alone after an iteration that moved nothing.
const MORE: usize = 3;

/// Tension is new when it resists by this share of what a node resists otherwise more or less than before.
const TAUTER: f64 = 0.1;

/// Velocities are left alone when no edge gets longer faster than this [m/s].
const STILL: f64 = 1e-8;
/// Edges that get longer more slowly are corrected no better for it [m/s].
const SLOW: f64 = 1e-4;

/// An old factor will do for velocities when it leaves no more than this share of the rates at which edges get longer;
/// on fine meshes, where a new one takes long, this.
const ENOUGH: f64 = 0.3;
const ENOUGH_FINE: f64 = 0.5;

/// How a substep ended.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Ended {
    pub(crate) iterations: u32,
    pub(crate) strain: f64,
    /// The part of the strain that is no answer to tension.
    pub(crate) unsolved: f64,
    pub(crate) shear: f64,
    pub(crate) gap: Option<f64>,
    /// How far a free node is below the table [m].
    pub(crate) sunk: f64,
    /// Share of the way without collisions.
    pub(crate) free: f64,
}

impl Simulator {
    /// One substep of `h` [s]. Hands go as far as `reach` says of their way, at whose end they are at
    /// `share` of the step's. The last resort is to go only as far as nothing collides. None when the
    /// iterations went astray.
    pub(crate) fn substep(
        &mut self,
        h: f64,
        share: f64,
        reach: Reach,
        last: bool,
    ) -> Result<Option<Ended>, Error> {
        let law = self.begin(h)?;
        self.hands.set_targets(&self.scratch.start, share, reach);
        let n = self.areas.len();
        let mut ended = Ended::default();
        let (mut aim, mut last_strain) = (true, f64::INFINITY);
        let (mut last_moved, mut least_moved) = (f64::INFINITY, f64::INFINITY);
        let mut last_change = f64::NAN;
        // A substep that cannot be cut any further may take its time.
        let most = self.settings.iterations * if last { 5 } else { 1 };
        for iteration in 0..most {
            ended.iterations += 1;
            self.solve();
            let mut changed = false;
            if iteration == 0 {
                changed |= self.set_surfaces(h, share);
                self.find_contacts(h)?;
            } else if !self.surroundings.is_empty() {
                if iteration == 2 {
                    self.set_lifts();
                }
                changed |= self.refresh_surfaces(h);
            }
            changed |= self.correct_ties();
            let (start, x) = (&self.scratch.start, &mut self.now.positions);
            for _ in 0..2 {
                self.contacts
                    .sweep(x, start, &mut self.nodes, self.material.friction_cloth);
            }

            // Stretch and shear; forces point along the middle of the way as long as that converges
            if aim {
                self.scratch.aimed.copy_from_slice(x);
                self.rows.set_gradients(start, x);
            }
            // With a fine mesh on the table an older factor will do; on obstacles nodes would sink in.
            let renew = changed && !(self.fine && self.surroundings.is_empty());
            if self.stale || renew {
                self.rows.factor(&self.nodes, law)?;
                self.stale = false;
            }
            let mut strain = self.correct_rows(law);

            // How good that is
            let x = &self.now.positions;
            // The forces still change where they do not matter: what counts is where the nodes go, as
            // far as can be told from how the changes shrink
            let change = farthest(x, &self.scratch.last);
            let ratio = (change / last_change).min(0.99);
            let left = if ratio.is_nan() {
                f64::INFINITY
            } else {
                change * ratio / (1.0 - ratio)
            };
            let moved = farthest(x, &self.scratch.free).min(left.max(0.1 * change));
            last_change = change;
            self.scratch.last.copy_from_slice(x);
            if !(moved.is_finite() && strain.largest < 0.5)
                || (!last && iteration > 2 && moved > 3.0 * least_moved && moved > 1e-3)
            {
                return Ok(None);
            }
            // Once nodes stay where they are, the rest of the strain needs no whole iterations; on
            // obstacles it does, since they would slide too easily
            let stays = moved <= self.settings.settled && self.surroundings.is_empty();
            let more = if stays { MORE } else { 0 };
            for _ in 0..more {
                let before = strain.open;
                if before <= self.settings.tolerance {
                    break;
                }
                strain = self.correct_rows(law);
                if strain.open > 0.7 * before {
                    break;
                }
            }
            (ended.strain, ended.unsolved) = (strain.largest, strain.unsolved);
            let (x, open) = (&self.now.positions, strain.open);
            let sunk = (0..n)
                .filter(|&node| !self.hands.is_held[node])
                .map(|node| {
                    self.supports
                        .lack(node, &self.scratch.surfaces[node], x[node])
                })
                .fold(0.0, f64::max);
            // Planes of obstacles are tangents only: their bodies are looked at on the way.
            ended.sunk = if self.surroundings.is_empty() {
                sunk
            } else {
                0.0
            };
            if open <= self.settings.tolerance
                && moved <= self.settings.settled
                && sunk <= SUNK
                && self.contacts.lack(x) <= TOO_NEAR
            {
                break;
            }

            // What the next iteration does
            if open > 0.7 * last_strain && moved < self.settings.settled && iteration > 1 {
                // Only edges of sticking nodes are left: pull harder
                self.nodes.looseness = (0.25 * self.nodes.looseness).max(0.01);
                self.stale = true;
            } else if self.nodes.looseness < 1.0 && moved > self.settings.settled {
                self.nodes.looseness = 1.0;
                self.stale = true;
            }
            self.stale |= open > OLD * last_strain && open > self.settings.tolerance;
            aim = iteration < 2 || moved < 0.3 * last_moved;
            least_moved = least_moved.min(moved);
            (last_moved, last_strain) = (moved, open);
        }
        self.end(h, law, last, &mut ended)?;
        Ok(Some(ended))
    }

    /// Sets up what stays the same through the iterations.
    fn begin(&mut self, h: f64) -> Result<ShearLaw, Error> {
        let material = self.material;
        let scratch = &mut self.scratch;
        scratch.start.copy_from_slice(&self.now.positions);
        scratch.aimed.copy_from_slice(&self.now.positions);
        scratch.last.fill(DVec3::INFINITY);
        self.nodes.reactions.copy_from_slice(&self.now.reactions);
        self.nodes.yielded.fill(DVec3::ZERO);
        self.rows.multipliers.copy_from_slice(&self.now.multipliers);
        self.supports.copy_from(&self.now.supports);
        self.set_lengths(h);
        self.rows
            .sines(&self.scratch.start, &mut self.scratch.sines);

        // Ties as they were
        for node in 0..self.areas.len() {
            let kept = match self.hands.is_held[node] {
                true => Kept::Fixed,
                false => self.supports.tie(node, &self.scratch.surfaces[node]),
            };
            self.nodes.kept[node] = kept;
            if kept == Kept::Free {
                self.nodes.reactions[node] = DVec3::ZERO;
            }
        }
        if self.nodes.looseness < 1.0 {
            self.nodes.looseness = 1.0;
            self.stale = true;
        }

        // Matrices
        let new = self
            .predictor
            .prepare(h, &material, &self.areas, &mut self.nodes);
        self.stale |= new;
        let resistance = match self.fine {
            true => self.predictor.resistance,
            false => 1.0 / self.nodes.inverse(0),
        };
        if self.rows.tauten(TAUTER * resistance) || new {
            self.predictor
                .factor(self.rows.tautness(), &self.hands.nodes)?;
        }

        // Load without the forces that are sought, less what takes the nodes straight on
        let scratch = &mut self.scratch;
        let lag = 0.5 * h + material.internal_damping;
        for (k, v) in self.now.velocities.iter().enumerate() {
            scratch.straight[k] = scratch.start[k] + *v * h;
            scratch.forces[k] = scratch.start[k] + *v * lag;
        }
        let weight = material.gravitational_density * self.settings.gravity;
        for (k, load) in scratch.load.iter_mut().enumerate() {
            let drag = self.now.velocities[k] * material.damping + DVec3::Z * weight;
            *load = self.external[k]
                - drag * self.areas[k]
                - self.bending.multiply_row(k, &scratch.forces) * material.bending;
        }
        self.rows.set_gradients(&scratch.start, &scratch.start);
        Ok(ShearLaw {
            end: material.shear * (0.5 + material.internal_damping / h),
            start: material.shear * (0.5 - material.internal_damping / h),
        })
    }

    /// Where a held node is to be, the hands' number `k`.
    fn target(&self, k: usize) -> DVec3 {
        let node = self.hands.nodes[k] as usize;
        // No penetration comes before targets.
        let target = self.hands.targets[k] + self.nodes.yielded[node];
        self.scratch.surfaces[node].lift(target)
    }

    /// The positions that the present forces give.
    fn solve(&mut self) {
        let scratch = &mut self.scratch;
        let forces = &mut scratch.forces;
        forces.copy_from_slice(&scratch.load);
        self.rows.add_forces(forces);
        self.rows
            .add_tautness(&scratch.straight, &scratch.aimed, forces);
        self.contacts.add_forces(forces);
        self.supports.add_forces(forces);
        for (force, reaction) in forces.iter_mut().zip(&self.nodes.reactions) {
            *force += *reaction;
        }
        for k in 0..self.hands.nodes.len() {
            let (node, target) = (self.hands.nodes[k] as usize, self.target(k));
            let way = target - self.scratch.straight[node];
            self.scratch.forces[node] += way * self.predictor.grip(node);
        }
        let (scratch, x) = (&self.scratch, &mut self.now.positions);
        self.predictor.solve(&scratch.forces, &scratch.straight, x);
        for k in 0..self.hands.nodes.len() {
            let (node, target) = (self.hands.nodes[k] as usize, self.target(k));
            let left = target - self.now.positions[node];
            self.nodes.reactions[node] += left * self.predictor.grip(node);
        }
        self.scratch.free.copy_from_slice(&self.now.positions);
    }

    fn table(&self, start: DVec3, h: f64) -> Surface {
        match self.settings.table {
            true => Surface::table(start, h, self.material.friction_table),
            false => Surface::NONE,
        }
    }

    /// The surface that each node may come to in this substep; true when one has to leave its own
    /// for that.
    fn set_surfaces(&mut self, h: f64, share: f64) -> bool {
        let empty = self.surroundings.is_empty();
        if !empty {
            self.set_lifts();
        }
        let mut changed = false;
        for node in 0..self.areas.len() {
            let start = self.scratch.start[node];
            let mut surface = self.table(start, h);
            if !empty && !self.hands.is_held[node] {
                let before = self.scratch.surfaces[node];
                let before = self.supports.rests_on(node, &before).then_some(before);
                let way = [start, self.now.positions[node]];
                surface = self.surroundings.surface(node, surface, before, way, h);
                changed |= self.supports.change(node, surface.id, &mut self.nodes);
            }
            self.scratch.surfaces[node] = surface;
        }
        for (k, &node) in self.hands.nodes.iter().enumerate() {
            let target = self.hands.from[k].lerp(self.hands.to[k], share);
            let way = [self.scratch.start[node as usize], target];
            let surface = &mut self.scratch.surfaces[node as usize];
            *surface = self
                .surroundings
                .surface(node as usize, *surface, None, way, h);
        }
        changed
    }

    fn set_lifts(&mut self) {
        let way = [&*self.scratch.start, &*self.now.positions];
        self.surroundings.set_lifts(way, self.contacts.parts());
    }

    /// The same for what turned out otherwise than predicted.
    fn refresh_surfaces(&mut self, h: f64) -> bool {
        let mut changed = false;
        for node in 0..self.areas.len() {
            let way = [self.scratch.start[node], self.now.positions[node]];
            let surface = &mut self.scratch.surfaces[node];
            if let (false, Some(new)) = (
                self.hands.is_held[node],
                self.surroundings.refresh(
                    node,
                    surface,
                    self.supports.rests_on(node, surface),
                    way,
                    h,
                ),
            ) {
                *surface = new;
                changed |= self.supports.change(node, new.id, &mut self.nodes);
            }
        }
        changed
    }

    fn find_contacts(&mut self, h: f64) -> Result<(), Error> {
        let way = [&*self.scratch.start, &*self.now.positions];
        let now = self.now.time;
        let found = self.contacts.look(way, now, h);
        if !self.surroundings.is_empty() {
            let mut on_ground = std::mem::take(&mut self.scratch.on_ground);
            let (way, parts) = (
                [&*self.scratch.start, &*self.now.positions],
                self.contacts.parts(),
            );
            let table = |start| self.table(start, h);
            self.surroundings.contacts(
                table,
                &self.scratch.surfaces,
                way,
                parts,
                h,
                &mut on_ground,
            );
            self.scratch.on_ground = on_ground;
        }
        self.contacts.begin(
            &self.scratch.start,
            &self.now.positions,
            h,
            &self.scratch.on_ground,
            self.surroundings.moves(),
        );
        if found { Ok(()) } else { Err(Error::Crowded) }
    }

    /// Puts held nodes where they belong and lets every other node rest, slide or leave; true when
    /// one left its surface.
    fn correct_ties(&mut self) -> bool {
        for k in 0..self.hands.nodes.len() {
            let (node, target) = (self.hands.nodes[k] as usize, self.target(k));
            self.nodes
                .place(node, target, &mut self.now.positions[node]);
        }
        let (scratch, x) = (&self.scratch, &mut self.now.positions);
        let mut changed = false;
        for (node, x) in x.iter_mut().enumerate() {
            if !self.hands.is_held[node] {
                let (surface, start) = (&scratch.surfaces[node], scratch.start[node]);
                changed |= self
                    .supports
                    .update(node, surface, start, x, &mut self.nodes);
            }
        }
        changed
    }

    /// One correction of stretch and shear; the strain that is left.
    fn correct_rows(&mut self, law: ShearLaw) -> Strain {
        let (x, forces) = (&mut self.now.positions, &mut self.scratch.forces);
        self.rows.correct(x, &self.scratch.sines, law, forces);
        for (node, (x, force)) in x.iter_mut().zip(&*forces).enumerate() {
            self.nodes.push(node, *force, x);
        }
        self.rows.strain(x, &self.nodes)
    }

    /// Looks for collisions on the way and sets the velocities.
    fn end(&mut self, h: f64, law: ShearLaw, last: bool, ended: &mut Ended) -> Result<(), Error> {
        let (start, x) = (&self.scratch.start, &mut self.now.positions);
        let (way, now) = ([&**start, &**x], self.now.time);
        if !self.contacts.look(way, now, h) {
            return Err(Error::Crowded);
        }
        let passage = self.contacts.passage(start, x);
        ended.free = passage.free;
        ended.gap = match ended.sunk > SUNK {
            true => Some(passage.gap.map_or(-ended.sunk, |gap| gap.min(-ended.sunk))),
            false => passage.gap,
        };
        if !self.surroundings.is_empty() {
            let clearance = self
                .surroundings
                .clearance([start, x], self.contacts.parts());
            ended.free = ended.free.min(clearance.free);
            ended.gap = match (ended.gap, clearance.gap) {
                (Some(a), Some(b)) => Some(a.min(b)),
                (a, b) => a.or(b),
            };
        }
        if ended.free < 1.0 && last {
            for (x, start) in x.iter_mut().zip(start) {
                *x = start.lerp(*x, 0.9 * ended.free);
            }
            let strain = self.rows.strain(x, &self.nodes);
            (ended.strain, ended.unsolved) = (strain.largest, strain.unsolved);
        }
        self.rows.sines(x, &mut self.scratch.end_sines);
        ended.shear = self
            .scratch
            .end_sines
            .iter()
            .fold(0.0, |m: f64, s| m.max(s.abs()));
        self.set_velocities(h, law)?;
        self.now.multipliers.copy_from_slice(&self.rows.multipliers);
        self.now.reactions.copy_from_slice(&self.nodes.reactions);
        self.now.supports.copy_from(&self.supports);
        self.now.gap = ended.gap.unwrap_or(0.0).min(0.0);
        self.now.time += h;
        Ok(())
    }

    /// `v_1 = 2 u/h - v_0`, then impacts without rebound, then no velocity along the edges: what the
    /// positions do not allow, the velocities must not have.
    fn set_velocities(&mut self, h: f64, law: ShearLaw) -> Result<(), Error> {
        let (x, velocities) = (&self.now.positions, &mut self.now.velocities);
        let scratch = &mut self.scratch;
        for (node, v) in velocities.iter_mut().enumerate() {
            let u = x[node] - scratch.start[node];
            *v = match self.hands.is_held[node] {
                true => u / h,
                false => {
                    let free = u * (2.0 / h) - *v;
                    self.supports.impact(node, &scratch.surfaces[node], free, h)
                }
            };
        }
        for _ in 0..2 {
            self.contacts.impact(velocities, &mut self.nodes, h);
        }
        self.rows.set_gradients(x, x);
        let rates = &scratch.length_rates;
        let before = self.rows.stretch_rate(velocities, rates);
        if before <= STILL {
            return Ok(());
        }
        scratch.free.copy_from_slice(velocities);
        let enough = if self.fine { ENOUGH_FINE } else { ENOUGH };
        for fresh in [false, true] {
            if fresh {
                self.rows.factor(&self.nodes, law)?;
            }
            self.rows
                .correct_velocities(velocities, rates, &mut scratch.forces);
            for (node, (v, impulse)) in velocities.iter_mut().zip(&scratch.forces).enumerate() {
                *v += self.nodes.respond(node, *impulse);
            }
            // The last factor may be that of too different a shape.
            if self.rows.stretch_rate(velocities, rates) <= enough * before.max(SLOW) {
                return Ok(());
            }
            velocities.copy_from_slice(&scratch.free);
        }
        Ok(())
    }

    /// Which edges are imposed and how long they are to be at the end of the substep.
    ///
    /// No inextensible edge can follow a squeeze: edges between two held nodes are not imposed. Once
    /// released they get their length back over [`RECOVERY`], by a smooth step.
    fn set_lengths(&mut self, h: f64) {
        let end = self.now.time + h;
        let (held, start) = (&self.hands.is_held, &self.scratch.start);
        let edge_count = self.rest_lengths.len();
        for e in 0..edge_count {
            let [p, q] = self.rows.edges()[e].map(|k| k as usize);
            let exempt = held[p] && held[q];
            self.rows.set_exempt(e, exempt);
            self.scratch.length_rates[e] = 0.0;
            let rest = self.rest_lengths[e];
            let released = &mut self.now.released[e];
            if exempt {
                *released = [start[p].distance(start[q]), self.now.time];
                continue;
            }
            let [length, since] = *released;
            if length.is_nan() {
                continue;
            }
            let at = |time: f64| {
                let s = ((time - since) / RECOVERY).clamp(0.0, 1.0);
                length + (rest - length) * (s * s * s * (10.0 + s * (6.0 * s - 15.0)))
            };
            self.rows.set_length(e, at(end));
            self.scratch.length_rates[e] = (at(end) - at(end - h)) / h;
            if end >= since + RECOVERY {
                self.rows.set_length(e, rest);
                *released = [f64::NAN; 2];
            }
        }
        for k in 0..self.rows.quads().len() {
            let count = self.rows.quads()[k]
                .iter()
                .filter(|&&node| held[node as usize])
                .count();
            self.rows.set_exempt(edge_count + k, count > 2);
        }
    }
}

/// Largest distance between a node's two positions [m].
fn farthest(a: &[DVec3], b: &[DVec3]) -> f64 {
    let squared = a.iter().zip(b).map(|(a, b)| a.distance_squared(*b));
    squared.fold(0.0, f64::max).sqrt()
}
