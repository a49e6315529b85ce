//! What a pose costs: of a sweep with either orientation, and of a whole schedule.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use selvedge_math::{DQuat, DVec3};
use selvedge_trajectory::{FoldTimes, Law, Orientation, QuadBezier, Schedule, Sweep};

fn sweep(orientation: Orientation) -> Sweep {
    let path = QuadBezier {
        start: DVec3::new(0.21, 0.295, 0.01),
        mid: DVec3::new(0.21, 0.295, 0.18),
        end: DVec3::new(0.21, -0.295, 0.04),
    };
    let to = DQuat::from_rotation_z(-1.57);
    let from = to * DQuat::from_rotation_y(-0.785);
    let tip = DVec3::new(0.0, 0.0, -0.015);
    Sweep::new(path, from, to, orientation, tip).expect("finite numbers")
}

fn poses(c: &mut Criterion) {
    let (nlerp, slerp) = (sweep(Orientation::Nlerp), sweep(Orientation::Slerp));
    let times = FoldTimes {
        close: 1.0,
        start: 2.0,
        open: 5.0,
        end: 11.0,
    };
    let fold = Schedule::fold(nlerp, Law::Quintic, times).expect("ordered times");
    c.bench_function("pose, nlerp", |b| b.iter(|| nlerp.pose(black_box(0.37))));
    c.bench_function("pose, slerp", |b| b.iter(|| slerp.pose(black_box(0.37))));
    c.bench_function("motion, nlerp", |b| {
        b.iter(|| nlerp.motion(black_box(0.37), 0.6, 0.1, -3.0));
    });
    c.bench_function("command, moving", |b| {
        b.iter(|| fold.command(black_box(3.1)));
    });
    c.bench_function("command, holding", |b| {
        b.iter(|| fold.command(black_box(0.5)));
    });
}

criterion_group!(benches, poses);
criterion_main!(benches);
