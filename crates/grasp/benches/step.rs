//! How long does a carrying step take, by the number of held nodes?

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4};
use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use selvedge_grasp::{
    ClothView, Command, DQuat, DVec3, GraspVolume, Gripper, Jaw, Pose, Shape, Squeeze,
};
use selvedge_trajectory::{Orientation, QuadBezier, Sweep};

const DT: f64 = 1.0 / 60.0;

/// A gripper that holds all of some nodes.
fn closed_on(positions: &[DVec3]) -> Gripper {
    let size = DVec3::splat(1.0);
    let volume = GraspVolume::new(Shape::Box { size }, DVec3::ZERO).expect("sizes are valid");
    let squeeze = Squeeze {
        amount: 0.5,
        lift: 2e-4,
        steps: 10,
    };
    let mut gripper = Gripper::new(volume, squeeze).expect("the squeeze is valid");
    let close = Command {
        pose: Pose::IDENTITY,
        jaw: Jaw::Closed,
    };
    let held = gripper.step(close, DT, view(positions));
    assert_eq!(held.expect("a valid step").nodes.len(), positions.len());
    gripper
}

fn view(positions: &[DVec3]) -> ClothView<'_> {
    ClothView {
        positions,
        ..ClothView::default()
    }
}

fn positions(count: u32) -> Vec<DVec3> {
    let node = |k| DVec3::new(0.01 * f64::from(k % 8), 0.01 * f64::from(k / 8), 0.0);
    (0..count).map(node).collect()
}

/// Targets and velocities; the pose is there already, another one in each step.
fn pose_given(criterion: &mut Criterion) {
    let commands: Vec<Command> = (0..64)
        .map(|k| {
            let turn = DQuat::from_rotation_x(0.01 * f64::from(k));
            let pose = Pose::new(DVec3::Z * 0.002 * f64::from(k), turn).expect("a valid pose");
            let jaw = Jaw::Closed;
            Command { pose, jaw }
        })
        .collect();
    for count in [1, 2, 4, 64] {
        let positions = positions(count);
        let mut gripper = closed_on(&positions);
        let mut k = 0;
        criterion.bench_function(&format!("step/pose given/{count}"), |bencher| {
            bencher.iter(|| {
                k = (k + 1) % 64;
                let held = gripper.step(commands[k], DT, view(black_box(&positions)));
                black_box(held.is_ok())
            });
        });
    }
}

/// What a fold pays in each step: the pose from the trajectory, targets and velocities, and the
/// targets written to the cloth.
fn fold_step(criterion: &mut Criterion) {
    for (name, orientation) in [("nlerp", Orientation::Nlerp), ("slerp", Orientation::Slerp)] {
        let path = QuadBezier {
            start: DVec3::new(0.21, 0.316, 0.037),
            mid: DVec3::new(0.21, 0.295, 0.217),
            end: DVec3::new(0.21, -0.295, 0.077),
        };
        let to = DQuat::from_rotation_z(-FRAC_PI_2);
        let from = to * DQuat::from_rotation_y(-FRAC_PI_4);
        let sweep = Sweep::new(path, from, to, orientation, DVec3::ZERO).expect("finite numbers");
        for count in [1, 2, 4, 64] {
            let mut positions = positions(count);
            let mut gripper = closed_on(&positions);
            let mut k = 0;
            criterion.bench_function(&format!("step/{name}/{count}"), |bencher| {
                bencher.iter(|| {
                    k = (k + 1) % 180;
                    let pose = sweep.pose(f64::from(k) / 180.0);
                    let jaw = Jaw::Closed;
                    let held = gripper.step(Command { pose, jaw }, DT, view(&positions));
                    if let Ok(held) = held {
                        for (&node, &target) in held.nodes.iter().zip(held.targets) {
                            positions[node as usize] = target;
                        }
                    }
                    black_box(&mut positions);
                });
            });
        }
    }
}

criterion_group!(group, pose_given, fold_step);
criterion_main!(group);
