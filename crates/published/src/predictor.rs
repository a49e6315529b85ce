//! The unconstrained step: inertia, weight, damping and bending.

use selvedge_cloth::linear::Cholesky;
use selvedge_cloth::{Grid, Material};
use selvedge_math::DVec3;

use crate::Error;
use crate::operators::{self, Rows};

/// Stiffness-proportional damping, as a share of the bending matrix [s].
const STIFFNESS_DAMPING: f64 = 0.02;

/// `E+ x^ = E- x + h rho A v - (h^2/2) delta g A e_z` with
/// `E+- = rho A + (h/2) C +- (h^2/4) B`, `B = kappa K`, `C = alpha A + 0.02 kappa K`.
pub(crate) struct Predictor {
    areas: Vec<f64>,
    bending: Rows,
    cholesky: Cholesky,
    slots: Vec<u32>,
    /// `E-`, in the pattern of the bending matrix.
    explicit: Vec<f64>,
    /// `h rho` and `(h^2/2) delta g`, each per area.
    inertia: f64,
    weight: f64,
    rhs: Vec<f64>,
}

impl Predictor {
    pub(crate) fn new(grid: Grid, areas: &[f64]) -> Result<Self, Error> {
        let bending = operators::bending(grid, areas);
        let n = areas.len();
        let mut entries = Vec::new();
        for r in 0..n {
            entries.extend(
                bending
                    .row(r)
                    .map(|(c, _)| (r as u32, c))
                    .filter(|(r, c)| r <= c),
            );
        }
        let (cholesky, slots) = Cholesky::analyse(n, &entries)?;
        Ok(Self {
            areas: areas.to_vec(),
            explicit: vec![0.0; bending.value.len()],
            bending,
            cholesky,
            slots,
            inertia: 0.0,
            weight: 0.0,
            rhs: vec![0.0; 3 * n],
        })
    }

    pub(crate) fn prepare(&mut self, material: &Material, g: f64, h: f64) -> Result<(), Error> {
        let &Material {
            density,
            gravitational_density,
            damping,
            bending,
            ..
        } = material;
        let mass = density + h / 2.0 * damping;
        let damped = h / 2.0 * STIFFNESS_DAMPING * bending;
        let elastic = h * h / 4.0 * bending;
        let values = self.cholesky.values_mut();
        values.fill(0.0);
        let mut slots = self.slots.iter();
        let mut k = 0;
        for r in 0..self.areas.len() {
            for (c, stiffness) in self.bending.row(r) {
                let lumped = if c as usize == r {
                    mass * self.areas[r]
                } else {
                    0.0
                };
                self.explicit[k] = lumped + (damped - elastic) * stiffness;
                k += 1;
                if r <= c as usize
                    && let Some(&slot) = slots.next()
                {
                    values[slot as usize] = lumped + (damped + elastic) * stiffness;
                }
            }
        }
        self.inertia = h * density;
        self.weight = h * h / 2.0 * gravitational_density * g;
        Ok(self.cholesky.factor()?)
    }

    /// Replaces positions by the prediction.
    pub(crate) fn predict(&mut self, x: &mut [DVec3], v: &[DVec3]) {
        let n = x.len();
        for (r, &v) in v.iter().enumerate() {
            let range = self.bending.start[r] as usize..self.bending.start[r + 1] as usize;
            let mut sum = self.areas[r] * (self.inertia * v - DVec3::Z * self.weight);
            for (&c, &value) in self.bending.column[range.clone()]
                .iter()
                .zip(&self.explicit[range])
            {
                sum += value * x[c as usize];
            }
            self.rhs[r] = sum.x;
            self.rhs[n + r] = sum.y;
            self.rhs[2 * n + r] = sum.z;
        }
        for coordinate in self.rhs.chunks_exact_mut(n) {
            self.cholesky.solve(coordinate);
        }
        for (r, x) in x.iter_mut().enumerate() {
            *x = DVec3::new(self.rhs[r], self.rhs[n + r], self.rhs[2 * n + r]);
        }
    }
}
