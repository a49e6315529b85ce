//! Cloth on cloth: the forces between features that are near.
//!
//! The faces are cut into triangles along one diagonal of each quad. Layers keep a distance of one
//! thickness, by two kinds of pairs, a node over a triangle and two crossing edges. A pair near
//! enough becomes a contact with the normal and the weights `w` of its nearest points at the start of
//! the substep:
//!
//! `g = n . sum w x - d >= 0`, `r >= 0`, `g r = 0`; friction `|f| <= mu r`, opposite to the relative
//! displacement, equal to it while sliding (Coulomb).

use selvedge_math::DVec3;

use crate::Mesh;
use crate::distance::{Course, Kind, combine, distance, weights};
use crate::nodes::{Kept, Nodes};
use crate::pairs::{Pair, Pairs, shortest_edge};
use crate::support::Surface;
use crate::surroundings::Part;

/// A pair is a contact when it may come so near the thickness within a substep [m].
const MARGIN: f64 = 5e-4;
/// How fast layers that are too near are moved apart [m/s].
const RECOVERY: f64 = 0.05;
/// The distance of a pair may shrink to this share in a substep.
const LEAST_SHARE: f64 = 0.1;
/// A node belongs to a triangle when its foot point is at most so far outside, in weights.
const OUTSIDE: f64 = 0.02;
/// Edges that are nearly parallel have no common normal; nodes over triangles separate them.
const CROSSING: f64 = 0.05;
/// Mobility is none, as a share of that of free nodes, that makes nodes move much further along their
/// ties than the contact asks for.
const LEVER: f64 = 0.01;
/// Contacts are kept as they are while no node has moved further [m].
const STILL: f64 = 5e-6;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Contact {
    pair: Pair,
    /// Table or obstacle, for contacts with these: they have no nodes on their second side.
    ground: Option<Ground>,
    weights: [f64; 4],
    normal: DVec3,
    /// What `n . sum w x` must be at least [m].
    distance: f64,
    /// Normal force [N].
    force: f64,
    friction: DVec3,
    sliding: bool,
}

/// The other side of a contact with table or obstacle.
#[derive(Clone, Copy, Debug)]
struct Ground {
    /// Which surface and which feature of it.
    key: [u32; 2],
    /// How far it moves in the substep [m].
    motion: DVec3,
    friction: f64,
}

impl Contact {
    /// A node on a surface.
    pub(crate) fn on_surface(node: u32, surface: &Surface) -> Self {
        Self::on_part([node; 3], [1.0, 0.0, 0.0], surface, 0)
    }

    /// An edge or a face on a feature of an obstacle.
    pub(crate) fn on_part(
        [a, b, c]: [u32; 3],
        weights: [f64; 3],
        surface: &Surface,
        feature: u32,
    ) -> Self {
        Self {
            pair: Pair {
                kind: Kind::NodeTriangle,
                nodes: [a, b, c, c],
            },
            ground: Some(Ground {
                key: [surface.id, feature],
                motion: surface.motion,
                friction: surface.friction,
            }),
            weights: [weights[0], weights[1], weights[2], 0.0],
            normal: surface.normal,
            distance: surface.offset,
            force: 0.0,
            friction: DVec3::ZERO,
            sliding: false,
        }
    }

    fn key(&self) -> (Pair, Option<[u32; 2]>) {
        (self.pair, self.ground.map(|ground| ground.key))
    }

    fn motion(&self) -> DVec3 {
        self.ground.map_or(DVec3::ZERO, |ground| ground.motion)
    }

    fn is_lone_node(&self) -> bool {
        self.pair.nodes[0] == self.pair.nodes[1]
    }
}

/// Pairs and contacts of a cloth with itself.
#[derive(Debug)]
pub(crate) struct Contacts {
    thickness: f64,
    pairs: Pairs,
    contacts: Vec<Contact>,
    before: Vec<Contact>,
    /// Forces before the present substep, where the contacts stayed.
    forces: Vec<(f64, DVec3, bool)>,
    /// Positions that the contacts were made for, and whether they are those of the present pairs.
    seen: Vec<DVec3>,
    fresh: bool,
    /// Whether no node has moved since.
    still: bool,
    gap: Option<f64>,
}

/// How the pairs stand after a substep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Passage {
    /// Share of the way that is free of collisions.
    pub(crate) free: f64,
    /// Smallest distance of two features less the thickness [m], of those that are near.
    pub(crate) gap: Option<f64>,
}

