//! The Newton matrix of the projection.

use selvedge_math::DVec3;

use super::row::Row;
use crate::Error;
use crate::linear::Cholesky;

/// `M + sum mu C'' + J^T W J` over the coordinates of all nodes; those that are fixed have a row and
/// a column of the identity.
pub(super) struct Newton {
    cholesky: Cholesky,
    /// Row and column of each value.
    pattern: Vec<(u32, u32)>,
    values: Vec<f64>,
    /// Where the blocks of each row begin, by pair of its nodes; `NONE` above the diagonal.
    blocks: Vec<[[u32; 4]; 4]>,
    fixed: Vec<bool>,
    unknowns: Vec<f64>,
}

const NONE: u32 = u32::MAX;

/// What a row brings to the matrix.
#[derive(Clone, Copy)]
pub(super) struct Share {
    pub(super) multiplier: f64,
    pub(super) weight: f64,
}

impl Newton {
    pub(super) fn new(rows: &[Row], fixed: &[bool]) -> Result<Self, Error> {
        let n = fixed.len();
        let mut pairs: Vec<(u32, u32)> = (0..n as u32).map(|node| (node, node)).collect();
        for row in rows {
            let nodes = row.nodes();
            let all = nodes.iter().flat_map(|&p| nodes.map(|q| (p, q)));
            pairs.extend(all.filter(|(p, q)| p < q));
        }
        pairs.sort_unstable();
        pairs.dedup();
        let mut pattern = Vec::with_capacity(9 * pairs.len());
        let mut begin = Vec::with_capacity(pairs.len());
        for &(p, q) in &pairs {
            begin.push(pattern.len() as u32);
            for i in 0..3 {
                let first = if p == q { i } else { 0 };
                pattern.extend((first..3).map(|j| (3 * p + i, 3 * q + j)));
            }
        }
        let blocks = rows.iter().map(|row| {
            row.nodes().map(|p| {
                row.nodes().map(|q| match pairs.binary_search(&(p, q)) {
                    Ok(k) => begin[k],
                    Err(_) => NONE,
                })
            })
        });
        Ok(Self {
            blocks: blocks.collect(),
            cholesky: Cholesky::analyse(3 * n, &pattern)?,
            values: vec![0.0; pattern.len()],
            pattern,
            fixed: fixed.to_vec(),
            unknowns: vec![0.0; 3 * n],
        })
    }

    /// Builds and factors the matrix: exact, or without what may make it indefinite. `diagonal` is
    /// by node.
    pub(super) fn factor(
        &mut self,
        x: &[DVec3],
        rows: &[Row],
        shares: &[Share],
        diagonal: &[DVec3],
        exact: bool,
    ) -> Result<(), Error> {
        self.values.fill(0.0);
        for ((row, share), blocks) in rows.iter().zip(shares).zip(&self.blocks) {
            let gradients = row.gradients(x);
            let nodes = row.nodes();
            let bend = if exact || (row.is_square() && share.multiplier > 0.0) {
                share.multiplier
            } else {
                0.0
            };
            for s in 0..4 {
                for t in 0..4 {
                    if blocks[s][t] == NONE {
                        continue;
                    }
                    let diagonal = nodes[s] == nodes[t];
                    let left = (share.weight * gradients[s]).to_array();
                    let right = gradients[t].to_array();
                    let mut k = blocks[s][t] as usize;
                    for (i, left) in left.into_iter().enumerate() {
                        let first = if diagonal { i } else { 0 };
                        for (j, right) in right.into_iter().enumerate().skip(first) {
                            self.values[k] += left * right;
                            if i == j {
                                self.values[k] += bend * Row::second(s, t);
                            }
                            k += 1;
                        }
                    }
                }
            }
        }
        for (value, &(r, c)) in self.values.iter_mut().zip(&self.pattern) {
            let (p, q) = (r as usize / 3, c as usize / 3);
            if self.fixed[p] || self.fixed[q] {
                *value = if r == c { 1.0 } else { 0.0 };
            } else if r == c {
                *value += diagonal[p][r as usize % 3];
            }
        }
        self.cholesky.factor(&self.values)
    }

    /// `x = -H^-1 gradient`, zero at fixed nodes.
    pub(super) fn direction(&mut self, gradient: &[DVec3], direction: &mut [DVec3]) {
        for ((unknowns, g), fixed) in self
            .unknowns
            .chunks_exact_mut(3)
            .zip(gradient)
            .zip(&self.fixed)
        {
            let g = if *fixed { DVec3::ZERO } else { -*g };
            unknowns.copy_from_slice(&g.to_array());
        }
        self.cholesky.solve(&mut self.unknowns);
        for (d, unknowns) in direction.iter_mut().zip(self.unknowns.chunks_exact(3)) {
            *d = DVec3::from_slice(unknowns);
        }
    }
}
