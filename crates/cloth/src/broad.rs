//! Which moving boxes come to overlap: a tree of boxes over parts that stay neighbours.
//!
//! Boxes move linearly, so parts that move together do not meet, however far they go.

use glam::Vec3A;
use selvedge_math::DVec3;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    pub(crate) low: DVec3,
    pub(crate) high: DVec3,
}

impl Bounds {
    pub(crate) fn join(&self, other: &Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
        }
    }
}

/// A box whose corners go straight from where they are at the start to where they are at the end,
/// all in the same time. Of single precision, rounded outwards: what is in the box stays in it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moving {
    /// Lower and upper corner, at the start and at the end.
    low: [Vec3A; 2],
    high: [Vec3A; 2],
}

impl Moving {
    const NOWHERE: Self = Self {
        low: [Vec3A::ZERO; 2],
        high: [Vec3A::ZERO; 2],
    };

    /// The box around a point, so large to each side, that goes from `start` to `end`.
    #[inline]
    pub(crate) fn around([start, end]: [DVec3; 2], side: f64) -> Self {
        // Half a unit in the last place is lost in rounding, and another half in this subtraction.
        let slack = |x: Vec3A| x.abs() * (1.5 * f32::EPSILON);
        let low = [start - side, end - side].map(|x| x.as_vec3a());
        let high = [start + side, end + side].map(|x| x.as_vec3a());
        Self {
            low: low.map(|x| x - slack(x)),
            high: high.map(|x| x + slack(x)),
        }
    }

    /// A box that holds both all the time.
    #[inline]
    pub(crate) fn join(&self, other: &Self) -> Self {
        Self {
            low: [0, 1].map(|k| self.low[k].min(other.low[k])),
            high: [0, 1].map(|k| self.high[k].max(other.high[k])),
        }
    }

    /// Whether the two overlap at any time.
    #[inline]
    pub(crate) fn meets(&self, other: &Self) -> bool {
        // Along each axis the one has come to the other where `a` is positive, and not passed it yet
        // where `b` is.
        let a = [0, 1].map(|k| self.high[k] - other.low[k]);
        let b = [0, 1].map(|k| other.high[k] - self.low[k]);
        if a[0].min(b[0]).cmpge(Vec3A::ZERO).all() {
            return true;
        }
        if a[0].max(a[1]).min(b[0].max(b[1])).cmplt(Vec3A::ZERO).any() {
            return false;
        }
        let (mut from, mut to) = (Vec3A::ZERO, Vec3A::ONE);
        for [start, end] in [a, b] {
            let zero = start / (start - end);
            let (later, earlier) = (start.cmplt(Vec3A::ZERO), end.cmplt(Vec3A::ZERO));
            from = from.max(Vec3A::select(later, zero, Vec3A::ZERO));
            to = to.min(Vec3A::select(earlier, zero, Vec3A::ONE));
        }
        // A rounding error is no reason to miss any.
        from.max_element() <= to.min_element() + 1e-5
    }
}

/// A binary tree over parts, which halves them along the longest side of where they are at first, and
/// whose boxes are set anew as they move.
///
/// The node of a range of parts is followed by those of its first half, then those of its second: of
/// `m` parts `2 m - 1` nodes.
#[derive(Clone, Debug)]
pub(crate) struct Tree {
    /// The parts from left to right.
    parts: Vec<u32>,
    boxes: Vec<Moving>,
}

/// A node: its place, and its range of parts.
type Node = (usize, usize, usize);

impl Tree {
    /// A tree over parts around these points.
    pub(crate) fn new(centres: &[DVec3]) -> Self {
        let mut parts: Vec<u32> = (0..centres.len() as u32).collect();
        halve(&mut parts, centres);
        Self {
            boxes: Vec::with_capacity(2 * parts.len()),
            parts,
        }
    }

    /// Says where the parts are.
    pub(crate) fn set_boxes(&mut self, of: impl Fn(u32) -> Moving) {
        let count = (2 * self.parts.len()).saturating_sub(1);
        self.boxes.resize(count, Moving::NOWHERE);
        if !self.parts.is_empty() {
            self.set((0, 0, self.parts.len()), &of);
        }
    }

    fn set(&mut self, node: Node, of: &impl Fn(u32) -> Moving) -> Moving {
        let here = match children(node) {
            None => of(self.parts[node.1]),
            Some([left, right]) => self.set(left, of).join(&self.set(right, of)),
        };
        self.boxes[node.0] = here;
        here
    }

    /// Calls `f` with each two parts whose boxes meet, once, in a fixed order, as long as it says true;
    /// false when it did not.
    pub(crate) fn meetings(&self, mut f: impl FnMut(u32, u32) -> bool) -> bool {
        self.parts.is_empty() || self.within((0, 0, self.parts.len()), &mut f)
    }

    fn within(&self, node: Node, f: &mut impl FnMut(u32, u32) -> bool) -> bool {
        children(node).is_none_or(|[left, right]| {
            self.within(left, f) && self.within(right, f) && self.between(left, right, f)
        })
    }

