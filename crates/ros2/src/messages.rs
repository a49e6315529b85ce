//! The messages that are sent and read, field by field in the order of their definitions.

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

macro_rules! message {
    ($(#[$doc:meta])* $name:ident { $($field:ident: $kind:ty),* $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[allow(missing_docs, reason = "the fields are those of the ROS definition")]
        pub struct $name { $(pub $field: $kind),* }
    };
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
    NoMultiDof { header: Header, joint_names: Vec<Name>, points: Vec<u8> });
message!(/// control_msgs/FollowJointTrajectory, goal (Humble and later); the tolerances are left empty.
    FollowGoal { trajectory: JointTrajectory, multi_dof_trajectory: NoMultiDof, path_tolerance: Vec<u8>, component_path_tolerance: Vec<u8>, goal_tolerance: Vec<u8>, component_goal_tolerance: Vec<u8>, goal_time_tolerance: Duration });
message!(/// control_msgs/FollowJointTrajectory, result.
    FollowResult { error_code: i32, error_string: String });
message!(/// control_msgs/FollowJointTrajectory, feedback up to its names.
    FollowFeedback { header: Header, joint_names: Vec<String> });
message!(/// control_msgs/GripperCommand, goal.
    GripperGoal { position: f64, max_effort: f64 });
message!(/// control_msgs/GripperCommand, result and feedback.
    GripperState { position: f64, effort: f64, stalled: bool, reached_goal: bool });
message!(/// franka_msgs/Grasp, goal: width, epsilon inner and outer, speed, force.
    GraspGoal { width: f64, inner: f64, outer: f64, speed: f64, force: f64 });
message!(/// franka_msgs/Move, goal.
    MoveGoal { width: f64, speed: f64 });
message!(/// franka_msgs/Grasp and Move, result.
    FrankaResult { success: bool, error: String });
message!(/// franka_msgs/Grasp and Move, feedback.
    FrankaFeedback { current_width: f64 });

impl Time {
    /// The time of day.
    pub fn now() -> Self {
        let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH);
        let now = now.unwrap_or_default();
        Self {
            sec: now.as_secs() as i32,
            nanosec: now.subsec_nanos(),
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
