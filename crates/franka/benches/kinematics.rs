//! What a pose, a Jacobian and all inverse solutions cost.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use selvedge_franka::Arm;

fn kinematics(c: &mut Criterion) {
    let arm = Arm::fr3();
    let q = [0.3, -0.4, 0.2, -2.1, 0.1, 1.8, 0.6];
    let target = arm.forward(&q);
    let mut columns = [[0.0; 6]; 7];
    c.bench_function("forward", |b| b.iter(|| arm.forward(black_box(&q))));
    c.bench_function("jacobian", |b| {
        b.iter(|| black_box(arm.jacobian(black_box(&q), &mut columns)));
    });
    c.bench_function("inverse, q7 given", |b| {
        b.iter(|| arm.inverse(black_box(&target), q[6], 0.0));
    });
    c.bench_function("inverse, 121 values of q7", |b| {
        b.iter(|| {
            let sweep = (0..121).map(|k| -3.0 + 0.05 * f64::from(k));
            sweep
                .filter_map(|q7| arm.inverse(black_box(&target), q7, 0.0).ok())
                .map(|solutions| solutions.as_slice().len())
                .sum::<usize>()
        });
    });
}

criterion_group!(benches, kinematics);
criterion_main!(benches);