    fn between(&self, a: Node, b: Node, f: &mut impl FnMut(u32, u32) -> bool) -> bool {
        if !self.boxes[a.0].meets(&self.boxes[b.0]) {
            return true;
        }
        let larger = (b.2 - b.1 > a.2 - a.1).then(|| children(b)).flatten();
        if let Some([left, right]) = larger {
            return self.between(a, left, f) && self.between(a, right, f);
        }
        match children(a) {
            Some([left, right]) => self.between(left, b, f) && self.between(right, b, f),
            None => f(self.parts[a.1], self.parts[b.1]),
        }
    }
}

/// The two nodes that a node of more than one part holds.
fn children((place, first, end): Node) -> Option<[Node; 2]> {
    let middle = usize::midpoint(first, end);
    let left = 2 * (middle - first);
    (end - first > 1).then(|| [(place + 1, first, middle), (place + left, middle, end)])
}

fn halve(parts: &mut [u32], centres: &[DVec3]) {
    if parts.len() < 2 {
        return;
    }
    let first = centres[parts[0] as usize];
    let (low, high) = parts.iter().fold((first, first), |(low, high), &k| {
        let centre = centres[k as usize];
        (low.min(centre), high.max(centre))
    });
    let axis = (high - low).max_position();
    let middle = usize::midpoint(0, parts.len());
    let along = |&k: &u32| centres[k as usize][axis];
    parts.select_nth_unstable_by(middle, |a, b| along(a).total_cmp(&along(b)).then(a.cmp(b)));
    let (left, right) = parts.split_at_mut(middle);
    halve(left, centres);
    halve(right, centres);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn random(state: &mut u64) -> f64 {
        *state = state
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (*state >> 11) as f64 / (1u64 << 53) as f64
    }

    /// A point with its way, and half the side of the box around it.
    fn moving(state: &mut u64) -> ([DVec3; 2], f64) {
        let start = DVec3::new(random(state), random(state), 0.1 * random(state));
        let way = 0.5 * DVec3::new(random(state) - 0.5, random(state) - 0.5, random(state));
        ([start, start + way], 0.2 * random(state))
    }

    #[test]
    fn boxes_meet_when_they_overlap_at_some_time() {
        let state = &mut 7;
        let mut count = [0; 2];
        for _ in 0..3000 {
            let [(a, r), (b, s)] = [moving(state), moving(state)];
            // The least over time of the largest distance along an axis
            let apart = |t: f64| {
                (a[0].lerp(a[1], t) - b[0].lerp(b[1], t))
                    .abs()
                    .max_element()
            };
            let least = (0..=1000)
                .map(|k| apart(f64::from(k) / 1000.0))
                .fold(f64::INFINITY, f64::min);
            let (one, other) = (Moving::around(a, r), Moving::around(b, s));
            let meet = one.meets(&other);
            assert_eq!(meet, other.meets(&one));
            // Between two looks they come nearer by no more than they move.
            assert!(meet || least > r + s);
            assert!(!meet || least < r + s + 1e-3);
            count[usize::from(meet)] += 1;
        }
        assert!(count.iter().all(|count| *count > 300), "{count:?}");
    }

    #[test]
    fn boxes_that_touch_meet_in_spite_of_rounding() {
        let state = &mut 11;
        for _ in 0..3000 {
            let ([at, to], side) = moving(state);
            let beside = DVec3::X * (2.0 * side);
            let far = 1e4 * DVec3::new(random(state), random(state), random(state));
            let one = Moving::around([far + at, far + to], side);
            let other = Moving::around([far + at + beside, far + to + beside], side);
            assert!(one.meets(&other));
        }
    }

    #[test]
    fn what_moves_together_does_not_meet() {
        let side = |from: f64, way: f64| {
            let at = |x: f64| DVec3::new(x, 0.0, 0.0);
            Moving::around([at(from), at(from + way)], 0.5)
        };
        let [a, b] = [0.0, 1.1].map(|x| side(x, 100.0));
        assert!(!a.meets(&b));
        let stays = side(50.0, 0.0);
        assert!(a.meets(&stays) && stays.meets(&b));
    }

    #[test]
    fn a_tree_finds_what_all_pairs_find() {
        let state = &mut 5;
        let parts: Vec<_> = (0..300).map(|_| moving(state)).collect();
        let centres: Vec<DVec3> = parts.iter().map(|(way, _)| way[0]).collect();
        let boxes: Vec<Moving> = parts
            .iter()
            .map(|&(way, side)| Moving::around(way, side))
            .collect();
        for count in [0, 1, 2, 3, 300] {
            let mut tree = Tree::new(&centres[..count]);
            tree.set_boxes(|k| boxes[k as usize]);
            let mut found = Vec::new();
            assert!(tree.meetings(|a, b| {
                found.push((a.min(b), a.max(b)));
                true
            }));
            found.sort_unstable();
            let all: Vec<(u32, u32)> = (0..count as u32)
                .flat_map(|a| (a + 1..count as u32).map(move |b| (a, b)))
                .filter(|&(a, b)| boxes[a as usize].meets(&boxes[b as usize]))
                .collect();
            assert_eq!(found, all, "{count}");
        }
    }
}
