//! The projection against the conditions of its problem, written down anew: constraint formulas,
//! gradients by differences, multipliers by dense least squares.

#![allow(clippy::unwrap_used, reason = "a failed set-up fails the test")]

mod cases;

use cases::Case;
use selvedge_cloth::{Error, Mesh, Projection, project};
use selvedge_math::DVec3;

/// Largest distance from a constraint and largest imbalance of a coordinate, both in metres.
fn residuals(case: &Case, x: &[DVec3]) -> (f64, f64) {
    let n = x.len();
    let flat = |x: &[DVec3]| -> Vec<f64> { x.iter().flat_map(|x| x.to_array()).collect() };
    let at = |x: &[f64], node: u32| DVec3::from_slice(&x[3 * node as usize..]);
    let grasped = |node: u32| case.grasp.iter().any(|&(held, _)| held == node);
    let (x, rest) = (flat(x), flat(case.mesh.rest()));
    let mut miss: f64 = 0.0;
    for &(node, target) in &case.grasp {
        miss = miss.max(at(&x, node).distance(target));
    }

    // Equalities as functions of the coordinates, edges in metres and shear over a cell side
    type Function<'a> = Box<dyn Fn(&[f64]) -> f64 + 'a>;
    let mut equalities: Vec<Function<'_>> = Vec::new();
    let mut soft: Vec<(Function<'_>, f64)> = Vec::new();
    for &[p, q] in case.mesh.edges() {
        if !(grasped(p) && grasped(q)) {
            let length = at(&rest, p).distance(at(&rest, q));
            equalities.push(Box::new(move |x| at(x, p).distance(at(x, q)) - length));
        }
    }
    if let Some(compliance) = case.shear_compliance {
        let [na, nb] = case.mesh.as_grid().unwrap().nodes;
        for k in 0..n {
            let (i, j) = (k % na, k / na);
            let node = |i: usize, j: usize| (j * na + i) as u32;
            let left = if i > 0 { node(i - 1, j) } else { node(i, j) };
            let right = if i + 1 < na {
                node(i + 1, j)
            } else {
                node(i, j)
            };
            let below = if j > 0 { node(i, j - 1) } else { node(i, j) };
            let above = if j + 1 < nb {
                node(i, j + 1)
            } else {
                node(i, j)
            };
            if [left, right, below, above].into_iter().all(grasped) {
                continue;
            }
            let shear =
                move |x: &[f64]| (at(x, right) - at(x, left)).dot(at(x, above) - at(x, below));
            let scale = at(&rest, right).distance(at(&rest, left));
            if compliance == 0.0 {
                equalities.push(Box::new(move |x| shear(x) / scale));
            } else {
                soft.push((Box::new(shear), compliance));
            }
        }
    }
    for equality in &equalities {
        miss = miss.max(equality(&x).abs());
    }

    // Gradient of the objective, scaled by the roots of the masses
    let root = |c: usize| case.masses[c / 3].sqrt();
    let predicted = flat(&case.predicted);
    let mut gradient: Vec<f64> = (0..3 * n)
        .map(|c| case.masses[c / 3] * (x[c] - predicted[c]))
        .collect();
    for (function, compliance) in &soft {
        let value = function(&x);
        for (g, d) in gradient.iter_mut().zip(derivatives(function, &x)) {
            *g += value * d / compliance;
        }
    }
    let free = |c: usize| !grasped((c / 3) as u32);
    for (c, g) in gradient.iter_mut().enumerate() {
        *g = if free(c) { *g / root(c) } else { 0.0 };
    }

    // Columns of the active constraints, scaled alike
    let mut columns: Vec<Vec<f64>> = Vec::new();
    for equality in &equalities {
        let mut column = derivatives(equality, &x);
        for (c, value) in column.iter_mut().enumerate() {
            *value = if free(c) { *value / root(c) } else { 0.0 };
        }
        columns.push(column);
    }
    let equality_count = columns.len();
    if let Some(table) = case.table {
        for node in 0..n {
            let z = x[3 * node + 2];
            miss = miss.max(table - z);
            if z - table < 1e-9 && free(3 * node) {
                let mut column = vec![0.0; 3 * n];
                column[3 * node + 2] = -1.0 / root(3 * node);
                columns.push(column);
            }
        }
    }

    // The table pushes and does not pull: among the multipliers of dependent constraints are such,
    // found by leaving out what pulls most (Lawson and Hanson 1974).
    loop {
        let (multipliers, residual) = least_squares(&columns, &gradient);
        let pulls = multipliers.iter().enumerate().skip(equality_count);
        let worst = pulls.min_by(|a, b| a.1.total_cmp(b.1));
        match worst {
            Some((k, &multiplier)) if multiplier < 0.0 => {
                columns.swap_remove(k);
            }
            _ => {
                let imbalances = (0..3 * n).map(|c| residual[c].abs() / root(c));
                return (miss, imbalances.fold(0.0, f64::max));
            }
        }
    }
}

/// Central differences, of a step that leaves some 1e-12 of a smooth function.
fn derivatives(function: &dyn Fn(&[f64]) -> f64, x: &[f64]) -> Vec<f64> {
    let mut moved = x.to_vec();
    (0..x.len())
        .map(|c| {
            let mut difference = |step: f64| {
                moved[c] = x[c] + step;
                let up = function(&moved);
                moved[c] = x[c] - step;
                let down = function(&moved);
                moved[c] = x[c];
                (up - down) / (2.0 * step)
            };
            // Richardson: the error of two steps cancels to the fourth order.
            let (coarse, fine) = (difference(2e-5), difference(1e-5));
            (4.0 * fine - coarse) / 3.0
        })
        .collect()
}

/// `y` that makes `gradient + sum y_k column_k` least, and that sum: Householder QR with columns
/// chosen by size, so that dependent ones come last and get 0.
fn least_squares(columns: &[Vec<f64>], gradient: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let mut a: Vec<(usize, Vec<f64>)> = columns.iter().cloned().enumerate().collect();
    let mut b: Vec<f64> = gradient.iter().map(|g| -g).collect();
    let norm = |column: &[f64]| column.iter().map(|v| v * v).sum::<f64>().sqrt();
    let largest = columns.iter().map(|c| norm(c)).fold(0.0, f64::max);
    let mut rank = 0;
    while rank < a.len().min(b.len()) {
        let best = (rank..a.len())
            .max_by(|&p, &q| norm(&a[p].1[rank..]).total_cmp(&norm(&a[q].1[rank..])))
            .unwrap();
        a.swap(rank, best);
        let size = norm(&a[rank].1[rank..]);
        if size < 1e-10 * largest {
            break;
        }
        // Reflect the rest of this column onto its first entry
        let mut v = a[rank].1[rank..].to_vec();
        v[0] += size.copysign(v[0]);
        let half = v.iter().map(|v| v * v).sum::<f64>() / 2.0;
        let reflect = |target: &mut [f64]| {
            let along = v.iter().zip(&*target).map(|(v, t)| v * t).sum::<f64>() / half;
            for (t, v) in target.iter_mut().zip(&v) {
                *t -= along * v;
            }
        };
        for (_, column) in &mut a[rank..] {
            reflect(&mut column[rank..]);
        }
        reflect(&mut b[rank..]);
        rank += 1;
    }
    let mut y = vec![0.0; columns.len()];
    for r in (0..rank).rev() {
        let known: f64 = (r + 1..rank).map(|k| a[k].1[r] * y[a[k].0]).sum();
        y[a[r].0] = (b[r] - known) / a[r].1[r];
    }
    let mut sum = gradient.to_vec();
    for (y, column) in y.iter().zip(columns) {
        for (s, c) in sum.iter_mut().zip(column) {
            *s += y * c;
        }
    }
    (y, sum)
}

fn check(nodes: [usize; 2], seed: u64) {
    for case in cases::cases(nodes, seed) {
        let name = &case.name;
        let projected = project(&case.projection()).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert!(projected.minimum, "{name}");
        assert!(
            projected.iterations < 2500,
            "{name}: {}",
            projected.iterations
        );
        let (miss, imbalance) = residuals(&case, &projected.positions);
        println!(
            "{name}: {} steps, {miss:.1e} m, {imbalance:.1e} m",
            projected.iterations
        );
        assert!(
            miss < 1e-8 && imbalance < 1e-8,
            "{name}: {miss:e}, {imbalance:e}"
        );
    }
}

#[test]
fn conditions_of_small_sheets() {
    for seed in 1..6 {
        check([4, 5], seed);
    }
    check([6, 7], 6);
}

#[test]
fn conditions_of_a_sheet_of_168_nodes() {
    check([12, 14], 7);
}

#[test]
fn two_answers_have_the_same_bits() {
    let case = &cases::cases([6, 7], 3)[15];
    let first = project(&case.projection()).unwrap();
    assert_eq!(first, project(&case.projection()).unwrap());
}

#[test]
fn a_sheet_out_of_reach_of_its_targets_is_refused() {
    let mut case = cases::cases([6, 7], 3).remove(1);
    for (_, target) in &mut case.grasp {
        target.x += 0.3;
    }
    // Both targets alone can be reached; edge (0, 1) is free.
    assert!(project(&case.projection()).is_ok());
    case.grasp.push((0, case.predicted[0] - DVec3::X));
    let error = project(&case.projection()).unwrap_err();
    assert!(matches!(error, Error::Unreachable { .. }), "{error}");
    assert!(error.to_string().contains("is off by"), "{error}");
}

#[test]
fn problems_that_are_not_well_posed_are_refused() {
    let mesh = Mesh::grid([3, 3], [0.1, 0.1]).unwrap();
    let good = Projection {
        mesh: &mesh,
        masses: &[1.0; 9],
        predicted: mesh.rest(),
        grasp: &[],
        shear_compliance: Some(0.0),
        table: Some(0.0),
    };
    assert_eq!(project(&good).unwrap().positions, mesh.rest());
    let refused = |bad: Projection<'_>| project(&bad).unwrap_err().to_string();
    let mut predicted = mesh.rest().to_vec();
    predicted[4].y = f64::NAN;
    let below = [(8, DVec3::new(0.05, 0.05, -1e-3))];
    let stranger = [(9, DVec3::ZERO)];
    let twice = [(3, DVec3::ZERO), (3, DVec3::ZERO)];
    for (bad, message) in [
        (
            Projection {
                masses: &[1.0; 8],
                ..good
            },
            "8 masses given, must be 9, one a node",
        ),
        (
            Projection {
                masses: &[0.0; 9],
                ..good
            },
            "node 0: mass is 0, must be positive and finite",
        ),
        (
            Projection {
                predicted: &predicted,
                ..good
            },
            "node 4: predicted position [m] is NaN, must be finite",
        ),
        (
            Projection {
                grasp: &below,
                ..good
            },
            "node 8: height of the target [m] is -0.001, must be not below the table",
        ),
        (
            Projection {
                grasp: &stranger,
                ..good
            },
            "node 9: index is 9, must be that of a node of the mesh, and grasped once",
        ),
        (
            Projection {
                grasp: &twice,
                ..good
            },
            "node 3: index is 3, must be that of a node of the mesh, and grasped once",
        ),
        (
            Projection {
                shear_compliance: Some(-1.0),
                ..good
            },
            "shear compliance is -1, must be at least 0 and finite",
        ),
        (
            Projection {
                table: Some(f64::NAN),
                ..good
            },
            "height of the table [m] is NaN, must be finite",
        ),
    ] {
        assert_eq!(refused(bad), message);
    }
}
