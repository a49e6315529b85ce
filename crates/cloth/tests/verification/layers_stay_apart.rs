//! No edge ever goes through a face, by a test of its own.

use std::f64::consts::FRAC_PI_2;

use selvedge_cloth::{Material, Mesh, Settings, Simulator};
use selvedge_math::{ClothSimulator, DQuat, DVec3, Held};

use crate::scene::{FRAME, along, polyline, put, simulator, strain};

/// Faces and edges, with each quad cut along the diagonal that the solver cuts it along.
struct Surface {
    triangles: Vec<[usize; 3]>,
    edges: Vec<[usize; 2]>,
}

impl Surface {
    fn new(mesh: &Mesh) -> Self {
        let mut edges: Vec<[usize; 2]> =
            mesh.edges().iter().map(|e| e.map(|k| k as usize)).collect();
        let mut triangles = Vec::new();
        for quad in mesh.quads() {
            let [a, b, c, d] = quad.map(|k| k as usize);
            triangles.extend([[a, b, c], [a, c, d]]);
            edges.push([a, c]);
        }
        Self { triangles, edges }
    }

    /// An edge that goes through a triangle it shares no node with, if there is one.
    fn intersection(&self, x: &[DVec3]) -> Option<([usize; 2], [usize; 3])> {
        let bounds = |nodes: &[usize]| {
            let points = nodes.iter().map(|&k| x[k]);
            points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| {
                (low.min(p), high.max(p))
            })
        };
        // By their start along x, so that few triangles are looked at for an edge
        let mut triangles: Vec<_> = self.triangles.iter().map(|t| (bounds(t), t)).collect();
        triangles.sort_by(|a, b| a.0.0.x.total_cmp(&b.0.0.x));
        let widest = triangles
            .iter()
            .map(|((low, high), _)| high.x - low.x)
            .fold(0.0, f64::max);
        for edge in &self.edges {
            let (low, high) = bounds(edge);
            let first = triangles.partition_point(|((l, _), _)| l.x < low.x - widest);
            for ((l, h), triangle) in &triangles[first..] {
                if l.x > high.x {
                    break;
                }
                let near = l.cmple(high).all() && low.cmple(*h).all();
                let apart = edge.iter().all(|k| !triangle.contains(k));
                if near && apart && crosses(edge.map(|k| x[k]), triangle.map(|k| x[k])) {
                    return Some((*edge, **triangle));
                }
            }
        }
        None
    }
}

/// Whether a segment goes through a triangle: its ends are clearly on two sides of the plane, and the
/// line passes the three sides in one sense (signs of volumes).
fn crosses([p, q]: [DVec3; 2], [a, b, c]: [DVec3; 3]) -> bool {
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let heights = [normal.dot(p - a), normal.dot(q - a)];
    if heights[0].min(heights[1]) > -1e-9 || heights[0].max(heights[1]) < 1e-9 {
        return false;
    }
    let volume = |a: DVec3, b: DVec3| (q - p).cross(a - p).dot(b - p);
    let sides = [volume(a, b), volume(b, c), volume(c, a)];
    sides.iter().all(|s| *s > 0.0) || sides.iter().all(|s| *s < 0.0)
}

#[test]
fn the_test_knows_crossings() {
    let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let through = |x, y| [DVec3::new(x, y, -0.1), DVec3::new(x + 0.02, y, 0.2)];
    assert!(crosses(through(0.3, 0.3), triangle));
    assert!(!crosses(through(0.7, 0.7), triangle));
    assert!(!crosses(
        [DVec3::new(0.3, 0.3, 0.1), DVec3::new(0.3, 0.3, 0.2)],
        triangle
    ));
}

/// What happened in a run.
#[derive(Debug, Default)]
struct Worst {
    gap: f64,
    strain: f64,
    contacts: u32,
    below: f64,
    missed: u32,
}

