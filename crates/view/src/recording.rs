//! What happened in a run, frame by frame.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use selvedge_math::{Command, DQuat, DVec3, Jaw, Pose};

use crate::error::AnyError;
use crate::npz::{NpzReader, NpzWriter};
use crate::sheet::{Rest, Sheet};
use crate::{Error, write_whole};

/// How far the length of a quaternion in a file may be from 1.
const MAX_LENGTH_ERROR: f64 = 1e-6;
/// Up to here it is taken as it stands, as [`Pose::from_unit`] does; beyond it is normalised.
const UNIT: f64 = 1e-9;

/// Bytes of the description, far more than one needs.
const MAX_META: usize = 1 << 24;

/// One gripper in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GripperState {
    /// Pose `T_wg` and jaw.
    pub command: Command,
    /// How much of the squeeze is done, `alpha` from 0 to 1.
    pub alpha: f64,
}

/// A run: cloth and grippers, frame by frame, with a description in JSON.
///
/// Frame `k` is the state after `k` steps, with the gripper states used in step `k`; frame 0 is the
/// start. Values are checked as they come in, so a recording can be written and read back at any
/// time.
///
/// ```
/// use selvedge_math::{Command, DVec3, Jaw, Pose};
/// use selvedge_view::{GripperState, Recording, Rest, Sheet};
///
/// let rest = Rest::Grid { nodes: [2, 2], sides: [0.1, 0.1] };
/// let sheet = Sheet { quads: vec![[0, 1, 3, 2]], triangles: vec![], rest };
/// let mut run = Recording::new(sheet, 1, r#"{"dt": 0.5}"#.into())?;
/// let command = Command { pose: Pose::IDENTITY, jaw: Jaw::Closed };
/// for k in 0..3 {
///     let z = DVec3::Z * f64::from(k);
///     let positions = [z, z + DVec3::X, z + DVec3::Y, z + DVec3::X + DVec3::Y];
///     let gripper = GripperState { command, alpha: 1.0 };
///     run.push(0.5 * f64::from(k), &positions, &[gripper], &[1, 0, 0, 0])?;
/// }
/// assert_eq!(run.positions(2)[1], DVec3::new(1.0, 0.0, 2.0));
/// # let folder = tempfile::tempdir()?;
/// # let path = folder.path().join("run.npz");
/// run.write(&path)?;
/// assert_eq!(Recording::read(&path)?, run);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    sheet: Sheet,
    node_count: usize,
    gripper_count: usize,
    meta: String,
    /// One a frame.
    times: Vec<f64>,
    /// `node_count` a frame.
    positions: Vec<DVec3>,
    /// `gripper_count` a frame.
    grippers: Vec<GripperState>,
    /// `node_count` a frame.
    grasped: Vec<u8>,
}

impl Recording {
    /// A recording without frames, for `gripper_count` grippers (255 at most) and with the JSON
    /// object `meta` as its description.
    ///
    /// # Errors
    /// [`Error::Value`] when there is no face, a face names a node that is not there, the shape at
    /// rest is empty or not finite, or `meta` is no JSON object or longer than 16 MiB.
    pub fn new(sheet: Sheet, gripper_count: usize, meta: String) -> Result<Self, Error> {
        let node_count = sheet.check()?;
        if gripper_count > usize::from(u8::MAX) {
            let value = format!("{gripper_count} grippers");
            return Err(Error::value("jaw", value, "255 at most"));
        }
        check_meta(&meta)?;
        Ok(Self {
            sheet,
            node_count,
            gripper_count,
            meta,
            times: Vec::new(),
            positions: Vec::new(),
            grippers: Vec::new(),
            grasped: Vec::new(),
        })
    }

    /// Adds a frame: its time [s], the node positions [m, world], the gripper states, and for each
    /// node the number of the gripper that holds it, counted from 1, or 0.
    ///
    /// # Errors
    /// [`Error::Value`], and nothing is added, when a value is not finite, `time` is not after that
    /// of the frame before, `alpha` is outside `[0, 1]`, or a node is held by a gripper that is
    /// open or not there.
    ///
    /// # Panics
    /// When a slice has not one entry a node or a gripper.
    pub fn push(
        &mut self,
        time: f64,
        positions: &[DVec3],
        grippers: &[GripperState],
        grasped: &[u8],
    ) -> Result<(), Error> {
        assert_eq!(positions.len(), self.node_count, "one position a node");
        assert_eq!(grippers.len(), self.gripper_count, "one state a gripper");
        assert_eq!(grasped.len(), self.node_count, "one number a node");
        let previous = self.times.last().copied();
        check_frame(
            self.times.len(),
            previous,
            time,
            positions,
            grippers,
            grasped,
        )?;
        self.times.push(time);
        self.positions.extend_from_slice(positions);
        self.grippers.extend_from_slice(grippers);
        self.grasped.extend_from_slice(grasped);
        Ok(())
    }

