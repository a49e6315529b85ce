//! A recording for Foxglove and other robot tools: the only file that names mcap.
//!
//! Messages are JSON with the Foxglove schemas of these names (docs.foxglove.dev, "Schemas"): what is
//! not used is there and empty, as they want it.

use std::collections::BTreeMap;
use std::path::Path;

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use selvedge_math::{DQuat, DVec3, Pose};
use serde_json::{Value, json};

use crate::error::AnyError;
use crate::volume::volumes;
use crate::{Error, Recording, write_whole};

const WORLD: &str = "world";
const CLOTH: [f64; 4] = [0.33, 0.53, 0.75, 1.0];
const GRASPED: [f64; 4] = [0.84, 0.12, 0.16, 1.0];
const GRIPPER: [f64; 4] = [0.16, 0.17, 0.2, 1.0];

impl Recording {
    /// Writes the recording as MCAP, LZ4 in chunks, to a file that appears whole. Times are those of
    /// the recording, from the epoch on, positions to 1e-9 m.
    ///
    /// | topic | schema | what |
    /// |---|---|---|
    /// | `/cloth` | `foxglove.SceneUpdate` | the sheet as triangles, held nodes red; the grasping volumes as lines |
    /// | `/gripper1`, ... | `foxglove.PoseInFrame` | the pose `T_wg` in `world` |
    /// | `/tf` | `foxglove.FrameTransform` | from `world` to `gripper1`, ... |
    /// | `/jaws` | `selvedge.Jaws` | `closed`, `alpha` and `held` nodes of each gripper |
    ///
    /// # Errors
    /// [`Error::Write`] names the file; also for a time before 0 or a description of the grasping
    /// volumes that is not as documented.
    pub fn write_mcap(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        write_whole(path, |writer| self.mcap(writer))
    }

    fn mcap<W: std::io::Write + std::io::Seek>(&self, writer: W) -> Result<(), AnyError> {
        let mut file = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .library(concat!("selvedge ", env!("CARGO_PKG_VERSION")))
            .create(writer)?;
        let mut topics = Topics::default();
        let volumes = volumes(self)?;
        let triangles = self.sheet().all_triangles();
        let indices: Vec<u32> = triangles.into_iter().flatten().collect();
        for frame in 0..self.frame_count() {
            let seconds = self.times()[frame];
            if !(0.0..1e9).contains(&seconds) {
                let bound = "0 to 1e9 s for MCAP";
                return Err(
                    Error::value("t", format!("frame {frame} is {seconds} s"), bound).into(),
                );
            }
            let time = (seconds * 1e9).round() as u64;
            let stamp = json!({"sec": time / 1_000_000_000, "nsec": time % 1_000_000_000});
            let mut put = |topic: &str, schema, message: Value| -> Result<(), AnyError> {
                topics.put(&mut file, topic, schema, time, &message)
            };

            let mut entities = vec![self.cloth_entity(frame, &indices, &stamp)];
            let mut jaws = Vec::new();
            for (number, state) in self.grippers(frame).iter().enumerate() {
                let name = format!("gripper{}", number + 1);
                let pose = state.command.pose;
                let closed = state.command.jaw.is_closed();
                let in_frame =
                    json!({"timestamp": stamp, "frame_id": WORLD, "pose": pose_json(&pose)});
                put(&format!("/{name}"), "foxglove.PoseInFrame", in_frame)?;
                let transform = json!({
                    "timestamp": stamp,
                    "parent_frame_id": WORLD,
                    "child_frame_id": name,
                    "translation": point_json(pose.position()),
                    "rotation": rotation_json(pose.rotation()),
                });
                put("/tf", "foxglove.FrameTransform", transform)?;
                if let Some(volume) = volumes.get(number) {
                    let ends = volume.edges.iter().flatten();
                    let points: Vec<Value> = ends.map(|k| point_json(volume.corners[*k])).collect();
                    let lines = json!([{
                        "type": 2, // a list of lines
                        "pose": pose_json(&Pose::IDENTITY),
                        "thickness": if closed { 3.0 } else { 1.0 },
                        "scale_invariant": true,
                        "points": points,
                        "color": colour_json(GRIPPER),
                        "colors": [],
                        "indices": [],
                    }]);
                    entities.push(entity(&name, &name, &stamp, &json!([]), &lines));
                }
                let held = self.grasped(frame).iter().enumerate();
                let held = held.filter(|(_, holder)| usize::from(**holder) == number + 1);
                jaws.push(json!({
                    "closed": closed,
                    "alpha": state.alpha,
                    "held": held.map(|(node, _)| node).collect::<Vec<_>>(),
                }));
            }
            let update = json!({"deletions": [], "entities": entities});
            put("/cloth", "foxglove.SceneUpdate", update)?;
            put(
                "/jaws",
                "selvedge.Jaws",
                json!({"timestamp": stamp, "grippers": jaws}),
            )?;
        }
        file.finish()?;
        Ok(())
    }

