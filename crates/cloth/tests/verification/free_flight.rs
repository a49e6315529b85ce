//! Sheets that nothing touches.

use selvedge_cloth::{Material, Mesh, Settings, Simulator};
use selvedge_math::{ClothSimulator, DVec3};

use crate::scene::{FRAME, air, along, areas, fall, polyline, run, simulator, without_drag};

/// `v(t) = (delta g/alpha) (1 - exp(-alpha t/rho))`,
/// `z(t) = -(delta g/alpha) (t - (rho/alpha) (1 - exp(-alpha t/rho)))`.
///
/// Velocities are exact: the masses of the scheme make them so. Positions are their trapezoidal
/// sums, whose error is `h^2/12` times the change of acceleration, `(delta g/rho) (1 - exp(...))`.
#[test]
fn free_fall_with_drag() {
    let (material, settings) = (Material::default(), air());
    let mesh = Mesh::grid([8, 9], [0.12, 0.16]).unwrap();
    let mut cloth = simulator(&mesh, material, settings);
    let rate = material.damping / material.density;
    let terminal = fall(&material, &settings) / rate;
    let mut worst = [0.0_f64; 2];
    run(&mut cloth, FRAME, 2.0, |cloth, _| {
        let t = cloth.time();
        let gone = 1.0 - (-rate * t).exp();
        for (x, (v, rest)) in cloth
            .positions()
            .iter()
            .zip(cloth.velocities().iter().zip(mesh.rest()))
        {
            let way = terminal * (t - gone / rate);
            worst[0] = worst[0].max((*v + DVec3::Z * terminal * gone).length() / (terminal * gone));
            let bound = settings.substep.powi(2) / 12.0 * terminal * rate * gone;
            worst[1] = worst[1].max((*x - *rest + DVec3::Z * way).length() / bound);
        }
    });
    println!(
        "free fall with drag: velocity {:.1e}, way {:.4} of the bound",
        worst[0], worst[1]
    );
    assert!((cloth.time() - 2.0).abs() < 1e-12);
    assert!(worst[0] < 1e-10 && worst[1] < 1.01, "{worst:?}");
}

/// `v = g' t`, `z = -g' t^2/2` with `g' = delta g/rho`: the midpoint rule is exact.
#[test]
fn free_fall_without_drag() {
    let (material, settings) = (without_drag(), air());
    let mesh = Mesh::grid([8, 9], [0.12, 0.16]).unwrap();
    let mut cloth = simulator(&mesh, material, settings);
    let g = fall(&material, &settings);
    run(&mut cloth, FRAME, 1.0, |_, _| ());
    for (x, (v, rest)) in cloth
        .positions()
        .iter()
        .zip(cloth.velocities().iter().zip(mesh.rest()))
    {
        assert!((*v + DVec3::Z * g).length() < 1e-9 * g);
        assert!((*x - *rest + DVec3::Z * 0.5 * g).length() < 1e-9 * g);
    }
}

/// Linear momentum and angular momentum about the origin, over `rho`.
fn momenta(cloth: &Simulator, areas: &[f64]) -> [DVec3; 2] {
    let mut sums = [DVec3::ZERO; 2];
    for ((x, v), area) in cloth.positions().iter().zip(cloth.velocities()).zip(areas) {
        sums[0] += *area * *v;
        sums[1] += *area * x.cross(*v);
    }
    sums
}

