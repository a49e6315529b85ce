//! What the tests share: sheets along a curve, strips, and running them.

use selvedge_cloth::{Material, Mesh, Settings, Simulator};
use selvedge_math::{ClothSimulator, DVec3, Held, Status, StepReport};

/// Period of the commands [s].
pub(crate) const FRAME: f64 = 1.0 / 60.0;

/// Nothing but the cloth: no table, and no drag.
pub(crate) fn air() -> Settings {
    Settings {
        table: false,
        ..Settings::default()
    }
}

/// The default cloth without drag.
pub(crate) fn without_drag() -> Material {
    Material {
        damping: 0.0,
        ..Material::default()
    }
}

/// Acceleration of a cloth that falls freely, `delta g / rho` [m/s^2].
pub(crate) fn fall(material: &Material, settings: &Settings) -> f64 {
    material.gravitational_density * settings.gravity / material.density
}

pub(crate) fn simulator(mesh: &Mesh, material: Material, settings: Settings) -> Simulator {
    Simulator::new(mesh, material, settings).unwrap()
}

/// Puts the cloth somewhere, at rest.
pub(crate) fn put(cloth: &mut Simulator, positions: &[DVec3]) {
    let still = vec![DVec3::ZERO; positions.len()];
    cloth.reset(positions, &still).unwrap();
}

/// Steps of `dt` for `time` [s], with nothing held.
pub(crate) fn run(
    cloth: &mut Simulator,
    dt: f64,
    time: f64,
    mut see: impl FnMut(&Simulator, &StepReport),
) {
    for _ in 0..(time / dt).round() as usize {
        let report = cloth.step(Held::NONE, dt).unwrap();
        assert_eq!(report.status, Status::Converged, "{report:?}");
        see(cloth, &report);
    }
}

/// The grid's nodes of column `i`.
pub(crate) fn column(mesh: &Mesh, i: usize) -> Vec<u32> {
    let [na, nb] = mesh.as_grid().unwrap().nodes;
    (0..nb).map(|j| (j * na + i) as u32).collect()
}

/// Area of each node of a grid [m^2].
pub(crate) fn areas(mesh: &Mesh) -> Vec<f64> {
    let grid = mesh.as_grid().unwrap();
    let ([na, nb], [dx, dy]) = (grid.nodes, grid.spacing());
    let share = |k: usize, n: usize| if k == 0 || k + 1 == n { 0.5 } else { 1.0 };
    (0..na * nb)
        .map(|k| share(k % na, na) * dx * share(k / na, nb) * dy)
        .collect()
}

/// Points of a line of edges of the length `side`, from the origin, each edge rising at its own
/// angle [rad] in the x-z plane.
pub(crate) fn polyline(side: f64, angles: impl Iterator<Item = f64>) -> Vec<DVec3> {
    let mut points = vec![DVec3::ZERO];
    for angle in angles {
        let last = points[points.len() - 1];
        points.push(last + side * DVec3::new(angle.cos(), 0.0, angle.sin()));
    }
    points
}

/// Positions of a grid whose columns lie on the points of a line in the x-z plane.
pub(crate) fn along(mesh: &Mesh, points: &[DVec3]) -> Vec<DVec3> {
    let na = mesh.as_grid().unwrap().nodes[0];
    let rest = mesh.rest().iter().enumerate();
    rest.map(|(k, p)| points[k % na] + DVec3::Y * p.y).collect()
}

/// Largest edge strain.
pub(crate) fn strain(mesh: &Mesh, x: &[DVec3]) -> f64 {
    let length = |x: &[DVec3], &[p, q]: &[u32; 2]| x[p as usize].distance(x[q as usize]);
    let edges = mesh.edges().iter();
    edges
        .map(|e| (length(x, e) / length(mesh.rest(), e) - 1.0).abs())
        .fold(0.0, f64::max)
}

/// Fastest node [m/s].
pub(crate) fn speed(cloth: &Simulator) -> f64 {
    let speeds = cloth.velocities().iter().map(|v| v.length());
    speeds.fold(0.0, f64::max)
}

/// `|a/b - 1|`.
pub(crate) fn off(a: f64, b: f64) -> f64 {
    (a / b - 1.0).abs()
}