    fn cloth_entity(&self, frame: usize, indices: &[u32], stamp: &Value) -> Value {
        let points: Vec<Value> = self
            .positions(frame)
            .iter()
            .map(|p| point_json(*p))
            .collect();
        let colour = |holder: &u8| colour_json(if *holder > 0 { GRASPED } else { CLOTH });
        let colours: Vec<Value> = self.grasped(frame).iter().map(colour).collect();
        let triangles = json!([{
            "pose": pose_json(&Pose::IDENTITY),
            "points": points,
            "color": colour_json(CLOTH),
            "colors": colours,
            "indices": indices,
        }]);
        entity("cloth", WORLD, stamp, &triangles, &json!([]))
    }
}

/// What stands in the scene until the next of its name.
fn entity(id: &str, frame: &str, stamp: &Value, triangles: &Value, lines: &Value) -> Value {
    json!({
        "timestamp": stamp,
        "frame_id": frame,
        "id": id,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": true,
        "metadata": [],
        "arrows": [], "cubes": [], "spheres": [], "cylinders": [], "texts": [], "models": [],
        "lines": lines,
        "triangles": triangles,
    })
}

/// A point to the nanometre, which halves the file.
fn point_json(point: DVec3) -> Value {
    let [x, y, z] = point.to_array().map(|value| (value * 1e9).round() / 1e9);
    json!({"x": x, "y": y, "z": z})
}

fn rotation_json(q: DQuat) -> Value {
    json!({"x": q.x, "y": q.y, "z": q.z, "w": q.w})
}

fn pose_json(pose: &Pose) -> Value {
    json!({"position": point_json(pose.position()), "orientation": rotation_json(pose.rotation())})
}

fn colour_json([r, g, b, a]: [f64; 4]) -> Value {
    json!({"r": r, "g": g, "b": b, "a": a})
}

/// Channels, each made when it is first needed, with the number of messages so far.
#[derive(Default)]
struct Topics {
    channels: BTreeMap<String, (u16, u32)>,
}

impl Topics {
    fn put<W: std::io::Write + std::io::Seek>(
        &mut self,
        file: &mut Writer<W>,
        topic: &str,
        schema: &str,
        time: u64,
        message: &Value,
    ) -> Result<(), AnyError> {
        if !self.channels.contains_key(topic) {
            let text = schema_json(schema, message).to_string();
            let schema = file.add_schema(schema, "jsonschema", text.as_bytes())?;
            let channel = file.add_channel(schema, topic, "json", &BTreeMap::new())?;
            self.channels.insert(topic.to_owned(), (channel, 0));
        }
        let Some((channel_id, sequence)) = self.channels.get_mut(topic) else {
            return Err("no channel".into());
        };
        let header = MessageHeader {
            channel_id: *channel_id,
            sequence: *sequence,
            log_time: time,
            publish_time: time,
        };
        *sequence += 1;
        file.write_to_known_channel(&header, message.to_string().as_bytes())?;
        Ok(())
    }
}

/// The JSON schema that a message has, by its own fields.
fn schema_json(title: &str, message: &Value) -> Value {
    fn of(value: &Value) -> Value {
        match value {
            Value::Object(fields) => {
                let properties: serde_json::Map<_, _> = fields
                    .iter()
                    .map(|(name, field)| (name.clone(), of(field)))
                    .collect();
                json!({"type": "object", "properties": properties})
            }
            Value::Array(items) => {
                let items = items.first().map_or(json!({"type": "object"}), of);
                json!({"type": "array", "items": items})
            }
            Value::String(_) => json!({"type": "string"}),
            Value::Bool(_) => json!({"type": "boolean"}),
            Value::Number(number) if number.is_u64() => json!({"type": "integer"}),
            _ => json!({"type": "number"}),
        }
    }
    let mut schema = of(message);
    schema["title"] = json!(title);
    schema
}
