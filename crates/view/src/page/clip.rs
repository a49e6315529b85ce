//! A recording as the page holds it: fewer frames, positions on a fine lattice, deflated.
//!
//! The arrays stand one after another, little-endian: times, poses, the ideal fold, triangles, sides
//! (4 bytes a number), then jaws, grasped and strains (1 byte), then positions. Strains and positions
//! are differences along time, node by node: small numbers that repeat deflate best.

use std::io::Write;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use selvedge_math::DVec3;
use serde_json::{Value, json};

use crate::volume::volumes;
use crate::{Error, Recording, Rest, Sheet};

/// Pictures a second.
const RATE: f64 = 20.0;
/// Distance of the lattice's points [m]: no position is farther than half of it from its own, in each
/// direction.
const UNIT: f64 = 1e-4;
/// Strains from the one to the other are told apart, on a logarithmic scale.
const STRAINS: [f64; 2] = [1e-4, 1e-1];
/// Steps of that scale, of 255.
const STRAIN_STEP: f64 = 5.0;

/// How far a position in the page may be from the recorded one [m].
pub(crate) const ACCURACY: f64 = 0.866e-4;

/// A recording for the player.
#[derive(Clone, Debug)]
pub struct Clip<'a> {
    /// What is done.
    pub case: &'a str,
    /// What it ran on; may be empty.
    pub solver: &'a str,
    /// What happened.
    pub recording: &'a Recording,
    /// What the end should be like [m], one a node, to be shown as a ghost.
    pub ideal: Option<&'a [DVec3]>,
    /// Points `(t [s], value)` to be drawn as a curve; may be empty.
    pub curve: &'a [(f64, f64)],
}

impl Clip<'_> {
    /// What the page's scripts are told of it, and its arrays as text.
    pub(super) fn encode(&self) -> Result<(Value, String), Error> {
        let recording = self.recording;
        let node_count = recording.node_count();
        if let Some(ideal) = self.ideal
            && (ideal.len() != node_count || !ideal.iter().all(|p| p.is_finite()))
        {
            let value = format!("{} positions", ideal.len());
            return Err(Error::value(
                "ideal",
                value,
                format!("{node_count}, finite"),
            ));
        }
        let frames = self.frames();
        let (Some(&first), Some(&last)) = (frames.first(), frames.last()) else {
            return Err(Error::value("t", "no frame", "one at least"));
        };
        let sheet = recording.sheet();
        let (triangles, sides) = (sheet.all_triangles(), sheet.sides());
        let grippers = recording.gripper_count();

        let mut bytes = Vec::new();
        let mut floats = |values: &[f64]| {
            bytes.extend(
                values
                    .iter()
                    .flat_map(|value| (*value as f32).to_le_bytes()),
            );
        };
        for &frame in &frames {
            floats(&[recording.times()[frame]]);
        }
        for &frame in &frames {
            for state in recording.grippers(frame) {
                let (p, q) = (state.command.pose.position(), state.command.pose.rotation());
                floats(&[p.x, p.y, p.z, q.x, q.y, q.z, q.w]);
            }
        }
        for point in self.ideal.into_iter().flatten() {
            floats(&point.to_array());
        }
        let corners = triangles.iter().flatten().chain(sides.iter().flatten());
        bytes.extend(corners.flat_map(|node| node.to_le_bytes()));
        for &frame in &frames {
            let jaws = recording.grippers(frame).iter();
            bytes.extend(jaws.map(|state| u8::from(state.command.jaw.is_closed())));
        }
        for &frame in &frames {
            bytes.extend(recording.grasped(frame));
        }
        bytes.extend(strains(recording, &sides, &frames));
        bytes.extend(positions(recording, &frames)?);

        let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for &frame in &frames {
            for p in recording.positions(frame) {
                (low, high) = (low.min(*p), high.max(*p));
            }
        }
        let volumes = volumes(recording)?.into_iter().map(|volume| {
            let corners: Vec<[f64; 3]> = volume.corners.iter().map(DVec3::to_array).collect();
            json!({"corners": corners, "edges": volume.edges})
        });
        let curve = self.curve.iter().enumerate();
        let curve = curve.filter(|(k, _)| k % self.stride() == 0 || k + 1 == self.curve.len());
        let head = json!({
            "case": self.case,
            "solver": self.solver,
            "frames": frames.len(),
            "nodes": node_count,
            "grippers": grippers,
            "triangles": triangles.len(),
            "sides": sides.len(),
            "ideal": self.ideal.is_some(),
            "unit": UNIT,
            "start": recording.times()[first],
            "end": recording.times()[last],
            "low": low.to_array(),
            "high": high.to_array(),
            "volumes": volumes.collect::<Vec<_>>(),
            "curve": curve.map(|(_, &(t, y))| [rounded(t), rounded(y)]).collect::<Vec<_>>(),
        });
        Ok((head, STANDARD.encode(deflated(&bytes)?)))
    }

    /// The frames that the page has: [`RATE`] a second; of a rest at the end its first and last only.
    fn frames(&self) -> Vec<usize> {
        let mut frames = self.recording.film(RATE);
        let Some(&last) = frames.last() else {
            return frames;
        };
        let end = self.recording.positions(last);
        let same = |frame: &usize| {
            let nodes = self.recording.positions(*frame).iter().zip(end);
            let still = nodes
                .into_iter()
                .all(|(p, q)| (*p - *q).abs().max_element() < 0.5 * UNIT);
            still && self.recording.grippers(*frame) == self.recording.grippers(last)
        };
        let moving = frames.iter().rposition(|frame| !same(frame));
        frames.truncate(moving.map_or(0, |k| k + 1) + 1);
        if frames.last() != Some(&last) {
            frames.push(last);
        }
        frames
    }

    /// Of so many points of the curve one is kept.
    fn stride(&self) -> usize {
        let span = match (self.curve.first(), self.curve.last()) {
            (Some(first), Some(last)) => last.0 - first.0,
            _ => 0.0,
        };
        ((self.curve.len() as f64 / (RATE * span).max(1.0)) as usize).max(1)
    }
}

