//! A step (six substeps) of the published scheme on the 23 x 28 sheet, one thread.

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

criterion_group!(benches, step);
criterion_main!(benches);
