//! Nearest neighbours of every node.

use selvedge_math::DVec3;

/// Exact nearest neighbours within a reach, by a hashed grid of cells of that size.
#[derive(Clone, Debug, Default)]
pub(crate) struct Search {
    /// Bucket and cell of each node.
    places: Vec<(u32, [i64; 3])>,
    /// Nodes by bucket; bucket `b` holds `sorted[bucket_start[b]..bucket_start[b + 1]]`.
    bucket_start: Vec<u32>,
    sorted: Vec<Sorted>,
    found: Vec<(f64, u32)>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Sorted {
    node: u32,
    cell: [i64; 3],
    position: DVec3,
}

/// One of `count` buckets, a power of two.
fn bucket(cell: [i64; 3], count: usize) -> usize {
    let mixed = (cell[0].wrapping_mul(73_856_093))
        ^ (cell[1].wrapping_mul(19_349_663))
        ^ (cell[2].wrapping_mul(83_492_791));
    mixed as usize & (count - 1)
}

impl Search {
    /// With room for everything that can be found among `n` nodes.
    pub(crate) fn with_capacity(n: usize) -> Self {
        Self {
            found: Vec::with_capacity(n),
            ..Self::default()
        }
    }

    /// Sorts the nodes into cells of the size of the reach.
    pub(crate) fn fill(&mut self, x: &[DVec3], reach: f64) {
        let count = x.len().next_power_of_two();
        self.places.clear();
        self.places.extend(x.iter().map(|p| {
            let cell = (*p / reach).to_array().map(|c| c.floor() as i64);
            (bucket(cell, count) as u32, cell)
        }));
        // Sizes, then ends of the buckets; filling from the back turns the ends into starts.
        self.bucket_start.clear();
        self.bucket_start.resize(count + 1, 0);
        for &(bucket, _) in &self.places {
            self.bucket_start[bucket as usize] += 1;
        }
        let mut end = 0;
        for bucket in &mut self.bucket_start {
            end += *bucket;
            *bucket = end;
        }
        self.sorted.resize(x.len(), Sorted::default());
        for (node, &(bucket, cell)) in self.places.iter().enumerate().rev() {
            let end = &mut self.bucket_start[bucket as usize];
            *end -= 1;
            self.sorted[*end as usize] = Sorted {
                node: node as u32,
                cell,
                position: x[node],
            };
        }
    }

    /// The nodes nearest to node `i`, at most `limit` of them, those closer than `reach`, with their
    /// squared distances.
    pub(crate) fn nearest(
        &mut self,
        x: &[DVec3],
        i: u32,
        reach: f64,
        limit: usize,
    ) -> &[(f64, u32)] {
        let centre = x[i as usize];
        let (_, [cx, cy, cz]) = self.places[i as usize];
        let count = self.bucket_start.len() - 1;
        self.found.clear();
        let around = |c: i64| [c.wrapping_sub(1), c, c.wrapping_add(1)];
        for x in around(cx) {
            for y in around(cy) {
                for z in around(cz) {
                    let cell = [x, y, z];
                    let bucket = bucket(cell, count);
                    let range =
                        self.bucket_start[bucket] as usize..self.bucket_start[bucket + 1] as usize;
                    for other in &self.sorted[range] {
                        let squared = centre.distance_squared(other.position);
                        // Other cells may share the bucket.
                        if squared < reach * reach && other.cell == cell && other.node != i {
                            self.found.push((squared, other.node));
                        }
                    }
                }
            }
        }
        if self.found.len() > limit {
            let nearer = |a: &(f64, u32), b: &(f64, u32)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
            self.found.select_nth_unstable_by(limit - 1, nearer);
            self.found.truncate(limit);
        }
        self.found.sort_unstable_by_key(|&(_, j)| j);
        &self.found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a fixed linear congruential generator in a small box.
    fn cloud(n: usize) -> Vec<DVec3> {
        let mut state = 1u64;
        let mut next = || {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        (0..n).map(|_| DVec3::new(next(), next(), next())).collect()
    }

    #[test]
    fn neighbours_are_those_of_a_full_scan() {
        let x = cloud(300);
        let mut search = Search::default();
        for reach in [0.05, 0.3] {
            search.fill(&x, reach);
            for i in 0..x.len() {
                let mut all: Vec<(f64, u32)> = (0..x.len())
                    .filter(|&j| j != i)
                    .map(|j| (x[i].distance(x[j]), j as u32))
                    .collect();
                all.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
                let mut expected: Vec<u32> = all
                    .iter()
                    .take(12)
                    .filter(|(d, _)| *d < reach)
                    .map(|&(_, j)| j)
                    .collect();
                expected.sort_unstable();
                let got: Vec<u32> = search
                    .nearest(&x, i as u32, reach, 12)
                    .iter()
                    .map(|&(_, j)| j)
                    .collect();
                assert_eq!(got, expected);
            }
        }
    }
}
