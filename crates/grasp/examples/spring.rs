//! A force-based cloth: held nodes are drawn to their targets by springs and dampers.
//!
//! Masses and springs, stepped by the semi-implicit Euler method. A held node feels
//! `k (u - x) + c (u' - v)`, with the target `u` and the target velocity `u'` of the gripper. At rest
//! and in uniform motion the springs of all held nodes together carry the weight of the cloth, so
//! the held nodes lag behind their targets by `m g / (n k)` in the mean.

use selvedge_grasp::{
    ClothView, Command, DVec3, Error, GraspVolume, Gripper, Held, Jaw, Pose, Shape, Squeeze,
};

#[path = "../tests/grid/mod.rs"]
mod grid;

const DT: f64 = 1.0 / 60.0; // s
const SUBSTEPS: usize = 100;
const GRAVITY: f64 = 9.81; // m/s^2
const NODE_MASS: f64 = 1e-3; // kg
const CLOTH_STIFFNESS: f64 = 400.0; // N/m
const CLOTH_DAMPING: f64 = 0.1; // N s/m
const GRASP_STIFFNESS: f64 = 300.0; // N/m
const GRASP_DAMPING: f64 = 0.6; // N s/m

struct Cloth {
    positions: Vec<DVec3>,
    velocities: Vec<DVec3>,
    /// Nodes and rest length [m].
    springs: Vec<([u32; 2], f64)>,
}

impl Cloth {
    fn step(&mut self, held: Held<'_>) {
        let h = DT / SUBSTEPS as f64;
        for substep in 0..SUBSTEPS {
            let mut forces = vec![-DVec3::Z * NODE_MASS * GRAVITY; self.positions.len()];
            for &(nodes, rest) in &self.springs {
                let [i, j] = nodes.map(|node| node as usize);
                let between = self.positions[j] - self.positions[i];
                let along = between.normalize();
                let speed = (self.velocities[j] - self.velocities[i]).dot(along);
                let pull = CLOTH_STIFFNESS * (between.length() - rest) + CLOTH_DAMPING * speed;
                forces[i] += pull * along;
                forces[j] -= pull * along;
            }

            // The grasp: a spring to where the target is now; its given place is that at the end of the step.
            let left = DT - substep as f64 * h;
            for (k, &node) in held.nodes.iter().enumerate() {
                let (x, v) = (
                    self.positions[node as usize],
                    self.velocities[node as usize],
                );
                let target = held.targets[k] - held.velocities[k] * left;
                forces[node as usize] +=
                    GRASP_STIFFNESS * (target - x) + GRASP_DAMPING * (held.velocities[k] - v);
            }

            for (k, force) in forces.iter().enumerate() {
                self.velocities[k] += force / NODE_MASS * h;
                self.positions[k] += self.velocities[k] * h;
            }
        }
    }

    /// How far the held nodes are behind their targets in the mean [m].
    fn lag(&self, held: Held<'_>) -> DVec3 {
        let behind = held.nodes.iter().zip(held.targets);
        let behind = behind.map(|(&node, &target)| target - self.positions[node as usize]);
        behind.sum::<DVec3>() / held.nodes.len() as f64
    }
}

fn main() -> Result<(), Error> {
    // A strip that hangs from the gripper already.
    let sheet = grid::flat([4, 13], [0.06, 0.24]);
    let positions: Vec<DVec3> = sheet
        .positions
        .iter()
        .map(|x| DVec3::new(x.x, 0.0, -x.y))
        .collect();
    let springs = sheet.edges.iter().copied();
    let springs = springs.chain(
        sheet
            .quads
            .iter()
            .flat_map(|&[a, b, c, d]| [[a, c], [b, d]]),
    );
    let springs = springs.map(|nodes| {
        let [i, j] = nodes.map(|node| positions[node as usize]);
        (nodes, i.distance(j))
    });
    let mut cloth = Cloth {
        springs: springs.collect(),
        velocities: vec![DVec3::ZERO; positions.len()],
        positions,
    };

    let size = DVec3::new(0.1, 0.02, 0.01);
    let volume = GraspVolume::new(Shape::Box { size }, DVec3::X * 0.03)?;
    let squeeze = Squeeze {
        amount: 0.2,
        lift: 0.0,
        steps: 30,
    };
    let mut gripper = Gripper::new(volume, squeeze)?;
    let expected = 52.0 * NODE_MASS * GRAVITY / (4.0 * GRASP_STIFFNESS);
    let mut height = 0.0;
    // Five seconds at rest, then five upwards at 0.2 m/s.
    for (name, speed) in [("at rest", 0.0), ("at 0.2 m/s", 0.2)] {
        let mut lag = DVec3::ZERO;
        for _ in 0..300 {
            height += speed * DT;
            let command = Command {
                pose: Pose::from_translation(DVec3::Z * height),
                jaw: Jaw::Closed,
            };
            let view = ClothView {
                positions: &cloth.positions,
                ..sheet.view()
            };
            let held = gripper.step(command, DT, view)?;
            cloth.step(held);
            lag = cloth.lag(held);
        }
        println!(
            "{name}: lag {:.7} mm, weight / stiffness {:.7} mm",
            1e3 * lag.z,
            1e3 * expected
        );
        assert_eq!(gripper.nodes().len(), 4);
        assert!((lag - DVec3::Z * expected).length() < 1e-3 * expected);
    }
    Ok(())
}
