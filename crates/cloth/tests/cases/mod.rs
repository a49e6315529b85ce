//! Random projections for the tests: sheets that lie flat or hang in an arc, moved at random.

use selvedge_cloth::Mesh;
use selvedge_math::DVec3;

/// A projection with its data.
pub(crate) struct Case {
    pub(crate) name: String,
    pub(crate) mesh: Mesh,
    pub(crate) masses: Vec<f64>,
    pub(crate) predicted: Vec<DVec3>,
    pub(crate) grasp: Vec<(u32, DVec3)>,
    pub(crate) shear_compliance: Option<f64>,
    pub(crate) table: Option<f64>,
}

impl Case {
    pub(crate) fn projection(&self) -> selvedge_cloth::Projection<'_> {
        selvedge_cloth::Projection {
            mesh: &self.mesh,
            masses: &self.masses,
            predicted: &self.predicted,
            grasp: &self.grasp,
            shear_compliance: self.shear_compliance,
            table: self.table,
        }
    }
}

/// Numbers in -1..1, the same in every run (Knuth's MMIX generator).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    pub(crate) fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}

/// Area shares of the nodes of a grid.
pub(crate) fn masses(mesh: &Mesh) -> Vec<f64> {
    let mut masses = vec![0.0; mesh.node_count()];
    for quad in mesh.quads() {
        let [a, b, _, d] = quad.map(|node| mesh.rest()[node as usize]);
        for &node in quad {
            masses[node as usize] += a.distance(b) * a.distance(d) / 4.0;
        }
    }
    masses
}

/// A sheet bent about the y axis by `turn` [rad] a cell, every edge as long as at rest, with its
/// lowest node on the table.
pub(crate) fn arc([na, nb]: [usize; 2], [dx, dy]: [f64; 2], turn: f64) -> Vec<DVec3> {
    let (mut x, mut z, mut angle) = (0.0, 0.0, -turn * (na - 2) as f64 / 2.0);
    let mut line = vec![(x, z)];
    for _ in 1..na {
        x += dx * f64::cos(angle);
        z += dx * f64::sin(angle);
        angle += turn;
        line.push((x, z));
    }
    let low = line.iter().map(|l| l.1).fold(f64::INFINITY, f64::min);
    let nodes = (0..nb).flat_map(|j| line.iter().map(move |&(x, z)| (j, x, z)));
    nodes
        .map(|(j, x, z)| DVec3::new(x, j as f64 * dy, z - low))
        .collect()
}

/// Sheets of cells of 2 cm, moved by up to 5 mm: every combination of shear, table and grasp.
pub(crate) fn cases(nodes: [usize; 2], seed: u64) -> Vec<Case> {
    let mut random = Random(seed);
    let cell = [0.019, 0.022];
    let sides = [0, 1].map(|axis| cell[axis] * (nodes[axis] - 1) as f64);
    let mesh = Mesh::grid(nodes, sides).unwrap();
    let mut cases = Vec::new();
    for (turn, motion) in [(0.0, 1e-3), (0.3, 1e-3), (0.3, 5e-3), (0.0, 5e-3)] {
        for shear_compliance in [None, Some(64.8), Some(0.1), Some(0.0)] {
            for (table, grasped) in [(false, false), (false, true), (true, false), (true, true)] {
                let start = arc(nodes, cell, turn);
                let predicted: Vec<DVec3> = start
                    .iter()
                    .map(|&x| x + motion * random.vector())
                    .collect();
                let corner = mesh.node_count() - 1;
                let mut grasp = Vec::new();
                if grasped {
                    let lift = 0.5 * motion * (random.vector() + 3.0 * DVec3::Z);
                    grasp.extend([corner - 1, corner].map(|k| (k as u32, start[k] + lift)));
                }
                let name = format!(
                    "{nodes:?} turn {turn} motion {motion} shear {shear_compliance:?} table {table} grasp {grasped}"
                );
                cases.push(Case {
                    name,
                    mesh: mesh.clone(),
                    masses: masses(&mesh),
                    predicted,
                    grasp,
                    shear_compliance,
                    table: table.then_some(0.0),
                });
            }
        }
    }
    cases
}
