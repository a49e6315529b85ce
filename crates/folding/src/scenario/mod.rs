//! The scenario file, checked once on load.

mod build;
mod check;
mod cloth;
mod commands;
mod hash;
mod tables;

use std::path::Path;

use selvedge_cloth::{Material, Mesh};
use selvedge_grasp::{Gripper, Shape};
use selvedge_math::DVec3;
use selvedge_trajectory::FoldTimes;
use serde_json::json;

use crate::{Error, Solver};

pub use commands::Commands;

/// A time is on a border when it is so near, in steps.
const ROUNDED: f64 = 1e-6;

/// A folding experiment: one cloth, one timeline, several cases.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// The name of the file without its ending.
    pub name: String,
    /// The cloth at rest.
    pub mesh: Mesh,
    /// What it is made of.
    pub material: Material,
    /// Settings of the published scheme, gravity included.
    pub published: selvedge_published::Settings,
    /// Settings of the default solver, gravity included.
    pub default: selvedge_cloth::Settings,
    /// Period of the commands [s].
    pub frame: f64,
    /// When the jaws close, the grippers move, the jaws open, and all ends [s].
    pub times: FoldTimes,
    /// Number of steps: one for each command from `t = 0` to the end, both included.
    pub steps: usize,
    /// The cases, in the order of the file.
    pub cases: Vec<Case>,
}

/// One way to grasp and fold.
#[derive(Clone, Debug)]
pub struct Case {
    /// Its name, also that of its files.
    pub name: String,
    /// The grippers that take part.
    pub grippers: Vec<GripperPlan>,
    /// The case whose end is the ideal fold; none for the analytic half fold.
    pub reference: Option<String>,
    published_hash: String,
    default_hash: String,
}

impl Case {
    /// SHA-256 over everything in the file that this case depends on when it runs on the solver,
    /// in hexadecimal.
    pub fn input_hash(&self, solver: Solver) -> &str {
        match solver {
            Solver::Published => &self.published_hash,
            Solver::Default => &self.default_hash,
        }
    }

    /// The grasping volumes as a recording describes them, for those who draw them: a list in JSON with
    /// an entry a gripper.
    pub fn volumes_json(&self) -> String {
        self.volumes().to_string()
    }

    pub(crate) fn volumes(&self) -> serde_json::Value {
        let entry = |plan: &GripperPlan| {
            let volume = plan.gripper.volume();
            let mut fields = match volume.shape() {
                Shape::Box { size } => json!({"type": "box", "size_m": size.to_array()}),
                Shape::Pyramid { side, height } => {
                    json!({"type": "pyramid", "side_m": side, "height_m": height})
                }
            };
            fields["tip_offset_m"] = json!(volume.offset().to_array());
            fields
        };
        self.grippers.iter().map(entry).collect()
    }
}

/// What one gripper does.
#[derive(Clone, Debug)]
pub struct GripperPlan {
    /// The gripper, open.
    pub gripper: Gripper,
    /// Its commands over time.
    pub commands: Commands,
    /// Where the tip is in the gripper frame [m].
    pub tip_offset: DVec3,
    /// How far the gripper turns on its way [rad].
    pub rotation: f64,
}

impl Scenario {
    /// Reads and checks a scenario file.
    ///
    /// # Errors
    /// [`Error::File`], [`Error::Syntax`] or [`Error::Value`], each naming the file and the key.
    pub fn load(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let text = std::fs::read_to_string(path).map_err(|reason| Error::File {
            path: path.to_owned(),
            reason,
        })?;
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        Self::parse(&text, &stem, &path.display().to_string())
    }

    /// Checks the text of a scenario; `file` is what errors call it.
    ///
    /// # Errors
    /// As [`Scenario::load`].
    pub fn parse(text: &str, name: &str, file: &str) -> Result<Self, Error> {
        let raw: tables::File = toml::from_str(text).map_err(|error| Error::Syntax {
            file: file.to_owned(),
            message: error.to_string().trim_end().replace('\n', "\n  "),
        })?;
        raw.check(name, &check::Check { file })
    }

    /// The time of a step [s], `k` times the period.
    ///
    /// A step whose time is that of [`Scenario::times`] but for rounding is exactly there: the
    /// jaws close in step 60 of 1/60 s when `close_s` is 1, in step 11 of 0.03 s when it is 0.33.
    pub fn time(&self, step: usize) -> f64 {
        let rate = (1.0 / self.frame).round();
        let time = if (1.0 / self.frame - rate).abs() < 1e-9 * rate {
            step as f64 / rate
        } else {
            step as f64 * self.frame
        };
        let FoldTimes {
            close,
            start,
            open,
            end,
        } = self.times;
        let near = |border: &f64| (time - border).abs() < ROUNDED * self.frame;
        [close, start, open, end]
            .into_iter()
            .find(near)
            .unwrap_or(time)
    }

    /// The case of that name.
    pub fn case(&self, name: &str) -> Option<&Case> {
        self.cases.iter().find(|case| case.name == name)
    }
}
