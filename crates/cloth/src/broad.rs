//! Which boxes overlap: a grid of cells over all boxes, rebuilt at each call.

use selvedge_math::DVec3;

/// The most cells of a grid; boxes that lie further apart get larger cells.
const MAX_CELLS: f64 = 65_536.0;

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bounds {
    pub(crate) low: DVec3,
    pub(crate) high: DVec3,
}

impl Bounds {
    /// A box that nothing is in.
    pub(crate) const NONE: Self = Self {
        low: DVec3::INFINITY,
        high: DVec3::NEG_INFINITY,
    };

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

/// Boxes sorted into cells.
#[derive(Clone, Debug, Default)]
pub(crate) struct Cells {
    origin: DVec3,
    per_metre: f64,
    count: [i32; 3],
    start: Vec<u32>,
    items: Vec<u32>,
    /// The cells that each box is in.
    ranges: Vec<Range>,
}

/// First and last cell along each axis.
#[derive(Clone, Copy, Debug, Default)]
struct Range {
    first: [i32; 3],
    last: [i32; 3],
}

impl Cells {
    /// Sorts the boxes into cells of about `size` [m].
    pub(crate) fn fill(&mut self, boxes: &[Bounds], size: f64) {
        let Some(first) = boxes.first() else {
            self.count = [0; 3];
            return;
        };
        let all = boxes.iter().fold(*first, |all, b| all.join(b));
        let extent = all.high - all.low;
        let mut size = size;
        let cells = |size: f64| (extent / size).floor() + 1.0;
        while cells(size).element_product() > MAX_CELLS {
            size *= 1.5;
        }
        self.origin = all.low;
        self.per_metre = 1.0 / size;
        self.count = cells(size).to_array().map(|n| n as i32);
        let mut ranges = std::mem::take(&mut self.ranges);
        ranges.clear();
        ranges.extend(boxes.iter().map(|b| self.range(b)));
        let total = self.count.iter().product::<i32>() as usize;
        self.start.clear();
        self.start.resize(total + 2, 0);
        for range in &ranges {
            self.cells_of(range, |start, cell| start[cell + 2] += 1);
        }
        for cell in 2..self.start.len() {
            self.start[cell] += self.start[cell - 1];
        }
        let mut items = std::mem::take(&mut self.items);
        items.clear();
        items.resize(self.start[total + 1] as usize, 0);
        for (k, range) in ranges.iter().enumerate() {
            self.cells_of(range, |start, cell| {
                items[start[cell + 1] as usize] = k as u32;
                start[cell + 1] += 1;
            });
        }
        (self.items, self.ranges) = (items, ranges);
    }

    fn range(&self, b: &Bounds) -> Range {
        let low = (b.low - self.origin) * self.per_metre;
        let high = (b.high - self.origin) * self.per_metre;
        let mut range = Range::default();
        for axis in 0..3 {
            let most = self.count[axis] - 1;
            range.first[axis] = (low[axis] as i32).clamp(0, most);
            range.last[axis] = (high[axis] as i32).clamp(0, most);
        }
        range
    }

    #[inline]
    fn cells_of(&mut self, range: &Range, mut f: impl FnMut(&mut [u32], usize)) {
        let Range { first, last } = *range;
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                let row = (z * self.count[1] + y) * self.count[0];
                for x in first[0]..=last[0] {
                    f(&mut self.start, (row + x) as usize);
                }
            }
        }
    }

    /// Calls `f` with each of the sorted boxes from number `least` on that overlaps `b`, once, in a
    /// fixed order.
    #[inline]
    pub(crate) fn overlaps(
        &self,
        b: &Bounds,
        boxes: &[Bounds],
        least: u32,
        mut f: impl FnMut(u32),
    ) {
        let Range { first, last } = self.range(b);
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                let row = (z * self.count[1] + y) * self.count[0];
                for x in first[0]..=last[0] {
                    let cell = (row + x) as usize;
                    let items = self.start[cell] as usize..self.start[cell + 1] as usize;
                    let items = &self.items[items];
                    // They ascend within a cell.
                    let skipped = match least {
                        0 => 0,
                        _ => items.partition_point(|&k| k < least),
                    };
                    for &k in &items[skipped..] {
                        // Only in the first cell that both are in.
                        let theirs = &self.ranges[k as usize].first;
                        let owner = x == first[0].max(theirs[0])
                            && y == first[1].max(theirs[1])
                            && z == first[2].max(theirs[2]);
                        if owner && b.overlaps(&boxes[k as usize]) {
                            f(k);
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn finds_what_all_pairs_find() {
        let mut state = 5u64;
        let mut random = || {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64
        };
        let boxes: Vec<Bounds> = (0..300)
            .map(|_| {
                let low = DVec3::new(random(), random(), 0.1 * random());
                let high = low + 0.15 * DVec3::new(random(), random(), random());
                Bounds { low, high }
            })
            .collect();
        let mut cells = Cells::default();
        for size in [0.02, 0.1, 5.0, 1e-9] {
            cells.fill(&boxes, size);
            for b in &boxes {
                let mut found = Vec::new();
                cells.overlaps(b, &boxes, 0, |k| found.push(k));
                found.sort_unstable();
                let all: Vec<u32> = (0..300)
                    .filter(|&k| b.overlaps(&boxes[k as usize]))
                    .collect();
                assert_eq!(found, all, "{size}");
                let mut late = Vec::new();
                cells.overlaps(b, &boxes, 150, |k| late.push(k));
                late.sort_unstable();
                assert!(late.iter().eq(all.iter().filter(|&&k| k >= 150)));
            }
        }
    }
}
