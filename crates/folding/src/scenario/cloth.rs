//! The cloth and the settings of its solvers, each value checked.

use std::path::Path;

use selvedge_cloth::{Material, Mesh};

use super::check::Check;
use super::hash::sha256;
use super::tables::{ClothTable, DefaultTable, PublishedTable, TimeTable};
use crate::Error;

/// A side of a sheet [m]: larger ones are another unit.
const MAX_LENGTH: f64 = 100.0;
/// Substeps of a step.
const MAX_SUBSTEPS: f64 = 1e4;
/// Iterations of a substep.
const MAX_ITERATIONS: u32 = 10_000;

/// Recordings hold every node at every step.
const MAX_NODES: i64 = 100_000;

impl ClothTable {
    /// The cloth at rest: a rectangle, or the mesh of a file, whose hash is kept.
    pub(super) fn mesh(&mut self, check: &Check<'_>) -> Result<Mesh, Error> {
        match (&self.mesh, self.sides_m, self.nodes) {
            (None, Some(sides), Some(nodes)) => rectangle(sides, nodes, check),
            (Some(name), None, None) => {
                let (mesh, hash) = file(name, check)?;
                self.mesh_sha256 = Some(hash);
                Ok(mesh)
            }
            (Some(name), ..) => {
                let bound = "alone: sides_m and nodes are those of a sheet without a file";
                Err(check.value("cloth.mesh", format!("{name:?}"), bound))
            }
            (None, sides, _) => {
                let missing = if sides.is_none() { "sides_m" } else { "nodes" };
                let bound = "given, or mesh in place of sides_m and nodes";
                Err(check.value(format!("cloth.{missing}"), "missing", bound))
            }
        }
    }

    pub(super) fn material(&self, check: &Check<'_>) -> Result<Material, Error> {
        check.above("cloth.density_kg_per_m2", self.density_kg_per_m2, 0.0, 1e3)?;
        let delta = self.gravitational_density_kg_per_m2;
        check.above("cloth.gravitational_density_kg_per_m2", delta, 0.0, 1e3)?;
        check.within(
            "cloth.damping_kg_per_m2_s",
            self.damping_kg_per_m2_s,
            0.0,
            1e6,
        )?;
        check.within("cloth.bending_n_m", self.bending_n_m, 0.0, 1e3)?;
        check.within("cloth.shear_n_per_m", self.shear_n_per_m, 0.0, 1e6)?;
        let internal_damping = self.internal_damping_s;
        check.within("cloth.internal_damping_s", internal_damping, 0.0, 1.0)?;
        check.within("cloth.friction_table", self.friction_table, 0.0, 1e3)?;
        check.within("cloth.friction_cloth", self.friction_cloth, 0.0, 1e3)?;
        check.above("cloth.thickness_m", self.thickness_m, 0.0, 1.0)?;
        check.within("cloth.gravity_m_per_s2", self.gravity_m_per_s2, 0.0, 1e3)?;
        Ok(Material {
            density: self.density_kg_per_m2,
            gravitational_density: delta,
            damping: self.damping_kg_per_m2_s,
            bending: self.bending_n_m,
            shear: self.shear_n_per_m,
            internal_damping,
            friction_table: self.friction_table,
            friction_cloth: self.friction_cloth,
            thickness: self.thickness_m,
        })
    }
}

fn rectangle(sides: [f64; 2], nodes: [i64; 2], check: &Check<'_>) -> Result<Mesh, Error> {
    for side in sides {
        check.above("cloth.sides_m", side, 0.0, MAX_LENGTH)?;
    }
    let [na, nb] = nodes;
    if na < 2 || nb < 2 || na.saturating_mul(nb) > MAX_NODES {
        let bound = format!("at least 2 each and at most {MAX_NODES} in all");
        return Err(check.value("cloth.nodes", format!("[{na}, {nb}]"), bound));
    }
    let mesh = Mesh::grid(nodes.map(|n| n as usize), sides);
    mesh.map_err(|error| check.value("cloth.nodes", format!("[{na}, {nb}]"), error.to_string()))
}

/// The mesh of a Wavefront OBJ file, named from the scenario's folder, and the file's hash.
fn file(name: &str, check: &Check<'_>) -> Result<(Mesh, String), Error> {
    let refused = |bound: String| check.value("cloth.mesh", format!("{name:?}"), bound);
    let folder = Path::new(check.file).parent().unwrap_or(Path::new(""));
    let path = folder.join(name);
    let text = std::fs::read_to_string(&path).map_err(|error| {
        refused(format!(
            "an OBJ file that can be read ({}: {error})",
            path.display()
        ))
    })?;
    let mesh = Mesh::parse_obj(&text, &path.display().to_string())
        .map_err(|error| refused(format!("a mesh of faces with 3 or 4 corners ({error})")))?;
    if mesh.node_count() as i64 > MAX_NODES {
        let bound = format!(
            "at most {MAX_NODES} nodes ({} has {})",
            path.display(),
            mesh.node_count()
        );
        return Err(refused(bound));
    }
    for (node, p) in mesh.rest().iter().enumerate() {
        if p.z < 0.0 || p.abs().max_element() > MAX_LENGTH {
            let [x, y, z] = p.to_array();
            return Err(refused(format!(
                "of nodes above the table z = 0 and within {MAX_LENGTH} m (node {node} of {} is at {x} {y} {z})",
                path.display()
            )));
        }
    }
    let hash = sha256(text.as_bytes());
    Ok((mesh, hash))
}

impl PublishedTable {
    pub(super) fn settings(
        &self,
        gravity: f64,
        check: &Check<'_>,
    ) -> Result<selvedge_published::Settings, Error> {
        let settings = selvedge_published::Settings {
            substeps: self.substeps,
            tolerance: self.tolerance,
            compliance_stretch: self.compliance_stretch,
            compliance_shear: self.compliance_shear,
            compliance_contact: self.compliance_contact,
            thickness_factor: self.thickness_factor,
            move_limit: self.move_limit,
            gravity,
        };
        settings.check().map_err(|error| Error::Syntax {
            file: check.file.to_owned(),
            message: format!("solver.published: {error}"),
        })?;
        Ok(settings)
    }
}

impl DefaultTable {
    pub(super) fn settings(
        &self,
        gravity: f64,
        time: &TimeTable,
        check: &Check<'_>,
    ) -> Result<selvedge_cloth::Settings, Error> {
        let substep = self.substep_s;
        check.above("solver.default.substep_s", substep, 0.0, 1.0)?;
        if time.frame_s / substep > MAX_SUBSTEPS {
            let bound = format!(
                "at least frame_s / {MAX_SUBSTEPS} ({} s)",
                time.frame_s / MAX_SUBSTEPS
            );
            return Err(check.value("solver.default.substep_s", substep, bound));
        }
        check.above("solver.default.tolerance", self.tolerance, 0.0, 1.0)?;
        check.above("solver.default.settled_m", self.settled_m, 0.0, 1.0)?;
        if !(1..=MAX_ITERATIONS).contains(&self.iterations) {
            let bound = format!("from 1 to {MAX_ITERATIONS}");
            return Err(check.value("solver.default.iterations", self.iterations, bound));
        }
        Ok(selvedge_cloth::Settings {
            substep,
            tolerance: self.tolerance,
            settled: self.settled_m,
            iterations: self.iterations,
            gravity,
            ..Default::default()
        })
    }
}
