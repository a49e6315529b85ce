//! A step (six substeps) and a whole fold of the published scheme on the 23 x 28 sheet, one thread.

use criterion::{Criterion, criterion_group, criterion_main};
use selvedge_cloth::{Material, Mesh};
use selvedge_math::{ClothSimulator, DVec3, Held};
use selvedge_published::{Settings, Simulator};

fn step(c: &mut Criterion) {
    let mesh = Mesh::grid([23, 28], [0.42, 0.59]).expect("a valid grid");
    let mut group = c.benchmark_group("published");
    for (name, height) in [("flat", 0.0), ("lifted", 0.15)] {
        let mut cloth = Simulator::new(&mesh, Material::default(), Settings::default())
            .expect("valid settings");
        // The far corner is lifted slowly, then kept there.
        let corner = [619, 620, 642, 643];
        let rest = corner.map(|k: u32| mesh.rest()[k as usize]);
        let mut held_step = |z: f64| {
            let targets = rest.map(|p| p + DVec3::Z * z);
            let held = Held {
                nodes: &corner,
                targets: &targets,
                velocities: &[DVec3::ZERO; 4],
            };
            cloth
                .step(held, 1.0 / 60.0)
                .expect("the cloth keeps its shape")
        };
        for frame in 0..180 {
            held_step(height * (f64::from(frame) / 120.0).min(1.0));
        }
        group.bench_function(name, |b| b.iter(|| held_step(height)));
    }
    group.finish();
}

/// 400 steps: the corner is carried along an arch to the other end in three seconds, then let go.
fn fold(c: &mut Criterion) {
    let mesh = Mesh::grid([23, 28], [0.42, 0.59]).expect("a valid grid");
    let fresh = Simulator::new(&mesh, Material::default(), Settings::default());
    let mut cloth = fresh.expect("valid settings");
    let corner = [619, 620, 642, 643];
    let rest = corner.map(|k: u32| mesh.rest()[k as usize]);
    let mut group = c.benchmark_group("published");
    group.sample_size(10);
    group.bench_function("fold", |b| {
        b.iter(|| {
            let still = vec![DVec3::ZERO; mesh.node_count()];
            cloth
                .reset(mesh.rest(), &still)
                .expect("a state of the mesh");
            for frame in 0..400 {
                let w = f64::from(frame) / 180.0;
                let s = w * w * w * (10.0 - 15.0 * w + 6.0 * w * w);
                let way = DVec3::new(0.0, -0.59 * s, 0.36 * s * (1.0 - s) + 0.04 * s * s);
                let targets = rest.map(|p| p + way);
                let velocities = &[DVec3::ZERO; 4];
                let held = Held {
                    nodes: &corner,
                    targets: &targets,
                    velocities,
                };
                let held = if w <= 1.0 { held } else { Held::NONE };
                cloth
                    .step(held, 1.0 / 60.0)
                    .expect("the cloth keeps its shape");
            }
        });
    });
    group.finish();
}

criterion_group!(benches, step, fold);
criterion_main!(benches);
