//! No step allocates once the buffers have grown.

#![allow(clippy::unwrap_used, reason = "a failed set-up fails the test")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use selvedge_grasp::{
    Command, DQuat, DVec3, GraspVolume, Gripper, Grippers, Jaw, Pose, Shape, Squeeze,
};

mod grid;

/// Counts the allocations of each thread.
struct Counting;

thread_local! {
    static COUNT: Cell<u64> = const { Cell::new(0) };
}

#[allow(unsafe_code, reason = "an allocator cannot be written without")]
// SAFETY: everything is passed on to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: as above.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        COUNT.with(|count| count.set(count.get() + 1));
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn allocations(run: impl FnOnce()) -> u64 {
    let before = COUNT.get();
    run();
    COUNT.get() - before
}

fn gripper() -> Gripper {
    let size = DVec3::splat(0.08);
    let volume = GraspVolume::new(Shape::Box { size }, DVec3::ZERO).unwrap();
    let squeeze = Squeeze {
        amount: 0.5,
        lift: 2e-4,
        steps: 10,
    };
    Gripper::new(volume, squeeze).unwrap()
}

fn command(x: f64, k: u32, jaw: Jaw) -> Command {
    let turn = DQuat::from_rotation_x(0.01 * f64::from(k));
    let position = DVec3::new(x, 0.0, 0.001 * f64::from(k % 20));
    let pose = Pose::new(position, turn).unwrap();
    Command { pose, jaw }
}

/// Ten steps open, then twenty closed.
fn jaw(k: u32) -> Jaw {
    if k % 30 < 10 { Jaw::Open } else { Jaw::Closed }
}

#[test]
fn one_gripper() {
    let grid = grid::flat([23, 28], [0.42, 0.59]);
    let mut gripper = gripper();
    let mut held = 0;
    let first = allocations(|| {
        let close = command(0.0, 0, Jaw::Closed);
        held = gripper.step(close, 0.01, grid.view()).unwrap().nodes.len();
    });
    assert!(first > 0 && held >= 4, "{first} allocations, {held} held");
    let later = allocations(|| {
        for k in 0..300 {
            gripper
                .step(command(0.0, k, jaw(k)), 0.01, grid.view())
                .unwrap();
        }
        gripper.reset();
        gripper
            .step(command(0.0, 0, Jaw::Closed), 0.01, grid.view())
            .unwrap();
    });
    assert_eq!(later, 0);
}

#[test]
fn two_grippers_with_shared_nodes() {
    let grid = grid::flat([23, 28], [0.42, 0.59]);
    let mut grippers = Grippers::new(vec![gripper(), gripper()]);
    let mut refused = 0;
    let mut round = || {
        for k in 0..300 {
            // The first closes before the second in some rounds, after it in others.
            let commands = [
                command(0.0, k, jaw(k + k / 60)),
                command(0.05, k, jaw(k + 3)),
            ];
            grippers.step(&commands, 0.01, grid.view()).unwrap();
            refused += grippers.grippers()[0].refused().len();
            refused += grippers.grippers()[1].refused().len();
        }
    };
    assert!(allocations(&mut round) > 0);
    assert_eq!(allocations(&mut round), 0);
    assert!(refused > 0);
}
