//! Cloth on cloth: a sheet on a larger one, both pieces of one mesh.

use selvedge_cloth::{Material, Mesh, Settings, Simulator};
use selvedge_math::{ClothSimulator, DVec3, Held, Status};

use crate::scene::{FRAME, air, off, run, without_drag};

/// A piece of a mesh: its nodes and their areas.
struct Piece {
    nodes: std::ops::Range<usize>,
    areas: Vec<f64>,
}

impl Piece {
    fn mean(&self, of: &[DVec3]) -> DVec3 {
        let pairs = of[self.nodes.clone()].iter().zip(&self.areas);
        pairs.map(|(p, area)| *p * *area).sum::<DVec3>() / self.areas.iter().sum::<f64>()
    }
}

/// Two square sheets, the lower one larger; with the positions of the upper one a thickness above.
/// Its nodes are over no node, line or diagonal of the lower one's.
fn pair(thickness: f64) -> (Mesh, [Piece; 2], Vec<DVec3>) {
    let (mut rest, mut quads, mut positions, mut pieces) = (vec![], vec![], vec![], vec![]);
    for (n, side, up) in [(14_u32, 0.02, 0.0), (7, 0.017, thickness)] {
        let first = rest.len() as u32;
        let mut areas = Vec::new();
        let half = 0.5 * side * f64::from(n - 1);
        for j in 0..n {
            for i in 0..n {
                let p = DVec3::new(f64::from(i) * side - half, f64::from(j) * side - half, up);
                // At rest the pieces lie next to each other.
                rest.push(DVec3::new(p.x + f64::from(first.min(1)), p.y, 0.0));
                positions.push(p + up * DVec3::new(3.1, 1.7, 0.0));
                let share = |k: u32| if k == 0 || k == n - 1 { 0.5 } else { 1.0 };
                areas.push(share(i) * share(j) * side * side);
                let k = first + j * n + i;
                if i + 1 < n && j + 1 < n {
                    quads.push([k, k + 1, k + n + 1, k + n]);
                }
            }
        }
        let nodes = first as usize..rest.len();
        pieces.push(Piece { nodes, areas });
    }
    let mesh = Mesh::new(rest, quads, Vec::new()).unwrap();
    let [lower, upper] = <[Piece; 2]>::try_from(pieces).ok().unwrap();
    (mesh, [lower, upper], positions)
}

fn material() -> Material {
    Material {
        friction_table: 2.0,
        ..without_drag()
    }
}

/// How fast the upper sheet moves against the lower one, which lies pinned on a table, after `time`
/// under a force along x of `share` times `mu_s` times its weight.
fn pulled(share: f64, time: f64) -> f64 {
    let material = material();
    let (mesh, [lower, upper], positions) = pair(material.thickness);
    let settings = Settings::default();
    let mut cloth = Simulator::new(&mesh, material, settings).unwrap();
    cloth
        .reset(&positions, &vec![DVec3::ZERO; positions.len()])
        .unwrap();
    let pins: Vec<u32> = lower.nodes.clone().map(|k| k as u32).collect();
    cloth.pin(&pins).unwrap();
    // Let the weight come to rest on the contacts first
    run(&mut cloth, FRAME, 0.2, |_, _| ());
    let weight = material.gravitational_density * settings.gravity;
    for (k, area) in upper.nodes.clone().zip(&upper.areas) {
        cloth.forces_mut()[k] = DVec3::X * share * material.friction_cloth * weight * *area;
    }
    run(&mut cloth, FRAME, time, |_, _| ());
    upper.mean(cloth.velocities()).x
}

/// The upper sheet moves when it is pulled with more than `mu_s` times its weight, and then with
/// `a = (F - mu_s W) / m`; below it stays.
#[test]
fn a_layer_slides_at_the_friction_of_its_weight() {
    let material = material();
    let below = pulled(0.99, 1.0);
    let above = pulled(1.01, 0.5);
    let twice = pulled(2.0, 0.15);
    let g = material.gravitational_density * 9.8 / material.density;
    let reference = [0.5 * 0.01, 0.15].map(|share| share * material.friction_cloth * g);
    println!(
        "layer: {below:.1e} m/s at 99 %, {above:.5} at 101 % (reference {:.5}), {twice:.5} at 200 % ({:.5})",
        reference[0], reference[1]
    );
    assert!(below.abs() < 1e-6);
    assert!(above > 0.5 * reference[0] && above < 2.0 * reference[0]);
    assert!(off(twice, reference[1]) < 0.01);
}

/// Two sheets in free flight, pressed together from outside and pulled past each other, all moving with
/// `velocity`: their relative velocity after 0.15 s.
fn pressed(velocity: DVec3, share: f64) -> DVec3 {
    let material = material();
    let (mesh, [lower, upper], positions) = pair(material.thickness);
    let settings = Settings {
        gravity: 0.0,
        ..air()
    };
    let mut cloth = Simulator::new(&mesh, material, settings).unwrap();
    cloth
        .reset(&positions, &vec![velocity; positions.len()])
        .unwrap();
    // The lower one is carried along, so that it stays flat.
    let nodes: Vec<u32> = lower.nodes.clone().map(|k| k as u32).collect();
    let pressure = 1.4;
    for (k, area) in upper.nodes.clone().zip(&upper.areas) {
        let pull = DVec3::X * share * material.friction_cloth * pressure;
        cloth.forces_mut()[k] = (pull - DVec3::Z * pressure) * *area;
    }
    for step in 1..=9 {
        let way = velocity * FRAME * f64::from(step);
        let targets: Vec<DVec3> = lower.nodes.clone().map(|k| positions[k] + way).collect();
        let velocities = vec![velocity; nodes.len()];
        let held = Held {
            nodes: &nodes,
            targets: &targets,
            velocities: &velocities,
        };
        let report = cloth.step(held, FRAME).unwrap();
        assert_eq!(report.status, Status::Converged, "{report:?}");
    }
    upper.mean(cloth.velocities()) - velocity
}

/// Friction knows relative motion only: at rest and at 1 m/s the same comes out.
#[test]
fn friction_between_layers_is_galilean() {
    for share in [0.9, 1.5] {
        let still = pressed(DVec3::ZERO, share);
        let moving = pressed(DVec3::new(0.8, -0.5, 0.3), share);
        let reference = material().friction_cloth * 1.4 / material().density * 0.15 * (share - 1.0);
        println!(
            "galilean, {share} of the bound: {:.6} and {:.6} m/s, reference {:.6}, apart by {:.1e}",
            still.x,
            moving.x,
            reference.max(0.0),
            still.distance(moving)
        );
        assert!(still.distance(moving) < 1e-6);
        if share > 1.0 {
            assert!(off(still.x, reference) < 0.01, "{still}");
        } else {
            assert!(still.length() < 1e-6, "{still}");
        }
    }
}
