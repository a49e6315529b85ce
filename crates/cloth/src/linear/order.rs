//! The order of elimination: nested dissection by places.
//!
//! Unknowns that are neighbours in space are cut in two where the fewest of one side touch the other.
//! Those come last, the two sides are cut likewise (George 1973): a sheet of `n` unknowns has factors
//! of `n log n` entries.

use selvedge_math::DVec3;

/// Sets of so few unknowns are not cut.
const LEAF: usize = 16;

/// The share of a set on each side of a cut, at least.
const BALANCE: f64 = 0.3;

/// The unknowns in the order in which they are to be eliminated, for the matrix with these entries whose
/// unknowns are at these places.
pub(super) fn dissect(entries: &[(u32, u32)], places: &[DVec3]) -> Vec<u32> {
    let n = places.len();
    let mut set: Vec<u32> = (0..n as u32).collect();
    let mut dissection = Dissection {
        places,
        neighbours: neighbours(n, entries),
        rank: vec![u32::MAX; n],
        order: Vec::with_capacity(n),
    };
    dissection.cut(&mut set);
    dissection.order
}

/// The neighbours of each unknown.
fn neighbours(n: usize, entries: &[(u32, u32)]) -> Vec<Vec<u32>> {
    let mut neighbours = vec![Vec::new(); n];
    for &(a, b) in entries.iter().filter(|(a, b)| a != b) {
        neighbours[a as usize].push(b);
        neighbours[b as usize].push(a);
    }
    neighbours
}

struct Dissection<'a> {
    places: &'a [DVec3],
    neighbours: Vec<Vec<u32>>,
    /// The place of each unknown of the present set along the axis of its cut.
    rank: Vec<u32>,
    order: Vec<u32>,
}

impl Dissection<'_> {
    fn cut(&mut self, set: &mut [u32]) {
        self.sort(set);
        if set.len() <= LEAF {
            self.order.extend_from_slice(set);
            return;
        }
        for (rank, &k) in (0u32..).zip(&*set) {
            self.rank[k as usize] = rank;
        }
        let (middle, lower) = self.best_cut(set);
        // Those of one side that touch the other
        let (first, second) = set.split_at(middle);
        let (side, other) = if lower {
            (first, second)
        } else {
            (second, first)
        };
        let of_other = |&k: &u32| {
            let rank = self.rank[k as usize] as usize;
            rank < set.len() && set[rank] == k && (rank < middle) != lower
        };
        let touches = |k: &u32| self.neighbours[*k as usize].iter().any(of_other);
        let (mut separator, mut side): (Vec<u32>, Vec<u32>) = side.iter().partition(|k| touches(k));
        let mut other = other.to_vec();
        self.cut(&mut side);
        self.cut(&mut other);
        self.sort(&mut separator);
        self.order.append(&mut separator);
    }

    /// Sorts unknowns along the axis in which they extend the most.
    fn sort(&self, set: &mut [u32]) {
        let at = |k: u32| self.places[k as usize];
        let low = set.iter().map(|&k| at(k)).fold(DVec3::INFINITY, DVec3::min);
        let high = set
            .iter()
            .map(|&k| at(k))
            .fold(-DVec3::INFINITY, DVec3::max);
        let axis = (high - low).max_position();
        let next = (axis + 1) % 3;
        set.sort_unstable_by(|&a, &b| {
            let along = |axis: usize| at(a)[axis].total_cmp(&at(b)[axis]);
            along(axis)
                .then_with(|| along(next))
                .then_with(|| along((next + 1) % 3))
                .then(a.cmp(&b))
        });
    }

    /// Where a sorted set is best cut, and whether those below the cut that touch the others are no
    /// more than those above.
    fn best_cut(&self, set: &[u32]) -> (usize, bool) {
        let n = set.len();
        // By how much more unknowns are in the separator of each cut than in that of the one before
        let (mut below, mut above) = (vec![0i32; n + 1], vec![0i32; n + 1]);
        for (rank, &k) in set.iter().enumerate() {
            let ranks = self.neighbours[k as usize].iter().filter_map(|&other| {
                let rank = self.rank[other as usize] as usize;
                (set.get(rank) == Some(&other)).then_some(rank)
            });
            let (first, last) = ranks.fold((rank, rank), |(a, b), r| (a.min(r), b.max(r)));
            below[rank + 1] += 1;
            below[last + 1] -= 1;
            above[first + 1] += 1;
            above[rank + 1] -= 1;
        }
        let least = (BALANCE * n as f64) as usize;
        let mut best = (i32::MAX, usize::MAX, n / 2, true);
        let (mut touching_below, mut touching_above) = (0, 0);
        for cut in 1..n {
            touching_below += below[cut];
            touching_above += above[cut];
            if cut >= least && cut <= n - least {
                let size = touching_below.min(touching_above);
                let off = cut.abs_diff(n / 2);
                best = best.min((size, off, cut, touching_below <= touching_above));
            }
        }
        (best.2, best.3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The pattern of a grid in which each unknown meets those around it.
    fn grid(columns: usize, rows: usize) -> (Vec<(u32, u32)>, Vec<DVec3>) {
        let mut entries = Vec::new();
        let places = (0..columns * rows)
            .map(|k| DVec3::new((k % columns) as f64, (k / columns) as f64, 0.0))
            .collect::<Vec<_>>();
        for (a, p) in (0u32..).zip(&places) {
            for (b, q) in (0u32..).zip(&places) {
                if b <= a && (*p - *q).abs().max_element() < 1.5 {
                    entries.push((a, b));
                }
            }
        }
        (entries, places)
    }

    #[test]
    fn every_unknown_comes_once() {
        for (columns, rows) in [(1, 1), (1, 40), (13, 13), (9, 30)] {
            let (entries, places) = grid(columns, rows);
            let mut order = dissect(&entries, &places);
            order.sort_unstable();
            assert!(order.iter().copied().eq(0..(columns * rows) as u32));
        }
        // All at one place, and nothing there
        let (entries, places) = grid(30, 3);
        assert_eq!(dissect(&entries, &vec![DVec3::ONE; places.len()]).len(), 90);
        assert!(dissect(&[], &[]).is_empty());
    }

    #[test]
    fn a_grid_is_cut_across() {
        let (entries, places) = grid(9, 31);
        let order = dissect(&entries, &places);
        let (rest, separator) = order.split_at(order.len() - 9);
        let y = places[separator[0] as usize].y;
        assert!(separator.iter().all(|&k| places[k as usize].y == y));
        assert!((12.0..=18.0).contains(&y), "{y}");
        let below = rest.iter().filter(|&&k| places[k as usize].y < y).count();
        assert!(rest[..below].iter().all(|&k| places[k as usize].y < y));
    }
}
