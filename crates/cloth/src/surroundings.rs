//! The obstacles of a simulation, where they are in a substep, and what the cloth finds there.

use selvedge_math::{DMat3, DVec3, Pose};

use crate::Error;
use crate::broad::Bounds;
use crate::contact::Contact;
use crate::obstacle::Obstacle;
use crate::shape::{Shape, Tangent};
use crate::support::{RECOVERY, Surface};
use crate::touch::mix;

/// A node has the plane of an obstacle when it may come so near within a substep [m].
const REACH: f64 = 2e-3;
/// A touch is a contact when it may come so near within a substep [m].
const MARGIN: f64 = 5e-4;
/// A node changes from a surface that it rests on to another one that it is deeper in by this [m].
const RELUCTANCE: f64 = 1e-6;
/// Nodes are at most so deep inside at the end of a substep [m].
const SUNK: f64 = 1e-6;
/// The most obstacles.
const MOST: usize = 65_536;
/// The surface of the first obstacle; those below are none and the table.
const FIRST: u32 = Surface::TABLE + 1;

/// Obstacles and their way in the present step and substep.
#[derive(Debug, Default)]
pub(crate) struct Surroundings {
    /// With their poses at the start of the step.
    obstacles: Vec<Obstacle>,
    /// Their poses at its end.
    targets: Vec<Pose>,
    placed: Vec<Placed>,
    /// How far above a round obstacle each node stays, so that edges and faces are not inside [m].
    lifts: Vec<Vec<f64>>,
}

/// Whether a part of the cloth is an edge or a face, and its nodes, see `touch`.
pub(crate) type Part = (bool, [u32; 3]);

/// Where an obstacle is in a substep.
#[derive(Clone, Copy, Debug)]
struct Placed {
    start: Frame,
    end: Frame,
    /// Around its way; none if it is everywhere.
    bounds: Option<Bounds>,
}

#[derive(Clone, Copy, Debug)]
struct Frame {
    position: DVec3,
    rotation: DMat3,
}

impl Frame {
    fn new(pose: Pose) -> Self {
        Self {
            position: pose.position(),
            rotation: pose.rotation_matrix(),
        }
    }

    fn world(&self, local: DVec3) -> DVec3 {
        self.position + self.rotation * local
    }

    fn local(&self, world: DVec3) -> DVec3 {
        self.rotation.transpose() * (world - self.position)
    }
}

impl Placed {
    fn new(shape: &Shape, from: Pose, to: Pose) -> Self {
        let (start, end) = (Frame::new(from), Frame::new(to));
        let bounds = shape.bounds().map(|local| {
            let (middle, half) = (
                0.5 * (local.low + local.high),
                0.5 * (local.high - local.low),
            );
            let around = |frame: &Frame| {
                let r = &frame.rotation;
                let half =
                    r.x_axis.abs() * half.x + r.y_axis.abs() * half.y + r.z_axis.abs() * half.z;
                let middle = frame.world(middle);
                Bounds {
                    low: middle - half,
                    high: middle + half,
                }
            };
            around(&start).join(&around(&end))
        });
        Self { start, end, bounds }
    }

    fn is_near(&self, low: DVec3, high: DVec3) -> bool {
        self.bounds
            .is_none_or(|b| b.low.cmple(high).all() && low.cmple(b.high).all())
    }

    /// How far a point of the obstacle moves.
    fn motion(&self, local: DVec3) -> DVec3 {
        self.end.world(local) - self.start.world(local)
    }
}

/// How the obstacles stand to the cloth after a substep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Clearance {
    /// Share of the way on which nothing gets too deep.
    pub(crate) free: f64,
    /// Smallest distance [m] of what is near, negative inside.
    pub(crate) gap: Option<f64>,
}

impl Surroundings {
    pub(crate) fn obstacles(&self) -> &[Obstacle] {
        &self.obstacles
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.obstacles.is_empty()
    }

    pub(crate) fn add(&mut self, obstacle: Obstacle) -> Result<usize, Error> {
        let count = self.obstacles.len();
        if count >= MOST {
            return Err(Error::Value {
                field: "number of obstacles",
                value: count as f64 + 1.0,
                bound: "at most 65536",
            });
        }
        self.targets.push(obstacle.pose);
        self.placed
            .push(Placed::new(&obstacle.shape, obstacle.pose, obstacle.pose));
        self.lifts.push(Vec::new());
        self.obstacles.push(obstacle);
        Ok(count)
    }

