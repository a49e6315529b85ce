//! What a joint path, a whole report and a search for the base cost.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use selvedge_franka::{Arm, Placement, joint_path, reach, search};
use selvedge_math::{Command, DQuat, DVec3, Jaw, Pose};
use selvedge_trajectory::log::{Log, Sample};

/// 0.59 m across a cloth in 200 rows, 0.3 m high, the hand leaning back by 60 degrees on the way.
fn fold() -> Log {
    let mut log = Log::new("bench");
    for k in 0..200 {
        let u = f64::from(k) / 199.0;
        let s = u * u * (3.0 - 2.0 * u);
        let p = DVec3::new(0.21, 0.295 - 0.59 * s, 0.02 + 1.2 * s * (1.0 - s));
        let q = DQuat::from_rotation_x(-s * f64::to_radians(60.0));
        let pose = Pose::new(p, q).unwrap_or(Pose::IDENTITY);
        let jaw = Jaw::Closed;
        let command = Command { pose, jaw };
        let time = 3.0 * u;
        log.samples.push(Sample { time, command });
    }
    log
}

fn paths(c: &mut Criterion) {
    let arm = Arm::fr3();
    let log = fold();
    let base = [0.77, 0.0, 0.0, std::f64::consts::PI];
    let Ok(placement) = Placement::new(base, 0.0) else {
        return;
    };
    c.bench_function("joint path, 200 rows", |b| {
        b.iter(|| joint_path(black_box(&arm), &log, &placement));
    });
    c.bench_function("report with times, 200 rows", |b| {
        b.iter(|| reach(black_box(&arm), &log, &placement));
    });
    c.bench_function("search, 11 x 13 x 2 bases", |b| {
        b.iter(|| search(black_box(&arm), &log, 0.0, 0.0));
    });
}

criterion_group!(benches, paths);
criterion_main!(benches);
