//! The unconstrained step: inertia, weight, damping and bending.

use std::f64::consts::PI;

use selvedge_cloth::linear::multiply;
use selvedge_cloth::{Grid, Material};
use selvedge_math::DVec3;

/// Stiffness-proportional damping, as a share of the bending matrix [s].
const STIFFNESS_DAMPING: f64 = 0.02;
/// Rows of coordinates are padded with zeros to a multiple of so many, so that products of
/// matrices have no remainders.
const PAD: usize = 8;
/// Coordinates of a position, and of a position with its velocity.
const SPACE: usize = 3;
const STATE: usize = 2 * SPACE;

/// `E+ x^ = E- x + h rho A v - (h^2/2) delta g A e_z` with
/// `E+- = rho A + (h/2) C +- (h^2/4) kappa K`, `C = alpha A + 0.02 kappa K`, `K = L^T A^-1 L`.
///
/// Solved by fast diagonalisation (Lynch, Rice and Thomas 1964). On the rectangular grid the
/// lumped areas are products of trapezoid weights, and both factors of `L = K_x M_y + M_x K_y`,
/// stiffness and mass of linear elements along one side, have the eigenvectors
/// `u_p(i) = cos(pi p i / (n - 1))` against these weights:
///
/// ```text
/// theta_p = (2 - 2 cos(pi p / (n - 1))) / d^2         stiffness
/// mu_p    = 1 - d^2 theta_p / 6                       mass
/// l_pq    = theta_p mu_q + mu_p theta_q               A^-1 L;  A^-1 K has l_pq^2
/// ```
///
/// So in the amplitudes `X`, `V` of the products `u_p(i) u_q(j)` the step is
/// `X^ = X + (h rho V - (h^2/2) kappa l^2 X) / (rho + (h/2)(alpha + 0.02 kappa l^2) + (h^2/4) kappa l^2)`,
/// the weight acts on the constant mode, and small dense products replace the solves.
///
/// **Not physics**: `L` takes no account of the free border, which bending therefore pulls inwards,
/// and `alpha` multiplies area, not mass.
pub(crate) struct Predictor {
    nodes: [usize; 2],
    /// Nodes along x with the padding.
    width: usize,
    /// `l_pq^2` [1/m^4], padded like the amplitudes.
    squared_eigenvalues: Vec<f64>,
    /// From nodes to amplitudes and back, along x multiplied from the right.
    analysis_x: Vec<f64>,
    synthesis_x: Vec<f64>,
    /// Along y multiplied from the left, for the even and for the odd modes.
    analysis_y: [Vec<f64>; 2],
    synthesis_y: [Vec<f64>; 2],
    /// Shares of `X` and of `V` in the change of `X`, by mode.
    shares: Vec<[f64; 2]>,
    /// Change of height of every node by its weight [m].
    sinking: f64,
    // Scratch: row j holds one row of the grid for each coordinate. The padding of `moving` is
    // never written, so that nothing outlives a step that failed.
    moving: Vec<f64>,
    half_way: Vec<f64>,
    amplitudes: Vec<f64>,
    change: Vec<f64>,
}

impl Predictor {
    pub(crate) fn new(grid: Grid) -> Self {
        let ([na, nb], [dx, dy]) = (grid.nodes, grid.spacing());
        let width = na.next_multiple_of(PAD);
        let mut squared_eigenvalues = vec![0.0; width * nb];
        let [even, odd] = [nb.div_ceil(2), nb / 2];
        let modes_y = (0..even).map(|k| 2 * k).chain((0..odd).map(|k| 2 * k + 1));
        for (row, q) in modes_y.enumerate() {
            for p in 0..na {
                let ((stiff_x, mass_x), (stiff_y, mass_y)) =
                    (element(p, na, dx), element(q, nb, dy));
                let l = stiff_x * mass_y + mass_x * stiff_y;
                squared_eigenvalues[row * width + p] = l * l;
            }
        }
        Self {
            nodes: grid.nodes,
            width,
            analysis_x: dense(na, width, |i, p| amplitude_weight(p, i, na)),
            synthesis_x: dense(na, width, |p, i| mode(p, i, na)),
            // Folding leaves the differences in the last rows, the middle of the sheet first.
            analysis_y: [
                dense(even, even, |k, j| amplitude_weight(2 * k, j, nb)),
                dense(odd, odd, |k, j| {
                    amplitude_weight(2 * k + 1, odd - 1 - j, nb)
                }),
            ],
            synthesis_y: [
                dense(even, even, |j, k| mode(2 * k, j, nb)),
                dense(odd, odd, |j, k| mode(2 * k + 1, odd - 1 - j, nb)),
            ],
            shares: vec![[0.0; 2]; width * nb],
            squared_eigenvalues,
            sinking: 0.0,
            moving: vec![0.0; nb * STATE * width],
            half_way: vec![0.0; nb * STATE * width],
            amplitudes: vec![0.0; nb * STATE * width],
            change: vec![0.0; nb * SPACE * width],
        }
    }

