//! Single steps of a small sheet against a cone program solved by Clarabel: exact Coulomb friction by
//! the fixed point of De Saxce's bipotential, the directions of the constraints by another.
//!
//! In one step of `h` the displacement `u` minimises
//! `1/2 u E u - b u + sum_q A (G_e/2 (g_q u)^2 + (G_e + G_s) s_q g_q u)` subject to
//! `J u = -C(x_0)` for the edges, held nodes where they must be, and for each node
//! `z + u_z + phi >= mu |u_t|` with `phi = mu |u_t|` of the last program; `J` and `g_q` at the middle
//! of the last `u`.

#![allow(clippy::unwrap_used, reason = "a failed set-up fails the test")]

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT,
};
use selvedge_cloth::{Material, Mesh, Settings, Simulator};
use selvedge_math::{ClothSimulator, DVec3, Held};

const GRAVITY: f64 = 9.8;
const H: f64 = 1.0 / 120.0;
/// The programs are in millimetres and in units of a node's weight.
const LENGTH: f64 = 1e-3;

struct Sheet {
    nodes: [usize; 2],
    spacing: [f64; 2],
    material: Material,
}

impl Sheet {
    fn node(&self, i: usize, j: usize) -> usize {
        j * self.nodes[0] + i
    }

    fn border(&self, i: usize, axis: usize) -> bool {
        i == 0 || i + 1 == self.nodes[axis]
    }

    /// A quarter of each cell around a node.
    fn area(&self, k: usize) -> f64 {
        let (i, j) = (k % self.nodes[0], k / self.nodes[0]);
        let half = |border: bool| if border { 0.5 } else { 1.0 };
        half(self.border(i, 0)) * half(self.border(j, 1)) * self.spacing[0] * self.spacing[1]
    }

    /// Second differences and twists with the length and width each stands for, see the module on
    /// bending: written anew from its text.
    fn bending(&self) -> Vec<Vec<f64>> {
        let [na, nb] = self.nodes;
        let n = na * nb;
        let mut matrix = vec![vec![0.0; n]; n];
        let mut add = |weight: f64, row: &[(usize, f64)]| {
            for &(a, left) in row {
                for &(b, right) in row {
                    matrix[a][b] += weight * left * right;
                }
            }
        };
        for axis in 0..2 {
            let (d, other) = (self.spacing[axis], self.spacing[1 - axis]);
            let (along, lines) = (self.nodes[axis], self.nodes[1 - axis]);
            for line in 0..lines {
                for k in 1..along - 1 {
                    let at = |k: usize| match axis {
                        0 => self.node(k, line),
                        _ => self.node(line, k),
                    };
                    let ends = usize::from(k == 1) + usize::from(k + 2 == along);
                    let length = d * (1.0 + 0.5 * ends as f64);
                    let width = other
                        * if self.border(line, 1 - axis) {
                            0.5
                        } else {
                            1.0
                        };
                    let f = 1.0 / (d * d);
                    add(
                        length * width,
                        &[(at(k - 1), f), (at(k), -2.0 * f), (at(k + 1), f)],
                    );
                }
            }
        }
        let f = 1.0 / (self.spacing[0] * self.spacing[1]);
        for j in 0..nb - 1 {
            for i in 0..na - 1 {
                let corners = [
                    (self.node(i, j), f),
                    (self.node(i + 1, j), -f),
                    (self.node(i, j + 1), -f),
                    (self.node(i + 1, j + 1), f),
                ];
                add(2.0 / f, &corners);
            }
        }
        matrix
    }

    fn edges(&self) -> Vec<([usize; 2], f64)> {
        let mut edges = Vec::new();
        for j in 0..self.nodes[1] {
            for i in 0..self.nodes[0] {
                if i + 1 < self.nodes[0] {
                    edges.push(([self.node(i, j), self.node(i + 1, j)], self.spacing[0]));
                }
                if j + 1 < self.nodes[1] {
                    edges.push(([self.node(i, j), self.node(i, j + 1)], self.spacing[1]));
                }
            }
        }
        edges
    }
}

/// A gradient as (coordinate, value).
type Gradient = Vec<(usize, f64)>;