/// A waving, spinning sheet: how far linear and angular momentum drift in a step, over their size, and
/// the most kinetic energy over all that was there at the start, with `kappa/2 int |lap x|^2` of the
/// wave.
fn wave() -> [f64; 3] {
    let material = Material {
        internal_damping: 0.0,
        ..without_drag()
    };
    let settings = Settings {
        gravity: 0.0,
        tolerance: 1e-12,
        settled: 1e-12,
        iterations: 100,
        ..air()
    };
    let (na, [a, b]) = (13, [0.24, 0.18]);
    let mesh = Mesh::grid([na, 10], [a, b]).unwrap();
    // A wave over the sheet that goes on waving, and a spin about two axes next to it.
    let side = a / (na - 1) as f64;
    let angles = (0..na - 1).map(|k| 0.5 * (0.5 * k as f64).sin());
    let points = polyline(side, angles);
    let positions = along(&mesh, &points);
    let mut wave = vec![DVec3::ZERO];
    for k in 0..na - 1 {
        let turn = -(2.0 * (0.7 * k as f64).cos()) * DVec3::Y;
        wave.push(wave[k] + turn.cross(points[k + 1] - points[k]));
    }
    let spin = DVec3::new(1.0, -0.5, 2.0);
    let velocities: Vec<DVec3> = positions
        .iter()
        .enumerate()
        .map(|(k, x)| wave[k % na] + spin.cross(*x) + DVec3::new(0.3, 0.1, -0.2))
        .collect();
    let mut cloth = simulator(&mesh, material, settings);
    cloth.reset(&positions, &velocities).unwrap();

    let areas = areas(&mesh);
    let kinetic = |cloth: &Simulator| -> f64 {
        let pairs = cloth.velocities().iter().zip(&areas);
        pairs
            .map(|(v, a)| 0.5 * material.density * a * v.length_squared())
            .sum()
    };
    let bending: f64 = (1..na - 1)
        .map(|k| {
            let curvature = (points[k + 1] - 2.0 * points[k] + points[k - 1]) / (side * side);
            // The strip's ends bend like the nodes next to them.
            let share = if k == 1 || k == na - 2 { 1.5 } else { 1.0 };
            0.5 * material.bending * b * side * share * curvature.length_squared()
        })
        .sum();
    let start = momenta(&cloth, &areas);
    let energy = kinetic(&cloth) + bending;
    let (mut before, mut worst, mut most) = (start, [0.0_f64; 2], 0.0_f64);
    run(&mut cloth, FRAME, 2.0, |cloth, report| {
        assert_eq!(report.contacts, 0);
        let now = momenta(cloth, &areas);
        for k in 0..2 {
            worst[k] = worst[k].max((now[k] - before[k]).length() / start[k].length());
        }
        before = now;
        most = most.max(kinetic(cloth) / energy);
    });
    println!(
        "momenta: linear {:.1e}, angular {:.1e} a step; kinetic energy {most:.6}, {:.6} at the end",
        worst[0],
        worst[1],
        kinetic(&cloth) / energy
    );
    [worst[0], worst[1], most]
}

/// Inner forces have no sum, and the projection's metric is that of inertia.
#[test]
fn linear_momentum_is_kept_and_energy_does_not_grow() {
    let [drift, _, energy] = wave();
    assert!(drift < 1e-10 && energy < 1.0 + 1e-6, "{drift} {energy}");
}

/// Inner forces have no moment. What is left is how far the last iteration still turned them: hence
/// the tight tolerance and the iterations that it needs.
#[test]
fn angular_momentum_is_kept() {
    let [_, drift, _] = wave();
    assert!(drift < 1e-10, "{drift}");
}

/// The factors of a large sheet are in single precision; its momentum is not.
#[test]
fn linear_momentum_of_a_large_sheet_is_kept() {
    let settings = Settings {
        gravity: 0.0,
        ..air()
    };
    let na = 92;
    let mesh = Mesh::grid([na, 112], [0.42, 0.59]).unwrap();
    let angles = (0..na - 1).map(|k| 0.5 * (0.08 * k as f64).sin());
    let positions = along(&mesh, &polyline(0.42 / (na - 1) as f64, angles));
    let spin = DVec3::new(1.0, -0.5, 2.0);
    let velocities = positions.iter().map(|x| spin.cross(*x) + DVec3::X);
    let velocities: Vec<DVec3> = velocities.collect();
    let mut cloth = simulator(&mesh, without_drag(), settings);
    cloth.reset(&positions, &velocities).unwrap();
    let areas = areas(&mesh);
    let start = momenta(&cloth, &areas)[0];
    let (mut before, mut worst) = (start, 0.0_f64);
    run(&mut cloth, FRAME, 0.1, |cloth, _| {
        let now = momenta(cloth, &areas)[0];
        worst = worst.max((now - before).length() / start.length());
        before = now;
    });
    println!("momentum of a large sheet: {worst:.1e} a step");
    assert!(worst < 1e-11, "{worst}");
}
