//! The messages that are sent and read, field by field in the order of their definitions.

macro_rules! message {
    ($(#[$doc:meta])* $name:ident { $($field:ident: $kind:ty),* $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[allow(missing_docs, reason = "the fields are those of the ROS definition")]
        pub struct $name { $(pub $field: $kind),* }
        impl $crate::dds::Message for $name {}
    };
}

pub mod franka;
pub mod moveit;

use std::sync::Arc;

use selvedge_math::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// A name of a frame or a joint that is shared, not copied, from message to message.
#[derive(Clone, Debug, PartialEq)]
pub struct Name(pub Arc<str>);

impl Name {
    /// A name.
    pub fn new(name: &str) -> Self {
        Self(name.into())
    }
}

impl Serialize for Name {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.0)
    }
}

impl<'de> Deserialize<'de> for Name {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer).map(|name| Self(name.into()))
    }
}

message!(/// builtin_interfaces/Time.
    Time { sec: i32, nanosec: u32 });
message!(/// builtin_interfaces/Duration.
    Duration { sec: i32, nanosec: u32 });
message!(/// std_msgs/Header.
    Header { stamp: Time, frame_id: Name });
message!(/// geometry_msgs/Pose: position, quaternion x y z w.
    Pose { position: [f64; 3], orientation: [f64; 4] });
message!(/// geometry_msgs/PoseStamped.
    PoseStamped { header: Header, pose: Pose });
message!(/// sensor_msgs/JointState.
    JointState { header: Header, name: Vec<String>, position: Vec<f64>, velocity: Vec<f64>, effort: Vec<f64> });
message!(/// trajectory_msgs/JointTrajectoryPoint.
    JointTrajectoryPoint { positions: Vec<f64>, velocities: Vec<f64>, accelerations: Vec<f64>, effort: Vec<f64>, time_from_start: Duration });
message!(/// trajectory_msgs/JointTrajectory.
    JointTrajectory { header: Header, joint_names: Vec<Name>, points: Vec<JointTrajectoryPoint> });
message!(/// trajectory_msgs/MultiDOFJointTrajectory without points, which is all that is sent.
    NoMultiDof { header: Header, joint_names: Vec<Name>, points: Nothing });
message!(/// control_msgs/FollowJointTrajectory, goal (Humble and later); the tolerances are left empty.
    FollowGoal { trajectory: JointTrajectory, multi_dof_trajectory: NoMultiDof, path_tolerance: Nothing, component_path_tolerance: Nothing, goal_tolerance: Nothing, component_goal_tolerance: Nothing, goal_time_tolerance: Duration });
message!(/// control_msgs/FollowJointTrajectory, result.
    FollowResult { error_code: i32, error_string: String });
message!(/// control_msgs/FollowJointTrajectory, feedback up to its names.
    FollowFeedback { header: Header, joint_names: Vec<String> });
message!(/// control_msgs/GripperCommand, goal.
    GripperGoal { position: f64, max_effort: f64 });
message!(/// control_msgs/GripperCommand, result and feedback.
    GripperState { position: f64, effort: f64, stalled: bool, reached_goal: bool });
message!(/// control_msgs/ParallelGripperCommand, goal.
    ParallelGoal { command: JointState });
message!(/// control_msgs/ParallelGripperCommand, result.
    ParallelResult { state: JointState, stalled: bool, reached_goal: bool });
message!(/// control_msgs/ParallelGripperCommand, feedback.
    ParallelFeedback { state: JointState });
message!(/// A message without fields, such as std_srvs/Trigger as a request: on the wire it has a byte.
    Empty { structure_needs_at_least_one_member: u8 });
message!(/// std_msgs/Bool, and std_srvs/SetBool as a request.
    SetBool { data: bool });
message!(/// std_srvs/SetBool and std_srvs/Trigger, reply.
    SetBoolReply { success: bool, message: String });
message!(/// moveit_msgs/ServoCommandType, request: 0 joints, 1 twist, 2 pose.
    CommandType { command_type: i8 });
message!(/// moveit_msgs/ServoCommandType, reply.
    Success { success: bool });
message!(/// moveit_msgs/ServoStatus (Jazzy and later).
    ServoStatus { code: i8, message: String });
message!(/// rosgraph_msgs/Clock.
    Clock { clock: Time });
message!(/// geometry_msgs/TransformStamped: translation, quaternion x y z w.
    TransformStamped { header: Header, child_frame_id: String, translation: [f64; 3], rotation: [f64; 4] });
message!(/// tf2_msgs/TFMessage.
    TfMessage { transforms: Vec<TransformStamped> });
message!(/// nav_msgs/Path.
    Path { header: Header, poses: Vec<PoseStamped> });
message!(/// diagnostic_msgs/KeyValue.
    KeyValue { key: String, value: String });
message!(/// diagnostic_msgs/DiagnosticStatus: level 0 ok, 1 warning, 2 error.
    DiagnosticStatus { level: u8, name: String, message: String, hardware_id: String, values: Vec<KeyValue> });
message!(/// diagnostic_msgs/DiagnosticArray.
    DiagnosticArray { header: Header, status: Vec<DiagnosticStatus> });

/// A sequence that is empty: more in it is refused when it is read.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Nothing;