impl Contacts {
    pub(crate) fn new(mesh: &Mesh, thickness: f64) -> Self {
        // Neighbours that share no node are at least one edge apart.
        let thickness = thickness.min(0.5 * shortest_edge(mesh));
        Self {
            thickness,
            pairs: Pairs::new(mesh, thickness + MARGIN),
            contacts: Vec::new(),
            before: Vec::new(),
            forces: Vec::new(),
            seen: mesh.rest().to_vec(),
            fresh: false,
            still: false,
            gap: None,
        }
    }

    pub(crate) fn active_count(&self) -> usize {
        self.contacts.iter().filter(|c| c.force > 0.0).count()
    }

    /// Goes back to the contacts before the last [`begin`](Self::begin).
    pub(crate) fn restore(&mut self) {
        if self.still {
            for (contact, &(force, friction, sliding)) in self.contacts.iter_mut().zip(&self.forces)
            {
                (contact.force, contact.friction, contact.sliding) = (force, friction, sliding);
            }
        } else {
            std::mem::swap(&mut self.contacts, &mut self.before);
        }
        self.fresh = false;
    }

    /// The contacts with their forces.
    pub(crate) fn list(&self) -> &[Contact] {
        &self.contacts
    }

    /// Goes on from such contacts.
    pub(crate) fn set_list(&mut self, contacts: &[Contact]) {
        self.contacts.clear();
        self.contacts.extend_from_slice(contacts);
    }

    /// Pairs are looked for anew.
    pub(crate) fn forget(&mut self) {
        self.fresh = false;
        self.pairs.forget();
    }

    /// Forgets all contacts.
    pub(crate) fn clear(&mut self) {
        self.contacts.clear();
        self.fresh = false;
    }

    /// Makes sure that the pairs are those of a substep of `h` [s] from `now` [s] on, on whose way the
    /// nodes go from `x` to `end`; false when there are too many, or a way is not finite.
    pub(crate) fn look(&mut self, way: [&[DVec3]; 2], now: f64, h: f64) -> bool {
        self.pairs.covers(way, now, h) || {
            self.fresh = false;
            self.pairs.find(way, now, h)
        }
    }

