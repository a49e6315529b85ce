//! Lumped areas of a rectangular sheet, and for the tests its Laplacian and bending matrix, which
//! the predictor knows by their eigenvectors; all per unit density.

use selvedge_cloth::Grid;

/// A square sparse matrix by rows; the same scalar acts on x, y and z.
#[cfg(test)]
#[derive(Clone, Debug)]
pub(crate) struct Rows {
    pub(crate) start: Vec<u32>,
    pub(crate) column: Vec<u32>,
    pub(crate) value: Vec<f64>,
}

#[cfg(test)]
impl Rows {
    /// From dense-in-pattern rows: `rows[r]` lists `(column, value)` in any order, repeats summed.
    fn from_lists(rows: Vec<Vec<(u32, f64)>>) -> Self {
        let mut out = Self {
            start: vec![0],
            column: Vec::new(),
            value: Vec::new(),
        };
        for mut row in rows {
            row.sort_by_key(|&(column, _)| column);
            for (column, value) in row {
                let first = *out.start.last().unwrap_or(&0) as usize;
                if out.column.len() > first && out.column.last() == Some(&column) {
                    if let Some(last) = out.value.last_mut() {
                        *last += value;
                    }
                } else {
                    out.column.push(column);
                    out.value.push(value);
                }
            }
            out.start.push(out.column.len() as u32);
        }
        out
    }

    pub(crate) fn row(&self, r: usize) -> impl Iterator<Item = (u32, f64)> + '_ {
        let range = self.start[r] as usize..self.start[r + 1] as usize;
        range.map(|k| (self.column[k], self.value[k]))
    }
}

/// The number of quads around each node: 1 at a corner, 2 on the border, 4 inside.
pub(crate) fn face_counts(grid: Grid) -> Vec<f64> {
    let [na, nb] = grid.nodes;
    let along = |i: usize, n: usize| if i == 0 || i + 1 == n { 1.0 } else { 2.0 };
    let mut counts = Vec::with_capacity(na * nb);
    for j in 0..nb {
        counts.extend((0..na).map(|i| along(i, na) * along(j, nb)));
    }
    counts
}

/// The area share [m^2] of each node, `m_k = F_k dx dy / 4`: the row sums of the mass matrix of
/// bilinear quads, which on rectangles is exactly a quarter of every quad around the node.
pub(crate) fn lumped_areas(grid: Grid) -> Vec<f64> {
    let [dx, dy] = grid.spacing();
    face_counts(grid)
        .into_iter()
        .map(|faces| faces * dx * dy / 4.0)
        .collect()
}

/// The Laplacian `L_cd = int grad N_c . grad N_d` of bilinear quads `dx` by `dy`. Positive
/// semidefinite, `L 1 = 0`.
///
/// **Not physics**: the rows of border nodes are not corrected for the free border, so bending a
/// flat sheet has an energy and pulls on its border.
#[cfg(test)]
fn laplacian(grid: Grid) -> Rows {
    let ([na, nb], [dx, dy]) = (grid.nodes, grid.spacing());
    // Corners in the order of the quad: (0,0), (1,0), (1,1), (0,1).
    const ALONG_X: [[f64; 4]; 4] = [
        [2., -2., -1., 1.],
        [-2., 2., 1., -1.],
        [-1., 1., 2., -2.],
        [1., -1., -2., 2.],
    ];
    const ALONG_Y: [[f64; 4]; 4] = [
        [2., 1., -1., -2.],
        [1., 2., -2., -1.],
        [-1., -2., 2., 1.],
        [-2., -1., 1., 2.],
    ];
    let mut rows = vec![Vec::new(); na * nb];
    for j in 0..nb - 1 {
        for i in 0..na - 1 {
            let k = j * na + i;
            let corners = [k, k + 1, k + 1 + na, k + na];
            for (c, &row) in corners.iter().enumerate() {
                for (d, &column) in corners.iter().enumerate() {
                    let value = dy / (6.0 * dx) * ALONG_X[c][d] + dx / (6.0 * dy) * ALONG_Y[c][d];
                    rows[row].push((column as u32, value));
                }
            }
        }
    }
    Rows::from_lists(rows)
}

/// The squared Laplacian `K = L^T A^-1 L` [1/m^2]; the bending energy is `kappa/2 x^T K x`.
#[cfg(test)]
pub(crate) fn bending(grid: Grid, areas: &[f64]) -> Rows {
    let laplacian = laplacian(grid);
    let rows = (0..areas.len()).map(|r| {
        let mut row = Vec::new();
        // L is symmetric: row r of L^T is row r of L.
        for (k, left) in laplacian.row(r) {
            for (column, right) in laplacian.row(k as usize) {
                row.push((column, left * right / areas[k as usize]));
            }
        }
        row
    });
    Rows::from_lists(rows.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: Grid = Grid {
        nodes: [23, 28],
        sides: [0.42, 0.59],
    };

    fn diagonal(rows: &Rows, r: usize) -> f64 {
        rows.row(r).find(|&(c, _)| c as usize == r).unwrap().1
    }

    // Reference values measured on the original scheme.
    #[test]
    fn areas_and_matrices_of_the_table_mesh() {
        let areas = lumped_areas(TABLE);
        assert!((areas.iter().sum::<f64>() - 0.2478).abs() < 1e-13);
        for (node, area) in [
            (0, 1.0429292929e-4),
            (1, 2.0858585859e-4),
            (24, 4.1717171717e-4),
        ] {
            assert!((areas[node] - area).abs() < 1e-14);
        }
        let l = laplacian(TABLE);
        assert!((diagonal(&l, 24) - 2.6910301110).abs() < 1e-10);
        assert!((diagonal(&l, 0) - 0.6727575277).abs() < 1e-10);
        for r in 0..644 {
            assert!(l.row(r).map(|(_, v)| v).sum::<f64>().abs() < 1e-14);
        }
        let k = bending(TABLE, &areas);
        assert!((diagonal(&k, 241) - 19704.76981651).abs() < 1e-7);
        assert!((diagonal(&k, 0) - 4926.19245413).abs() < 1e-7);
        let trace: f64 = (0..644).map(|r| diagonal(&k, r)).sum();
        assert!((trace - 11791957.686).abs() < 1e-2);
        assert_eq!(k.value.len(), 14606);
    }
}