/// Six digits, for a smaller page.
fn rounded(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
}

fn deflated(bytes: &[u8]) -> Result<Vec<u8>, Error> {
    let failed = |error: std::io::Error| Error::Draw(error.to_string());
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).map_err(failed)?;
    encoder.finish().map_err(failed)
}

/// The largest strain of the sides at each node that are not between two held nodes, from 0 to 255 on
/// the scale of [`STRAINS`]; differences modulo 256, node by node.
fn strains(recording: &Recording, sides: &[[u32; 2]], frames: &[usize]) -> Vec<u8> {
    let rest = recording.sheet().rest_positions();
    let node_count = recording.node_count();
    let mut worst = vec![0.0_f64; frames.len() * node_count];
    for (row, &frame) in frames.iter().enumerate() {
        let (positions, grasped) = (recording.positions(frame), recording.grasped(frame));
        for side in sides {
            let [p, q] = side.map(|node| node as usize);
            let length = rest[p].distance(rest[q]);
            if length > 0.0 && (grasped[p] == 0 || grasped[q] == 0) {
                let strain = (positions[p].distance(positions[q]) / length - 1.0).abs();
                for node in [p, q] {
                    let worst = &mut worst[row * node_count + node];
                    *worst = worst.max(strain);
                }
            }
        }
    }
    let [low, high] = STRAINS;
    let level = |strain: f64| {
        let share = (strain.max(low) / low).ln() / (high / low).ln();
        ((share.min(1.0) * 255.0 / STRAIN_STEP).round() * STRAIN_STEP) as u8
    };
    let mut bytes = Vec::with_capacity(worst.len());
    for node in 0..node_count {
        let mut before = 0;
        for row in 0..frames.len() {
            let now = level(worst[row * node_count + node]);
            bytes.push(now.wrapping_sub(before));
            before = now;
        }
    }
    bytes
}

/// Positions in units of the lattice, axis by axis and node by node: the first, its change to the
/// second, then changes of that change; signs last, and the low bytes of all before the higher ones.
fn positions(recording: &Recording, frames: &[usize]) -> Result<Vec<u8>, Error> {
    /// So that differences of differences still fit.
    const MOST: f64 = (1 << 28) as f64;
    let node_count = recording.node_count();
    let mut changes = Vec::with_capacity(3 * frames.len() * node_count);
    for axis in 0..3 {
        for node in 0..node_count {
            let (mut value, mut step) = (0_i32, 0_i32);
            for (row, &frame) in frames.iter().enumerate() {
                let place = (recording.positions(frame)[node].to_array()[axis] / UNIT).round();
                if place.abs() > MOST {
                    let found = format!("frame {frame}, node {node} is at {} m", place * UNIT);
                    let bound = format!("within {} m of 0 for a page", MOST * UNIT);
                    return Err(Error::value("positions", found, bound));
                }
                let now = place as i32;
                let change = match row {
                    0 => now,
                    _ => now - value - step,
                };
                if row > 0 {
                    step = now - value;
                }
                value = now;
                changes.push((change << 1 ^ change >> 31) as u32);
            }
        }
    }
    let plane = |k: usize| changes.iter().map(move |change| change.to_le_bytes()[k]);
    Ok((0..4).flat_map(plane).collect())
}

impl Sheet {
    /// The node positions at rest [m]; a grid lies around the origin.
    fn rest_positions(&self) -> Vec<DVec3> {
        match &self.rest {
            Rest::Positions(positions) => positions.clone(),
            Rest::Grid { nodes, sides } => {
                let along = |k: u32, axis: usize| {
                    let cells = f64::from(nodes[axis].saturating_sub(1).max(1));
                    (f64::from(k) / cells - 0.5) * sides[axis]
                };
                let row = |j| (0..nodes[0]).map(move |i| DVec3::new(along(i, 0), along(j, 1), 0.0));
                (0..nodes[1]).flat_map(row).collect()
            }
        }
    }
}
