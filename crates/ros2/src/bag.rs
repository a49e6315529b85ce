//! What was commanded as MCAP, for the tools that play and show bags: the only file that names mcap.
//!
//! Messages are CDR with the definitions of ROS beside them, so that Foxglove, `ros2 bag` and PyPI's
//! `mcap-ros2-support` read them.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};
use serde::Serialize;

use crate::messages::encode;

const TIME: &str = "int32 sec\nuint32 nanosec\n";
const HEADER: &str = "builtin_interfaces/Time stamp\nstring frame_id\n";

/// Definitions by the names of their types: the type itself, then those it is made of.
const DEFINITIONS: &[(&str, &[(&str, &str)])] = &[
    (
        "geometry_msgs/msg/PoseStamped",
        &[
            ("", "std_msgs/Header header\ngeometry_msgs/Pose pose\n"),
            ("std_msgs/Header", HEADER),
            ("builtin_interfaces/Time", TIME),
            (
                "geometry_msgs/Pose",
                "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n",
            ),
            ("geometry_msgs/Point", "float64 x\nfloat64 y\nfloat64 z\n"),
            (
                "geometry_msgs/Quaternion",
                "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
            ),
        ],
    ),
    (
        "trajectory_msgs/msg/JointTrajectory",
        &[
            (
                "",
                "std_msgs/Header header\nstring[] joint_names\n\
                 trajectory_msgs/JointTrajectoryPoint[] points\n",
            ),
            ("std_msgs/Header", HEADER),
            ("builtin_interfaces/Time", TIME),
            ("builtin_interfaces/Duration", TIME),
            (
                "trajectory_msgs/JointTrajectoryPoint",
                "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\n\
                 float64[] effort\nbuiltin_interfaces/Duration time_from_start\n",
            ),
        ],
    ),
    ("std_msgs/msg/String", &[("", "string data\n")]),
];

fn definition(kind: &str) -> String {
    let found = DEFINITIONS.iter().find(|(name, _)| *name == kind);
    let parts = found.map_or(&[][..], |(_, parts)| parts);
    let part = |(name, text): &(&str, &str)| match name.is_empty() {
        true => (*text).to_owned(),
        false => format!("{}\nMSG: {name}\n{text}", "=".repeat(80)),
    };
    parts.iter().map(part).collect()
}

/// A file of messages.
pub(crate) struct Bag {
    file: Writer<BufWriter<File>>,
    channels: BTreeMap<String, (u16, u32)>,
}

type Outcome = std::io::Result<()>;

impl Bag {
    pub(crate) fn create(path: &Path) -> std::io::Result<Self> {
        let file = WriteOptions::new()
            .compression(Some(Compression::Lz4))
            .profile("ros2")
            .library(concat!("selvedge ", env!("CARGO_PKG_VERSION")))
            .create(BufWriter::new(File::create(path)?))
            .map_err(std::io::Error::other)?;
        Ok(Self {
            file,
            channels: BTreeMap::new(),
        })
    }

    /// A message that was sent so many seconds after 1970.
    pub(crate) fn put<T: Serialize>(
        &mut self,
        sent: f64,
        topic: &str,
        kind: &str,
        message: &T,
    ) -> Outcome {
        let other = std::io::Error::other::<mcap::McapError>;
        if !self.channels.contains_key(topic) {
            let text = definition(kind);
            let schema = self.file.add_schema(kind, "ros2msg", text.as_bytes());
            let schema = schema.map_err(other)?;
            let channel = self
                .file
                .add_channel(schema, topic, "cdr", &BTreeMap::new());
            let channel = (channel.map_err(other)?, 0);
            self.channels.insert(topic.to_owned(), channel);
        }
        let Some((channel_id, sequence)) = self.channels.get_mut(topic) else {
            return Ok(());
        };
        let time = (sent * 1e9).round() as u64;
        let header = MessageHeader {
            channel_id: *channel_id,
            sequence: *sequence,
            log_time: time,
            publish_time: time,
        };
        *sequence += 1;
        // The encoding first: CDR, little-endian.
        let mut bytes = vec![0, 1, 0, 0];
        bytes.extend(encode(message).map_err(std::io::Error::other)?);
        let written = self.file.write_to_known_channel(&header, &bytes);
        written.map_err(other)
    }

    pub(crate) fn finish(mut self) -> Outcome {
        self.file.finish().map_err(std::io::Error::other)?;
        Ok(())
    }
}
