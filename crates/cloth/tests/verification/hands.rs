//! What hands do to a sheet: squeeze it, pull it, let it go.

use selvedge_cloth::{Material, Mesh, RECOVERY, Settings, Simulator};
use selvedge_math::{ClothSimulator, DQuat, DVec3, Held, Status, StepReport};

use crate::scene::{FRAME, air, along, polyline, put, run, simulator, speed, strain};

/// A step with nodes held on these targets.
fn hold(cloth: &mut Simulator, nodes: &[u32], targets: &[DVec3]) -> StepReport {
    let place = |&node: &u32| cloth.positions()[node as usize];
    let velocities: Vec<DVec3> = nodes
        .iter()
        .zip(targets)
        .map(|(node, target)| (*target - place(node)) / FRAME)
        .collect();
    let held = Held {
        nodes,
        targets,
        velocities: &velocities,
    };
    cloth.step(held, FRAME).unwrap()
}

/// Four nodes of a quad drawn to half their distance along x, or along both sides, in ten steps, then
/// let go: no jump, and within [`RECOVERY`] every edge has its length again.
#[test]
fn a_squeezed_quad_opens_gently() {
    for both in [false, true] {
        for corner in [105_usize, 240] {
            let mesh = Mesh::grid([23, 28], [0.42, 0.59]).unwrap();
            let mut cloth = simulator(&mesh, Material::default(), Settings::default());
            let nodes = [corner, corner + 1, corner + 23, corner + 24].map(|k| k as u32);
            let places = nodes.map(|k| mesh.rest()[k as usize]);
            let centre = places.iter().sum::<DVec3>() / 4.0;
            let mut missed = 0.0_f64;
            for step in 1..=20 {
                let share = 0.5 * f64::from(step.min(10)) / 10.0;
                let targets = places.map(|p| {
                    let way = (centre - p) * share;
                    p + DVec3::new(way.x, if both { way.y } else { 0.0 }, 4e-4 * share)
                });
                let report = hold(&mut cloth, &nodes, &targets);
                missed = missed.max(report.held_error);
            }
            let squeezed = strain(&mesh, cloth.positions());
            let mut fastest = 0.0_f64;
            run(&mut cloth, FRAME, RECOVERY + FRAME, |cloth, _| {
                fastest = fastest.max(speed(cloth));
            });
            let left = strain(&mesh, cloth.positions());
            println!(
                "squeeze: strain {squeezed:.2}, hands late by {missed:.1e} m, {fastest:.3} m/s, strain {left:.1e} after it"
            );
            assert!(squeezed > 0.4 && fastest < 1.0 && left <= 1e-4);
        }
    }
}

/// Two hands hold both ends of an edge of the sheet, which stands on the table as a bow; they pull
/// them 5 cm further apart than it is long and come back: what they cannot get is reported, and the
/// cloth keeps its lengths.
#[test]
fn hands_that_want_too_much_are_told() {
    let mesh = Mesh::grid([10, 12], [0.18, 0.22]).unwrap();
    let mut cloth = simulator(&mesh, Material::default(), Settings::default());
    let angles = [0.5, 0.4, 0.3, 0.2, 0.0, -0.2, -0.3, -0.4, -0.5];
    put(
        &mut cloth,
        &along(&mesh, &polyline(0.02, angles.into_iter())),
    );
    let nodes = [0, 9];
    let places = nodes.map(|k| cloth.positions()[k as usize]);
    let slack = 0.18 - places[0].distance(places[1]);
    let start = std::time::Instant::now();
    let (mut worst, mut missed, mut iterations) = (0.0_f64, 0.0_f64, 0);
    for step in 0..270 {
        // Out within a second, half a second there, back within a second, two seconds' rest
        let share = match step {
            0..60 => f64::from(step + 1) / 60.0,
            60..90 => 1.0,
            90..150 => f64::from(149 - step) / 60.0,
            _ => 0.0,
        };
        let out = DVec3::X * 0.5 * share * (slack + 0.05);
        let up = DVec3::Z * 0.01 * f64::from(step + 1).min(30.0) / 30.0;
        let targets = [places[0] - out + up, places[1] + out + up];
        let report = hold(&mut cloth, &nodes, &targets);
        assert!(cloth.positions().iter().all(|x| x.is_finite()));
        worst = worst.max(strain(&mesh, cloth.positions()));
        missed = missed.max(report.held_error);
        iterations += report.iterations;
        match step {
            89 => assert!(report.held_error > 0.015, "{report:?}"),
            269 => assert!(
                report.held_error < 1e-9 && report.status == Status::Converged,
                "{report:?}"
            ),
            _ => (),
        }
    }
    let spent = start.elapsed().as_secs_f64();
    println!(
        "pulled too far: strain {worst:.1e}, {missed:.4} m missed, {iterations} iterations, {spent:.1} s"
    );
    assert!(worst <= 1e-3 && spent < 20.0, "{worst} {spent}");
}