    /// Says where an obstacle is at the end of the step.
    pub(crate) fn set_target(&mut self, k: usize, pose: Pose) -> Result<(), Error> {
        let count = self.targets.len();
        let target = self.targets.get_mut(k);
        *target.ok_or(Error::NoSuchObstacle { obstacle: k, count })? = pose;
        Ok(())
    }

    /// Poses at the start and at the end of the step, one pair an obstacle.
    pub(crate) fn poses(&self) -> Vec<[Pose; 2]> {
        let pairs = self.obstacles.iter().zip(&self.targets);
        pairs.map(|(o, target)| [o.pose, *target]).collect()
    }

    pub(crate) fn set_poses(&mut self, poses: &[[Pose; 2]]) {
        for ((o, target), &[from, to]) in
            self.obstacles.iter_mut().zip(&mut self.targets).zip(poses)
        {
            (o.pose, *target) = (from, to);
        }
    }

    /// The step is over: every obstacle is where it was to go.
    pub(crate) fn arrive(&mut self) {
        for (o, target) in self.obstacles.iter_mut().zip(&self.targets) {
            o.pose = *target;
        }
    }

    /// Sets the share of the step that the substep is.
    pub(crate) fn set_way(&mut self, [from, to]: [f64; 2]) {
        for ((o, target), placed) in self
            .obstacles
            .iter()
            .zip(&self.targets)
            .zip(&mut self.placed)
        {
            let at = |share| match o.pose == *target {
                true => o.pose,
                false => between(&o.pose, target, share),
            };
            *placed = Placed::new(&o.shape, at(from), at(to));
        }
    }

    /// Whether an obstacle moves in the step.
    pub(crate) fn moves(&self) -> bool {
        let mut pairs = self.obstacles.iter().zip(&self.targets);
        pairs.any(|(o, target)| o.pose != *target)
    }

    /// How far above an obstacle a node stays [m].
    fn lift(&self, k: usize, node: usize) -> f64 {
        self.lifts[k].get(node).copied().unwrap_or(0.0)
    }