    /// The number of frames.
    pub fn frame_count(&self) -> usize {
        self.times.len()
    }

    /// The number of nodes.
    pub fn node_count(&self) -> usize {
        self.node_count
    }

    /// The number of grippers.
    pub fn gripper_count(&self) -> usize {
        self.gripper_count
    }

    /// Faces and shape at rest.
    pub fn sheet(&self) -> &Sheet {
        &self.sheet
    }

    /// The description, a JSON object.
    pub fn meta(&self) -> &str {
        &self.meta
    }

    /// Gives another description, a JSON object.
    ///
    /// # Errors
    /// [`Error::Value`], and the old one stays, when `meta` is no JSON object or longer than 16 MiB.
    pub fn set_meta(&mut self, meta: String) -> Result<(), Error> {
        check_meta(&meta)?;
        self.meta = meta;
        Ok(())
    }

    /// A field of the description.
    pub(crate) fn meta_field(&self, name: &str) -> Option<serde_json::Value> {
        let mut fields: serde_json::Map<_, _> = serde_json::from_str(&self.meta).ok()?;
        fields.remove(name)
    }

    /// The times [s], one a frame.
    pub fn times(&self) -> &[f64] {
        &self.times
    }

    /// The node positions of a frame [m, world].
    ///
    /// # Panics
    /// When there is no such frame, as for [`grippers`](Self::grippers) and
    /// [`grasped`](Self::grasped).
    pub fn positions(&self, frame: usize) -> &[DVec3] {
        self.assert_frame(frame);
        &self.positions[frame * self.node_count..][..self.node_count]
    }

    /// The gripper states of a frame.
    pub fn grippers(&self, frame: usize) -> &[GripperState] {
        self.assert_frame(frame);
        &self.grippers[frame * self.gripper_count..][..self.gripper_count]
    }

    /// For each node the number of the gripper that holds it in a frame, counted from 1, or 0.
    pub fn grasped(&self, frame: usize) -> &[u8] {
        self.assert_frame(frame);
        &self.grasped[frame * self.node_count..][..self.node_count]
    }

    fn assert_frame(&self, frame: usize) {
        let count = self.times.len();
        assert!(
            frame < count,
            "frame {frame} must be below the frame count {count}"
        );
    }

    /// Writes the recording to a file that appears whole, see [`write_whole`]. The same recording
    /// gives the same bytes.
    ///
    /// # Errors
    /// [`Error::Write`] names the file, also when there is no frame or the arrays have more than
    /// 4 GB.
    pub fn write(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        write_whole(path, |writer| {
            let mut npz = NpzWriter::new(writer);
            self.write_arrays(&mut npz)?;
            npz.finish()?;
            Ok(())
        })
    }