impl Serialize for Nothing {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        [0u8; 0][..].serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Nothing {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match Vec::<u8>::deserialize(deserializer)?.is_empty() {
            true => Ok(Self),
            false => Err(serde::de::Error::custom("a list that must be empty is not")),
        }
    }
}

impl JointState {
    /// Without names.
    pub fn empty() -> Self {
        Self {
            header: Header::none(),
            name: Vec::new(),
            position: Vec::new(),
            velocity: Vec::new(),
            effort: Vec::new(),
        }
    }
}

impl Header {
    /// No time, no frame.
    pub fn none() -> Self {
        Self {
            stamp: Time { sec: 0, nanosec: 0 },
            frame_id: Name::new(""),
        }
    }
}

/// The bytes of a message as CDR, little-endian, without the four that tell the encoding.
///
/// # Errors
/// What the encoder says.
pub fn encode<T: Serialize>(message: &T) -> Result<Vec<u8>, String> {
    crate::dds::encode(message)
}

/// A message from such bytes.
///
/// # Errors
/// What the decoder says: too few bytes, no text, a list that must be empty and is not.
pub fn decode<T: serde::de::DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    crate::dds::decode(bytes)
}

impl Time {
    /// The time of day.
    pub fn now() -> Self {
        let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
        Self::since(now.unwrap_or_default())
    }

    /// From seconds since 1970.
    pub fn from_seconds(seconds: f64) -> Self {
        Self::since(std::time::Duration::try_from_secs_f64(seconds).unwrap_or_default())
    }

    fn since(time: std::time::Duration) -> Self {
        Self {
            sec: time.as_secs() as i32,
            nanosec: time.subsec_nanos(),
        }
    }
}

impl Duration {
    /// From seconds, 0 at least, to the nanosecond.
    pub fn from_seconds(seconds: f64) -> Self {
        let time = std::time::Duration::try_from_secs_f64(seconds).unwrap_or_default();
        Self {
            sec: time.as_secs() as i32,
            nanosec: time.subsec_nanos(),
        }
    }
}

impl From<&selvedge_math::Pose> for Pose {
    fn from(pose: &selvedge_math::Pose) -> Self {
        Self {
            position: pose.position().to_array(),
            orientation: pose.rotation().to_array(),
        }
    }
}

impl Pose {
    /// As a rigid transform, unless it is none.
    pub fn rigid(&self) -> Option<selvedge_math::Pose> {
        let (p, q) = (
            DVec3::from_array(self.position),
            DQuat::from_array(self.orientation),
        );
        selvedge_math::Pose::new(p, q)
            .ok()
            .filter(|_| (q.length() - 1.0).abs() < 1e-3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::de::DeserializeOwned;

    fn header() -> Header {
        let stamp = Time { sec: 3, nanosec: 5 };
        let frame_id = Name::new("fr3");
        Header { stamp, frame_id }
    }

    /// Both ways against what the encoder of rosbags 0.11.9 makes of the definitions of Jazzy; without
    /// its four bytes that tell the encoding.
    fn golden<T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(value: &T, hex: &str) {
        let bytes: Vec<u8> = (0..hex.len() / 2)
            .map(|k| u8::from_str_radix(&hex[2 * k..2 * k + 2], 16).unwrap())
            .collect();
        assert_eq!(encode(value).unwrap(), bytes);
        assert_eq!(&decode::<T>(&bytes).unwrap(), value);
    }

    #[test]
    fn bytes_are_those_of_another_encoder() {
        let (position, orientation) = ([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]);
        let pose = Pose {
            position,
            orientation,
        };
        golden(
            &PoseStamped {
                header: header(),
                pose,
            },
            "03000000050000000400000066723300000000000000f03f00000000000000400000000000000840\
             000000000000000000000000000000000000000000000000000000000000f03f",
        );
        golden(
            &JointState {
                header: header(),
                name: vec!["a".into(), "bcd".into()],
                position: vec![0.5, 1.0],
                velocity: vec![],
                effort: vec![2.0],
            },
            "0300000005000000040000006672330002000000020000006100000004000000626364000200000000\
             0000000000e03f000000000000f03f00000000010000000000000000000040",
        );
        let point = JointTrajectoryPoint {
            positions: vec![0.5],
            velocities: vec![1.0],
            accelerations: vec![],
            effort: vec![],
            time_from_start: Duration { sec: 1, nanosec: 7 },
        };
        golden(
            &JointTrajectory {
                header: header(),
                joint_names: vec![Name::new("a")],
                points: vec![point.clone(), point],
            },
            "0300000005000000040000006672330001000000020000006100000002000000010000000000000000\
             0000000000e03f0100000000000000000000000000f03f000000000000000001000000070000000100\
             000000000000000000000000e03f0100000000000000000000000000f03f0000000000000000010000\
             0007000000",
        );
    }

    #[test]
    fn a_list_that_must_be_empty_is_refused_when_it_is_not() {
        assert_eq!(encode(&Nothing).unwrap(), [0; 4]);
        assert_eq!(decode::<Nothing>(&[0; 4]).unwrap(), Nothing);
        assert!(decode::<Nothing>(&[1, 0, 0, 0, 7]).is_err());
        assert!(decode::<Nothing>(&[1, 0, 0, 0]).is_err());
    }
}
