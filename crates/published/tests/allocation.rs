//! No step allocates once the buffers have grown.

#![allow(clippy::unwrap_used, reason = "a failed set-up fails the test")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use selvedge_cloth::{Material, Mesh};
use selvedge_math::{ClothSimulator, DVec3, Held};
use selvedge_published::{Settings, Simulator};

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

/// Steps with these nodes held where they are, moved by `way`; returns the contacts.
fn step(cloth: &mut Simulator, nodes: &[u32], targets: &mut Vec<DVec3>, way: DVec3) -> u32 {
    targets.clear();
    targets.extend(
        nodes
            .iter()
            .map(|&node| cloth.positions()[node as usize] + way),
    );
    let velocities = &[DVec3::ZERO; 4][..nodes.len()];
    let held = Held {
        nodes,
        targets,
        velocities,
    };
    cloth.step(held, 1.0 / 60.0).unwrap().contacts
}

#[test]
fn only_the_first_steps_allocate() {
    let mesh = Mesh::grid([9, 11], [0.16, 0.2]).unwrap();
    let mut cloth = Simulator::new(&mesh, Material::default(), Settings::default()).unwrap();
    let mut targets = Vec::with_capacity(4);
    let mut run = |nodes: &[u32], steps: u32, way: DVec3| {
        let mut contacts = 0;
        let first = allocations(|| contacts += step(&mut cloth, nodes, &mut targets, way));
        let later = allocations(|| {
            for _ in 1..steps {
                contacts += step(&mut cloth, nodes, &mut targets, way);
            }
        });
        (first, later, contacts)
    };

    // Free, then held: in the first step of each the buffers grow.
    assert_eq!(run(&[], 20, DVec3::ZERO).1, 0);
    assert_eq!(run(&[97, 98], 30, DVec3::Z * 2e-3).1, 0);
    // Others, no more than before: not even then.
    let (first, later, _) = run(&[96, 97], 20, DVec3::Z * 1e-3);
    assert_eq!((first, later), (0, 0));
    // More of them; then folded over and let go.
    assert_eq!(run(&[88, 89, 97, 98], 10, DVec3::Z * 1e-3).1, 0);
    assert_eq!(
        run(&[88, 89, 97, 98], 40, DVec3::new(-2e-3, -4e-3, 0.0)).1,
        0
    );
    let (first, later, contacts) = run(&[88, 89, 97, 98], 40, DVec3::new(0.0, -2e-3, -2e-3));
    assert_eq!((first, later), (0, 0));
    assert!(contacts > 0);
    let (first, later, contacts) = run(&[], 60, DVec3::ZERO);
    assert_eq!((first, later), (0, 0));
    assert!(contacts > 0);
}
