//! From the tables of a file to a scenario, each value checked on the way.

use selvedge_cloth::Mesh;
use selvedge_grasp::{GraspVolume, Gripper, Shape, Squeeze};
use selvedge_math::DVec3;
use selvedge_trajectory::{FoldTimes, Law, Orientation, QuadBezier, Schedule, Sweep};
use selvedge_view::MAX_BYTES;

use super::check::Check;
use super::tables::{
    CaseTable, File, GripperTable, LawKey, OrientationKey, PathTable, SqueezeTable, TimeTable,
    TipConvention, VolumeTable,
};
use super::{Case, Commands, GripperPlan, ROUNDED, Scenario};
use crate::Error;

/// Steps of one run.
const MAX_STEPS: f64 = 1e6;
/// Grippers of one case; a recording numbers them in a byte.
const MAX_GRIPPERS: usize = 255;
/// A side of a volume or a tip offset [m]: larger ones are another unit.
const MAX_TOOL: f64 = 1.0;

/// What the arrays of a recording hold, up to a few rows.
fn recording_bytes(steps: usize, nodes: usize, grippers: usize) -> u64 {
    let row = 8 + nodes as u64 * (3 * 8 + 1) + grippers as u64 * (9 * 8 + 1);
    (steps as u64 + 1)
        .saturating_mul(row)
        .saturating_add(nodes as u64 * 16)
}

impl File {
    pub(super) fn check(mut self, name: &str, check: &Check<'_>) -> Result<Scenario, Error> {
        if self.schema != 1 {
            return Err(check.value("schema", self.schema, "1"));
        }
        let mesh = self.cloth.mesh(check)?;
        let material = self.cloth.material(check)?;
        let gravity = self.cloth.gravity_m_per_s2;
        let published = self.solver.published.settings(gravity, check)?;
        let steps = self.time.steps(check)?;
        let default = self.solver.default.settings(gravity, &self.time, check)?;
        self.path.check(check)?;
        self.squeeze.check(check)?;
        if self.case.is_empty() {
            return Err(check.value("case", "[]", "at least one case"));
        }
        let mut cases = Vec::with_capacity(self.case.len());
        for case in &self.case {
            if self
                .case
                .iter()
                .filter(|other| other.name == case.name)
                .count()
                > 1
            {
                return Err(check.value("case.name", &case.name, "the name of one case only"));
            }
            cases.push(self.case(case, &mesh, steps, check)?);
        }
        Ok(Scenario {
            name: name.to_owned(),
            mesh,
            material,
            published,
            default,
            frame: self.time.frame_s,
            times: self.time.times(),
            steps,
            cases,
        })
    }

    fn case(
        &self,
        case: &CaseTable,
        mesh: &Mesh,
        steps: usize,
        check: &Check<'_>,
    ) -> Result<Case, Error> {
        let name = &case.name;
        let plain = |c: char| c.is_ascii_alphanumeric() || "-_".contains(c);
        if name.is_empty() || name.len() > 64 || !name.chars().all(plain) {
            let bound = "1 to 64 letters, digits, - or _ (it names files)";
            return Err(check.value("case.name", format!("{name:?}"), bound));
        }
        if let Some(reference) = &case.reference
            && !self.case.iter().any(|other| other.name == *reference)
        {
            return Err(check.value(
                format!("case {name}: reference"),
                reference,
                "a case's name",
            ));
        }
        let tables = case.grippers(check)?;
        if tables.len() > MAX_GRIPPERS {
            let bound = format!("at most {MAX_GRIPPERS} grippers");
            return Err(check.value(format!("case {name}: gripper"), tables.len(), bound));
        }
        let bytes = recording_bytes(steps, mesh.node_count(), tables.len());
        if bytes > MAX_BYTES {
            let steps_and_nodes = format!("{steps} steps of {} nodes", mesh.node_count());
            let bound = format!("at most {MAX_BYTES} bytes in a recording (these are {bytes})");
            return Err(check.value(format!("case {name}"), steps_and_nodes, bound));
        }
        let several = tables.len() > 1;
        let mut grippers = Vec::with_capacity(tables.len());
        for (number, table) in tables.iter().enumerate() {
            let place = match several {
                true => format!("case {name}, gripper {}", number + 1),
                false => format!("case {name}"),
            };
            grippers.push(self.plan(table, mesh, &place, check)?);
        }
        let unwritable = |error: serde_json::Error| Error::Syntax {
            file: check.file.to_owned(),
            message: format!("case {name}: {error}"),
        };
        Ok(Case {
            name: name.clone(),
            grippers,
            reference: case.reference.clone(),
            published_hash: self.published_hash(case).map_err(unwritable)?,
            default_hash: self.default_hash(case).map_err(unwritable)?,
        })
    }

