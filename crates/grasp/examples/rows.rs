//! A constraint-based cloth: held nodes are equality rows beside those of the inextensible edges.
//!
//! Each step predicts `x* = x + h v + h^2 g` and then moves to the nearest point, in the metric of
//! the masses, of `C(x) = 0`: edge rows `(|x_j - x_i|^2 - l^2) / (2 l)` and, for each held node,
//! three rows `x_i - u_i` (Goldenthal et al. 2007). Every Newton step solves
//! `(J M^-1 J^T) lambda = C`. The sum of the multipliers of a held node, over `h^2`, is the force of
//! the gripper on it: at rest they carry the weight of the cloth.

use selvedge_grasp::{
    ClothView, Command, DVec3, Error, GraspVolume, Gripper, Held, Jaw, Pose, Shape, Squeeze,
};

#[path = "../tests/grid/mod.rs"]
mod grid;

const DT: f64 = 1.0 / 60.0; // s
const GRAVITY: f64 = 9.81; // m/s^2
const DAMPING: f64 = 3.0; // 1/s
const NODE_MASS: f64 = 2e-3; // kg
const TOLERANCE: f64 = 1e-10; // m

/// One row: its value [m] and its gradient at some nodes.
struct Row {
    value: f64,
    gradient: Vec<(usize, DVec3)>,
}

/// The rows at the positions `x`, three for each held node first.
fn rows(x: &[DVec3], edges: &[([u32; 2], f64)], held: Held<'_>) -> Vec<Row> {
    let mut rows = Vec::new();
    for (&node, &target) in held.nodes.iter().zip(held.targets) {
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            rows.push(Row {
                value: axis.dot(x[node as usize] - target),
                gradient: vec![(node as usize, axis)],
            });
        }
    }
    for (nodes, rest) in edges {
        // Between two held nodes the gripper decides.
        if !nodes.iter().all(|node| held.nodes.contains(node)) {
            let [i, j] = nodes.map(|node| node as usize);
            let between = x[j] - x[i];
            rows.push(Row {
                value: (between.length_squared() - rest * rest) / (2.0 * rest),
                gradient: vec![(i, -between / rest), (j, between / rest)],
            });
        }
    }
    rows
}

/// Solves `A y = b` by Cholesky's factorisation; the lower half of `a` is overwritten.
fn solve(a: &mut [Vec<f64>], b: &[f64]) -> Vec<f64> {
    let mut y = b.to_vec();
    for j in 0..y.len() {
        for k in j..y.len() {
            let inner: f64 = (0..j).map(|m| a[j][m] * a[k][m]).sum();
            a[k][j] -= inner;
        }
        let pivot = a[j][j].sqrt();
        assert!(pivot > 0.0, "row {j} depends on those before it");
        a[j..].iter_mut().for_each(|row| row[j] /= pivot);
        y[j] = (y[j] - (0..j).map(|m| a[j][m] * y[m]).sum::<f64>()) / a[j][j];
    }
    for j in (0..y.len()).rev() {
        y[j] = (y[j] - (j + 1..y.len()).map(|m| a[m][j] * y[m]).sum::<f64>()) / a[j][j];
    }
    y
}

/// Steps the cloth; gives the largest row left [m] and the force of the gripper on it [N].
fn step(
    x: &mut [DVec3],
    v: &mut [DVec3],
    edges: &[([u32; 2], f64)],
    held: Held<'_>,
) -> (f64, DVec3) {
    let before = x.to_vec();
    for (x, v) in x.iter_mut().zip(v.iter()) {
        *x += (*v - DVec3::Z * GRAVITY * DT) / (1.0 + DAMPING * DT) * DT;
    }
    let (mut residual, mut force) = (f64::INFINITY, DVec3::ZERO);
    for _ in 0..30 {
        let rows = rows(x, edges, held);
        residual = rows.iter().map(|row| row.value.abs()).fold(0.0, f64::max);
        if residual < TOLERANCE {
            break;
        }
        let product = |a: &Row, b: &Row| {
            let pairs = a
                .gradient
                .iter()
                .flat_map(|p| b.gradient.iter().map(move |q| (p, q)));
            let same = pairs.filter(|(p, q)| p.0 == q.0);
            same.map(|(p, q)| p.1.dot(q.1) / NODE_MASS).sum::<f64>()
        };
        let mut schur: Vec<Vec<f64>> = rows
            .iter()
            .map(|a| rows.iter().map(|b| product(a, b)).collect())
            .collect();
        let values: Vec<f64> = rows.iter().map(|row| row.value).collect();
        let multipliers = solve(&mut schur, &values);
        for (row, multiplier) in rows.iter().zip(&multipliers) {
            for &(node, gradient) in &row.gradient {
                x[node] -= gradient * (multiplier / NODE_MASS);
            }
        }
        for own in multipliers[..3 * held.nodes.len()].chunks_exact(3) {
            force -= DVec3::from_slice(own) * (1.0 + DAMPING * DT) / (DT * DT);
        }
    }
    for ((v, x), before) in v.iter_mut().zip(x.iter()).zip(before) {
        *v = (*x - before) / DT;
    }
    (residual, force)
}

fn main() -> Result<(), Error> {
    let sheet = grid::flat([5, 7], [0.2, 0.3]);
    let length =
        |[a, b]: [u32; 2]| sheet.positions[a as usize].distance(sheet.positions[b as usize]);
    let edges: Vec<_> = sheet
        .edges
        .iter()
        .map(|&edge| (edge, length(edge)))
        .collect();
    let mut x = sheet.positions.clone();
    let mut v = vec![DVec3::ZERO; x.len()];

    // The side at y = 0 is lifted by 0.2 m in one second; then the cloth comes to rest.
    let size = DVec3::new(0.21, 0.02, 0.02);
    let volume = GraspVolume::new(Shape::Box { size }, DVec3::ZERO)?;
    let squeeze = Squeeze {
        amount: 0.3,
        lift: 2e-4,
        steps: 10,
    };
    let mut gripper = Gripper::new(volume, squeeze)?;
    let (mut worst, mut force) = (0.0_f64, DVec3::ZERO);
    for k in 1..=900 {
        let s = (f64::from(k) * DT).min(1.0);
        let command = Command {
            pose: Pose::from_translation(DVec3::new(0.1, 0.0, 0.2 * s * s * (3.0 - 2.0 * s))),
            jaw: Jaw::Closed,
        };
        let view = ClothView {
            positions: &x,
            ..sheet.view()
        };
        let held = gripper.step(command, DT, view)?;
        let residual;
        (residual, force) = step(&mut x, &mut v, &edges, held);
        worst = worst.max(residual);
    }
    let weight = x.len() as f64 * NODE_MASS * GRAVITY;
    println!(
        "{} held nodes, rows met within {worst:.1e} m",
        gripper.nodes().len()
    );
    println!(
        "force of the gripper {:.6} N, weight {weight:.6} N",
        force.z
    );
    assert_eq!(gripper.nodes().len(), 5);
    assert!(worst < TOLERANCE);
    assert!((force - DVec3::Z * weight).length() < 0.01 * weight);
    Ok(())
}
