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
}

type Range = [[i32; 2]; 3];

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
        let total = self.count.iter().product::<i32>() as usize;
        self.start.clear();
        self.start.resize(total + 2, 0);
        for b in boxes {
            let range = self.range(b);
            self.visit(&range, |start, cell| start[cell + 2] += 1);
        }
        for cell in 2..self.start.len() {
            self.start[cell] += self.start[cell - 1];
        }
        let entries = self.start[total + 1] as usize;
        let mut items = std::mem::take(&mut self.items);
        items.clear();
        items.resize(entries, 0);
        for (k, b) in boxes.iter().enumerate() {
            let range = self.range(b);
            self.visit(&range, |start, cell| {
                items[start[cell + 1] as usize] = k as u32;
                start[cell + 1] += 1;
            });
        }
        self.items = items;
    }

    fn range(&self, b: &Bounds) -> Range {
        let (low, high) = (
            ((b.low - self.origin) * self.per_metre).to_array(),
            ((b.high - self.origin) * self.per_metre).to_array(),
        );
        [0, 1, 2].map(|k| {
            let last = self.count[k] - 1;
            [
                (low[k] as i32).clamp(0, last),
                (high[k] as i32).clamp(0, last),
            ]
        })
    }

    fn visit(&mut self, range: &Range, mut f: impl FnMut(&mut [u32], usize)) {
        for z in range[2][0]..=range[2][1] {
            for y in range[1][0]..=range[1][1] {
                let row = (z * self.count[1] + y) * self.count[0];
                for x in range[0][0]..=range[0][1] {
                    f(&mut self.start, (row + x) as usize);
                }
            }
        }
    }

    /// Calls `f` with each box that overlaps `b`, once, in a fixed order.
    pub(crate) fn overlaps(&self, b: &Bounds, boxes: &[Bounds], mut f: impl FnMut(u32)) {
        let range = self.range(b);
        for z in range[2][0]..=range[2][1] {
            for y in range[1][0]..=range[1][1] {
                let row = (z * self.count[1] + y) * self.count[0];
                for x in range[0][0]..=range[0][1] {
                    let cell = (row + x) as usize;
                    let items = self.start[cell] as usize..self.start[cell + 1] as usize;
                    for &k in &self.items[items] {
                        let other = &boxes[k as usize];
                        if !b.overlaps(other) {
                            continue;
                        }
                        // Only in the first cell that both are in.
                        let theirs = self.range(other);
                        let owner = [0, 1, 2].map(|k| range[k][0].max(theirs[k][0]));
                        if owner == [x, y, z] {
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
                cells.overlaps(b, &boxes, |k| found.push(k));
                found.sort_unstable();
                let all: Vec<u32> = (0..300)
                    .filter(|&k| b.overlaps(&boxes[k as usize]))
                    .collect();
                assert_eq!(found, all, "{size}");
            }
        }
    }
}