/// Sine of the shear angle of a cell, and its gradient.
fn sine(sheet: &Sheet, corner: usize, x: &[DVec3]) -> (f64, Gradient) {
    let [a, b, d, c] = [
        corner,
        corner + 1,
        corner + sheet.nodes[0],
        corner + sheet.nodes[0] + 1,
    ];
    let u = 0.5 * (x[b] - x[a] + x[c] - x[d]);
    let v = 0.5 * (x[d] - x[a] + x[c] - x[b]);
    let area = sheet.spacing[0] * sheet.spacing[1];
    let mut gradient = Gradient::new();
    for (node, g) in [(a, -u - v), (b, v - u), (c, u + v), (d, u - v)] {
        gradient.extend((0..3).map(|axis| (3 * node + axis, 0.5 * g[axis] / area)));
    }
    (u.dot(v) / area, gradient)
}

/// The step by fixed points over cone programs.
fn reference(sheet: &Sheet, x0: &[DVec3], v0: &[DVec3], held: &[(usize, DVec3)]) -> Vec<DVec3> {
    let n = x0.len();
    let m = &sheet.material;
    let turn = 0.5 * H * m.damping / m.density;
    let mass = m.density * turn / turn.tanh();
    let bending = sheet.bending();
    let force = m.gravitational_density * GRAVITY * sheet.spacing[0] * sheet.spacing[1];
    let unit = force / LENGTH;
    // E and b in the program's units
    let stiffness = m.bending * (0.5 + m.internal_damping / H);
    let mut quadratic = Vec::new();
    for (a, row) in bending.iter().enumerate() {
        for (b, entry) in row.iter().enumerate() {
            let mut e = stiffness * entry;
            if a == b {
                e += sheet.area(a) * (2.0 * mass / (H * H) + m.damping / H);
            }
            if e != 0.0 {
                quadratic.extend((0..3).map(|axis| (3 * a + axis, 3 * b + axis, e / unit)));
            }
        }
    }
    let mut load = vec![0.0; 3 * n];
    for a in 0..n {
        let mut f = v0[a] * (2.0 * mass * sheet.area(a) / H)
            - DVec3::Z * (m.gravitational_density * GRAVITY * sheet.area(a));
        for (x, entry) in x0.iter().zip(&bending[a]) {
            f -= *x * (m.bending * entry);
        }
        (0..3).for_each(|axis| load[3 * a + axis] = f[axis] / force);
    }
    let (end, start) = (
        m.shear * (0.5 + m.internal_damping / H),
        m.shear * (0.5 - m.internal_damping / H),
    );
    let is_held = |node: usize| held.iter().any(|&(k, _)| k == node);

    let mut u = vec![DVec3::ZERO; n];
    let mut phi = vec![0.0; n];
    for _ in 0..200 {
        let middle: Vec<DVec3> = x0.iter().zip(&u).map(|(x, u)| *x + 0.5 * *u).collect();
        let (mut p, mut q) = (
            quadratic.clone(),
            load.iter().map(|f| -f).collect::<Vec<f64>>(),
        );
        for j in 0..sheet.nodes[1] - 1 {
            for i in 0..sheet.nodes[0] - 1 {
                let corner = sheet.node(i, j);
                let before = sine(sheet, corner, x0).0;
                let gradient = sine(sheet, corner, &middle).1;
                let area = sheet.spacing[0] * sheet.spacing[1];
                for &(a, left) in &gradient {
                    q[a] += area * (end + start) * before * left / force;
                    for &(b, right) in &gradient {
                        p.push((a, b, area * end * left * right / unit));
                    }
                }
            }
        }
        // Rows: edges, held nodes, cones
        let (mut rows, mut right): (Vec<(usize, usize, f64)>, Vec<f64>) = (Vec::new(), Vec::new());
        for ([a, b], length) in sheet.edges() {
            let row = right.len();
            let now = (x0[b].distance_squared(x0[a]) - length * length) / (2.0 * length);
            let g = (middle[b] - middle[a]) / length;
            for axis in 0..3 {
                rows.push((row, 3 * b + axis, g[axis]));
                rows.push((row, 3 * a + axis, -g[axis]));
            }
            right.push(-now / LENGTH);
        }
        for &(node, target) in held {
            for axis in 0..3 {
                rows.push((right.len(), 3 * node + axis, 1.0));
                right.push((target - x0[node])[axis] / LENGTH);
            }
        }
        let equalities = right.len();
        let mut cones = vec![SupportedConeT::ZeroConeT(equalities)];
        for node in (0..n).filter(|&node| !is_held(node)) {
            let row = right.len();
            rows.push((row, 3 * node + 2, -1.0));
            rows.push((row + 1, 3 * node, -m.friction_table));
            rows.push((row + 2, 3 * node + 1, -m.friction_table));
            right.extend([(x0[node].z + phi[node]) / LENGTH, 0.0, 0.0]);
            cones.push(SupportedConeT::SecondOrderConeT(3));
        }
        p.retain(|&(a, b, _)| a <= b);
        let p = triplets(3 * n, 3 * n, &p);
        let a = triplets(right.len(), 3 * n, &rows);
        let settings = DefaultSettingsBuilder::default()
            .verbose(false)
            .tol_gap_abs(1e-11)
            .tol_gap_rel(1e-11)
            .tol_feas(1e-11)
            .build()
            .unwrap();
        let mut solver = DefaultSolver::new(&p, &q, &a, &right, &cones, settings).unwrap();
        solver.solve();
        let status = solver.solution.status;
        assert!(
            matches!(status, SolverStatus::Solved | SolverStatus::AlmostSolved),
            "{status}"
        );
        let mut moved = 0.0_f64;
        for node in 0..n {
            let new = LENGTH * DVec3::from_slice(&solver.solution.x[3 * node..3 * node + 3]);
            moved = moved.max(new.distance(u[node]));
            u[node] = new;
            phi[node] = m.friction_table * new.truncate().length();
        }
        if moved < 1e-9 {
            break;
        }
    }
    x0.iter().zip(&u).map(|(x, u)| *x + *u).collect()
}

