//! Coulomb friction on the table and on inclined planes.
//!
//! An incline is the table with gravity turned: `g cos(theta)` along -z, and the rest as a force from
//! outside along x, `delta g A sin(theta)` for a node's area `A`.

use selvedge_cloth::{Material, Mesh, Settings, Simulator};
use selvedge_math::{ClothSimulator, DVec3};

use crate::scene::{
    FRAME, along, areas, fall, off, polyline, put, run, simulator, speed, without_drag,
};

fn mean(of: &[DVec3], areas: &[f64]) -> DVec3 {
    let total: f64 = areas.iter().sum();
    of.iter().zip(areas).map(|(p, a)| *p * *a).sum::<DVec3>() / total
}

/// `v_0^2 / (2 mu g')` with `g' = delta g/rho`: 50.3 mm for the paper's cloth at 0.3 m/s.
#[test]
fn a_sliding_sheet_stops() {
    let (material, settings) = (without_drag(), Settings::default());
    let mesh = Mesh::grid([12, 15], [0.21, 0.295]).unwrap();
    let mut cloth = simulator(&mesh, material, settings);
    let start = vec![DVec3::X * 0.3; mesh.node_count()];
    cloth.reset(mesh.rest(), &start).unwrap();
    run(&mut cloth, FRAME, 1.0, |_, _| ());
    let reference = 0.09 / (2.0 * material.friction_table * fall(&material, &settings));
    let ways = cloth
        .positions()
        .iter()
        .zip(mesh.rest())
        .map(|(x, rest)| (*x - *rest).x);
    let (least, most) = ways.fold((f64::INFINITY, 0.0_f64), |(a, b), way| {
        (a.min(way), b.max(way))
    });
    println!(
        "slide: {:.3} to {:.3} mm, reference {:.3}",
        1e3 * least,
        1e3 * most,
        1e3 * reference
    );
    assert!(off(least, reference) < 0.01 && off(most, reference) < 0.01);
    assert!(speed(&cloth) < 1e-6);
}

/// A sheet at rest on an incline of `tan(theta)`.
fn on_incline(material: Material, tangent: f64) -> (Mesh, Simulator) {
    let cosine = 1.0 / tangent.hypot(1.0);
    let settings = Settings {
        gravity: Settings::default().gravity * cosine,
        ..Settings::default()
    };
    let mesh = Mesh::grid([9, 11], [0.16, 0.2]).unwrap();
    let mut cloth = simulator(&mesh, material, settings);
    let weight = material.gravitational_density * settings.gravity;
    for (force, area) in cloth.forces_mut().iter_mut().zip(areas(&mesh)) {
        *force = DVec3::X * weight * tangent * area;
    }
    (mesh, cloth)
}

/// `a = g' (sin theta - mu cos theta)`.
#[test]
fn a_sheet_slides_down_an_incline() {
    let material = Material {
        friction_table: 0.3,
        ..without_drag()
    };
    let tangent = 0.6;
    let (mesh, mut cloth) = on_incline(material, tangent);
    let g = fall(&material, &Settings::default());
    run(&mut cloth, FRAME, 1.0, |_, _| ());
    let reference = g * (tangent - material.friction_table) / tangent.hypot(1.0);
    let measured = mean(cloth.velocities(), &areas(&mesh)).x;
    println!("incline: acceleration {measured:.4}, reference {reference:.4}");
    assert!(off(measured, reference) < 0.01, "{measured}");
}

/// Slides if and only if `tan(theta) > mu`; below, nothing creeps.
#[test]
fn friction_holds_up_to_its_angle() {
    for friction in [0.1, 0.4, 1.3] {
        let material = Material {
            friction_table: friction,
            ..without_drag()
        };
        let (mesh, mut cloth) = on_incline(material, 0.99 * friction);
        let mut fastest = 0.0_f64;
        run(&mut cloth, FRAME, 10.0, |cloth, _| {
            fastest = fastest.max(speed(cloth));
        });
        let pairs = cloth.positions().iter().zip(mesh.rest());
        let way = pairs.map(|(x, rest)| x.distance(*rest)).fold(0.0, f64::max);
        let (_, mut above) = on_incline(material, 1.01 * friction);
        run(&mut above, FRAME, 1.0, |_, _| ());
        let steep = 1.01 * friction;
        let g = fall(&material, &Settings::default());
        let reference = g * 0.01 * friction / steep.hypot(1.0);
        let slow = mean(above.velocities(), &areas(&mesh)).x;
        println!(
            "friction {friction}: at 99 % {fastest:.1e} m/s and {way:.1e} m in 10 s, at 101 % {slow:.5} m/s after 1 s, reference {reference:.5}"
        );
        assert!(fastest < 1e-6 && way < 1e-5);
        assert!(slow > 0.5 * reference);
    }
}

/// A bow that falls onto an incline and comes to rest there as a ruck, held by friction, does not creep
/// either: less than 1e-6 m/s over 10 s.
#[test]
fn a_ruck_on_an_incline_does_not_creep() {
    let material = Material {
        friction_table: 1.0,
        ..Material::default()
    };
    let (mesh, mut cloth) = on_incline(material, 0.3);
    let angles = (0..8).map(|k| if k < 4 { 0.9 } else { -0.9 });
    let bow: Vec<DVec3> = along(&mesh, &polyline(0.02, angles))
        .iter()
        .map(|x| *x + DVec3::Z * 0.01)
        .collect();
    put(&mut cloth, &bow);
    run(&mut cloth, FRAME, 5.0, |_, _| ());
    let before = cloth.positions().to_vec();
    run(&mut cloth, FRAME, 10.0, |_, _| ());
    let top = before.iter().map(|x| x.z).fold(0.0, f64::max);
    let pairs = cloth.positions().iter().zip(&before);
    let way = pairs
        .map(|(x, before)| x.distance(*before))
        .fold(0.0, f64::max);
    println!(
        "ruck on an incline: {top:.4} m high, {:.1e} m/s",
        way / 10.0
    );
    assert!(top > 0.001 && way / 10.0 < 1e-6, "{top} {way}");
}