    /// Sets what depends on the substep `h` [s]; `g` is the gravitational acceleration [m/s^2].
    pub(crate) fn prepare(&mut self, material: &Material, g: f64, h: f64) {
        let &Material {
            density,
            gravitational_density,
            damping,
            bending,
            ..
        } = material;
        for (share, squared) in self.shares.iter_mut().zip(&self.squared_eigenvalues) {
            let stiffness = bending * squared;
            let damping = damping + STIFFNESS_DAMPING * stiffness;
            let implicit = density + h / 2.0 * damping + h * h / 4.0 * stiffness;
            *share = [-h * h / 2.0 * stiffness / implicit, h * density / implicit];
        }
        let implicit = density + h / 2.0 * damping;
        self.sinking = -h * h / 2.0 * gravitational_density * g / implicit;
    }

    /// Replaces positions by the prediction.
    pub(crate) fn predict(&mut self, x: &mut [DVec3], v: &[DVec3]) {
        let ([na, nb], width) = (self.nodes, self.width);
        let rows = x.chunks_exact(na).zip(v.chunks_exact(na));
        for (row, (x, v)) in self.moving.chunks_exact_mut(STATE * width).zip(rows) {
            for (i, (x, v)) in x.iter().zip(v).enumerate() {
                for (c, value) in [x.x, x.y, x.z, v.x, v.y, v.z].into_iter().enumerate() {
                    row[c * width + i] = value;
                }
            }
        }
        fold(&mut self.moving, STATE * width);
        multiply_halves(&self.analysis_y, &self.moving, nb, &mut self.half_way);
        multiply(
            &self.half_way,
            &self.analysis_x,
            width,
            &mut self.amplitudes,
        );
        let shares = self.shares.chunks_exact(width);
        let changes = self.change.chunks_exact_mut(SPACE * width);
        for ((change, state), shares) in changes
            .zip(self.amplitudes.chunks_exact(STATE * width))
            .zip(shares)
        {
            let (positions, velocities) = state.split_at(SPACE * width);
            let coordinates = positions
                .chunks_exact(width)
                .zip(velocities.chunks_exact(width));
            for (change, (x, v)) in change.chunks_exact_mut(width).zip(coordinates) {
                for (((change, x), v), [of_x, of_v]) in change.iter_mut().zip(x).zip(v).zip(shares)
                {
                    *change = of_x * x + of_v * v;
                }
            }
        }
        let half_way = &mut self.half_way[..nb * SPACE * width];
        multiply(&self.change, &self.synthesis_x, width, half_way);
        multiply_halves(&self.synthesis_y, half_way, nb, &mut self.change);
        fold(&mut self.change, SPACE * width);
        for (row, x) in self
            .change
            .chunks_exact(SPACE * width)
            .zip(x.chunks_exact_mut(na))
        {
            for (i, x) in x.iter_mut().enumerate() {
                let change = DVec3::new(row[i], row[width + i], row[2 * width + i]);
                *x += change + DVec3::Z * self.sinking;
            }
        }
    }
}

/// Sums of the first and last row, the second and last but one, and so on in the first half of the
/// rows, their differences in the last. Even modes see only the sums, odd ones only the differences;
/// and the other way round the same makes nodes of the two parts.
fn fold(rows: &mut [f64], length: usize) {
    let mut rows = rows.chunks_exact_mut(length);
    while let (Some(first), Some(last)) = (rows.next(), rows.next_back()) {
        for (a, b) in first.iter_mut().zip(last) {
            (*a, *b) = (*a + *b, *a - *b);
        }
    }
}

/// Multiplies the sums and the differences among `n` folded rows, each by its matrix.
fn multiply_halves([even, odd]: &[Vec<f64>; 2], from: &[f64], n: usize, to: &mut [f64]) {
    let sums = n.div_ceil(2);
    let (from_even, from_odd) = from.split_at(from.len() / n * sums);
    let (to_even, to_odd) = to.split_at_mut(from_even.len());
    multiply(even, from_even, sums, to_even);
    multiply(odd, from_odd, n - sums, to_odd);
}

