//! How far an arm is from the table and from itself.

use crate::Arm;
use crate::body::{Body, Solid};
use crate::distance::distance;
use crate::forward::Frame;

/// Bodies with fewer joints between them are neighbours, whose shapes overlap by design or are kept
/// apart by the limits of the joints.
const APART: usize = 3;

/// The nearest distances of one configuration [m].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearance<'a> {
    /// Lowest point of what moves above the table; negative below it, infinite without shapes.
    pub table: f64,
    /// The link that is lowest.
    pub lowest: &'a str,
    /// Least distance of two links that three joints or more lie between; not above 0 where they
    /// overlap, infinite without shapes.
    pub own: f64,
    /// Those links.
    pub nearest: [&'a str; 2],
}

/// Measures clearances; holds the bodies as they were placed last.
#[derive(Clone, Debug)]
pub(crate) struct Ruler<'a> {
    arm: &'a Arm,
    /// Height of the table in the base link [m].
    table: f64,
    /// Bodies that could come near, capsules first: those are quick.
    pairs: Vec<[u32; 2]>,
    frames: Vec<Frame>,
    placed: Vec<(Solid, bool)>,
    jaw: usize,
}

impl<'a> Ruler<'a> {
    pub(crate) fn new(arm: &'a Arm, table: f64) -> Self {
        let bodies = arm.bodies();
        let mut pairs = Vec::new();
        for (a, first) in bodies.iter().enumerate() {
            for (b, second) in bodies.iter().enumerate().skip(a + 1) {
                if first.joints.abs_diff(second.joints) >= APART {
                    pairs.push([a as u32, b as u32]);
                }
            }
        }
        let is_capsule = |k: u32| matches!(bodies[k as usize].solids[0], Solid::Capsule { .. });
        pairs.sort_by_key(|pair| !pair.iter().all(|k| is_capsule(*k)));
        Self {
            arm,
            table,
            pairs,
            frames: Vec::new(),
            placed: Vec::new(),
            jaw: 0,
        }
    }

    pub(crate) fn arm(&self) -> &'a Arm {
        self.arm
    }

    /// Puts the bodies where they are at `q`.
    fn place(&mut self, q: &[f64], open: bool) {
        self.arm.frames(q, &mut self.frames);
        self.jaw = usize::from(open);
        self.placed.clear();
        for body in self.arm.bodies() {
            let solid = body.solids[self.jaw].placed(&self.frames[body.joints]);
            // The base stands on the table, the first link turns in place, and envelopes of the
            // fingers are rounder than those.
            self.placed.push((solid, body.joints > 1 && !body.envelope));
        }
    }

    /// Whether `q` is at least so far above the table and from itself [m].
    pub(crate) fn is_clear(&mut self, q: &[f64], open: bool, table: f64, own: f64) -> bool {
        self.place(q, open);
        let low = |(solid, moves): &(Solid, bool)| *moves && solid.bottom() - self.table < table;
        if self.placed.iter().any(low) {
            return false;
        }
        self.pairs.iter().all(|&[a, b]| {
            let (a, b) = (&self.placed[a as usize].0, &self.placed[b as usize].0);
            let ((p, r), (q, s)) = (a.ball(), b.ball());
            let far = own + r + s;
            p.distance_squared(q) >= far * far || distance(a, b) >= own
        })
    }

    pub(crate) fn clearance(&mut self, q: &[f64], open: bool) -> Clearance<'a> {
        self.place(q, open);
        let bodies = self.arm.bodies();
        let mut clearance = Clearance {
            table: f64::INFINITY,
            lowest: "",
            own: f64::INFINITY,
            nearest: ["", ""],
        };
        for ((solid, moves), body) in self.placed.iter().zip(bodies) {
            let height = solid.bottom() - self.table;
            if *moves && height < clearance.table {
                (clearance.table, clearance.lowest) = (height, &body.link);
            }
        }
        for &[a, b] in &self.pairs {
            let (first, second) = (&self.placed[a as usize].0, &self.placed[b as usize].0);
            let ((p, r), (q, s)) = (first.ball(), second.ball());
            if p.distance(q) - r - s < clearance.own {
                let apart = distance(first, second);
                if apart < clearance.own {
                    clearance.own = apart;
                    clearance.nearest = [a, b].map(|k| bodies[k as usize].link.as_str());
                }
            }
        }
        clearance
    }

    /// Height above the table of what is fixed to the tip, for a pose of the tip: no configuration
    /// is needed, so it holds for any base. And the link that is lowest.
    pub(crate) fn hand(&self, tip: &selvedge_math::Pose, open: bool) -> (f64, &'a str) {
        let last = *tip * self.arm.tool().inverse();
        let frame = Frame {
            rotation: last.rotation_matrix(),
            origin: last.position(),
        };
        let count = self.arm.joints().len();
        let mut lowest = (f64::INFINITY, "");
        let of_hand = |body: &&Body| body.joints == count && !body.envelope;
        for body in self.arm.bodies().iter().filter(of_hand) {
            let height = body.solids[usize::from(open)].placed(&frame).bottom() - self.table;
            if height < lowest.0 {
                lowest = (height, &body.link);
            }
        }
        lowest
    }
}

impl Arm {
    /// How far a configuration is from a table, a plane at height `table` in the base link [m], and
    /// from itself, with the jaws open or closed. Bodies are those of the description: capsules,
    /// cylinders, spheres and boxes, without any safety distance that it does not have.
    ///
    /// # Panics
    /// When `q` has not one entry a joint.
    ///
    /// ```
    /// use selvedge_franka::Arm;
    /// let arm = Arm::fr3();
    /// let q = [0.0, 0.5, 0.0, -2.3, 0.0, 2.8, 0.785];
    /// let clearance = arm.clearance(&q, false, 0.0);
    /// // Fingers down, their tips 9.5 mm beyond the tool centre point.
    /// let height = arm.forward(&q).position().z - 0.0095;
    /// assert!((clearance.table - height).abs() < 1e-3);
    /// assert!(clearance.lowest.ends_with("finger") && clearance.own > 0.1);
    /// ```
    pub fn clearance(&self, q: &[f64], open: bool, table: f64) -> Clearance<'_> {
        assert_eq!(q.len(), self.joints().len(), "one position a joint");
        Ruler::new(self, table).clearance(q, open)
    }
}
