//! Messages of `moveit_msgs` as MoveIt of Humble and of Jazzy (and later) have them: the same names, other
//! bytes.

use serde::{Deserialize, Serialize};

use super::{Header, JointState, JointTrajectory, Name, NoMultiDof, Nothing, Pose};

message!(/// sensor_msgs/MultiDOFJointState without joints.
    NoMultiDofState { header: Header, joint_names: Vec<Name>, transforms: Nothing, twist: Nothing, wrench: Nothing });
message!(/// moveit_msgs/RobotState without bodies attached to it; a difference is one to the robot's own state.
    RobotState { joint_state: JointState, multi_dof_joint_state: NoMultiDofState, attached_collision_objects: Nothing, is_diff: bool });
message!(/// moveit_msgs/Constraints without any.
    NoConstraints { name: String, joint_constraints: Nothing, position_constraints: Nothing, orientation_constraints: Nothing, visibility_constraints: Nothing });
message!(/// moveit_msgs/RobotTrajectory.
    RobotTrajectory { joint_trajectory: JointTrajectory, multi_dof_joint_trajectory: NoMultiDof });
message!(/// moveit_msgs/MoveItErrorCodes of Humble.
    CodeHumble { val: i32 });
message!(/// moveit_msgs/MoveItErrorCodes of Jazzy.
    CodeJazzy { val: i32, message: String, source: String });
message!(/// moveit_msgs/GetCartesianPath of Humble, request.
CartesianPathHumble {
    header: Header, start_state: RobotState, group_name: String, link_name: String, waypoints: Vec<Pose>,
    max_step: f64, jump_threshold: f64, prismatic_jump_threshold: f64, revolute_jump_threshold: f64,
    avoid_collisions: bool, path_constraints: NoConstraints,
});
message!(/// moveit_msgs/GetCartesianPath of Jazzy, request.
CartesianPathJazzy {
    header: Header, start_state: RobotState, group_name: String, link_name: String, waypoints: Vec<Pose>,
    max_step: f64, jump_threshold: f64, prismatic_jump_threshold: f64, revolute_jump_threshold: f64,
    avoid_collisions: bool, path_constraints: NoConstraints,
    max_velocity_scaling_factor: f64, max_acceleration_scaling_factor: f64,
    cartesian_speed_limited_link: String, max_cartesian_speed: f64,
});
message!(/// moveit_msgs/GetCartesianPath of Humble, reply.
    CartesianReplyHumble { start_state: RobotState, solution: RobotTrajectory, fraction: f64, error_code: CodeHumble });
message!(/// moveit_msgs/GetCartesianPath of Jazzy, reply.
    CartesianReplyJazzy { start_state: RobotState, solution: RobotTrajectory, fraction: f64, error_code: CodeJazzy });
message!(/// moveit_msgs/ExecuteTrajectory of Humble, goal.
    ExecuteHumble { trajectory: RobotTrajectory });
message!(/// moveit_msgs/ExecuteTrajectory of Jazzy, goal.
    ExecuteJazzy { trajectory: RobotTrajectory, controller_names: Vec<String> });
message!(/// moveit_msgs/ExecuteTrajectory of Humble, result.
    ExecutedHumble { error_code: CodeHumble });
message!(/// moveit_msgs/ExecuteTrajectory of Jazzy, result.
    ExecutedJazzy { error_code: CodeJazzy });
message!(/// moveit_msgs/ExecuteTrajectory, feedback.
    ExecuteState { state: String });

/// The name of a number of MoveItErrorCodes.
pub fn code(number: i32) -> &'static str {
    match number {
        1 => "SUCCESS",
        0 => "UNDEFINED",
        99999 => "FAILURE",
        -1 => "PLANNING_FAILED",
        -2 => "INVALID_MOTION_PLAN",
        -3 => "MOTION_PLAN_INVALIDATED_BY_ENVIRONMENT_CHANGE",
        -4 => "CONTROL_FAILED",
        -5 => "UNABLE_TO_AQUIRE_SENSOR_DATA",
        -6 => "TIMED_OUT",
        -7 => "PREEMPTED",
        -10 => "START_STATE_IN_COLLISION",
        -11 => "START_STATE_VIOLATES_PATH_CONSTRAINTS",
        -12 => "GOAL_IN_COLLISION",
        -13 => "GOAL_VIOLATES_PATH_CONSTRAINTS",
        -14 => "GOAL_CONSTRAINTS_VIOLATED",
        -15 => "INVALID_GROUP_NAME",
        -16 => "INVALID_GOAL_CONSTRAINTS",
        -17 => "INVALID_ROBOT_STATE",
        -18 => "INVALID_LINK_NAME",
        -19 => "INVALID_OBJECT_NAME",
        -21 => "FRAME_TRANSFORM_FAILURE",
        -22 => "COLLISION_CHECKING_UNAVAILABLE",
        -23 => "ROBOT_STATE_STALE",
        -24 => "SENSOR_INFO_STALE",
        -25 => "COMMUNICATION_FAILURE",
        -26 => "START_STATE_INVALID",
        -27 => "GOAL_STATE_INVALID",
        -28 => "UNRECOGNIZED_GOAL_TYPE",
        -29 => "CRASH",
        -30 => "ABORT",
        -31 => "NO_IK_SOLUTION",
        _ => "an unknown code",
    }
}
