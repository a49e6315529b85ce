//! Messages of `franka_msgs`, as in franka_ros2.

use serde::{Deserialize, Serialize};

use super::{Header, JointState, PoseStamped};

message!(/// franka_msgs/Grasp, goal: width, epsilon inner and outer, speed, force.
    GraspGoal { width: f64, inner: f64, outer: f64, speed: f64, force: f64 });
message!(/// franka_msgs/Move, goal.
    MoveGoal { width: f64, speed: f64 });
message!(/// franka_msgs/Grasp, Move and Homing, result.
    FrankaResult { success: bool, error: String });
message!(/// franka_msgs/Grasp, Move and Homing, feedback.
    FrankaFeedback { current_width: f64 });
message!(/// geometry_msgs/WrenchStamped, TwistStamped and AccelStamped.
    SixStamped { header: Header, six: [f64; 6] });
message!(/// geometry_msgs/InertiaStamped: m, com, ixx ixy ixz iyy iyz izz.
    InertiaStamped { header: Header, m: f64, com: [f64; 3], inertia: [f64; 6] });
message!(/// franka_msgs/FrankaRobotState: what is read of it is the mode and the errors, the last fields.
RobotState {
    header: Header, collision_indicators: [f64; 26],
    measured_joint_state: JointState, desired_joint_state: JointState, measured_joint_motor_state: JointState,
    ddq_d: [f64; 7], dtau_j: [f64; 7], tau_ext_hat_filtered: JointState, elbow: [f64; 10],
    k_f_ext_hat_k: SixStamped, o_f_ext_hat_k: SixStamped,
    inertia_ee: InertiaStamped, inertia_load: InertiaStamped, inertia_total: InertiaStamped,
    o_t_ee: PoseStamped, o_t_ee_d: PoseStamped, o_t_ee_c: PoseStamped, f_t_ee: PoseStamped, ee_t_k: PoseStamped,
    o_dp_ee_d: SixStamped, o_dp_ee_c: SixStamped, o_ddp_ee_c: SixStamped,
    time: f64, control_command_success_rate: f64, robot_mode: u8,
    current_errors: [[bool; 18]; 2], last_motion_errors: [[bool; 18]; 2],
});

/// The modes of FrankaRobotState.
pub const MODES: [&str; 7] = [
    "other",
    "idle",
    "move",
    "guiding",
    "reflex",
    "user stopped",
    "automatic error recovery",
];

/// The errors of franka_msgs/Errors, in its order.
pub const ERRORS: [&str; 36] = [
    "joint_position_limits_violation",
    "cartesian_position_limits_violation",
    "self_collision_avoidance_violation",
    "joint_velocity_violation",
    "cartesian_velocity_violation",
    "force_control_safety_violation",
    "joint_reflex",
    "cartesian_reflex",
    "max_goal_pose_deviation_violation",
    "max_path_pose_deviation_violation",
    "cartesian_velocity_profile_safety_violation",
    "joint_position_motion_generator_start_pose_invalid",
    "joint_motion_generator_position_limits_violation",
    "joint_motion_generator_velocity_limits_violation",
    "joint_motion_generator_velocity_discontinuity",
    "joint_motion_generator_acceleration_discontinuity",
    "cartesian_position_motion_generator_start_pose_invalid",
    "cartesian_motion_generator_elbow_limit_violation",
    "cartesian_motion_generator_velocity_limits_violation",
    "cartesian_motion_generator_velocity_discontinuity",
    "cartesian_motion_generator_acceleration_discontinuity",
    "cartesian_motion_generator_elbow_sign_inconsistent",
    "cartesian_motion_generator_start_elbow_invalid",
    "cartesian_motion_generator_joint_position_limits_violation",
    "cartesian_motion_generator_joint_velocity_limits_violation",
    "cartesian_motion_generator_joint_velocity_discontinuity",
    "cartesian_motion_generator_joint_acceleration_discontinuity",
    "cartesian_position_motion_generator_invalid_frame",
    "force_controller_desired_force_tolerance_violation",
    "controller_torque_discontinuity",
    "start_elbow_sign_inconsistent",
    "communication_constraints_violation",
    "power_limit_violation",
    "joint_p2p_insufficient_torque_for_planning",
    "tau_j_range_violation",
    "instability_detected",
];

impl RobotState {
    /// The mode and the current errors in words.
    pub fn told(&self) -> String {
        let mode = usize::from(self.robot_mode);
        let mode = MODES.get(mode).copied().unwrap_or("unknown");
        let set = self.current_errors.iter().flatten().zip(ERRORS);
        let set: Vec<&str> = set.filter(|(set, _)| **set).map(|(_, name)| name).collect();
        match set.is_empty() {
            true => format!("mode {mode}"),
            false => format!("mode {mode}, errors: {}", set.join(", ")),
        }
    }
}