fn triplets(rows: usize, columns: usize, entries: &[(usize, usize, f64)]) -> CscMatrix {
    let (mut i, mut j, mut v) = (Vec::new(), Vec::new(), Vec::new());
    for &(row, column, value) in entries {
        i.push(row);
        j.push(column);
        v.push(value);
    }
    CscMatrix::new_from_triplets(rows, columns, i, j, v)
}

/// A corner is lifted and drawn inwards, the far half sticks, slides, and is lifted in turn.
#[test]
fn steps_agree_with_the_cone_program() {
    let nodes = [5, 6];
    let sides = [0.08, 0.1];
    let sheet = Sheet {
        nodes,
        spacing: [0.02, 0.02],
        material: Material::default(),
    };
    let mesh = Mesh::grid(nodes, sides).unwrap();
    let settings = Settings {
        substep: H,
        tolerance: 1e-9,
        settled: 1e-10,
        iterations: 2000,
        ..Settings::default()
    };
    let mut cloth = Simulator::new(&mesh, sheet.material, settings).unwrap();
    let corner = mesh.node_count() - 1;
    let (mut compared, mut slid) = (0, 0);
    for step in 1..=60 {
        let s = f64::from(step) / 60.0;
        let target = mesh.rest()[corner] + DVec3::new(-0.03 * s, -0.09 * s, 0.05 * s * (2.0 - s));
        let held = [(corner, target)];
        let (x0, v0) = (cloth.positions().to_vec(), cloth.velocities().to_vec());
        let report = cloth
            .step(
                Held {
                    nodes: &[corner as u32],
                    targets: &[target],
                    velocities: &[DVec3::ZERO],
                },
                H,
            )
            .unwrap();
        if step % 6 != 0 {
            continue;
        }
        let expected = reference(&sheet, &x0, &v0, &held);
        let off = cloth
            .positions()
            .iter()
            .zip(&expected)
            .map(|(a, b)| a.distance(*b))
            .fold(0.0, f64::max);
        println!("step {step}: {off:.1e} m, {report:?}");
        assert!(off < 1e-6, "step {step}: {off:e} m");
        compared += 1;
        slid += cloth
            .positions()
            .iter()
            .zip(&x0)
            .filter(|(a, b)| a.z == 0.0 && b.z == 0.0 && a.distance(**b) > 1e-5)
            .count();
    }
    assert!(
        compared == 10 && slid > 20,
        "{compared} steps, {slid} sliding nodes"
    );
}
