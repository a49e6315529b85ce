//! Thin-plate bending: the energy `kappa/2 int |Hess x|^2`, a quadratic form whose matrix never
//! changes and acts on x, y and z alike.
//!
//! On a surface that keeps its metric the Gauss curvature is zero, so this is the energy
//! `kappa/2 int |lap x|^2` of mean curvature (Bergou et al. 2006); the full Hessian also resists the
//! saddles and border ripples that a Laplacian does not see (a plate with Poisson ratio 0).
//!
//! A grid has one row for each second difference along its lines and one for the twist of each
//! quad. A border line counts with half a cell's width, and the last difference of a line also for
//! the half cell and the cell end beyond it, so that no area is lost: a flat sheet has no force and
//! no energy, a cylinder's energy is exact to O(h^2), and free edges are natural.
//!
//! Other meshes, their quads cut along a diagonal, have one row for each edge between two triangles
//! (the quadratic hinge of Bergou et al. 2006); a free edge has none.

use selvedge_math::DVec3;

use crate::{Grid, Mesh};

/// A symmetric sparse matrix by rows.
#[derive(Clone, Debug, Default)]
pub(crate) struct Matrix {
    start: Vec<u32>,
    column: Vec<u32>,
    value: Vec<f64>,
}

impl Matrix {
    /// Sums `weight * row row^T` over the rows; a row lists nodes and factors.
    fn from_rows(n: usize, rows: &[(f64, Vec<(u32, f64)>)]) -> Self {
        let mut entries: Vec<(u32, u32, f64)> = (0..n as u32).map(|k| (k, k, 0.0)).collect();
        for (weight, row) in rows {
            for &(a, left) in row {
                entries.extend(row.iter().map(|&(b, right)| (a, b, weight * left * right)));
            }
        }
        entries.sort_by_key(|&(row, column, _)| (row, column));
        let mut matrix = Self {
            start: vec![0; n + 1],
            ..Self::default()
        };
        let mut last = None;
        for (row, column, value) in entries {
            if last == Some((row, column)) {
                if let Some(sum) = matrix.value.last_mut() {
                    *sum += value;
                }
            } else {
                matrix.column.push(column);
                matrix.value.push(value);
                last = Some((row, column));
            }
            matrix.start[row as usize + 1] = matrix.value.len() as u32;
        }
        matrix
    }

    /// `(row, column, value)` of the lower triangle, diagonal included.
    pub(crate) fn lower(&self) -> impl Iterator<Item = (u32, u32, f64)> + '_ {
        (0..self.start.len() - 1).flat_map(move |row| {
            let range = self.start[row] as usize..self.start[row + 1] as usize;
            range
                .map(move |k| (row as u32, self.column[k], self.value[k]))
                .filter(|&(row, column, _)| column <= row)
        })
    }

    /// Sum of the diagonal.
    pub(crate) fn trace(&self) -> f64 {
        let diagonal = self.lower().filter(|(row, column, _)| row == column);
        diagonal.map(|(.., value)| value).sum()
    }

    /// Row `row` times `x`.
    #[inline]
    pub(crate) fn multiply_row(&self, row: usize, x: &[DVec3]) -> DVec3 {
        let mut sum = DVec3::ZERO;
        for k in self.start[row] as usize..self.start[row + 1] as usize {
            sum += x[self.column[k] as usize] * self.value[k];
        }
        sum
    }
}

/// `K` [1/m^2] of the energy `kappa/2 sum x^T K x`.
pub(crate) fn bending_matrix(mesh: &Mesh) -> Matrix {
    let rows = match mesh.as_grid() {
        Some(grid) => grid_rows(grid),
        None => hinge_rows(mesh),
    };
    Matrix::from_rows(mesh.node_count(), &rows)
}

type Row = (f64, Vec<(u32, f64)>);

fn grid_rows(grid: Grid) -> Vec<Row> {
    let ([na, nb], [dx, dy]) = (grid.nodes, grid.spacing());
    let node = |i: usize, j: usize| (j * na + i) as u32;
    // Width of a line's strip, and length that a second difference stands for.
    let width = |k: usize, n: usize| if k == 0 || k + 1 == n { 0.5 } else { 1.0 };
    let length = |k: usize, n: usize| {
        1.0 + if k == 1 { 0.5 } else { 0.0 } + if k + 2 == n { 0.5 } else { 0.0 }
    };
    let mut rows = Vec::new();
    for j in 0..nb {
        for i in 0..na {
            if i > 0 && i + 1 < na {
                let f = 1.0 / (dx * dx);
                let row = vec![
                    (node(i - 1, j), f),
                    (node(i, j), -2.0 * f),
                    (node(i + 1, j), f),
                ];
                rows.push((length(i, na) * dx * width(j, nb) * dy, row));
            }
            if j > 0 && j + 1 < nb {
                let f = 1.0 / (dy * dy);
                let row = vec![
                    (node(i, j - 1), f),
                    (node(i, j), -2.0 * f),
                    (node(i, j + 1), f),
                ];
                rows.push((length(j, nb) * dy * width(i, na) * dx, row));
            }
            if i + 1 < na && j + 1 < nb {
                let f = 1.0 / (dx * dy);
                let row = vec![
                    (node(i, j), f),
                    (node(i + 1, j), -f),
                    (node(i, j + 1), -f),
                    (node(i + 1, j + 1), f),
                ];
                rows.push((2.0 * dx * dy, row));
            }
        }
    }
    rows
}

