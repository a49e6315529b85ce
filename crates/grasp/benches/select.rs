//! How long does it take to find the support when the jaws close?

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use selvedge_grasp::{DVec3, GraspVolume, Pose, Shape, Support, select};

#[path = "../tests/grid/mod.rs"]
mod grid;

fn benches(criterion: &mut Criterion) {
    let pinch = Shape::Box {
        size: DVec3::splat(0.03),
    };
    let point = Shape::Pyramid {
        side: 0.03,
        height: -0.015,
    };
    // The cloth of the paper, and one of 1e5 nodes with cells of the same size.
    let paper = grid::flat([23, 28], [0.42, 0.59]);
    let large = grid::flat([316, 317], [6.01, 6.9]);
    for (name, shape, grid) in [
        ("select/box/644", pinch, &paper),
        ("select/pyramid/644", point, &paper),
        ("select/box/1e5", pinch, &large),
    ] {
        let volume = GraspVolume::new(shape, DVec3::ZERO).expect("sizes are valid");
        let cloth = grid.view();
        // At the last corner.
        let pose = Pose::from_translation(grid.positions[grid.positions.len() - 1]);
        let mut support = Support::default();
        criterion.bench_function(name, |bencher| {
            bencher.iter(|| select(&volume, black_box(&pose), black_box(cloth), &mut support));
        });
        assert!(!support.nodes().is_empty());
    }
}

criterion_group!(group, benches);
criterion_main!(group);
