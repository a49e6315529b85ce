//! What a step of 1/60 s costs: a sheet at rest, and a second of three motions on meshes of 168 to 10304
//! nodes, of large ones on two threads, too.

use std::hint::black_box;
use std::ops::Range;
use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use selvedge_cloth::{Material, Mesh, Settings, Simulator};
use selvedge_math::{ClothSimulator, DVec3, Held};

const DT: f64 = 1.0 / 60.0;
const SIDES: [f64; 2] = [0.42, 0.59];

/// A motion of a second from a flat sheet at rest.
struct Motion {
    name: &'static str,
    table: bool,
    /// Which nodes are held, and where they go [m].
    held: fn([usize; 2]) -> Range<usize>,
    way: DVec3,
}

const MOTIONS: [Motion; 3] = [
    Motion {
        name: "lifted by a corner and drawn inwards",
        table: true,
        held: |[a, b]| a * b - 1..a * b,
        way: DVec3::new(0.0, -0.1, 0.12),
    },
    Motion {
        name: "raised by a side",
        table: true,
        held: |[a, b]| a * b - a..a * b,
        way: DVec3::new(0.0, 0.0, 0.25),
    },
    Motion {
        name: "let fall from a side that stays",
        table: false,
        held: |[a, _]| 0..a,
        way: DVec3::ZERO,
    },
];

fn sheet(nodes: [usize; 2], table: bool) -> (Mesh, Simulator) {
    let settings = Settings {
        table,
        ..Settings::default()
    };
    let mesh = Mesh::grid(nodes, SIDES).expect("a grid");
    let cloth = Simulator::new(&mesh, Material::default(), settings).expect("a cloth");
    (mesh, cloth)
}

/// How long a step of a motion took.
fn perform(motion: &Motion, nodes: [usize; 2], mesh: &Mesh, cloth: &mut Simulator) -> Duration {
    let steps = 60;
    let held = (motion.held)(nodes);
    let ids: Vec<u32> = held.clone().map(|k| k as u32).collect();
    let starts = &mesh.rest()[held];
    let velocities = vec![DVec3::ZERO; ids.len()];
    let mut targets = starts.to_vec();
    let before = Instant::now();
    for k in 1..=steps {
        let s = f64::from(k) / f64::from(steps);
        for (target, start) in targets.iter_mut().zip(starts) {
            *target = *start + s * s * (3.0 - 2.0 * s) * motion.way;
        }
        let held = Held {
            nodes: &ids,
            targets: &targets,
            velocities: &velocities,
        };
        black_box(cloth.step(held, DT).expect("a step"));
    }
    before.elapsed() / steps
}

fn rest(c: &mut Criterion) {
    let (_, mut cloth) = sheet([23, 28], true);
    for _ in 0..30 {
        cloth.step(Held::NONE, DT).expect("a step");
    }
    c.bench_function("a step at rest, 644 nodes", |b| {
        b.iter(|| black_box(cloth.step(Held::NONE, DT).expect("a step")));
    });
}

fn growth(c: &mut Criterion) {
    for motion in &MOTIONS {
        let mut group = c.benchmark_group(format!("a step of a sheet {}", motion.name));
        group.sample_size(10);
        let meshes = [[12, 14], [23, 28], [46, 56], [92, 112]];
        let alone = meshes.map(|nodes| (nodes, 1));
        // Threads help what is large.
        let together = meshes[2..].iter().map(|&nodes| (nodes, 2));
        for (nodes, threads) in alone.into_iter().chain(together) {
            let (mesh, mut cloth) = sheet(nodes, motion.table);
            cloth.set_threads(threads).expect("threads");
            let zero = vec![DVec3::ZERO; mesh.node_count()];
            let name = match threads {
                1 => BenchmarkId::from_parameter(mesh.node_count()),
                _ => BenchmarkId::new(format!("{threads} threads"), mesh.node_count()),
            };
            group.bench_function(name, |b| {
                b.iter_custom(|repeats| {
                    let mut spent = Duration::ZERO;
                    for _ in 0..repeats {
                        cloth.reset(mesh.rest(), &zero).expect("its own shape");
                        spent += perform(motion, nodes, &mesh, &mut cloth);
                    }
                    spent
                });
            });
        }
        group.finish();
    }
}

criterion_group!(benches, rest, growth);
criterion_main!(benches);
