//! Nodes on the table and on obstacles: Signorini's law and Coulomb friction, solved with the rows.
//!
//! A node that rests on a surface is tied to it: to its plane when it slides, to its place when it
//! sticks. So the rows are solved with the supports in place, and the supports' forces come out as
//! the reactions of the ties. After each iteration a tie that would have to pull lets go, a node below
//! its surface gets one, a reaction outside the friction cone lets the node slide, and a node that
//! friction would push backwards sticks again.

use selvedge_math::DVec3;

use crate::nodes::{Kept, Nodes};

/// How fast a node that starts below a surface is moved out [m/s].
pub(crate) const RECOVERY: f64 = 0.05;
/// A node is below its surface when it is so far below [m].
const BELOW: f64 = 1e-10;

/// The plane of a surface near a node for one substep: `n . x >= offset`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Surface {
    pub(crate) normal: DVec3,
    /// The normal at the end of the substep; on curved surfaces another one.
    pub(crate) end_normal: DVec3,
    /// Below the surface for a node that starts below it: it is moved out no faster than `RECOVERY`.
    pub(crate) offset: f64,
    /// How far the surface moves there in the substep [m].
    pub(crate) motion: DVec3,
    pub(crate) friction: f64,
    /// Which one it is: none, the table, or an obstacle.
    pub(crate) id: u32,
}

impl Surface {
    pub(crate) const TABLE: u32 = 1;

    /// There is none.
    pub(crate) const NONE: Self = Self {
        normal: DVec3::Z,
        end_normal: DVec3::Z,
        offset: f64::NEG_INFINITY,
        motion: DVec3::ZERO,
        friction: 0.0,
        id: 0,
    };

    /// The table for a node at `start`, in a substep of `h` [s].
    pub(crate) fn table(start: DVec3, h: f64, friction: f64) -> Self {
        Self {
            offset: (start.z + RECOVERY * h).min(0.0),
            friction,
            id: Self::TABLE,
            ..Self::NONE
        }
    }

    /// The point, or the nearest on the surface if it is below.
    pub(crate) fn lift(&self, point: DVec3) -> DVec3 {
        let below = self.offset - self.normal.dot(point);
        if below > 0.0 {
            point + self.normal * below
        } else {
            point
        }
    }
}

/// Where the nodes rest.
#[derive(Clone, Debug)]
pub(crate) struct Supports {
    rests: Vec<Rest>,
    /// The surfaces that they rest on.
    on: Vec<u32>,
    /// Friction of sliding nodes [N].
    slides: Vec<DVec3>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Rest {
    No,
    Sticks,
    Slides,
}

impl Supports {
    pub(crate) fn new(node_count: usize) -> Self {
        Self {
            rests: vec![Rest::No; node_count],
            on: vec![0; node_count],
            slides: vec![DVec3::ZERO; node_count],
        }
    }

    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.rests.copy_from_slice(&other.rests);
        self.on.copy_from_slice(&other.on);
        self.slides.copy_from_slice(&other.slides);
    }

    /// A held node rests on nothing.
    pub(crate) fn release(&mut self, node: usize) {
        self.rests[node] = Rest::No;
        self.slides[node] = DVec3::ZERO;
    }

    /// Whether a node rests on a surface.
    pub(crate) fn rests_on(&self, node: usize, surface: &Surface) -> bool {
        self.rests[node] != Rest::No && self.on[node] == surface.id
    }

    /// Gives a node a surface; true when it has to leave another one for that.
    pub(crate) fn change(&mut self, node: usize, surface: u32, nodes: &mut Nodes) -> bool {
        let leaves = self.rests[node] != Rest::No && self.on[node] != surface;
        self.on[node] = surface;
        if leaves {
            self.release(node);
            nodes.kept[node] = Kept::Free;
            nodes.reactions[node] = DVec3::ZERO;
        }
        leaves
    }

    /// Friction forces of the sliding nodes [N].
    pub(crate) fn add_forces(&self, forces: &mut [DVec3]) {
        for (force, slide) in forces.iter_mut().zip(&self.slides) {
            *force += *slide;
        }
    }

    /// The tie of a node at the start of a substep, from how it rested before.
    pub(crate) fn tie(&self, node: usize, surface: &Surface) -> Kept {
        match self.rests[node] {
            Rest::No => Kept::Free,
            Rest::Sticks => Kept::Sticks(surface.normal),
            Rest::Slides => Kept::OnPlane(surface.normal),
        }
    }

    /// Decides how a node at `x`, which was at `start`, rests, and puts it there; true when it
    /// left its surface.
    pub(crate) fn update(
        &mut self,
        node: usize,
        surface: &Surface,
        start: DVec3,
        x: &mut DVec3,
        nodes: &mut Nodes,
    ) -> bool {
        let &Surface {
            normal,
            offset,
            motion,
            friction,
            ..
        } = surface;
        let before = self.rests[node];
        let below = offset - normal.dot(*x);
        let inverse = nodes.inverse(node);
        if before == Rest::No {
            if below <= BELOW {
                return false;
            }
            nodes.reactions[node] = DVec3::ZERO;
            self.slides[node] = DVec3::ZERO;
            self.rests[node] = Rest::Sticks;
            nodes.kept[node] = Kept::Sticks(normal);
        }
        let pressure = normal.dot(nodes.reactions[node]) + below / inverse;
        if pressure < 0.0 {
            nodes.kept[node] = Kept::Free;
            nodes.reactions[node] = DVec3::ZERO;
            self.rests[node] = Rest::No;
            self.slides[node] = DVec3::ZERO;
            return true;
        }
        // Friction that would hold the node, cut to the cone
        let slip = *x - start - motion;
        let slip = slip - normal * normal.dot(slip);
        let reaction = nodes.reactions[node];
        let across = reaction - normal * normal.dot(reaction);
        let friction_now = across + self.slides[node];
        let wanted = friction_now - slip / inverse;
        let (size, bound) = (wanted.length(), friction * pressure);
        nodes.reactions[node] = reaction - across;
        if size <= bound {
            self.rests[node] = Rest::Sticks;
            nodes.kept[node] = Kept::Sticks(normal);
            nodes.reactions[node] += friction_now;
            self.slides[node] = DVec3::ZERO;
        } else {
            self.rests[node] = Rest::Slides;
            nodes.kept[node] = Kept::OnPlane(normal);
            self.slides[node] = wanted * (bound / size);
            *x += (self.slides[node] - friction_now) * inverse;
        }
        let place = start + motion;
        let place = place + normal * (offset - normal.dot(place));
        nodes.place(node, place, x);
        false
    }

    /// How far below its surface the node is [m].
    pub(crate) fn lack(&self, node: usize, surface: &Surface, x: DVec3) -> f64 {
        match self.rests[node] {
            Rest::No => surface.offset - surface.normal.dot(x),
            _ => 0.0,
        }
    }

    /// The velocity of a node that rests: that of the surface along the normal, after an impact
    /// without rebound whose friction acts too; that of the surface altogether when it sticks.
    pub(crate) fn impact(&self, node: usize, surface: &Surface, velocity: DVec3, h: f64) -> DVec3 {
        let ground = surface.motion / h;
        let relative = velocity - ground;
        match self.rests[node] {
            Rest::No => velocity,
            Rest::Sticks => ground,
            Rest::Slides => {
                let along = surface.end_normal.dot(relative);
                let across = relative - surface.end_normal * along;
                let speed = across.length();
                let lost = surface.friction * (-along).max(0.0);
                let left = match speed > lost {
                    true => across * (1.0 - lost / speed),
                    false => DVec3::ZERO,
                };
                ground + left
            }
        }
    }
}