    fn write_arrays<W: std::io::Write + std::io::Seek>(
        &self,
        npz: &mut NpzWriter<W>,
    ) -> Result<(), AnyError> {
        let (frames, nodes) = (self.frame_count(), self.node_count);
        if frames == 0 {
            return Err(no_frame().into());
        }
        npz.array("t", &[frames], self.times.iter().copied())?;
        npz.array(
            "positions",
            &[frames, nodes, 3],
            coordinates(&self.positions),
        )?;
        let Sheet {
            quads,
            triangles,
            rest,
        } = &self.sheet;
        if !quads.is_empty() {
            npz.array("quads", &[quads.len(), 4], quads.iter().flatten().copied())?;
        }
        if !triangles.is_empty() {
            let indices = triangles.iter().flatten().copied();
            npz.array("triangles", &[triangles.len(), 3], indices)?;
        }
        match rest {
            Rest::Grid { nodes, sides } => {
                npz.array("grid", &[2], *nodes)?;
                npz.array("sides", &[2], *sides)?;
            }
            Rest::Positions(rest) => npz.array("rest", &[nodes, 3], coordinates(rest))?,
        }
        let lead = match self.gripper_count {
            1 => vec![frames],
            count => vec![frames, count],
        };
        let commands = || self.grippers.iter().map(|gripper| gripper.command);
        let jaws = commands().map(|command| u8::from(command.jaw.is_closed()));
        npz.array("jaw", &lead, jaws)?;
        let poses = commands().flat_map(|command| {
            let (p, q) = (command.pose.position(), command.pose.rotation());
            [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
        });
        npz.array("pose", &[&lead[..], &[7]].concat(), poses)?;
        npz.array("grasped", &[frames, nodes], self.grasped.iter().copied())?;
        npz.array(
            "alpha",
            &lead,
            self.grippers.iter().map(|gripper| gripper.alpha),
        )?;
        npz.array("meta", &[self.meta.len()], self.meta.bytes())
    }

    /// Reads a recording. A quaternion whose length is 1 to 1e-9 is taken as it stands, one that is
    /// off by up to 1e-6 is normalised. Arrays of other names are passed over.
    ///
    /// # Errors
    /// [`Error::Read`] names file, array, value and bound: for a file that is no zip archive, cut
    /// short or damaged, for an array that is missing or whose type or shape is not the documented
    /// one, for values that [`new`](Self::new) or [`push`](Self::push) refuse, and for arrays of
    /// more than 4 GB.
    pub fn read(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let read = || -> Result<Self, AnyError> {
            let mut npz = NpzReader::new(BufReader::new(File::open(path)?))?;
            Ok(Self::read_arrays(&mut npz)?)
        };
        read().map_err(|reason| Error::Read {
            path: path.to_owned(),
            reason,
        })
    }

    fn read_arrays<R: std::io::Read + std::io::Seek>(
        npz: &mut NpzReader<R>,
    ) -> Result<Self, Error> {
        // What stays the same.
        let meta = npz.shape("meta")?;
        let meta = npz.array::<u8>("meta", &[first(&meta)])?;
        let meta = String::from_utf8(meta)
            .map_err(|error| Error::value("meta", error.to_string(), "UTF-8"))?;
        let quads = faces(npz, "quads")?;
        let triangles = faces(npz, "triangles")?;
        let rest = match (npz.has("grid"), npz.has("sides"), npz.has("rest")) {
            (true, true, false) => {
                let (nodes, sides) = (npz.array("grid", &[2])?, npz.array("sides", &[2])?);
                Rest::Grid {
                    nodes: [nodes[0], nodes[1]],
                    sides: [sides[0], sides[1]],
                }
            }
            (false, false, true) => {
                let count = first(&npz.shape("rest")?);
                Rest::Positions(points(npz, "rest", &[count, 3])?)
            }
            (grid, sides, rest) => {
                let value = format!("grid {grid}, sides {sides}, rest {rest}");
                let bound = "in the file without grid and sides, or these two without it";
                return Err(Error::value("rest", value, bound));
            }
        };
        let jaw = npz.shape("jaw")?;
        let gripper_count = match jaw[..] {
            [_] => 1,
            [_, count] => count,
            _ => {
                return Err(Error::value(
                    "jaw",
                    format!("shape is {jaw:?}"),
                    "(T) or (T, G)",
                ));
            }
        };
        let sheet = Sheet {
            quads,
            triangles,
            rest,
        };
        let mut recording = Self::new(sheet, gripper_count, meta)?;

        // The frames.
        let frames = first(&npz.shape("t")?);
        let nodes = recording.node_count;
        let lead = &[frames, gripper_count][..jaw.len()];
        recording.times = npz.array("t", &[frames])?;
        recording.positions = points(npz, "positions", &[frames, nodes, 3])?;
        recording.grasped = npz.array("grasped", &[frames, nodes])?;
        let jaws = npz.array::<u8>("jaw", lead)?;
        let poses = npz.array::<f64>("pose", &[lead, &[7]].concat())?;
        let alphas = npz.array::<f64>("alpha", lead)?;
        for (k, &jaw) in jaws.iter().enumerate() {
            let frame = k / gripper_count;
            let jaw = match jaw {
                0 => Jaw::Open,
                1 => Jaw::Closed,
                other => {
                    let value = format!("frame {frame} is {other}");
                    return Err(Error::value("jaw", value, "0 or 1"));
                }
            };
            let pose = pose(&poses[7 * k..][..7]).ok_or_else(|| {
                let value = format!("frame {frame} is {:?}", &poses[7 * k..][..7]);
                Error::value("pose", value, "finite, its quaternion of length 1 to 1e-6")
            })?;
            recording.grippers.push(GripperState {
                command: Command { pose, jaw },
                alpha: alphas[k],
            });
        }
        if frames == 0 {
            return Err(no_frame());
        }
        for (k, &time) in recording.times.iter().enumerate() {
            let previous = k.checked_sub(1).map(|k| recording.times[k]);
            let (positions, grasped) = (recording.positions(k), recording.grasped(k));
            check_frame(k, previous, time, positions, recording.grippers(k), grasped)?;
        }
        Ok(recording)
    }
}

/// A JSON object that is not too long.
fn check_meta(meta: &str) -> Result<(), Error> {
    if meta.len() > MAX_META {
        let value = format!("{} bytes", meta.len());
        return Err(Error::value(
            "meta",
            value,
            format!("{MAX_META} bytes at most"),
        ));
    }
    if let Err(error) = serde_json::from_str::<serde_json::Map<String, serde_json::Value>>(meta) {
        return Err(Error::value("meta", error.to_string(), "a JSON object"));
    }
    Ok(())
}

fn check_frame(
    frame: usize,
    previous: Option<f64>,
    time: f64,
    positions: &[DVec3],
    grippers: &[GripperState],
    grasped: &[u8],
) -> Result<(), Error> {
    let refuse = |array, value: String, bound: &str| {
        Err(Error::value(array, format!("frame {frame}{value}"), bound))
    };
    if !time.is_finite() {
        return refuse("t", format!(" is {time} s"), "finite");
    }
    if let Some(previous) = previous.filter(|&previous| time <= previous) {
        let value = format!(" is {time} s after {previous} s");
        return refuse("t", value, "larger than the one before");
    }
    if let Some(node) = positions.iter().position(|p| !p.is_finite()) {
        let value = format!(", node {node} is {} m", positions[node]);
        return refuse("positions", value, "finite");
    }
    for (k, GripperState { command, alpha }) in grippers.iter().enumerate() {
        if !(0.0..=1.0).contains(alpha) {
            let value = format!(", gripper {} is {alpha}", k + 1);
            return refuse("alpha", value, "in [0, 1]");
        }
        let (p, q) = (command.pose.position(), command.pose.rotation());
        if !(p.is_finite() && q.is_finite()) {
            let value = format!(", gripper {} is {p} m, {q}", k + 1);
            return refuse("pose", value, "finite");
        }
    }
    for (node, &holder) in grasped.iter().enumerate() {
        let Some(k) = usize::from(holder).checked_sub(1) else {
            continue;
        };
        let closed = |gripper: &GripperState| gripper.command.jaw.is_closed();
        if !grippers.get(k).is_some_and(closed) {
            let value = format!(", node {node} is {holder}");
            return refuse("grasped", value, "0 or the number of a closed gripper");
        }
    }
    Ok(())
}

fn coordinates(points: &[DVec3]) -> impl Iterator<Item = f64> {
    points.iter().flat_map(DVec3::to_array)
}

fn no_frame() -> Error {
    Error::value("t", "no frame", "one frame at least")
}

/// The first entry of a shape; the rest is compared when the array is read.
fn first(shape: &[usize]) -> usize {
    shape.first().copied().unwrap_or(0)
}

fn faces<const N: usize, R: std::io::Read + std::io::Seek>(
    npz: &mut NpzReader<R>,
    name: &'static str,
) -> Result<Vec<[u32; N]>, Error> {
    if !npz.has(name) {
        return Ok(Vec::new());
    }
    let count = first(&npz.shape(name)?);
    let indices = npz.array::<u32>(name, &[count, N])?;
    let faces = indices.chunks_exact(N);
    Ok(faces.map(|face| std::array::from_fn(|k| face[k])).collect())
}

fn points<R: std::io::Read + std::io::Seek>(
    npz: &mut NpzReader<R>,
    name: &'static str,
    shape: &[usize],
) -> Result<Vec<DVec3>, Error> {
    let coordinates = npz.array::<f64>(name, shape)?;
    Ok(coordinates.chunks_exact(3).map(DVec3::from_slice).collect())
}

/// A pose from seven numbers, unless its quaternion is too far from unit length.
fn pose(x: &[f64]) -> Option<Pose> {
    let (position, rotation) = (DVec3::from_slice(x), DQuat::from_slice(&x[3..]));
    let off = (rotation.length() - 1.0).abs();
    if !position.is_finite() {
        None
    } else if off <= UNIT {
        Some(Pose::from_unit(position, rotation))
    } else if off <= MAX_LENGTH_ERROR {
        Pose::new(position, rotation).ok()
    } else {
        None
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::fs;
    use std::io::Cursor;

    use super::*;

    const META: &str = r#"{"case": "C4 ✓", "dt": 0.5}"#;

    fn grid() -> Sheet {
        Sheet {
            quads: vec![[0, 1, 4, 3], [1, 2, 5, 4]],
            triangles: vec![],
            rest: Rest::Grid {
                nodes: [3, 2],
                sides: [0.42, 0.59],
            },
        }
    }

    fn state(k: usize, g: usize) -> GripperState {
        let angle = 0.3 * (k + 7 * g) as f64;
        let position = DVec3::new(0.1 * k as f64, g as f64, -0.0);
        let pose = Pose::new(position, DQuat::from_rotation_y(angle)).unwrap();
        let jaw = if k == 2 { Jaw::Closed } else { Jaw::Open };
        GripperState {
            command: Command { pose, jaw },
            alpha: 0.1 * k as f64,
        }
    }

    /// Four frames; in the third the grippers hold a node each.
    fn recording(sheet: Sheet, gripper_count: usize) -> Recording {
        let mut run = Recording::new(sheet, gripper_count, META.into()).unwrap();
        let nodes = run.node_count();
        for k in 0..4 {
            let point = |i| DVec3::new(0.1 * i as f64, k as f64 / 3.0, 1e-3 * (i * k) as f64);
            let positions: Vec<DVec3> = (0..nodes).map(point).collect();
            let states: Vec<GripperState> = (0..gripper_count).map(|g| state(k, g)).collect();
            let mut grasped = vec![0; nodes];
            if k == 2 {
                (0..gripper_count).for_each(|g| grasped[g] = g as u8 + 1);
            }
            run.push(k as f64 / 60.0, &positions, &states, &grasped)
                .unwrap();
        }
        run
    }

    fn read_bytes(bytes: Vec<u8>) -> Result<Recording, String> {
        let mut npz = NpzReader::new(Cursor::new(bytes)).map_err(|error| error.to_string())?;
        Recording::read_arrays(&mut npz).map_err(|error| error.to_string())
    }

    type Put = Box<dyn Fn(&'static str, &mut NpzWriter<Cursor<Vec<u8>>>)>;

    fn put<T: crate::npz::Element + 'static>(shape: &[usize], values: Vec<T>) -> Put {
        let shape = shape.to_vec();
        Box::new(move |name, npz| npz.array(name, &shape, values.clone()).unwrap())
    }

    /// A file of two frames, three nodes and one triangle, with some arrays changed or left out.
    fn file(changes: Vec<(&'static str, Option<Put>)>) -> Result<Recording, String> {
        let poses = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0].repeat(2);
        let mut arrays: BTreeMap<&'static str, Put> = BTreeMap::from([
            ("t", put(&[2], vec![0.0, 1.0])),
            ("positions", put(&[2, 3, 3], vec![0.0; 18])),
            ("triangles", put(&[1, 3], vec![0_u32, 1, 2])),
            ("rest", put(&[3, 3], vec![0.5; 9])),
            ("jaw", put(&[2], vec![0_u8, 1])),
            ("pose", put(&[2, 7], poses)),
            ("grasped", put(&[2, 3], vec![0_u8, 0, 0, 1, 0, 0])),
            ("alpha", put(&[2], vec![0.0, 1.0])),
            ("meta", put(&[2], b"{}".to_vec())),
        ]);
        for (name, change) in changes {
            match change {
                Some(change) => arrays.insert(name, change),
                None => arrays.remove(name),
            };
        }
        let mut npz = NpzWriter::new(Cursor::new(Vec::new()));
        for (name, put) in arrays {
            put(name, &mut npz);
        }
        read_bytes(npz.finish().unwrap().into_inner())
    }

