//! Convergence in time.

use selvedge_cloth::{Mesh, Settings};
use selvedge_math::{ClothSimulator, DVec3};

use crate::scene::{air, put, run, simulator, without_drag};

/// Where a sheet pinned along its top is after half a second of swinging, for a substep.
fn swung(dt: f64) -> Vec<DVec3> {
    let mesh = Mesh::grid([7, 9], [0.15, 0.2]).unwrap();
    let settings = Settings {
        substep: dt,
        tolerance: 1e-9,
        // What is left of a position counts as an acceleration by the square of the substep.
        settled: 1e-12,
        iterations: 100,
        ..air()
    };
    let mut cloth = simulator(&mesh, without_drag(), settings);
    let (sine, cosine) = f64::sin_cos(0.6);
    let tilted: Vec<DVec3> = mesh
        .rest()
        .iter()
        .map(|p| DVec3::new(p.x, (0.1 - p.y) * sine, (p.y - 0.1) * cosine))
        .collect();
    put(&mut cloth, &tilted);
    cloth.pin(&[56, 57, 58, 59, 60, 61, 62]).unwrap();
    run(&mut cloth, dt, 0.5, |_, _| ());
    assert!((cloth.time() - 0.5).abs() < 1e-9);
    cloth.positions().to_vec()
}

/// The implicit midpoint rule is of second order: halving the step divides the error by four, by 3
/// at least where the steps are not small yet.
#[test]
fn the_error_falls_with_the_square_of_the_step() {
    let fine = swung(1.0 / 3840.0);
    let errors = [60.0, 120.0, 240.0].map(|rate: f64| {
        let pairs = swung(1.0 / rate);
        let pairs = pairs.iter().zip(&fine);
        let sum: f64 = pairs.clone().map(|(a, b)| a.distance_squared(*b)).sum();
        (sum / pairs.len() as f64).sqrt()
    });
    let orders = [errors[0] / errors[1], errors[1] / errors[2]].map(f64::log2);
    println!("order in time: errors {errors:?} m, orders {orders:.2?}");
    assert!(orders[0] > 1.6 && orders[1] > 1.8, "{orders:?}");
}

/// At the period of the commands without substeps the motion is still the same, to 1 mm.
#[test]
fn one_substep_a_frame_is_stable() {
    let errors = swung(1.0 / 60.0);
    let fine = swung(1.0 / 480.0);
    let worst = errors
        .iter()
        .zip(&fine)
        .map(|(a, b)| a.distance(*b))
        .fold(0.0, f64::max);
    println!("one substep a frame: off by {worst:.1e} m");
    assert!(worst < 1e-3, "{worst}");
}