/// Two grippers at the ends of a taut row squeeze what they hold to half its length, which pulls their
/// inner nodes further apart than the row between them is long: they get as near as it lets them, and
/// the sheet is carried along as they rise.
#[test]
fn grippers_that_squeeze_a_taut_row_carry_it() {
    let mesh = Mesh::grid([12, 14], [0.42, 0.59]).unwrap();
    let mut cloth = simulator(&mesh, Material::default(), Settings::default());
    let nodes = [144, 145, 154, 155, 156, 157, 166, 167];
    let places = nodes.map(|k| mesh.rest()[k as usize]);
    let middle = (places[0] + places[7]) / 2.0;
    let centre =
        |p: DVec3| middle + DVec3::X * (0.42 - 0.42 / 11.0) / 2.0 * (p.x - middle.x).signum();
    let (mut worst, mut missed) = (0.0_f64, 0.0_f64);
    for step in 1..=90 {
        let share = 0.5 * f64::from(step.min(10)) / 10.0;
        let up = DVec3::Z * 0.2 * f64::from(step - step.min(10)) / 80.0;
        let targets = places.map(|p| p.lerp(centre(p), share) + up);
        let report = hold(&mut cloth, &nodes, &targets);
        assert_eq!(report.status, Status::Converged, "{report:?}");
        worst = worst.max(report.strain.unwrap());
        missed = missed.max(report.held_error);
    }
    let height = |k: u32| cloth.positions()[k as usize].z;
    let lowest = nodes.map(height).into_iter().fold(f64::INFINITY, f64::min);
    println!("taut row: {missed:.4} m missed, strain {worst:.1e}, lifted to {lowest:.3} m");
    // Half of each cell of 3.8 cm by 4.5 cm is what is squeezed away.
    assert!(missed < 0.021 && worst <= 1e-3, "{missed} {worst}");
    assert!(lowest > 0.19, "{lowest}");
}

/// A hand folds a sheet over and presses down on what it holds: the edge below it stands on the lower
/// layer like a strut that friction does not let go. The hand is held up and told, and no edge gets
/// shorter.
#[test]
fn a_strut_holds_the_hand_up() {
    let mesh = Mesh::grid([12, 14], [0.42, 0.59]).unwrap();
    let mut cloth = simulator(&mesh, Material::default(), Settings::default());
    let nodes = [144, 145, 154, 155, 156, 157, 166, 167];
    let places = nodes.map(|k| mesh.rest()[k as usize]);
    let grip = DVec3::Y * mesh.rest()[167].y;
    let (mut worst, mut missed, mut iterations) = (0.0_f64, 0.0_f64, 0);
    for step in 1..=180 {
        let s = (f64::from(step) / 120.0).min(1.0);
        let s = s * s * s * (10.0 + s * (6.0 * s - 15.0));
        // Bezier curve and turn of a gripper, found by a search for good folds that went astray
        let way = 2.0 * (1.0 - s) * s * DVec3::new(0.0, -0.038, 0.389)
            + s * s * DVec3::new(0.0, -0.268, 0.0169)
            + (1.0 - s) * (1.0 - s) * grip;
        let turn = DQuat::from_rotation_x(0.2924 * s);
        let targets = places.map(|p| way + turn * (p - grip));
        let report = hold(&mut cloth, &nodes, &targets);
        worst = worst.max(strain(&mesh, cloth.positions()));
        missed = missed.max(report.held_error);
        iterations += report.iterations;
    }
    println!("strut: strain {worst:.1e}, {missed:.4} m missed, {iterations} iterations");
    assert!(missed > 0.005 && worst <= 1e-3, "{missed} {worst}");
}