/// One row for each edge that two triangles share: edge length times angle, by cotangents, over the
/// area of both. This scale is exact for cylinders on regular triangles (Seung and Nelson 1988), and
/// along the sides of halved squares.
fn hinge_rows(mesh: &Mesh) -> Vec<Row> {
    let rest = mesh.rest();
    let mut triangles = mesh.triangles().to_vec();
    for &[a, b, c, d] in mesh.quads() {
        triangles.extend([[a, b, c], [a, c, d]]);
    }
    // Each edge with the corner opposite to it and the triangle's area
    let mut sides: Vec<([u32; 2], u32, f64)> = Vec::with_capacity(3 * triangles.len());
    for &[a, b, c] in &triangles {
        let [p, q, r] = [a, b, c].map(|k| rest[k as usize]);
        let area = 0.5 * (q - p).cross(r - p).length();
        for (from, to, opposite) in [(a, b, c), (b, c, a), (c, a, b)] {
            sides.push(([from.min(to), from.max(to)], opposite, area));
        }
    }
    sides.sort_by_key(|&(edge, opposite, _)| (edge, opposite));
    let mut rows = Vec::new();
    for pair in sides.windows(2) {
        let (edge, first, area) = pair[0];
        let (other, second, other_area) = pair[1];
        if edge != other {
            continue;
        }
        let cotangent = |at: u32, b: u32, c: u32| {
            let [at, b, c] = [at, b, c].map(|k| rest[k as usize]);
            (b - at).dot(c - at) / (b - at).cross(c - at).length()
        };
        let [p, q] = edge;
        let at_p = [cotangent(p, q, first), cotangent(p, q, second)];
        let at_q = [cotangent(q, p, first), cotangent(q, p, second)];
        let row = vec![
            (p, at_q[0] + at_q[1]),
            (q, at_p[0] + at_p[1]),
            (first, -at_p[0] - at_q[0]),
            (second, -at_p[1] - at_q[1]),
        ];
        rows.push((1.0 / (area + other_area), row));
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    fn energy(mesh: &Mesh, x: &[DVec3]) -> f64 {
        let matrix = bending_matrix(mesh);
        let sum: f64 = (0..x.len())
            .map(|k| x[k].dot(matrix.multiply_row(k, x)))
            .sum();
        sum / 2.0
    }

    #[test]
    fn flat_sheets_have_neither_energy_nor_force() {
        let mesh = Mesh::grid([23, 28], [0.42, 0.59]).unwrap();
        let matrix = bending_matrix(&mesh);
        for k in 0..mesh.node_count() {
            assert!(matrix.multiply_row(k, mesh.rest()).length() < 1e-7);
        }
        assert!(energy(&mesh, mesh.rest()).abs() < 1e-8);
    }

    /// `kappa/2 A/R^2`, to second order in the cell, whichever way the cylinder's axis points.
    #[test]
    fn the_energy_of_a_cylinder_converges_to_second_order() {
        let radius = 0.1;
        for angle in [0.0_f64, std::f64::consts::FRAC_PI_2, 0.6] {
            let errors: Vec<f64> = [1, 2, 4]
                .iter()
                .map(|k| {
                    let mesh = Mesh::grid([11 * k + 1, 14 * k + 1], [0.22, 0.28]).unwrap();
                    let rolled: Vec<DVec3> = mesh
                        .rest()
                        .iter()
                        .map(|p| {
                            let along = p.x * angle.cos() + p.y * angle.sin();
                            let axis = -p.x * angle.sin() + p.y * angle.cos();
                            let turn = along / radius;
                            DVec3::new(radius * turn.sin(), axis, radius * turn.cos())
                        })
                        .collect();
                    let exact = 0.5 * 0.22 * 0.28 / (radius * radius);
                    energy(&mesh, &rolled) / exact - 1.0
                })
                .collect();
            assert!(errors[0].abs() < 1e-2, "{angle}: {errors:?}");
            assert!(
                errors[2].abs() < errors[0].abs() / 12.0,
                "{angle}: {errors:?}"
            );
        }
    }

    /// Hinges know the same energy, on regular triangles to 1 %.
    #[test]
    fn hinges_agree_with_the_cylinder() {
        let (rows, columns, side) = (40, 30, 0.01);
        let (mut rest, mut triangles) = (Vec::new(), Vec::new());
        let node = |i: usize, j: usize| (j * columns + i) as u32;
        for j in 0..rows {
            for i in 0..columns {
                let shift = if j % 2 == 1 { 0.5 } else { 0.0 };
                let height = 0.75_f64.sqrt() * j as f64;
                rest.push(side * DVec3::new(i as f64 + shift, height, 0.0));
                if i + 1 < columns && j + 1 < rows {
                    let [a, b, c, d] = [
                        node(i, j),
                        node(i + 1, j),
                        node(i, j + 1),
                        node(i + 1, j + 1),
                    ];
                    match j % 2 {
                        0 => triangles.extend([[a, b, c], [b, d, c]]),
                        _ => triangles.extend([[a, b, d], [a, d, c]]),
                    }
                }
            }
        }
        let mesh = Mesh::new(rest, Vec::new(), triangles).unwrap();
        let matrix = bending_matrix(&mesh);
        for k in 0..mesh.node_count() {
            assert!(matrix.multiply_row(k, mesh.rest()).length() < 1e-7);
        }
        let radius = 0.1;
        let rolled: Vec<DVec3> = mesh
            .rest()
            .iter()
            .map(|p| {
                let turn = p.x / radius;
                DVec3::new(radius * turn.sin(), p.y, radius * turn.cos())
            })
            .collect();
        // Without the border, whose hinges are missing: one side less each way.
        let inner = (columns as f64 - 1.5) * side * (rows as f64 - 2.0) * side * 0.75_f64.sqrt();
        let exact = 0.5 * inner / (radius * radius);
        let ratio = energy(&mesh, &rolled) / exact;
        assert!((ratio - 1.0).abs() < 0.05, "{ratio}");
    }
}
