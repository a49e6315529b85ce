//! The whole of it in ten lines: a gripper lifts a corner of a cloth that goes where it is asked to.

use selvedge_grasp::*;

#[path = "../tests/grid/mod.rs"]
mod grid;

fn main() -> Result<(), Error> {
    let mut cloth = grid::flat([23, 28], [0.42, 0.59]);
    let size = DVec3::splat(0.05);
    let volume = GraspVolume::new(Shape::Box { size }, DVec3::ZERO)?;
    let squeeze = Squeeze {
        amount: 0.5,
        lift: 2e-4,
        steps: 10,
    };
    let mut gripper = Gripper::new(volume, squeeze)?;
    for k in 0..60 {
        let pose = Pose::from_translation(DVec3::Z * 0.1 * f64::from(k) / 59.0);
        let jaw = Jaw::Closed;
        let held = gripper.step(Command { pose, jaw }, 1.0 / 60.0, cloth.view())?;
        for (&node, &target) in held.nodes.iter().zip(held.targets) {
            cloth.positions[node as usize] = target; // the simulator's part
        }
    }

    println!("held nodes {:?}", gripper.nodes());
    println!("node 1 at {} m", cloth.positions[1]);
    assert_eq!(gripper.nodes(), [0, 1, 23, 24]);
    // Cells are 0.42/22 m wide; half of that is squeezed away.
    let expected = DVec3::new(0.5 * 0.42 / 22.0, 0.0, 0.1 + 2e-4);
    assert!((cloth.positions[1] - expected).length() < 1e-15);
    Ok(())
}
