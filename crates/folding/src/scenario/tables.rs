//! The scenario file as it is written; every key is described in docs/SCENARIOS.md.

use selvedge_cloth::Material;
use serde::{Deserialize, Serialize};

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct File {
    pub(super) schema: u32,
    pub(super) cloth: ClothTable,
    #[serde(default)]
    pub(super) solver: SolverTable,
    pub(super) time: TimeTable,
    pub(super) path: PathTable,
    pub(super) squeeze: SqueezeTable,
    pub(super) case: Vec<CaseTable>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ClothTable {
    // A rectangle, or the mesh of a file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) sides_m: Option<[f64; 2]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) nodes: Option<[i64; 2]>,
    #[serde(skip_serializing)]
    pub(super) mesh: Option<String>,
    // A run depends on what is in the file, not on its name.
    #[serde(skip_deserializing, skip_serializing_if = "Option::is_none")]
    pub(super) mesh_sha256: Option<String>,
    pub(super) density_kg_per_m2: f64,
    pub(super) gravitational_density_kg_per_m2: f64,
    pub(super) damping_kg_per_m2_s: f64,
    pub(super) bending_n_m: f64,
    // The published scheme has neither: only the hash of the default solver adds them.
    #[serde(default = "shear", skip_serializing)]
    pub(super) shear_n_per_m: f64,
    #[serde(default = "internal_damping", skip_serializing)]
    pub(super) internal_damping_s: f64,
    pub(super) friction_table: f64,
    pub(super) friction_cloth: f64,
    pub(super) thickness_m: f64,
    pub(super) gravity_m_per_s2: f64,
}

fn shear() -> f64 {
    Material::default().shear
}

fn internal_damping() -> f64 {
    Material::default().internal_damping
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct SolverTable {
    pub(super) default: DefaultTable,
    pub(super) published: PublishedTable,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct DefaultTable {
    pub(super) substep_s: f64,
    pub(super) tolerance: f64,
    pub(super) settled_m: f64,
    pub(super) iterations: u32,
}

impl Default for DefaultTable {
    fn default() -> Self {
        let selvedge_cloth::Settings {
            substep,
            tolerance,
            settled,
            iterations,
            ..
        } = selvedge_cloth::Settings::default();
        Self {
            substep_s: substep,
            tolerance,
            settled_m: settled,
            iterations,
        }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct PublishedTable {
    pub(super) substeps: u32,
    pub(super) tolerance: f64,
    pub(super) compliance_stretch: f64,
    pub(super) compliance_shear: f64,
    pub(super) compliance_contact: f64,
    pub(super) thickness_factor: f64,
    pub(super) move_limit: f64,
}

impl Default for PublishedTable {
    fn default() -> Self {
        let selvedge_published::Settings {
            substeps,
            tolerance,
            compliance_stretch,
            compliance_shear,
            compliance_contact,
            thickness_factor,
            move_limit,
            gravity: _,
        } = selvedge_published::Settings::default();
        Self {
            substeps,
            tolerance,
            compliance_stretch,
            compliance_shear,
            compliance_contact,
            thickness_factor,
            move_limit,
        }
    }
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TimeTable {
    pub(super) frame_s: f64,
    pub(super) close_s: f64,
    pub(super) move_s: f64,
    pub(super) open_s: f64,
    pub(super) end_s: f64,
    pub(super) law: LawKey,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum LawKey {
    Linear,
    Cubic,
    Quintic,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PathTable {
    pub(super) mid_m: [f64; 3],
    pub(super) end_m: [f64; 3],
    pub(super) keep_x: bool,
    pub(super) orientation: OrientationKey,
}

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum OrientationKey {
    Slerp,
    Nlerp,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SqueezeTable {
    pub(super) amount: f64,
    pub(super) lift_m: f64,
    pub(super) steps: u32,
}

/// A case has either the keys of one gripper or a list of grippers.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CaseTable {
    pub(super) name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) reference: Option<String>,
    pub(super) volume: Option<VolumeTable>,
    pub(super) tip_offset_m: Option<[f64; 3]>,
    pub(super) tip_convention: Option<TipConvention>,
    pub(super) start_node: Option<i64>,
    pub(super) start_offset_m: Option<[f64; 3]>,
    pub(super) start_xyzw: Option<[f64; 4]>,
    pub(super) end_xyzw: Option<[f64; 4]>,
    #[serde(default)]
    pub(super) gripper: Vec<GripperTable>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GripperTable {
    pub(super) volume: VolumeTable,
    pub(super) tip_offset_m: [f64; 3],
    #[serde(default)]
    pub(super) tip_convention: TipConvention,
    pub(super) start_node: i64,
    pub(super) start_offset_m: [f64; 3],
    pub(super) start_xyzw: [f64; 4],
    pub(super) end_xyzw: [f64; 4],
    pub(super) mid_m: Option<[f64; 3]>,
    pub(super) end_m: Option<[f64; 3]>,
}

#[derive(Clone, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum VolumeTable {
    Box { size_m: [f64; 3] },
    Pyramid { side_m: f64, height_m: f64 },
}

/// How the tip's path becomes that of the gripper frame: `g = p - R c`, or `g = p - c` as in the
/// published runs.
#[derive(Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum TipConvention {
    #[default]
    Rigid,
    Published,
}