/// Steps, with nothing held or what `hands` gives, looking for crossings after each.
fn watch(
    name: &str,
    mesh: &Mesh,
    cloth: &mut Simulator,
    steps: usize,
    mut hands: impl FnMut(usize) -> Option<(u32, DVec3, DVec3)>,
) -> Worst {
    let surface = Surface::new(mesh);
    assert_eq!(
        surface.intersection(cloth.positions()),
        None,
        "at the start"
    );
    let mut worst = Worst::default();
    for step in 0..steps {
        let hand = hands(step);
        let (nodes, targets, velocities) = match hand {
            Some((node, target, velocity)) => (vec![node], vec![target], vec![velocity]),
            None => Default::default(),
        };
        let held = Held {
            nodes: &nodes,
            targets: &targets,
            velocities: &velocities,
        };
        let report = cloth.step(held, FRAME).unwrap();
        let x = cloth.positions();
        assert_eq!(surface.intersection(x), None, "{name}: step {step}");
        worst.gap = worst.gap.min(report.gap.unwrap_or(0.0));
        worst.strain = worst.strain.max(strain(mesh, x));
        worst.contacts = worst.contacts.max(report.contacts);
        worst.below = worst.below.min(x.iter().map(|p| p.z).fold(0.0, f64::min));
        worst.missed += u32::from(report.status != Default::default());
    }
    println!("{name}: {worst:?}");
    worst
}

/// A corner swung over by a hand and thrown down onto the rest of the sheet: from rest to 5 m/s within
/// 0.2 m, and let go.
#[test]
fn a_corner_thrown_at_the_sheet_stays_above_it() {
    let mesh = Mesh::grid([14, 16], [0.26, 0.3]).unwrap();
    let material = Material::default();
    let mut cloth = simulator(&mesh, material, Settings::default());
    let corner = (14 * 16 - 1) as u32;
    let from = mesh.rest()[corner as usize];
    let mut last = from;
    let worst = watch("thrown corner", &mesh, &mut cloth, 120, |step| {
        let time = step as f64 + 1.0;
        let share = (time / 48.0).min(1.0);
        let angle = 1.9 * share * share * (3.0 - 2.0 * share);
        let over = from
            + DVec3::new(-0.7, -0.7, 0.0) * 0.13 * (1.0 - angle.cos())
            + DVec3::Z * (0.22 * angle.sin());
        let fallen = 0.5 * 62.5 * ((time - 52.0).max(0.0) * FRAME).powi(2);
        let target = over - DVec3::Z * fallen;
        let velocity = (target - last) / FRAME;
        last = target;
        (target.z > 0.0).then_some((corner, target, velocity))
    });
    assert!(
        worst.gap > -0.2 * material.thickness && worst.contacts > 20,
        "{worst:?}"
    );
    assert!(worst.strain < 1e-3 && worst.below > -1e-6, "{worst:?}");
}

/// A sheet that stands in waves on its edge, a little askew, and falls into a heap of layers.
fn heap() -> Worst {
    let mesh = Mesh::grid([22, 11], [0.42, 0.2]).unwrap();
    let mut cloth = simulator(&mesh, Material::default(), Settings::default());
    let angles = (0..21).map(|k| FRAC_PI_2 + 0.7 * (0.9 * f64::from(k)).sin());
    let askew = DQuat::from_rotation_x(0.15);
    let positions: Vec<DVec3> = along(&mesh, &polyline(0.02, angles))
        .iter()
        .map(|x| askew * *x + DVec3::Z * 0.03)
        .collect();
    put(&mut cloth, &positions);
    watch("heap", &mesh, &mut cloth, 150, |_| None)
}

/// A sheet that falls nearly upright on a corner, which makes small sharp folds.
fn on_its_corner() -> Worst {
    let mesh = Mesh::grid([14, 16], [0.26, 0.3]).unwrap();
    let mut cloth = simulator(&mesh, Material::default(), Settings::default());
    let turn = DQuat::from_rotation_x(1.35) * DQuat::from_rotation_z(0.3);
    let rest = mesh.rest().iter();
    let positions: Vec<DVec3> = rest.map(|p| turn * *p + DVec3::Z * 0.3).collect();
    let velocities = vec![DVec3::NEG_Z; positions.len()];
    cloth.reset(&positions, &velocities).unwrap();
    watch("on its corner", &mesh, &mut cloth, 150, |_| None)
}

#[test]
fn crumpling_sheets_do_not_cross_themselves() {
    for worst in [heap(), on_its_corner()] {
        assert!(worst.strain < 1e-3 && worst.below > -1e-6, "{worst:?}");
    }
}

/// Nothing is nearer than four fifths of the thickness, in impacts too.
#[test]
fn crumpling_sheets_keep_their_layers_apart() {
    for worst in [heap(), on_its_corner()] {
        assert!(
            worst.gap > -0.2 * Material::default().thickness,
            "{worst:?}"
        );
    }
}
