//! Same input, same bits; and steps that are refused change nothing.

use selvedge_cloth::{Material, Mesh, Settings, Simulator};
use selvedge_math::{ClothSimulator, DVec3, Held, SimulatorError, Status};

use crate::scene::{FRAME, simulator};

/// A corner that is lifted, folded over and let go.
fn fold() -> (Mesh, Simulator) {
    let mesh = Mesh::grid([12, 14], [0.22, 0.26]).unwrap();
    let cloth = simulator(&mesh, Material::default(), Settings::default());
    (mesh, cloth)
}

fn steps(mesh: &Mesh, cloth: &mut Simulator, range: std::ops::Range<u32>) -> u32 {
    let node = [12 * 14 - 1];
    let from = mesh.rest()[node[0] as usize];
    let place = |step: u32| {
        let angle = f64::from(step.min(60)) / 60.0 * std::f64::consts::PI;
        let way = 0.12 * (1.0 - angle.cos());
        from + DVec3::new(-0.6 * way, -0.8 * way, 0.1 * angle.sin() + 2e-3)
    };
    let mut contacts = 0;
    for step in range {
        let target = [place(step + 1)];
        let velocity = [(target[0] - place(step)) / FRAME];
        let held = Held {
            nodes: &node,
            targets: &target,
            velocities: &velocity,
        };
        let held = if step < 70 { held } else { Held::NONE };
        contacts += cloth.step(held, FRAME).unwrap().contacts;
    }
    contacts
}

fn bits(cloth: &Simulator) -> Vec<[u64; 3]> {
    let both = cloth.positions().iter().chain(cloth.velocities());
    both.map(|p| p.to_array().map(f64::to_bits)).collect()
}

#[test]
fn the_same_bits_twice() {
    let run = || {
        let (mesh, mut cloth) = fold();
        assert!(steps(&mesh, &mut cloth, 0..110) > 100);
        bits(&cloth)
    };
    assert!(run() == run());
}

/// On as many threads as there are, a sheet whose factors are made on several is lifted to the same bits; so is
/// one whose factors are kept in single precision and used on several, as accurately as others.
#[test]
fn the_same_bits_on_any_number_of_threads() {
    let run = |nodes: [usize; 2], threads| {
        let mesh = Mesh::grid(nodes, [0.42, 0.59]).unwrap();
        let mut cloth = simulator(&mesh, Material::default(), Settings::default());
        cloth.set_threads(threads).unwrap();
        let corner = mesh.node_count() - 1;
        for step in 1..=4 {
            let target = [mesh.rest()[corner] + DVec3::Z * 2e-3 * f64::from(step)];
            let held = Held {
                nodes: &[corner as u32],
                targets: &target,
                velocities: &[DVec3::ZERO],
            };
            let report = cloth.step(held, FRAME).unwrap();
            assert!(report.status == Status::Converged && report.held_error < 1e-6);
            assert!(report.strain < Some(1e-4), "{report:?}");
        }
        bits(&cloth)
    };
    for nodes in [[46, 56], [92, 112]] {
        let alone = run(nodes, 1);
        assert!(
            alone == run(nodes, 2) && alone == run(nodes, 5),
            "{nodes:?}"
        );
    }
    let mesh = Mesh::grid([3, 3], [0.1, 0.1]).unwrap();
    let mut cloth = simulator(&mesh, Material::default(), Settings::default());
    assert!(cloth.set_threads(0).is_err());
}

/// Going on after a save gives the bits of going on from what was saved, in the same simulator and in
/// a new one, in the air, in the hand and in contact.
#[test]
fn a_restored_state_goes_on_to_the_same_bits() {
    for at in [30, 65, 90] {
        let (mesh, mut cloth) = fold();
        steps(&mesh, &mut cloth, 0..at);
        let state = cloth.save();
        assert_eq!(state.positions(), cloth.positions());
        steps(&mesh, &mut cloth, at..at + 30);
        let end = bits(&cloth);
        cloth.restore(&state).unwrap();
        assert_eq!(state.velocities(), cloth.velocities());
        steps(&mesh, &mut cloth, at..at + 30);
        assert!(bits(&cloth) == end, "at {at}, same simulator");
        let (_, mut other) = fold();
        other.restore(&state).unwrap();
        assert!((other.time() - f64::from(at) * FRAME).abs() < 1e-12);
        steps(&mesh, &mut other, at..at + 30);
        assert!(bits(&other) == end, "at {at}, new simulator");
    }
}

#[test]
fn a_state_of_another_mesh_is_refused() {
    let (_, mut cloth) = fold();
    let before = bits(&cloth);
    let small = Mesh::grid([4, 4], [0.1, 0.1]).unwrap();
    let other = simulator(&small, Material::default(), Settings::default()).save();
    assert!(matches!(
        cloth.restore(&other),
        Err(SimulatorError::StateLength { .. })
    ));
    assert!(bits(&cloth) == before);
}

/// A step with a bad time or bad hands is refused, and the next one is as if it had not been asked for.
#[test]
fn a_refused_step_changes_nothing() {
    let (mesh, mut cloth) = fold();
    let (_, mut other) = fold();
    steps(&mesh, &mut cloth, 0..65);
    steps(&mesh, &mut other, 0..65);
    let before = bits(&cloth);
    let time = cloth.time();
    for dt in [-1.0, 0.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(
            cloth.step(Held::NONE, dt),
            Err(SimulatorError::TimeStep(_))
        ));
    }
    let zero = [DVec3::ZERO; 2];
    for (nodes, targets) in [
        ([3, 4], [DVec3::NAN, DVec3::ZERO]),
        ([3, 4], [DVec3::ZERO, DVec3::INFINITY]),
        ([4, 3], zero),
        ([4, 4], zero),
        ([4, 4000], zero),
    ] {
        let held = Held {
            nodes: &nodes,
            targets: &targets,
            velocities: &zero,
        };
        assert!(matches!(
            cloth.step(held, FRAME),
            Err(SimulatorError::Held(_))
        ));
    }
    cloth.forces_mut()[7] = DVec3::NAN;
    assert!(matches!(
        cloth.step(Held::NONE, FRAME),
        Err(SimulatorError::NotFinite { node: 7 })
    ));
    cloth.forces_mut()[7] = DVec3::ZERO;
    assert!(bits(&cloth) == before && cloth.time() == time);
    steps(&mesh, &mut cloth, 65..100);
    steps(&mesh, &mut other, 65..100);
    assert!(bits(&cloth) == bits(&other));
}
