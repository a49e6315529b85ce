//! Scenes with a known answer: no gripper, one sheet, pins and forces.

mod list;

use selvedge_cloth::{Material, Mesh, Settings, Simulator};
use selvedge_math::{ClothSimulator, Command, DVec3, Held, Jaw, Pose};
use selvedge_view::{GripperState, Recording, Rest, Sheet};
use serde_json::json;

use crate::Error;

/// Time between two frames [s].
const FRAME: f64 = 1.0 / 60.0;

/// A sheet, how it starts and what acts on it, and what theory says of it.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Its name, also that of its file.
    pub name: &'static str,
    /// What happens, in one sentence.
    pub about: &'static str,
    /// The sheet at rest, a grid.
    pub mesh: Mesh,
    /// What it is made of.
    pub material: Material,
    /// Gravity, table and accuracy.
    pub settings: Settings,
    /// Positions at the start [m].
    pub positions: Vec<DVec3>,
    /// Velocities at the start [m/s].
    pub velocities: Vec<DVec3>,
    /// Nodes that stay where they start.
    pub pinned: Vec<u32>,
    /// Constant forces from outside [N].
    pub forces: Vec<DVec3>,
    /// How long it lasts, in frames of 1/60 s.
    pub steps: usize,
    /// What can be read from its recording.
    pub quantities: Vec<Quantity>,
}

/// A number that a recording has and, where there is a formula, theory too.
#[derive(Clone, Copy, Debug)]
pub struct Quantity {
    /// Its name, with the unit.
    pub name: &'static str,
    /// Where the reference is from.
    pub formula: &'static str,
    /// What theory says.
    pub reference: Option<f64>,
    measure: fn(&Scene, &Recording) -> f64,
}

impl Scene {
    /// All scenes.
    ///
    /// # Errors
    /// [`Error::Cloth`] when a mesh is refused.
    pub fn all() -> Result<Vec<Self>, Error> {
        list::all()
    }

    /// Simulates it and records every frame. The recording has one gripper, open and at the origin;
    /// its description has material, settings, pins and references.
    ///
    /// # Errors
    /// [`Error::Cloth`], [`Error::Simulator`] or [`Error::View`].
    pub fn run(&self) -> Result<Recording, Error> {
        let failed = |time| move |reason| Error::Simulator { time, reason };
        let mut cloth = Simulator::new(&self.mesh, self.material, self.settings)?;
        cloth
            .reset(&self.positions, &self.velocities)
            .map_err(failed(0.0))?;
        cloth.pin(&self.pinned)?;
        cloth.forces_mut().copy_from_slice(&self.forces);

        let mut recording = self.recording()?;
        let command = Command {
            pose: Pose::IDENTITY,
            jaw: Jaw::Open,
        };
        let gripper = [GripperState {
            command,
            alpha: 0.0,
        }];
        let grasped = vec![0; self.mesh.node_count()];
        recording.push(0.0, cloth.positions(), &gripper, &grasped)?;
        for step in 0..self.steps {
            let time = step as f64 * FRAME;
            cloth.step(Held::NONE, FRAME).map_err(failed(time))?;
            let time = (step + 1) as f64 * FRAME;
            recording.push(time, cloth.positions(), &gripper, &grasped)?;
        }
        Ok(recording)
    }

    fn recording(&self) -> Result<Recording, Error> {
        let grid = self.mesh.as_grid();
        let grid = grid.ok_or(selvedge_cloth::Error::NoGrid("a scene"))?;
        let sheet = Sheet {
            quads: self.mesh.quads().to_vec(),
            triangles: Vec::new(),
            rest: Rest::Grid {
                nodes: grid.nodes.map(|n| n as u32),
                sides: grid.sides,
            },
        };
        let references = self.quantities.iter().map(|quantity| {
            json!({
                "name": quantity.name,
                "formula": quantity.formula,
                "reference": quantity.reference,
            })
        });
        let meta = json!({
            "scene": self.name,
            "about": self.about,
            "solver": "default",
            "version": env!("CARGO_PKG_VERSION"),
            "dt": FRAME,
            "material": self.material,
            "settings": self.settings,
            "pinned": self.pinned,
            "force_n": self.forces.iter().sum::<DVec3>().to_array(),
            "quantities": references.collect::<Vec<_>>(),
        });
        Ok(Recording::new(sheet, 1, meta.to_string())?)
    }
}

impl Quantity {
    /// Its value in a recording of its scene.
    pub fn measured(&self, scene: &Scene, recording: &Recording) -> f64 {
        (self.measure)(scene, recording)
    }
}
