//! The substep without constraints.

use selvedge_math::DVec3;

use crate::bending::Matrix;
use crate::linear::{Cholesky, Threads};
use crate::nodes::Nodes;
use crate::{Error, Material};

/// Stiffness of the grip on a held node, as a share of the node's own.
const GRIP: f64 = 1e6;

/// `E = 2 M/h^2 + D/h + (1/2 + b/h) kappa K` with tension and grips, the matrix of an implicit midpoint substep without
/// constraints.
#[derive(Debug)]
pub(crate) struct Predictor {
    cholesky: Cholesky,
    entries: Vec<(u32, u32, f64)>,
    values: Vec<f64>,
    /// The values without tension.
    constant: Vec<f64>,
    /// The entries that an edge adds to.
    places: Vec<[u32; 3]>,
    /// The entries on the diagonal.
    diagonal: Vec<u32>,
    /// Stiffness of the grip on each held node [N/m], zero for others.
    grips: Vec<f64>,
    h: f64,
    /// What a node resists on average without tension [N/m].
    pub(crate) resistance: f64,
    /// What each resists by inertia and drag alone [N/m].
    inertias: Vec<f64>,
    /// Masses for this `h`, which make the decay by drag exact.
    pub(crate) masses: Vec<f64>,
}

impl Predictor {
    pub(crate) fn new(n: usize, bending: &Matrix, edges: &[[u32; 2]]) -> Result<Self, Error> {
        let mut entries: Vec<(u32, u32, f64)> = bending.lower().collect();
        entries.extend(edges.iter().map(|&[p, q]| (q, p, 0.0)));
        entries.sort_by_key(|&(r, c, _)| (r, c));
        entries.dedup_by(|extra, kept| {
            let same = (extra.0, extra.1) == (kept.0, kept.1);
            kept.2 += if same { extra.2 } else { 0.0 };
            same
        });
        let place = |r, c| {
            let found = entries.binary_search_by_key(&(r, c), |&(r, c, _)| (r, c));
            found.unwrap_or_default() as u32
        };
        let places = edges
            .iter()
            .map(|&[p, q]| [place(p, p), place(q, q), place(q, p)])
            .collect();
        let pattern: Vec<(u32, u32)> = entries.iter().map(|&(r, c, _)| (r, c)).collect();
        Ok(Self {
            cholesky: Cholesky::analyse(n, &pattern)?.single_if_large(),
            values: vec![0.0; entries.len()],
            constant: vec![0.0; entries.len()],
            places,
            diagonal: (0..n as u32).map(|k| place(k, k)).collect(),
            grips: vec![0.0; n],
            inertias: vec![0.0; n],
            entries,
            h: 0.0,
            resistance: 0.0,
            masses: vec![0.0; n],
        })
    }

    /// Builds the constant part for the substep `h`, and what the nodes do with a force; true when
    /// that is new.
    pub(crate) fn prepare(
        &mut self,
        h: f64,
        material: &Material,
        areas: &[f64],
        nodes: &mut Nodes,
    ) -> bool {
        if self.h == h {
            return false;
        }
        let &Material {
            density,
            damping,
            bending,
            internal_damping,
            ..
        } = material;
        // With this mass the midpoint rule decays by exp(-alpha h / rho), as drag does.
        let turn = 0.5 * h * damping / density;
        let exact = if turn > 0.0 { turn / turn.tanh() } else { 1.0 };
        let stiffness = bending * (0.5 + internal_damping / h);
        for (k, mass) in self.masses.iter_mut().enumerate() {
            *mass = density * areas[k] * exact;
            let diagonal = 2.0 * *mass / (h * h) + damping * areas[k] / h;
            self.inertias[k] = diagonal;
            nodes.set_inverse(k, 1.0 / diagonal);
        }
        for (value, &(r, c, k)) in self.constant.iter_mut().zip(&self.entries) {
            *value = stiffness * k;
            if r == c {
                *value += self.inertias[r as usize];
            }
        }
        let diagonal = self.diagonal.iter();
        let sum: f64 = diagonal.map(|&k| self.constant[k as usize]).sum();
        self.resistance = sum / areas.len() as f64;
        self.h = h;
        true
    }

    pub(crate) fn set_threads(&mut self, threads: &Threads) {
        self.cholesky.set_threads(threads);
    }

    /// The matrix is built anew.
    pub(crate) fn forget(&mut self) {
        self.h = 0.0;
    }

    /// Factors `E` with the stiffness that tension gives across each edge [N/m], and with a stiff grip
    /// on held nodes: in their place, the others' bending and tension give their reactions at once.
    pub(crate) fn factor(&mut self, tautness: &[f64], held: &[u32]) -> Result<(), Error> {
        self.values.copy_from_slice(&self.constant);
        self.grips.fill(0.0);
        for &node in held {
            let value = &mut self.values[self.diagonal[node as usize] as usize];
            self.grips[node as usize] = GRIP * *value;
            *value += GRIP * *value;
        }
        for (&[p, q, pq], stiffness) in self.places.iter().zip(tautness) {
            self.values[p as usize] += stiffness;
            self.values[q as usize] += stiffness;
            self.values[pq as usize] -= stiffness;
        }
        self.cholesky.factor(&self.values)
    }

    /// Stiffness of the grip on a held node in the present factor [N/m].
    pub(crate) fn grip(&self, node: usize) -> f64 {
        self.grips[node]
    }

    /// Solves `E u = load` and puts `from + u` into `x`.
    ///
    /// Of large sheets the factor is in single precision. Bending and tension have no sum, so that the sum of
    /// the loads is that of inertia, drag and grips: what it lacks is given to all nodes alike, which keeps the
    /// momentum to rounding.
    pub(crate) fn solve(&mut self, load: &[DVec3], from: &[DVec3], x: &mut [DVec3]) {
        x.copy_from_slice(load);
        self.cholesky.solve_points(x);
        let resistances = self.inertias.iter().zip(&self.grips);
        let (mut left, mut all) = (DVec3::ZERO, 0.0);
        for ((load, u), (inertia, grip)) in load.iter().zip(&*x).zip(resistances) {
            let resistance = inertia + grip;
            left += *load - *u * resistance;
            all += resistance;
        }
        let shift = left / all;
        for (x, from) in x.iter_mut().zip(from) {
            *x += *from + shift;
        }
    }
}