/// Two hands bring the ends of an edge of a flat sheet together by 2 cm while they lift it: they get
/// where they want, and the edge makes a bow.
#[test]
fn hands_that_come_together_lift_a_bow() {
    let mesh = Mesh::grid([10, 12], [0.18, 0.22]).unwrap();
    let mut cloth = simulator(&mesh, Material::default(), Settings::default());
    let nodes = [0, 9];
    let places = nodes.map(|k| mesh.rest()[k as usize]);
    for step in 1..=60 {
        let share = f64::from(step) / 60.0;
        let (way, up) = (DVec3::X * 0.01 * share, DVec3::Z * 0.02 * share);
        let report = hold(
            &mut cloth,
            &nodes,
            &[places[0] + way + up, places[1] - way + up],
        );
        if step == 60 {
            println!("together: {report:?}");
            assert!(report.held_error < 1e-9, "{report:?}");
        }
    }
}

/// A hand lifts a corner, then moves at 5 m/s at once, down or sideways, for two steps: no step fails,
/// the cloth keeps its lengths, and what the hand missed is reported until it is made good.
#[test]
fn a_sudden_hand_is_followed_or_told() {
    for way in [DVec3::NEG_Z, DVec3::new(-0.6, -0.6, -0.5).normalize()] {
        let mesh = Mesh::grid([14, 16], [0.26, 0.3]).unwrap();
        let mut cloth = simulator(&mesh, Material::default(), Settings::default());
        let mut target = mesh.rest()[223];
        let mut missed = [0.0_f64; 2];
        for step in 0..80 {
            target += match step {
                0..48 => DVec3::new(-1.5e-3, -1.5e-3, 4e-3),
                48..50 => way * 5.0 * FRAME,
                _ => DVec3::ZERO,
            };
            let report = hold(&mut cloth, &[223], &[target]);
            missed[0] = missed[0].max(report.held_error);
            missed[1] = report.held_error;
            assert!(strain(&mesh, cloth.positions()) < 1e-3);
        }
        println!("sudden hand: {missed:?} m missed at most and at the end");
        assert!(missed[1] < 1e-9, "{missed:?}");
    }
}

/// A sheet carried at a constant velocity by some of its nodes, without gravity, goes on with it when
/// it is let go.
#[test]
fn a_released_sheet_goes_on_as_it_moved() {
    let mesh = Mesh::grid([10, 12], [0.18, 0.22]).unwrap();
    let settings = Settings {
        gravity: 0.0,
        ..air()
    };
    let material = Material {
        damping: 0.0,
        ..Material::default()
    };
    let mut cloth = simulator(&mesh, material, settings);
    let velocity = DVec3::new(0.2, -0.3, 0.4);
    cloth
        .reset(mesh.rest(), &vec![velocity; mesh.node_count()])
        .unwrap();
    let nodes = [0, 1, 57, 119];
    for step in 1..=30 {
        let way = velocity * FRAME * f64::from(step);
        let targets = nodes.map(|k| mesh.rest()[k as usize] + way);
        hold(&mut cloth, &nodes, &targets);
    }
    run(&mut cloth, FRAME, 0.5, |_, _| ());
    let off = |v: &DVec3| v.distance(velocity);
    let worst = cloth.velocities().iter().map(off).fold(0.0, f64::max);
    println!("release: velocities off by {worst:.1e} m/s");
    assert!(worst < 1e-9, "{worst}");
    let ends = cloth.positions().iter().zip(mesh.rest());
    let worst = ends
        .map(|(x, rest)| x.distance(*rest + velocity))
        .fold(0.0, f64::max);
    assert!(worst < 1e-9, "{worst}");
}
