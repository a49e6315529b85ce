//! Which moving boxes come to overlap: a tree of boxes over parts that stay neighbours.
//!
//! Boxes move linearly, so parts that move together do not meet, however far they go.

use selvedge_math::DVec3;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    pub(crate) low: DVec3,
    pub(crate) high: DVec3,
}

impl Bounds {
    pub(crate) fn overlaps(&self, other: &Self) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }

    pub(crate) fn join(&self, other: &Self) -> Self {
        Self {
            low: self.low.min(other.low),
            high: self.high.max(other.high),
        }
    }
}

/// A box whose corners go straight from where they are at the start to where they are at the end,
/// all in the same time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moving {
    pub(crate) start: Bounds,
    pub(crate) end: Bounds,
}

impl Moving {
    /// A box that holds both all the time.
    pub(crate) fn join(&self, other: &Self) -> Self {
        Self {
            start: self.start.join(&other.start),
            end: self.end.join(&other.end),
        }
    }

    /// Whether the two overlap at any time.
    #[inline]
    pub(crate) fn meets(&self, other: &Self) -> bool {
        if self.start.overlaps(&other.start) {
            return true;
        }
        // Along each axis they overlap from when the one has come to the other until it has passed it.
        let (mut from, mut to) = (0.0_f64, 1.0_f64);
        for (a, b) in [(self, other), (other, self)] {
            let (start, end) = (a.start.high - b.start.low, a.end.high - b.end.low);
            if start.max(end).cmplt(DVec3::ZERO).any() {
                return false;
            }
            for axis in 0..3 {
                let zero = start[axis] / (start[axis] - end[axis]);
                if start[axis] < 0.0 {
                    from = from.max(zero);
                } else if end[axis] < 0.0 {
                    to = to.min(zero);
                }
            }
        }
        // A rounding error is no reason to miss any.
        from <= to + 1e-12
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
        let nothing = Bounds {
            low: DVec3::ZERO,
            high: DVec3::ZERO,
        };
        let nowhere = Moving {
            start: nothing,
            end: nothing,
        };
        self.boxes
            .resize((2 * self.parts.len()).saturating_sub(1), nowhere);
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

    fn box_at(corner: DVec3, state: &mut u64) -> Bounds {
        let sides = DVec3::new(random(state), random(state), random(state));
        Bounds {
            low: corner,
            high: corner + 0.4 * sides,
        }
    }

    fn moving(state: &mut u64) -> Moving {
        let corner = DVec3::new(random(state), random(state), 0.1 * random(state));
        let way = 0.5 * DVec3::new(random(state) - 0.5, random(state) - 0.5, random(state));
        Moving {
            start: box_at(corner, state),
            end: box_at(corner + way, state),
        }
    }

    fn at(moving: &Moving, t: f64) -> Bounds {
        Bounds {
            low: moving.start.low.lerp(moving.end.low, t),
            high: moving.start.high.lerp(moving.end.high, t),
        }
    }

    fn grown(moving: &Moving, by: f64) -> Moving {
        let [start, end] = [moving.start, moving.end].map(|b| Bounds {
            low: b.low - by,
            high: b.high + by,
        });
        Moving { start, end }
    }

    #[test]
    fn boxes_meet_when_they_overlap_at_some_time() {
        let state = &mut 7;
        let mut count = [0; 2];
        for _ in 0..3000 {
            let (a, b) = (moving(state), moving(state));
            let overlap = |a: &Moving, b: &Moving| {
                let mut times = (0..=1000).map(|k| f64::from(k) / 1000.0);
                times.any(|t| at(a, t).overlaps(&at(b, t)))
            };
            let meet = a.meets(&b);
            assert_eq!(meet, b.meets(&a));
            // What overlaps between two looks only does so at one of them when it is a little larger.
            assert!(meet || !overlap(&a, &b));
            assert!(!meet || overlap(&grown(&a, 1e-3), &grown(&b, 1e-3)));
            count[usize::from(meet)] += 1;
        }
        assert!(count.iter().all(|count| *count > 300), "{count:?}");
    }

    #[test]
    fn what_moves_together_does_not_meet() {
        let side = |x: f64| Bounds {
            low: DVec3::new(x, 0.0, 0.0),
            high: DVec3::new(x + 1.0, 1.0, 1.0),
        };
        let [a, b] = [0.0, 1.1].map(|x| Moving {
            start: side(x),
            end: side(x + 100.0),
        });
        assert!(!a.meets(&b));
        let stays = Moving {
            start: side(50.0),
            end: side(50.0),
        };
        assert!(a.meets(&stays) && stays.meets(&b));
    }

    #[test]
    fn a_tree_finds_what_all_pairs_find() {
        let state = &mut 5;
        let boxes: Vec<Moving> = (0..300).map(|_| moving(state)).collect();
        let centres: Vec<DVec3> = boxes.iter().map(|b| b.start.low).collect();
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
