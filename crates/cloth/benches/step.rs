//! What a step of 1/60 s costs: a sheet at rest, the sheet of the paper's table lifted by a corner,
//! and the same on meshes of 168 to 10304 nodes.

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use selvedge_cloth::{Material, Mesh, Settings, Simulator};
use selvedge_math::{ClothSimulator, DVec3, Held};

const DT: f64 = 1.0 / 60.0;
const SIDES: [f64; 2] = [0.42, 0.59];

fn sheet(nodes: [usize; 2]) -> (Mesh, Simulator) {
    let mesh = Mesh::grid(nodes, SIDES).expect("a grid");
    let cloth = Simulator::new(&mesh, Material::default(), Settings::default()).expect("a cloth");
    (mesh, cloth)
}

/// Lifts the last corner by 12 cm and 10 cm inwards within a second, and says how long a step took.
fn lift(mesh: &Mesh, cloth: &mut Simulator) -> Duration {
    let steps = 60;
    let (corner, start) = (mesh.node_count() - 1, mesh.rest()[mesh.node_count() - 1]);
    let before = Instant::now();
    for k in 1..=steps {
        let s = f64::from(k) / 60.0;
        let target = start + s * s * (3.0 - 2.0 * s) * DVec3::new(0.0, -0.1, 0.12);
        let held = Held {
            nodes: &[corner as u32],
            targets: &[target],
            velocities: &[DVec3::ZERO],
        };
        black_box(cloth.step(held, DT).expect("a step"));
    }
    before.elapsed() / steps
}

fn rest(c: &mut Criterion) {
    let (_, mut cloth) = sheet([23, 28]);
    for _ in 0..30 {
        cloth.step(Held::NONE, DT).expect("a step");
    }
    c.bench_function("a step at rest, 644 nodes", |b| {
        b.iter(|| black_box(cloth.step(Held::NONE, DT).expect("a step")));
    });
}

fn growth(c: &mut Criterion) {
    let mut group = c.benchmark_group("a step of a sheet lifted by a corner");
    group.sample_size(10);
    for nodes in [[12, 14], [23, 28], [46, 56], [92, 112]] {
        let (mesh, mut cloth) = sheet(nodes);
        let zero = vec![DVec3::ZERO; mesh.node_count()];
        group.bench_function(BenchmarkId::from_parameter(mesh.node_count()), |b| {
            b.iter_custom(|repeats| {
                let mut spent = Duration::ZERO;
                for _ in 0..repeats {
                    cloth.reset(mesh.rest(), &zero).expect("its own shape");
                    spent += lift(&mesh, &mut cloth);
                }
                spent
            });
        });
    }
    group.finish();
}

criterion_group!(benches, rest, growth);
criterion_main!(benches);