/// Eigenvalues `theta` [1/m^2] and `mu` of mode `p` along a side with `n` nodes at distance `d` [m].
fn element(p: usize, n: usize, d: f64) -> (f64, f64) {
    // 2 - 2 cos, without its cancellation.
    let stiffness = 4.0 * (PI / 2.0 * p as f64 / (n - 1) as f64).sin().powi(2) / (d * d);
    (stiffness, 1.0 - d * d * stiffness / 6.0)
}

/// `u_p(i)` along a side with `n` nodes.
fn mode(p: usize, i: usize, n: usize) -> f64 {
    // Reduced by the period, since the cosine loses digits with growing angles.
    (PI * (p * i % (2 * (n - 1))) as f64 / (n - 1) as f64).cos()
}

/// What node `i` adds to the amplitude of mode `p`: `w_i u_p(i) / sum_k w_k u_p(k)^2` with the
/// trapezoid weights `w`.
fn amplitude_weight(p: usize, i: usize, n: usize) -> f64 {
    let half_at_ends = |k: usize| if k == 0 || k + 1 == n { 0.5 } else { 1.0 };
    let norm = (n - 1) as f64 * 0.5 / half_at_ends(p);
    half_at_ends(i) * mode(p, i, n) / norm
}

/// A square matrix padded with zeros from `n` to `width`, row by row.
fn dense(n: usize, width: usize, entry: impl Fn(usize, usize) -> f64) -> Vec<f64> {
    let mut matrix = vec![0.0; width * width];
    for row in 0..n {
        for column in 0..n {
            matrix[row * width + column] = entry(row, column);
        }
    }
    matrix
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::operators::{bending, lumped_areas};

    /// `E+ x^ = E- x + h rho A v - (h^2/2) delta g A e_z`, by the matrices themselves.
    #[test]
    fn the_prediction_solves_the_matrix_equation() {
        let (g, h) = (9.8, 1.0 / 360.0);
        let material = Material {
            bending: 7e-5,
            ..Material::default()
        };
        let &Material {
            density,
            gravitational_density,
            damping,
            ..
        } = &material;
        for nodes in [[2, 2], [2, 7], [7, 2], [3, 3], [5, 6], [8, 9], [23, 28]] {
            let grid = Grid {
                nodes,
                sides: [0.42, 0.59],
            };
            let areas = lumped_areas(grid);
            let stiffness = bending(grid, &areas);
            // A crumpled sheet.
            let wave =
                |k: usize, f: f64| DVec3::new((f * k as f64).sin(), (k as f64 / f).cos(), 0.3);
            let start: Vec<DVec3> = (0..areas.len()).map(|k| 0.1 * wave(k, 1.3)).collect();
            let velocities: Vec<DVec3> = (0..areas.len()).map(|k| wave(k, 0.7)).collect();
            let mut predicted = start.clone();
            let mut predictor = Predictor::new(grid);
            predictor.prepare(&material, g, h);
            predictor.predict(&mut predicted, &velocities);

            let kappa = material.bending;
            let damped = h / 2.0 * STIFFNESS_DAMPING * kappa;
            let elastic = h * h / 4.0 * kappa;
            let weight = h * h / 2.0 * gravitational_density * g * DVec3::Z;
            for (r, &area) in areas.iter().enumerate() {
                let mass = area * (density + h / 2.0 * damping);
                let mut off = mass * (predicted[r] - start[r]) + area * weight
                    - area * h * density * velocities[r];
                let mut size = (mass * start[r]).length();
                for (c, k) in stiffness.row(r) {
                    let (new, old) = (predicted[c as usize], start[c as usize]);
                    off += damped * k * (new - old) + elastic * k * (new + old);
                    size += (damped + elastic) * k.abs() * new.length();
                }
                assert!(
                    off.length() < 1e-12 * size,
                    "{nodes:?}, node {r}: {off} of {size:e}"
                );
            }
        }
    }

    // Reference values measured on the original scheme.
    #[test]
    fn the_first_prediction_of_the_table_mesh() {
        let mesh = selvedge_cloth::Mesh::grid([23, 28], [0.42, 0.59]).unwrap();
        let mut predictor = Predictor::new(mesh.as_grid().unwrap());
        predictor.prepare(&Material::default(), 9.8, 1.0 / 360.0);
        let mut x = mesh.rest().to_vec();
        predictor.predict(&mut x, &[DVec3::splat(1e-12); 644]);
        for x in &x {
            assert!((x.z + 1.722078610045e-5).abs() < 1e-14);
        }
        let moved = x[0] - mesh.rest()[0];
        assert!((moved.x - 1.54563997e-4).abs() < 1e-12);
        assert!((moved.y - 1.09744848e-4).abs() < 1e-12);
    }
}