    /// All edges and faces.
    pub(crate) fn parts(&self) -> impl Iterator<Item = Part> + Clone + '_ {
        self.pairs.parts()
    }

    /// Makes contacts of the pairs that may touch in a substep of `h` [s], and adds those `on_ground`;
    /// those that were contacts before keep their forces.
    pub(crate) fn begin(
        &mut self,
        x: &[DVec3],
        guess: &[DVec3],
        h: f64,
        on_ground: &[Contact],
        ground_moves: bool,
    ) {
        let far = |(at, now): (&DVec3, &DVec3)| at.distance_squared(*now) > STILL * STILL;
        self.still = self.fresh
            && !ground_moves
            && !self.seen.iter().zip(x).any(far)
            && !self.seen.iter().zip(guess).any(far);
        if self.still {
            self.forces.clear();
            let forces = self
                .contacts
                .iter()
                .map(|c| (c.force, c.friction, c.sliding));
            self.forces.extend(forces);
            return;
        }
        self.seen.copy_from_slice(x);
        self.fresh = true;
        std::mem::swap(&mut self.contacts, &mut self.before);
        self.contacts.clear();
        for pair in self.pairs.near() {
            let at = pair.nodes.map(|k| x[k as usize]);
            let ahead = pair.nodes.map(|k| guess[k as usize]);
            if !near(pair.kind, &at, &ahead, self.thickness + MARGIN) {
                continue;
            }
            let Some((weights, normal, distance)) = touch(pair.kind, &at) else {
                continue;
            };
            let way = [0, 1, 2, 3].map(|k| ahead[k] - at[k]);
            let approach = normal.dot(combine(&weights, &way));
            if distance.min(distance + approach) > self.thickness + MARGIN {
                continue;
            }
            self.contacts.push(Contact {
                pair: *pair,
                ground: None,
                weights,
                normal,
                distance: self.thickness.min(distance + RECOVERY * h),
                force: 0.0,
                friction: DVec3::ZERO,
                sliding: false,
            });
        }
        self.contacts.extend_from_slice(on_ground);
        self.contacts.sort_unstable_by_key(Contact::key);
        let mut old = self.before.iter().peekable();
        for contact in &mut self.contacts {
            while old.next_if(|c| c.key() < contact.key()).is_some() {}
            if let Some(same) = old.next_if(|c| c.key() == contact.key()) {
                contact.force = same.force;
                contact.friction =
                    same.friction - contact.normal * contact.normal.dot(same.friction);
                contact.sliding = same.sliding;
            }
        }
    }

    /// Adds the forces of the contacts [N].
    pub(crate) fn add_forces(&self, forces: &mut [DVec3]) {
        for c in self.contacts.iter().filter(|c| c.force > 0.0) {
            let force = c.normal * c.force + c.friction;
            for (&node, &weight) in c.pair.nodes.iter().zip(&c.weights) {
                forces[node as usize] += force * weight;
            }
        }
    }

    /// One sweep over the contacts at the positions `x`, displaced from `start`.
    pub(crate) fn sweep(
        &mut self,
        x: &mut [DVec3],
        start: &[DVec3],
        nodes: &mut Nodes,
        friction: f64,
    ) {
        for c in &mut self.contacts {
            let ids = c.pair.nodes.map(|k| k as usize);
            let between = combine(&c.weights, &ids.map(|k| x[k]));
            let gap = c.normal.dot(between) - c.distance;
            if gap >= 0.0 && c.force == 0.0 {
                continue;
            }
            let mut mobility = [0.0; 2];
            for (&k, w) in ids.iter().zip(c.weights) {
                let along = c.normal.dot(nodes.respond(k, c.normal));
                mobility[0] += w * w * along;
                mobility[1] += w * w * nodes.mobility(k);
            }
            let inverse = |(&k, w): (&usize, f64)| w * w * nodes.inverse(k);
            let least = LEVER * ids.iter().zip(c.weights).map(inverse).sum::<f64>();
            if c.ground.is_some() && mobility[0] <= least {
                // Nodes that stick: press on, until they slide or leave.
                let along = |(&k, w): (&usize, f64)| w * w * nodes.prospect_along(k, c.normal);
                mobility[0] = ids.iter().zip(c.weights).map(along).sum();
            }
            if mobility[0] <= least {
                // Between hands and supports: no penetration comes before targets
                let held = |k: usize| {
                    if nodes.kept[k] == Kept::Fixed {
                        1.0
                    } else {
                        0.0
                    }
                };
                let weights = [0, 1, 2, 3].map(|k| c.weights[k] * held(ids[k]));
                let [sum, all] = [weights, c.weights].map(|w| w.iter().map(|w| w * w).sum::<f64>());
                if sum > LEVER * all && gap < 0.0 {
                    for (&k, w) in ids.iter().zip(weights) {
                        let shift = c.normal * (-gap * w / sum);
                        x[k] += shift;
                        nodes.yielded[k] += shift;
                    }
                }
                continue;
            }
            let force = (c.force - gap / mobility[0]).max(0.0);
            let mut change = c.normal * (force - c.force);
            c.force = force;

            // Friction against the relative displacement over the substep
            let bound = c.ground.map_or(friction, |ground| ground.friction) * force;
            let mut wanted = DVec3::ZERO;
            if bound > 0.0 && mobility[1] > 0.0 {
                let slip = between - combine(&c.weights, &ids.map(|k| start[k])) - c.motion();
                let slip = slip - c.normal * c.normal.dot(slip);
                wanted = c.friction - slip / mobility[1];
                let size = wanted.length();
                c.sliding = size > bound;
                if c.sliding {
                    wanted *= bound / size;
                }
            }
            change += wanted - c.friction;
            c.friction = wanted;
            for (&k, w) in ids.iter().zip(c.weights) {
                nodes.push(k, change * w, &mut x[k]);
            }
        }
    }

    /// Largest distance that a contact lacks at `x` [m]; obstacles have no thickness to spare, so
    /// with them it counts five times, that of nodes more.
    pub(crate) fn lack(&self, x: &[DVec3]) -> f64 {
        let lack = |c: &Contact| {
            let at = combine(&c.weights, &c.pair.nodes.map(|k| x[k as usize]));
            let lack = c.distance - c.normal.dot(at);
            match c.ground {
                None => lack,
                Some(_) if c.is_lone_node() => 300.0 * lack,
                Some(_) => 5.0 * lack,
            }
        };
        self.contacts.iter().map(lack).fold(0.0, f64::max)
    }

    /// Impacts without rebound: contacts with a force get no relative velocity along their normal,
    /// those that stick none at all.
    pub(crate) fn impact(&self, velocities: &mut [DVec3], nodes: &mut Nodes, h: f64) {
        for c in self.contacts.iter().filter(|c| c.force > 0.0) {
            let ids = c.pair.nodes.map(|k| k as usize);
            let relative = combine(&c.weights, &ids.map(|k| velocities[k])) - c.motion() / h;
            let (mut along, mut across) = (0.0, 0.0);
            for (&k, w) in ids.iter().zip(c.weights) {
                along += w * w * c.normal.dot(nodes.respond(k, c.normal));
                across += w * w * nodes.mobility(k);
            }
            if along <= LEVER * across {
                continue;
            }
            let normal = c.normal * c.normal.dot(relative);
            let mut impulse = -normal / along;
            if !c.sliding && across > 0.0 {
                impulse -= (relative - normal) / across;
            }
            for (&k, w) in ids.iter().zip(c.weights) {
                velocities[k] += nodes.respond(k, impulse * w);
            }
        }
    }

    /// Follows every pair along its way from `start` to `end`.
    pub(crate) fn passage(&mut self, start: &[DVec3], end: &[DVec3]) -> Passage {
        let near_seen = |(at, now): (&DVec3, &DVec3)| at.distance_squared(*now) <= STILL * STILL;
        if self.still && self.seen.iter().zip(end).all(near_seen) {
            // Everything is where it was, to a small part of the smallest distance.
            if self
                .gap
                .is_none_or(|gap| gap + self.thickness > 8.0 * STILL)
            {
                return Passage {
                    free: 1.0,
                    gap: self.gap,
                };
            }
        }
        let mut passage = Passage {
            free: 1.0,
            gap: None,
        };
        let mut least = f64::INFINITY;
        for pair in self.pairs.near() {
            let (a, b) = (
                pair.nodes.map(|k| start[k as usize]),
                pair.nodes.map(|k| end[k as usize]),
            );
            if !near(pair.kind, &a, &b, self.thickness + MARGIN) {
                continue;
            }
            let course = Course::new(pair.kind, &a, &b);
            passage.free = passage.free.min(course.free(LEAST_SHARE));
            if course.at_start - course.bound < least {
                least = least.min(distance(pair.kind, &b));
            }
        }
        if least.is_finite() {
            passage.gap = Some(least - self.thickness);
        }
        self.gap = passage.gap;
        passage
    }
}