    /// The obstacles that a node may come to on its way.
    fn each_near<'a>(
        &'a self,
        node: usize,
        [start, ahead]: [DVec3; 2],
    ) -> impl Iterator<Item = (usize, &'a Obstacle, &'a Placed)> + 'a {
        let reach = REACH + start.distance(ahead);
        let (low, high) = (start.min(ahead) - reach, start.max(ahead) + reach);
        let all = self.obstacles.iter().zip(&self.placed).enumerate();
        all.filter(move |&(k, (_, placed))| {
            let lift = self.lift(k, node);
            placed.is_near(low - lift, high + lift)
        })
        .map(|(k, (obstacle, placed))| (k, obstacle, placed))
    }

    /// The surface that a node at `start` comes to on its way to `ahead`: of the table and the
    /// obstacles that are near, the one that it would be deepest in. `before` is the one that it
    /// rested on, which it keeps when none is deeper.
    pub(crate) fn surface(
        &self,
        node: usize,
        table: Surface,
        before: Option<Surface>,
        [start, ahead]: [DVec3; 2],
        h: f64,
    ) -> Surface {
        let depth = |surface: &Surface| {
            let kept = before.is_some_and(|before| before.id == surface.id);
            surface.offset - surface.normal.dot(ahead) + if kept { RELUCTANCE } else { 0.0 }
        };
        let (mut best, mut deepest) = (table, depth(&table));
        for (k, ..) in self.each_near(node, [start, ahead]) {
            let before = before.map(|before| before.end_normal);
            let surface = self.plane(k, node, [start, ahead], before, h);
            if depth(&surface) > deepest {
                (best, deepest) = (surface, depth(&surface));
            }
        }
        best
    }

    /// The same in a later iteration. A node that rests keeps its surface, which turns with it if it
    /// is round; one that does not takes another if it is inside of that.
    pub(crate) fn refresh(
        &self,
        node: usize,
        now: &Surface,
        rests: bool,
        [start, ahead]: [DVec3; 2],
        h: f64,
    ) -> Option<Surface> {
        let (mut best, mut deepest) = (None, now.offset - now.normal.dot(ahead));
        deepest = deepest.max(0.0) + RELUCTANCE;
        for (k, obstacle, _) in self.each_near(node, [start, ahead]) {
            let round = matches!(obstacle.shape, Shape::Round { .. });
            if (id(k) == now.id && !round) || (id(k) != now.id && rests) {
                continue;
            }
            let surface = self.plane(k, node, [start, ahead], None, h);
            let depth = surface.offset - surface.normal.dot(ahead);
            if (id(k) == now.id && best.is_none()) || depth > deepest {
                best = Some(surface);
                deepest = deepest.max(depth);
            }
        }
        best
    }

    /// The plane of an obstacle for a node.
    fn plane(
        &self,
        k: usize,
        node: usize,
        [start, end]: [DVec3; 2],
        before: Option<DVec3>,
        h: f64,
    ) -> Surface {
        let (obstacle, placed) = (&self.obstacles[k], &self.placed[k]);
        let lift = self.lift(k, node);
        let before = before.map(|normal| placed.start.rotation.transpose() * normal);

        let Tangent {
            point,
            normal,
            end_normal,
            distance,
        } = obstacle.shape.tangent(
            placed.start.local(start),
            placed.end.local(end),
            before,
            lift,
        );
        let normal = placed.end.rotation * normal;
        // What starts inside is moved out gently.
        let depth = (-distance - RECOVERY * h).max(0.0);
        Surface {
            normal,
            end_normal: placed.end.rotation * end_normal,
            offset: normal.dot(placed.end.world(point)) - depth,
            motion: placed.motion(point),
            friction: obstacle.friction(),
            id: id(k),
        }
    }

    /// Sets how far nodes stay above round obstacles. With an edge or a face moved along the normal
    /// at its nearest point until it just touches, its nodes are as far from the obstacle as they must
    /// be; so the ties of nodes keep edges and faces out too.
    pub(crate) fn set_lifts(
        &mut self,
        [start, ahead]: [&[DVec3]; 2],
        parts: impl Iterator<Item = Part> + Clone,
    ) {
        for ((obstacle, placed), lifts) in
            self.obstacles.iter().zip(&self.placed).zip(&mut self.lifts)
        {
            if !matches!(obstacle.shape, Shape::Round { .. }) {
                continue;
            }
            lifts.clear();
            lifts.resize(start.len(), 0.0);
            for (is_edge, part) in parts.clone() {
                let (at, to) = (pick(&part, start), pick(&part, ahead));
                let (low, high) = around(&at, &to);
                if !placed.is_near(low - REACH, high + REACH) {
                    continue;
                }
                let at = at.map(|x| placed.start.local(x));
                let to = to.map(|x| placed.end.local(x));
                obstacle.shape.touches(is_edge, &at, &to, |touch| {
                    for (&node, x) in part.iter().zip(&to) {
                        let touching = *x - touch.normal * touch.distance;
                        let lift = &mut lifts[node as usize];
                        *lift = lift.max(obstacle.shape.foot(touching).distance);
                    }
                });
            }
        }
    }

    /// Contacts of nodes that are near several surfaces, and of edges and faces, for a substep of
    /// `h` [s] from `start` to `ahead`.
    pub(crate) fn contacts(
        &self,
        table: impl Fn(DVec3) -> Surface,
        surfaces: &[Surface],
        [start, ahead]: [&[DVec3]; 2],
        parts: impl Iterator<Item = Part>,
        h: f64,
        found: &mut Vec<Contact>,
    ) {
        found.clear();
        for (node, (&a, &b)) in start.iter().zip(ahead).enumerate() {
            // The node's own surface is its tie.
            let (table, own) = (table(a), &surfaces[node]);
            let lone = |s: &Surface| {
                (s.normal.dot(b) - s.offset < MARGIN || s.normal.dot(a) - s.offset < MARGIN)
                    .then(|| Contact::on_surface(node as u32, s))
            };
            if own.id != table.id {
                found.extend(lone(&table));
            }
            for (k, ..) in self
                .each_near(node, [a, b])
                .filter(|(k, ..)| id(*k) != own.id)
            {
                let before = Some(own.end_normal);
                found.extend(lone(&self.plane(k, node, [a, b], before, h)));
            }
        }
        for (is_edge, part) in parts {
            let (at, to) = (pick(&part, start), pick(&part, ahead));
            let (low, high) = around(&at, &to);
            for (k, (obstacle, placed)) in self.obstacles.iter().zip(&self.placed).enumerate() {
                if matches!(obstacle.shape, Shape::Round { .. })
                    || !placed.is_near(low - REACH, high + REACH)
                {
                    continue;
                }
                let at = at.map(|x| placed.start.local(x));
                let to = to.map(|x| placed.end.local(x));
                obstacle.shape.touches(is_edge, &at, &to, |touch| {
                    let now = touch.normal.dot(mix(&touch.weights, &at) - touch.point);
                    let then = touch.normal.dot(mix(&touch.weights, &to) - touch.point);
                    if now.min(then) > MARGIN {
                        return;
                    }
                    let depth = (-touch.distance - RECOVERY * h).max(0.0);
                    let normal = placed.end.rotation * touch.normal;
                    let surface = Surface {
                        normal,
                        end_normal: normal,
                        offset: normal.dot(placed.end.world(touch.point)) - depth,
                        motion: placed.motion(touch.point),
                        friction: obstacle.friction(),
                        id: id(k),
                    };
                    found.push(Contact::on_part(
                        part,
                        touch.weights,
                        &surface,
                        touch.feature,
                    ));
                });
            }
        }
    }

    /// Follows nodes, edges and faces on their way from `start` to `end`.
    pub(crate) fn clearance(
        &self,
        [start, end]: [&[DVec3]; 2],
        parts: impl Iterator<Item = Part>,
    ) -> Clearance {
        let (mut free, mut gap) = (1.0_f64, f64::INFINITY);
        for (node, (&a, &b)) in start.iter().zip(end).enumerate() {
            for (_, obstacle, placed) in self.each_near(node, [a, b]) {
                let (a, b) = (placed.start.local(a), placed.end.local(b));
                let after = obstacle.shape.foot(b).distance;
                gap = gap.min(after);
                let curved = matches!(&obstacle.shape, Shape::Solid(solid) if !solid.convex);
                if after > -SUNK && !curved {
                    continue;
                }
                let before = obstacle.shape.foot(a).distance;
                if after < -SUNK && after < before - 0.1 * SUNK {
                    // A last resort, so half the share at which it is inside
                    free = free.min(0.5 * before.max(0.0) / (before.max(0.0) - after));
                }
                if let (true, Shape::Solid(solid)) = (curved, &obstacle.shape) {
                    free = free.min(solid.deep_entry(a, b).map_or(1.0, |t| 0.9 * t));
                }
            }
        }
        for (is_edge, part) in parts {
            let (at, to) = (pick(&part, start), pick(&part, end));
            let (low, high) = around(&at, &to);
            for (obstacle, placed) in self.obstacles.iter().zip(&self.placed) {
                if !placed.is_near(low - MARGIN, high + MARGIN) {
                    continue;
                }
                let at = at.map(|x| placed.start.local(x));
                let to = to.map(|x| placed.end.local(x));
                let shape = &obstacle.shape;
                free = free.min(shape.free_way(is_edge, &at, &to));
                shape.touches(is_edge, &to, &to, |touch| gap = gap.min(touch.distance));
            }
        }
        Clearance {
            free,
            gap: gap.is_finite().then_some(gap),
        }
    }
}

/// The surface that an obstacle is.
fn id(k: usize) -> u32 {
    FIRST + k as u32
}

/// Along a straight line, turning about one axis at one rate.
fn between(from: &Pose, to: &Pose, share: f64) -> Pose {
    let position = from.position().lerp(to.position(), share);
    Pose::from_unit(
        position,
        from.rotation().slerp(to.rotation(), share).normalize(),
    )
}

fn pick(part: &[u32; 3], x: &[DVec3]) -> [DVec3; 3] {
    part.map(|k| x[k as usize])
}

fn around(a: &[DVec3; 3], b: &[DVec3; 3]) -> (DVec3, DVec3) {
    let low = |x: &[DVec3; 3]| x[0].min(x[1]).min(x[2]);
    let high = |x: &[DVec3; 3]| x[0].max(x[1]).max(x[2]);
    (low(a).min(low(b)), high(a).max(high(b)))
}