    #[test]
    fn what_is_written_reads_back_and_writes_the_same_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let rest = (0..5).map(|k| DVec3::splat(f64::from(k))).collect();
        let mixed = Sheet {
            quads: vec![[0, 1, 2, 3]],
            triangles: vec![[2, 3, 4]],
            rest: Rest::Positions(rest),
        };
        for (sheet, grippers) in [(grid(), 1), (grid(), 0), (mixed, 3)] {
            let run = recording(sheet, grippers);
            let (one, two) = (folder.path().join("one.npz"), folder.path().join("two.npz"));
            run.write(&one).unwrap();
            let back = Recording::read(&one).unwrap();
            assert_eq!(back, run);
            back.write(&two).unwrap();
            assert_eq!(fs::read(&one).unwrap(), fs::read(&two).unwrap());
            assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
        }
    }

    #[test]
    fn frames_are_where_they_were_put() {
        let run = recording(grid(), 2);
        assert_eq!(run.frame_count(), 4);
        assert_eq!((run.node_count(), run.gripper_count()), (6, 2));
        assert_eq!(run.times()[3], 0.05);
        assert_eq!(run.positions(3)[5], DVec3::new(0.5, 1.0, 0.015));
        assert_eq!(run.grippers(2)[1], state(2, 1));
        assert_eq!(run.grasped(2), [1, 2, 0, 0, 0, 0]);
        assert_eq!(run.sheet(), &grid());
        assert_eq!(run.meta(), META);
    }

    #[test]
    fn bad_sheets_are_named() {
        let refused = |sheet, meta: &str| {
            let error = Recording::new(sheet, 1, meta.into()).unwrap_err();
            error.to_string()
        };
        let with = |change: fn(&mut Sheet)| {
            let mut sheet = grid();
            change(&mut sheet);
            refused(sheet, "{}")
        };
        let with_grid = |nodes, sides| {
            let rest = Rest::Grid { nodes, sides };
            refused(Sheet { rest, ..grid() }, "{}")
        };
        assert_eq!(
            with(|sheet| sheet.quads[1][2] = 6),
            "quads: face 1 has node 6, must be below the node count 6"
        );
        assert_eq!(
            with(|sheet| sheet.triangles.push([0, 1, 9])),
            "triangles: face 0 has node 9, must be below the node count 6"
        );
        assert_eq!(
            with(|sheet| sheet.quads.clear()),
            "quads: no face, and none in triangles, must be one face at least"
        );
        assert_eq!(
            with_grid([1 << 16, 1 << 16], [1.0; 2]),
            "grid: 65536 by 65536, must be of 1 to 2^32 - 1 nodes"
        );
        assert_eq!(
            with_grid([3, 2], [1.0, 0.0]),
            "sides: [1.0, 0.0] m, must be positive and finite"
        );
        assert_eq!(
            with(|sheet| sheet.rest = Rest::Positions(vec![])),
            "rest: 0 nodes, must be 1 to 2^32 - 1"
        );
        assert_eq!(
            with(|sheet| sheet.rest = Rest::Positions(vec![DVec3::X, DVec3::NAN])),
            "rest: node 1 is [NaN, NaN, NaN] m, must be finite"
        );
        for meta in ["", "[1]", "{\"a\": }", "{} {}"] {
            let error = refused(grid(), meta);
            assert!(error.starts_with("meta: "), "{error}");
            assert!(error.ends_with("must be a JSON object"), "{error}");
        }
        assert_eq!(
            refused(grid(), &" ".repeat(MAX_META + 1)),
            "meta: 16777217 bytes, must be 16777216 bytes at most"
        );
        let error = Recording::new(grid(), 256, "{}".into()).unwrap_err();
        assert_eq!(error.to_string(), "jaw: 256 grippers, must be 255 at most");
    }

    #[test]
    fn bad_frames_are_named_and_not_added() {
        let good = recording(grid(), 2);
        let points = [DVec3::ZERO; 6];
        let states = [state(2, 0), state(1, 1)];
        let mut bad_point = points;
        bad_point[4].y = f64::INFINITY;
        let mut bad_alpha = states;
        bad_alpha[1].alpha = 1.5;
        let mut bad_pose = states;
        bad_pose[1].command.pose = Pose::from_translation(DVec3::NAN);
        for (time, points, states, holder, message) in [
            (
                f64::NAN,
                points,
                states,
                0,
                "t: frame 4 is NaN s, must be finite",
            ),
            (
                0.05,
                points,
                states,
                0,
                "t: frame 4 is 0.05 s after 0.05 s, must be larger than the one before",
            ),
            (
                1.0,
                bad_point,
                states,
                0,
                "positions: frame 4, node 4 is [0, inf, 0] m, must be finite",
            ),
            (
                1.0,
                points,
                bad_alpha,
                0,
                "alpha: frame 4, gripper 2 is 1.5, must be in [0, 1]",
            ),
            (
                1.0,
                points,
                bad_pose,
                0,
                "pose: frame 4, gripper 2 is [NaN, NaN, NaN] m, [0, 0, 0, 1], must be finite",
            ),
            (
                1.0,
                points,
                states,
                2,
                "grasped: frame 4, node 3 is 2, must be 0 or the number of a closed gripper",
            ),
            (
                1.0,
                points,
                states,
                3,
                "grasped: frame 4, node 3 is 3, must be 0 or the number of a closed gripper",
            ),
        ] {
            let mut run = good.clone();
            let error = run.push(time, &points, &states, &[0, 0, 0, holder, 0, 0]);
            assert_eq!(error.unwrap_err().to_string(), message);
            assert_eq!(run, good);
        }
    }

    #[test]
    #[should_panic(expected = "one position a node")]
    fn a_wrong_length_is_a_mistake_of_the_caller() {
        let states = [state(0, 0)];
        let mut run = recording(grid(), 1);
        run.push(1.0, &[DVec3::ZERO; 5], &states, &[0; 6]).ok();
    }

    #[test]
    fn bad_files_are_named() {
        assert_eq!(file(vec![]).unwrap().frame_count(), 2);
        let required = [
            "t",
            "positions",
            "rest",
            "jaw",
            "pose",
            "grasped",
            "alpha",
            "meta",
        ];
        for name in required {
            let error = file(vec![(name, None)]).unwrap_err();
            assert!(error.starts_with(&format!("{name}: ")), "{error}");
        }
        let pose = |k: usize, x: f64| {
            let mut poses = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0].repeat(2);
            poses[7 + k] = x;
            put(&[2, 7], poses)
        };
        for (name, change, message) in [
            (
                "t",
                put(&[3], vec![0.0, 1.0, 2.0]),
                "positions: shape is (2, 3, 3), must be (3, 3, 3)",
            ),
            (
                "t",
                put(&[2], vec![0.0, f64::NAN]),
                "t: frame 1 is NaN s, must be finite",
            ),
            (
                "t",
                put(&[2], vec![1.0, 1.0]),
                "t: frame 1 is 1 s after 1 s, must be larger than the one before",
            ),
            (
                "t",
                put(&[2], vec![0_u32, 1]),
                "t: dtype is <u4, must be <f8",
            ),
            (
                "t",
                put(&[2, 1], vec![0.0, 1.0]),
                "t: shape is (2, 1), must be (2,)",
            ),
            (
                "positions",
                put(&[2, 3], vec![0.0; 6]),
                "positions: shape is (2, 3), must be (2, 3, 3)",
            ),
            (
                "positions",
                put(&[2, 3, 3], vec![f64::INFINITY; 18]),
                "positions: frame 0, node 0 is [inf, inf, inf] m, must be finite",
            ),
            (
                "triangles",
                put(&[1, 3], vec![0_u32, 1, 3]),
                "triangles: face 0 has node 3, must be below the node count 3",
            ),
            (
                "triangles",
                put(&[1, 4], vec![0_u32; 4]),
                "triangles: shape is (1, 4), must be (1, 3)",
            ),
            (
                "triangles",
                put(&[0, 3], vec![0_u32; 0]),
                "quads: no face, and none in triangles, must be one face at least",
            ),
            (
                "quads",
                put(&[1, 4], vec![9_u32; 4]),
                "quads: face 0 has node 9, must be below the node count 3",
            ),
            (
                "grid",
                put(&[2], vec![3_u32, 1]),
                "rest: grid true, sides false, rest true, must be in the file without grid and \
                 sides, or these two without it",
            ),
            (
                "rest",
                put(&[2, 3], vec![0.0; 6]),
                "triangles: face 0 has node 2, must be below the node count 2",
            ),
            (
                "jaw",
                put(&[2], vec![0_u8, 2]),
                "jaw: frame 1 is 2, must be 0 or 1",
            ),
            (
                "jaw",
                put(&[2], vec![0.0, 1.0]),
                "jaw: dtype is <f8, must be |u1",
            ),
            (
                "jaw",
                put(&[2, 2], vec![0_u8; 4]),
                "pose: shape is (2, 7), must be (2, 2, 7)",
            ),
            (
                "jaw",
                put(&[2, 1, 1], vec![0_u8; 2]),
                "jaw: shape is [2, 1, 1], must be (T) or (T, G)",
            ),
            (
                "pose",
                pose(6, 1.1),
                "pose: frame 1 is [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.1], must be finite, its \
                 quaternion of length 1 to 1e-6",
            ),
            (
                "pose",
                pose(0, f64::NAN),
                "pose: frame 1 is [NaN, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], must be finite, its \
                 quaternion of length 1 to 1e-6",
            ),
            (
                "grasped",
                put(&[2, 3], vec![0_u8, 1, 0, 0, 0, 0]),
                "grasped: frame 0, node 1 is 1, must be 0 or the number of a closed gripper",
            ),
            (
                "grasped",
                put(&[2, 3], vec![0_u8, 0, 0, 2, 0, 0]),
                "grasped: frame 1, node 0 is 2, must be 0 or the number of a closed gripper",
            ),
            (
                "alpha",
                put(&[2], vec![0.0, -0.5]),
                "alpha: frame 1, gripper 1 is -0.5, must be in [0, 1]",
            ),
            (
                "alpha",
                put(&[1], vec![0.0]),
                "alpha: shape is (1,), must be (2,)",
            ),
            (
                "meta",
                put(&[1], vec![0xff_u8]),
                "meta: invalid utf-8 sequence of 1 bytes from index 0, must be UTF-8",
            ),
            (
                "meta",
                put(&[2], b"[]".to_vec()),
                "meta: invalid type: sequence, expected a map at line 1 column 0, must be a JSON \
                 object",
            ),
        ] {
            assert_eq!(file(vec![(name, Some(change))]).unwrap_err(), message);
        }
        // No frame: every array of frames is empty.
        let error = file(vec![
            ("t", Some(put(&[0], vec![0.0; 0]))),
            ("positions", Some(put(&[0, 3, 3], vec![0.0; 0]))),
            ("jaw", Some(put(&[0], vec![0_u8; 0]))),
            ("pose", Some(put(&[0, 7], vec![0.0; 0]))),
            ("grasped", Some(put(&[0, 3], vec![0_u8; 0]))),
            ("alpha", Some(put(&[0], vec![0.0; 0]))),
        ]);
        assert_eq!(
            error.unwrap_err(),
            "t: no frame, must be one frame at least"
        );
        // A quaternion of few digits is normalised, another array passed over.
        let run = file(vec![
            ("pose", Some(pose(6, 1.0 + 1e-7))),
            ("note", Some(put(&[1], vec![1.0]))),
        ]);
        assert_eq!(run.unwrap().grippers(1)[0].command.pose, Pose::IDENTITY);
    }

    #[test]
    fn files_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.npz");
        let empty = Recording::new(grid(), 1, "{}".into()).unwrap();
        assert_eq!(
            empty.write(&path).unwrap_err().to_string(),
            format!(
                "{} cannot be written: t: no frame, must be one frame at least",
                path.display()
            )
        );
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        let names_the_file = || {
            let error = Recording::read(&path).unwrap_err().to_string();
            assert!(
                error.starts_with(&format!("{}: ", path.display())),
                "{error}"
            );
        };
        names_the_file();
        fs::write(&path, "no archive").unwrap();
        names_the_file();
        // Cut anywhere, the file is refused.
        recording(grid(), 1).write(&path).unwrap();
        let bytes = fs::read(&path).unwrap();
        for end in (0..bytes.len()).step_by(7) {
            fs::write(&path, &bytes[..end]).unwrap();
            names_the_file();
        }
    }

    #[test]
    fn damage_is_noticed() {
        let run = recording(grid(), 1);
        let mut npz = NpzWriter::new(Cursor::new(Vec::new()));
        run.write_arrays(&mut npz).unwrap();
        let bytes = npz.finish().unwrap().into_inner();
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x41;
            // Some bytes of a zip carry nothing: what still reads is what was written.
            if let Ok(back) = read_bytes(damaged) {
                assert_eq!(back, run, "byte {at}");
            }
        }
    }
}