    fn plan(
        &self,
        table: &GripperTable,
        mesh: &Mesh,
        place: &str,
        check: &Check<'_>,
    ) -> Result<GripperPlan, Error> {
        let key = |key: &str| format!("{place}: {key}");
        let tip_offset = check.point(&key("tip_offset_m"), table.tip_offset_m)?;
        let offset = check.point(&key("start_offset_m"), table.start_offset_m)?;
        let from = check.rotation(&key("start_xyzw"), table.start_xyzw)?;
        let to = check.rotation(&key("end_xyzw"), table.end_xyzw)?;
        let Some(&node) = usize::try_from(table.start_node)
            .ok()
            .and_then(|node| mesh.rest().get(node))
        else {
            let bound = format!("from 0 and below the node count {}", mesh.node_count());
            return Err(check.value(key("start_node"), table.start_node, bound));
        };
        let start = node + offset;
        let mut mid = check.point(&key("mid_m"), table.mid_m.unwrap_or(self.path.mid_m))?;
        let mut end = check.point(&key("end_m"), table.end_m.unwrap_or(self.path.end_m))?;
        if self.path.keep_x {
            (mid.x, end.x) = (start.x, start.x);
        }
        // An inextensible sheet follows a corner at most so far without being dragged.
        let reach = mesh.diagonal();
        for (name, point) in [("start_offset_m", start), ("mid_m", mid), ("end_m", end)] {
            let distance = mesh
                .rest()
                .iter()
                .map(|p| p.distance(point))
                .fold(f64::INFINITY, f64::min);
            if distance > reach {
                let bound = format!(
                    "within the sheet's diagonal, {reach:.4} m, of a node (it is {distance:.4} m \
                     from the nearest; lengths are in metres)"
                );
                return Err(check.value(key(name), point, bound));
            }
        }
        let (shape, size_key) = match table.volume {
            VolumeTable::Box { size_m } => (
                Shape::Box {
                    size: size_m.into(),
                },
                "volume.size_m",
            ),
            VolumeTable::Pyramid { side_m, height_m } => (
                Shape::Pyramid {
                    side: side_m,
                    height: height_m,
                },
                "volume",
            ),
        };
        let tool = |name: &str, sizes: &[f64]| match sizes.iter().find(|size| size.abs() > MAX_TOOL)
        {
            Some(size) => {
                let bound = format!("at most {MAX_TOOL} m (lengths are in metres)");
                Err(check.value(key(name), size, bound))
            }
            None => Ok(()),
        };
        tool("tip_offset_m", &table.tip_offset_m)?;
        match table.volume {
            VolumeTable::Box { size_m } => tool("volume.size_m", &size_m)?,
            VolumeTable::Pyramid { side_m, height_m } => {
                tool("volume.side_m", &[side_m])?;
                tool("volume.height_m", &[height_m])?;
            }
        }
        let refused = |error: selvedge_grasp::Error| Error::Syntax {
            file: check.file.to_owned(),
            message: format!("{}: {error}", key(size_key)),
        };
        let volume = GraspVolume::new(shape, tip_offset).map_err(refused)?;
        let squeeze = Squeeze {
            amount: self.squeeze.amount,
            lift: self.squeeze.lift_m,
            steps: self.squeeze.steps,
        };
        let gripper = Gripper::new(volume, squeeze).map_err(refused)?;
        let (shift, tip) = match table.tip_convention {
            TipConvention::Rigid => (DVec3::ZERO, tip_offset),
            TipConvention::Published => (tip_offset, DVec3::ZERO),
        };
        let path = QuadBezier {
            start: start - shift,
            mid: mid - shift,
            end: end - shift,
        };
        let orientation = match self.path.orientation {
            OrientationKey::Slerp => Orientation::Slerp,
            OrientationKey::Nlerp => Orientation::Nlerp,
        };
        let sweep = Sweep::new(path, from, to, orientation, tip)?;
        let law = match self.time.law {
            LawKey::Linear => Law::Linear,
            LawKey::Cubic => Law::Cubic,
            LawKey::Quintic => Law::Quintic,
        };
        Ok(GripperPlan {
            gripper,
            rotation: sweep.angle(),
            commands: Commands::Schedule(Schedule::fold(sweep, law, self.time.times())?),
            tip_offset,
        })
    }
}

