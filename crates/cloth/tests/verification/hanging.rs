//! Sheets that hang from pins.

use selvedge_cloth::{Material, Mesh, Settings, Simulator};
use selvedge_math::{ClothSimulator, DVec3};

use crate::scene::{
    FRAME, air, along, areas, column, fall, off, polyline, put, run, simulator, speed, strain,
    without_drag,
};

/// Zeros of the Bessel function J0.
const ZEROS: [f64; 3] = [2.404825557695773, 5.520078110286311, 8.653727912911013];

/// J0 by its power series.
fn bessel(x: f64) -> f64 {
    let mut term = 1.0;
    let mut sum = 1.0;
    for k in 1..40 {
        term *= -(x * x) / f64::from(4 * k * k);
        sum += term;
    }
    sum
}

/// A strip that swings in its `mode`, from `J0(j sqrt(s/L))` of a two-hundredth of its length;
/// calls back with the time, and the mode's amplitude and its rate, once a step.
fn swing(mode: usize, material: Material, time: f64, mut see: impl FnMut(f64, f64, f64)) {
    const CELLS: usize = 60;
    let length = 0.59;
    let side = length / CELLS as f64;
    let mesh = Mesh::grid([CELLS + 1, 2], [length, side]).unwrap();
    // Columns go down from the pins; `s` is measured from the free end.
    let shape: Vec<f64> = (0..=CELLS)
        .map(|k| bessel(ZEROS[mode] * (1.0 - k as f64 / CELLS as f64).sqrt()))
        .collect();
    let angles = (0..CELLS).map(|k| {
        let across = 0.005 * length * (shape[k + 1] - shape[k]);
        -(across / side).acos()
    });
    let positions = along(&mesh, &polyline(side, angles));
    let mut cloth = simulator(&mesh, material, air());
    put(&mut cloth, &positions);
    cloth.pin(&column(&mesh, 0)).unwrap();
    let areas = areas(&mesh);
    let amplitude = |of: &[DVec3]| -> f64 {
        let nodes = of.iter().zip(&areas).enumerate();
        nodes
            .map(|(k, (p, area))| p.x * area * shape[k % (CELLS + 1)])
            .sum()
    };
    run(&mut cloth, 1.0 / 120.0, time, |cloth, _| {
        see(
            cloth.time(),
            amplitude(cloth.positions()),
            amplitude(cloth.velocities()),
        );
    });
}

/// `omega_k = (j_0k/2) sqrt(delta g/(rho L))` of a heavy chain (Bernoulli 1733). The mesh alone is
/// off by `O((k/60)^2)`, the step by `(omega h)^2/12`, 8e-4 for the third mode: 1 % holds both.
#[test]
fn a_hanging_strip_swings_like_a_heavy_chain() {
    let material = Material {
        bending: 0.0,
        ..without_drag()
    };
    for (mode, zero) in ZEROS.iter().enumerate() {
        let reference = zero / 2.0 * (fall(&material, &air()) / 0.59).sqrt();
        let mut before: Option<[f64; 2]> = None;
        let mut crossings = Vec::new();
        let time = 5.6 * std::f64::consts::TAU / reference;
        swing(mode, material, time, |time, amplitude, _| {
            if let Some([earlier, was]) = before
                && (was < 0.0) != (amplitude < 0.0)
            {
                crossings.push(earlier + (time - earlier) * was / (was - amplitude));
            }
            before = Some([time, amplitude]);
        });
        let count = crossings.len() - 1;
        assert_eq!(count, 10);
        let measured = std::f64::consts::PI * count as f64 / (crossings[count] - crossings[0]);
        println!(
            "mode {}: {measured:.4} /s, reference {reference:.4}",
            mode + 1
        );
        assert!(off(measured, reference) < 0.01, "{measured} {reference}");
    }
}

/// Amplitudes decay at the rate `alpha/(2 rho)`: so do the speeds at the crossings, to 1 %.
#[test]
fn a_hanging_strip_loses_its_swing_to_drag() {
    let material = Material {
        bending: 0.0,
        ..Material::default()
    };
    let mut before: Option<[f64; 3]> = None;
    let mut crossings: Vec<[f64; 2]> = Vec::new();
    swing(1, material, 3.0, |time, amplitude, rate| {
        if let Some([earlier, was, rate_was]) = before
            && (was < 0.0) != (amplitude < 0.0)
        {
            let share = was / (was - amplitude);
            let speed = rate_was + share * (rate - rate_was);
            crossings.push([earlier + share * (time - earlier), speed.abs()]);
        }
        before = Some([time, amplitude, rate]);
    });
    let (first, last) = (crossings[0], crossings[crossings.len() - 1]);
    let measured = (first[1] / last[1]).ln() / (last[0] - first[0]);
    let reference = material.damping / (2.0 * material.density);
    println!("decay: {measured:.4} /s, reference {reference:.4}");
    assert!(off(measured, reference) < 0.01, "{measured} {reference}");
}

