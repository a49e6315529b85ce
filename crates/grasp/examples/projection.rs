//! A position-based cloth: held nodes are projected on their targets.
//!
//! Extended position-based dynamics (Macklin et al. 2016) with rigid edges and soft diagonals. A
//! held node is put on its target and given no inverse mass, so that the edges cannot move it.

use selvedge_grasp::{
    Command, DVec3, Error, GraspVolume, Gripper, Held, Jaw, Pose, Shape, Squeeze,
};

#[path = "../tests/grid/mod.rs"]
mod grid;

const DT: f64 = 1.0 / 60.0; // s
const SUBSTEPS: usize = 40;
const GRAVITY: f64 = 9.81; // m/s^2
const DAMPING: f64 = 2.0; // 1/s
const NODE_MASS: f64 = 1e-3; // kg
const SHEAR_COMPLIANCE: f64 = 1e-2; // m/N

struct Link {
    nodes: [u32; 2],
    rest: f64,
    compliance: f64,
}

struct Cloth {
    positions: Vec<DVec3>,
    velocities: Vec<DVec3>,
    links: Vec<Link>,
}

impl Cloth {
    fn step(&mut self, held: Held<'_>) {
        let h = DT / SUBSTEPS as f64;
        let mut inverse_masses = vec![1.0 / NODE_MASS; self.positions.len()];
        for &node in held.nodes {
            inverse_masses[node as usize] = 0.0;
        }
        for substep in 1..=SUBSTEPS {
            let before = self.positions.clone();
            for (x, v) in self.positions.iter_mut().zip(&mut self.velocities) {
                *v = (*v - DVec3::Z * GRAVITY * h) / (1.0 + DAMPING * h);
                *x += *v * h;
            }

            // The grasp: p_i - u_i = 0. The target holds at the end of the step.
            let left = DT - substep as f64 * h;
            for (k, &node) in held.nodes.iter().enumerate() {
                self.positions[node as usize] = held.targets[k] - held.velocities[k] * left;
            }

            for link in &self.links {
                let [i, j] = link.nodes.map(|node| node as usize);
                let between = self.positions[j] - self.positions[i];
                let weights = [inverse_masses[i], inverse_masses[j]];
                let stiffness = weights[0] + weights[1] + link.compliance / (h * h);
                if stiffness > 0.0 {
                    let length = between.length();
                    let change = (length - link.rest) / stiffness * between / length;
                    self.positions[i] += weights[0] * change;
                    self.positions[j] -= weights[1] * change;
                }
            }
            for (k, v) in self.velocities.iter_mut().enumerate() {
                *v = (self.positions[k] - before[k]) / h;
            }
        }
    }
}

fn main() -> Result<(), Error> {
    let sheet = grid::flat([13, 13], [0.3, 0.3]);
    let rest = |[a, b]: [u32; 2]| sheet.positions[a as usize].distance(sheet.positions[b as usize]);
    let link = |nodes, compliance| Link {
        nodes,
        rest: rest(nodes),
        compliance,
    };
    let mut links: Vec<Link> = sheet.edges.iter().map(|&edge| link(edge, 0.0)).collect();
    for &[a, b, c, d] in &sheet.quads {
        links.extend([[a, c], [b, d]].map(|diagonal| link(diagonal, SHEAR_COMPLIANCE)));
    }
    let mut cloth = Cloth {
        positions: sheet.positions.clone(),
        velocities: vec![DVec3::ZERO; sheet.positions.len()],
        links,
    };

    // A pinch of the corner at the origin, carried 0.2 m along the diagonal in one second, then kept.
    let size = DVec3::splat(0.06);
    let volume = GraspVolume::new(Shape::Box { size }, DVec3::ZERO)?;
    let squeeze = Squeeze {
        amount: 0.5,
        lift: 2e-4,
        steps: 10,
    };
    let mut gripper = Gripper::new(volume, squeeze)?;
    let (mut target_error, mut stretch) = (0.0_f64, 0.0_f64);
    for k in 1..=240 {
        let s = (f64::from(k) * DT).min(1.0);
        let pose = Pose::from_translation(DVec3::new(0.2, 0.2, 0.2) * s * s * (3.0 - 2.0 * s));
        let view = selvedge_grasp::ClothView {
            positions: &cloth.positions,
            ..sheet.view()
        };
        let jaw = Jaw::Closed;
        let held = gripper.step(Command { pose, jaw }, DT, view)?;
        cloth.step(held);
        for (&node, &target) in held.nodes.iter().zip(held.targets) {
            target_error = target_error.max(cloth.positions[node as usize].distance(target));
        }
        // The squeeze shortens edges between held nodes by design.
        for link in cloth.links.iter().filter(|link| link.compliance == 0.0) {
            if !link.nodes.iter().all(|node| held.nodes.contains(node)) {
                let [i, j] = link.nodes.map(|node| cloth.positions[node as usize]);
                stretch = stretch.max(i.distance(j) / link.rest - 1.0);
            }
        }
    }
    let lowest = cloth
        .positions
        .iter()
        .map(|x| x.z)
        .fold(f64::INFINITY, f64::min);
    println!(
        "{} held nodes, off target by {target_error:.1e} m at most",
        gripper.nodes().len()
    );
    println!(
        "largest stretch {stretch:.1e}, lowest node {:.3} m below the gripper",
        0.2 - lowest
    );
    assert_eq!(gripper.nodes().len(), 4);
    assert!(target_error < 1e-15);
    assert!(stretch < 0.05);
    // The far corner hangs below the gripper at the length of the diagonal, or a little less.
    let diagonal = 0.3 * 2.0_f64.sqrt();
    assert!(0.2 - lowest > 0.9 * diagonal && 0.2 - lowest < 1.3 * diagonal);
    Ok(())
}