/// Whether the boxes around the ways of the two features come within `reach`: a cheap test that
/// leaves out most pairs.
#[inline]
fn near(kind: Kind, start: &[DVec3; 4], end: &[DVec3; 4], reach: f64) -> bool {
    let low = |k: usize| start[k].min(end[k]);
    let high = |k: usize| start[k].max(end[k]);
    let (first, second) = match kind {
        Kind::NodeTriangle => (
            (low(0), high(0)),
            (
                low(1).min(low(2)).min(low(3)),
                high(1).max(high(2)).max(high(3)),
            ),
        ),
        Kind::EdgeEdge => (
            (low(0).min(low(1)), high(0).max(high(1))),
            (low(2).min(low(3)), high(2).max(high(3))),
        ),
    };
    (first.0 - reach).cmple(second.1).all() && (second.0 - reach).cmple(first.1).all()
}

/// Weights, normal and distance of a pair that can touch: none when the nearest points are on a
/// border that belongs to other pairs.
fn touch(kind: Kind, x: &[DVec3; 4]) -> Option<([f64; 4], DVec3, f64)> {
    match kind {
        Kind::NodeTriangle => {
            let (ab, ac, ap) = (x[2] - x[1], x[3] - x[1], x[0] - x[1]);
            let cross = ab.cross(ac);
            let area = cross.length_squared();
            let v = ap.cross(ac).dot(cross) / area;
            let w = ab.cross(ap).dot(cross) / area;
            let inside = v.min(w).min(1.0 - v - w);
            if inside.is_nan() || inside <= -OUTSIDE {
                return None;
            }
            let normal = cross / area.sqrt();
            let height = normal.dot(ap);
            let normal = if height < 0.0 { -normal } else { normal };
            Some(([1.0, v + w - 1.0, -v, -w], normal, height.abs()))
        }
        Kind::EdgeEdge => {
            let (u, v) = (x[1] - x[0], x[3] - x[2]);
            let sine_squared = u.cross(v).length_squared();
            if sine_squared < CROSSING * CROSSING * u.length_squared() * v.length_squared() {
                return None;
            }
            let weights = weights(kind, x);
            if weights[0].min(weights[1]) <= 0.0 || weights[2].max(weights[3]) >= 0.0 {
                return None;
            }
            let between = combine(&weights, x);
            let distance = between.length();
            (distance > 0.0).then(|| (weights, between / distance, distance))
        }
    }
}
