//! The nodes that hands and pins keep, where they are to go in a step, and how far the cloth lets
//! them.

use selvedge_math::{DVec3, Held};

/// Hands that are late catch up no faster [m/s].
const CATCH_UP: f64 = 6.0;

/// Sweeps over pairs of hands that are too far apart.
const SWEEPS: usize = 200;

/// The nodes that hands and pins keep in the present step.
#[derive(Clone, Debug, Default)]
pub(crate) struct Hands {
    pub(crate) nodes: Vec<u32>,
    pub(crate) from: Vec<DVec3>,
    pub(crate) to: Vec<DVec3>,
    pub(crate) is_held: Vec<bool>,
    /// Where each is to be at the end of the present substep.
    pub(crate) targets: Vec<DVec3>,
    /// How many are no pins; these come first.
    free: usize,
    /// Pairs that the cloth does not let further apart than so much [m].
    leashes: Vec<([u32; 2], f64)>,
    /// Way along edges from a node [m].
    ways: Vec<f64>,
}

/// How far hands go in a substep: shares of the mean way of all, and of what each goes besides.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reach {
    pub(crate) common: f64,
    pub(crate) own: f64,
}

impl Reach {
    pub(crate) const WHOLE: Self = Self::even(1.0);

    pub(crate) const fn even(share: f64) -> Self {
        Self {
            common: share,
            own: share,
        }
    }
}

impl Hands {
    pub(crate) fn new(node_count: usize) -> Self {
        Self {
            is_held: vec![false; node_count],
            ..Self::default()
        }
    }

    /// Lets everything go.
    pub(crate) fn release(&mut self) {
        self.is_held.fill(false);
        self.nodes.clear();
    }

    /// Takes what is held and the pins, of the cloth at `x`; true when these are the nodes as before.
    pub(crate) fn take(&mut self, held: Held<'_>, pinned: &[u32], x: &[DVec3], dt: f64) -> bool {
        let same = self.nodes.len() == held.nodes.len() + pinned.len()
            && held
                .nodes
                .iter()
                .chain(pinned)
                .all(|&node| self.is_held[node as usize]);
        self.release();
        self.from.clear();
        self.to.clear();
        let pins = pinned.iter().map(|&node| (node, x[node as usize]));
        for (node, target) in held
            .nodes
            .iter()
            .copied()
            .zip(held.targets.iter().copied())
            .chain(pins)
        {
            let is_held = &mut self.is_held[node as usize];
            if !*is_held {
                *is_held = true;
                self.nodes.push(node);
                let from = x[node as usize];
                self.from.push(from);
                let way = target - from;
                self.to
                    .push(from + way * (CATCH_UP * dt / way.length()).min(1.0));
            }
        }
        self.free = held.nodes.len().min(self.nodes.len());
        same
    }

    /// Draws targets in that no inextensible cloth can follow: two hands are at most as far apart as
    /// the way along edges from one to the other is long. Of two that are too far apart each gives way
    /// by half; pins stay.
    pub(crate) fn draw_in(
        &mut self,
        rest: &[DVec3],
        edges: &[[u32; 2]],
        lengths: &[f64],
        tolerance: f64,
    ) {
        let count = self.nodes.len();
        let (nodes, to) = (&self.nodes, &self.to);
        let too_far = |a: usize, b: usize, length: f64| {
            to[a].distance_squared(to[b]) > ((1.0 + tolerance) * length).powi(2)
        };
        // Most hands are no further apart than at rest: no need to look for ways then.
        let straight =
            |a: usize, b: usize| rest[nodes[a] as usize].distance(rest[nodes[b] as usize]);
        if !(0..count).any(|a| (0..a).any(|b| too_far(a, b, straight(a, b)))) {
            return;
        }
        self.leashes.clear();
        for a in 0..count {
            shortest_ways(nodes[a], edges, lengths, &mut self.ways, rest.len());
            let pairs = (0..a).map(|b| ([b as u32, a as u32], self.ways[nodes[b] as usize]));
            self.leashes.extend(pairs);
        }
        for _ in 0..SWEEPS {
            let mut done = true;
            for &([b, a], length) in &self.leashes {
                let [b, a] = [b, a].map(|k| k as usize);
                let way = self.to[a] - self.to[b];
                let distance = way.length();
                let movable = [b, a].map(|k| if k < self.free { 1.0 } else { 0.0 });
                let sum = movable[0] + movable[1];
                if distance > (1.0 + tolerance) * length && sum > 0.0 {
                    let excess = way * ((1.0 - length / distance) / sum);
                    self.to[b] += excess * movable[0];
                    self.to[a] -= excess * movable[1];
                    done = false;
                }
            }
            if done {
                break;
            }
        }
    }

    /// Sets the targets of a substep from the positions `start`, at whose end hands would be at `share`
    /// of the step's way. Pins stay.
    pub(crate) fn set_targets(&mut self, start: &[DVec3], share: f64, reach: Reach) {
        let ends = self.from.iter().zip(&self.to);
        let ways = self
            .nodes
            .iter()
            .zip(ends)
            .map(|(&node, (from, to))| from.lerp(*to, share) - start[node as usize]);
        let free = ways.clone().take(self.free);
        let mean = free.sum::<DVec3>() / self.free.max(1) as f64;
        self.targets.clear();
        let targets = self.nodes.iter().zip(ways).enumerate();
        self.targets.extend(targets.map(|(k, (&node, way))| {
            let mean = if k < self.free { mean } else { DVec3::ZERO };
            start[node as usize] + mean * reach.common + (way - mean) * reach.own
        }));
    }
}

/// Length of the shortest way along edges from a node to every other: sweeps over all edges, there and
/// back, until nothing gets shorter.
fn shortest_ways(
    from: u32,
    edges: &[[u32; 2]],
    lengths: &[f64],
    ways: &mut Vec<f64>,
    count: usize,
) {
    ways.clear();
    ways.resize(count, f64::INFINITY);
    ways[from as usize] = 0.0;
    let mut relax = |e: usize| {
        let [p, q] = edges[e].map(|k| k as usize);
        let (to_q, to_p) = (ways[p] + lengths[e], ways[q] + lengths[e]);
        let shorter = to_q < ways[q] || to_p < ways[p];
        ways[q] = ways[q].min(to_q);
        ways[p] = ways[p].min(to_p);
        shorter
    };
    loop {
        let there = (0..edges.len()).fold(false, |any, e| relax(e) | any);
        let back = (0..edges.len()).rev().fold(false, |any, e| relax(e) | any);
        if !(there || back) {
            return;
        }
    }
}