impl TimeTable {
    fn times(&self) -> FoldTimes {
        FoldTimes {
            close: self.close_s,
            start: self.move_s,
            open: self.open_s,
            end: self.end_s,
        }
    }

    fn steps(&self, check: &Check<'_>) -> Result<usize, Error> {
        let Self {
            frame_s,
            close_s,
            move_s,
            open_s,
            end_s,
            ..
        } = *self;
        check.above("time.frame_s", frame_s, 0.0, 1.0)?;
        let ordered = [
            ("time.close_s", close_s, 0.0, "0, the start"),
            ("time.move_s", move_s, close_s, "close_s"),
            ("time.open_s", open_s, move_s, "move_s"),
            ("time.end_s", end_s, open_s, "open_s"),
        ];
        for (key, value, low, name) in ordered {
            if !(value >= low && value.is_finite()) {
                let bound = format!("finite and not before {name} ({low} s)");
                return Err(check.value(key, value, bound));
            }
        }
        if open_s == move_s {
            let bound = format!("after move_s ({move_s} s): the gripper needs time to move");
            return Err(check.value("time.open_s", open_s, bound));
        }
        let steps = end_s / frame_s;
        if steps > MAX_STEPS {
            let bound = format!("at most {MAX_STEPS} steps of frame_s");
            return Err(check.value("time.end_s", end_s, bound));
        }
        let first_closed = (close_s / frame_s - ROUNDED).ceil();
        if first_closed * frame_s > open_s - ROUNDED * frame_s {
            let bound = format!(
                "at most one frame_s ({frame_s} s) before open_s ({open_s} s), so that the jaws \
                 are closed in at least one step"
            );
            return Err(check.value("time.close_s", close_s, bound));
        }
        Ok((steps + ROUNDED).floor() as usize + 1)
    }
}

impl PathTable {
    fn check(&self, check: &Check<'_>) -> Result<(), Error> {
        check.point("path.mid_m", self.mid_m)?;
        check.point("path.end_m", self.end_m)?;
        Ok(())
    }
}

impl SqueezeTable {
    fn check(&self, check: &Check<'_>) -> Result<(), Error> {
        check.within("squeeze.amount", self.amount, 0.0, 1.0)?;
        check.within("squeeze.lift_m", self.lift_m, 0.0, 1.0)?;
        if self.steps == 0 {
            return Err(check.value("squeeze.steps", 0, "at least 1"));
        }
        Ok(())
    }
}

impl CaseTable {
    /// The grippers of the case, whichever way they are written.
    fn grippers(&self, check: &Check<'_>) -> Result<Vec<GripperTable>, Error> {
        let place = format!("case {}", self.name);
        let own_keys = [
            ("volume", self.volume.is_some()),
            ("tip_offset_m", self.tip_offset_m.is_some()),
            ("start_node", self.start_node.is_some()),
            ("start_offset_m", self.start_offset_m.is_some()),
            ("start_xyzw", self.start_xyzw.is_some()),
            ("end_xyzw", self.end_xyzw.is_some()),
        ];
        if !self.gripper.is_empty() {
            let tip = ("tip_convention", self.tip_convention.is_some());
            if let Some((key, _)) = own_keys.iter().chain([&tip]).find(|(_, given)| *given) {
                let bound = "given in each [[case.gripper]], or the case has no [[case.gripper]]";
                return Err(check.value(format!("{place}: {key}"), "given twice", bound));
            }
            return Ok(self.gripper.iter().map(GripperTable::copied).collect());
        }
        match (
            &self.volume,
            self.tip_offset_m,
            self.start_node,
            self.start_offset_m,
            self.start_xyzw,
            self.end_xyzw,
        ) {
            (
                Some(volume),
                Some(tip_offset_m),
                Some(start_node),
                Some(start_offset_m),
                Some(start_xyzw),
                Some(end_xyzw),
            ) => Ok(vec![GripperTable {
                volume: volume.clone(),
                tip_offset_m,
                tip_convention: self.tip_convention.unwrap_or_default(),
                start_node,
                start_offset_m,
                start_xyzw,
                end_xyzw,
                mid_m: None,
                end_m: None,
            }]),
            _ => {
                let missing: Vec<&str> = own_keys
                    .iter()
                    .filter(|(_, given)| !given)
                    .map(|(key, _)| *key)
                    .collect();
                Err(check.value(place, format!("without {}", missing.join(", ")), "complete"))
            }
        }
    }
}

impl GripperTable {
    fn copied(&self) -> Self {
        Self {
            volume: self.volume.clone(),
            ..*self
        }
    }
}
