//! No step allocates once the buffers have grown.

#![allow(clippy::unwrap_used, reason = "a failed set-up fails the test")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use selvedge_cloth::{Material, Mesh, Settings, Simulator};
use selvedge_math::{ClothSimulator, DVec3, Held};

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

/// A corner that is lifted, folded over and let go, for 120 steps: the contacts of all of them.
fn fold(cloth: &mut Simulator, from: DVec3) -> u32 {
    let place = |step: u32| {
        let angle = f64::from(step.min(60)) / 60.0 * std::f64::consts::PI;
        let way = 0.12 * (1.0 - angle.cos());
        from + DVec3::new(-0.6 * way, -0.8 * way, 0.1 * angle.sin() + 2e-3)
    };
    let mut contacts = 0;
    for step in 0..120 {
        let target = [place(step + 1)];
        let velocity = [(target[0] - place(step)) * 60.0];
        let held = Held {
            nodes: &[12 * 14 - 1],
            targets: &target,
            velocities: &velocity,
        };
        let held = if step < 70 { held } else { Held::NONE };
        contacts += cloth.step(held, 1.0 / 60.0).unwrap().contacts;
    }
    contacts
}

/// Contacts come and go, so buffers grow while a motion is new; the second time nothing does.
#[test]
fn a_motion_allocates_the_first_time_only() {
    let mesh = Mesh::grid([12, 14], [0.22, 0.26]).unwrap();
    let mut cloth = Simulator::new(&mesh, Material::default(), Settings::default()).unwrap();
    let start = cloth.save();
    let corner = mesh.rest()[12 * 14 - 1];
    assert!(fold(&mut cloth, corner) > 100);
    cloth.restore(&start).unwrap();
    let mut contacts = 0;
    let count = allocations(|| contacts = fold(&mut cloth, corner));
    assert!(contacts > 100);
    assert_eq!(count, 0);
}

/// A sheet that has swung for a while does not allocate as it goes on.
#[test]
fn a_swinging_sheet_does_not_allocate() {
    let mesh = Mesh::grid([12, 14], [0.22, 0.26]).unwrap();
    let settings = Settings {
        table: false,
        ..Settings::default()
    };
    let mut cloth = Simulator::new(&mesh, Material::default(), settings).unwrap();
    let row: Vec<u32> = (0..12).collect();
    cloth.pin(&row).unwrap();
    for _ in 0..60 {
        cloth.step(Held::NONE, 1.0 / 60.0).unwrap();
    }
    let count = allocations(|| {
        for _ in 0..60 {
            cloth.step(Held::NONE, 1.0 / 60.0).unwrap();
        }
    });
    assert_eq!(count, 0);
}