/// `2a sinh(d/2a) = L`, sag `a (cosh(d/2a) - 1)`: the catenary, `L = 1 m`. A hundred straight edges
/// hang like it to 1e-4.
#[test]
fn a_strip_between_two_pins_is_a_catenary() {
    for (span, sag) in [(0.5, 0.398194), (0.7, 0.319720), (0.9, 0.190709)] {
        let mesh = Mesh::grid([101, 2], [1.0, 0.01]).unwrap();
        let material = Material {
            bending: 0.0,
            damping: 2.0,
            ..Material::default()
        };
        let settings = Settings {
            settled: 1e-8,
            ..air()
        };
        let mut cloth = simulator(&mesh, material, settings);
        // From two straight lines
        let angle = f64::acos(span);
        let angles = (0..100).map(|k| if k < 50 { -angle } else { angle });
        put(&mut cloth, &along(&mesh, &polyline(0.01, angles)));
        cloth
            .pin(&[column(&mesh, 0), column(&mesh, 100)].concat())
            .unwrap();
        run(&mut cloth, FRAME, 10.0, |_, _| ());
        let lowest = cloth.positions().iter().map(|x| -x.z).fold(0.0, f64::max);
        println!(
            "catenary over {span}: sag {lowest:.6}, reference {sag}, still {:.1e}",
            speed(&cloth)
        );
        assert!((lowest - sag).abs() < 1e-3, "{lowest}");
        assert!(speed(&cloth) < 1e-3);
    }
}

/// A sheet of the default cloth that hangs from two corners, `way` [m] nearer to each other than
/// they are at rest, which lets it sag into folds.
fn curtain(material: Material, settings: Settings, way: f64) -> (Mesh, Simulator) {
    let mesh = Mesh::grid([13, 14], [0.24, 0.26]).unwrap();
    let mut cloth = simulator(&mesh, material, settings);
    // A bow with the pins at its ends: both halves turn by the same angle.
    let side = 0.02;
    let angle = f64::acos(1.0 - way / 0.24);
    let points = polyline(side, (0..12).map(|k| if k < 6 { -angle } else { angle }));
    let middle = points[12].x / 2.0;
    let positions: Vec<DVec3> = mesh
        .rest()
        .iter()
        .enumerate()
        .map(|(k, p)| {
            let bow = points[k % 13];
            DVec3::new(bow.x - middle, bow.z, p.y)
        })
        .collect();
    put(&mut cloth, &positions);
    cloth.pin(&[13 * 13, 13 * 14 - 1]).unwrap();
    (mesh, cloth)
}

/// `sum f = delta g A`, and the moments of pins and weights cancel.
#[test]
fn pins_carry_the_weight() {
    let material = Material {
        damping: 2.0,
        ..Material::default()
    };
    let settings = Settings {
        tolerance: 1e-9,
        ..air()
    };
    let (mesh, mut cloth) = curtain(material, settings, 0.02);
    run(&mut cloth, FRAME, 14.0, |_, _| ());
    let weight = material.gravitational_density * settings.gravity;
    let total = weight * 0.24 * 0.26;
    let force: DVec3 = cloth.reactions().iter().sum();
    let pairs = cloth.positions().iter().zip(cloth.reactions());
    let moment: DVec3 = pairs.map(|(x, f)| x.cross(*f)).sum();
    let pairs = cloth.positions().iter().zip(areas(&mesh));
    let of_weight: DVec3 = pairs
        .map(|(x, area)| x.cross(DVec3::NEG_Z * weight * area))
        .sum();
    let off = (force - DVec3::Z * total).length() / total;
    let turning = (moment + of_weight).length() / (total * 0.24);
    println!(
        "pins: force off by {off:.1e}, moment by {turning:.1e}, still {:.1e} m/s",
        speed(&cloth)
    );
    assert!(off < 1e-6 && turning < 1e-6, "{off} {turning}");
}

/// A scene that is its own mirror image stays so, to rounding that the motion lets grow.
#[test]
fn a_symmetric_scene_stays_symmetric() {
    let (_, mut cloth) = curtain(Material::default(), air(), 0.02);
    let mut worst = 0.0_f64;
    run(&mut cloth, FRAME, 2.0, |cloth, _| {
        let x = cloth.positions();
        for k in 0..x.len() {
            let mirrored = x[k / 13 * 13 + 12 - k % 13] * DVec3::new(-1.0, 1.0, 1.0);
            worst = worst.max(x[k].distance(mirrored));
        }
    });
    println!("symmetry: off by {worst:.1e} m");
    assert!(worst < 1e-9, "{worst}");
}

/// A flat sheet pinned at two corners of a side falls and hangs. The side between the pins is straight
/// already: it can carry no weight but by a sag within the tolerance, `sqrt(3/8 tolerance)` of it.
#[test]
fn a_flat_sheet_pinned_at_two_corners_hangs() {
    let mesh = Mesh::grid([12, 14], [0.22, 0.26]).unwrap();
    let mut cloth = simulator(&mesh, Material::default(), air());
    cloth.pin(&[0, 11]).unwrap();
    run(&mut cloth, FRAME, 3.0, |cloth, _| {
        assert!(strain(&mesh, cloth.positions()) < 1e-3);
    });
}
