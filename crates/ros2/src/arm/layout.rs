//! What is said to MoveIt and by it, in the messages of Humble and in those of Jazzy and later.

use crate::arm::joints::{Execute, no_multi_dof};
use crate::dds::{Kind, Message};
use crate::messages::moveit::{
    CartesianPathHumble, CartesianPathJazzy, CartesianReplyHumble, CartesianReplyJazzy,
    ExecuteHumble, ExecuteJazzy, ExecuteState, ExecutedHumble, ExecutedJazzy, NoConstraints,
    RobotState, RobotTrajectory, code,
};
use crate::messages::{Header, JointTrajectory, Nothing, Pose};

/// How far apart MoveIt's points may be [m].
const MAX_STEP: f64 = 0.005;

/// What is asked of MoveIt for a motion.
pub(crate) struct Ask {
    pub(crate) header: Header,
    pub(crate) start_state: RobotState,
    pub(crate) group_name: String,
    pub(crate) link_name: String,
    pub(crate) waypoints: Vec<Pose>,
}

/// What it answers.
pub(crate) struct Answer {
    pub(crate) solution: JointTrajectory,
    pub(crate) fraction: f64,
    pub(crate) code: i32,
    pub(crate) text: String,
}

/// The messages of a distribution.
pub(crate) trait Layout: Execute {
    type Request: Message + Clone + 'static;
    type Reply: Message + 'static;
    fn request(ask: Ask) -> Self::Request;
    fn answer(reply: Self::Reply) -> Answer;
}

const EXECUTE: Kind = ("moveit_msgs", "ExecuteTrajectory");

fn whole(joint_trajectory: JointTrajectory) -> RobotTrajectory {
    RobotTrajectory {
        joint_trajectory,
        multi_dof_joint_trajectory: no_multi_dof(),
    }
}

fn free() -> NoConstraints {
    NoConstraints {
        name: String::new(),
        joint_constraints: Nothing,
        position_constraints: Nothing,
        orientation_constraints: Nothing,
        visibility_constraints: Nothing,
    }
}

/// MoveIt of Humble.
pub(crate) struct Humble;

impl Execute for Humble {
    type Goal = ExecuteHumble;
    type Result = ExecutedHumble;
    type Feedback = ExecuteState;
    const KIND: Kind = EXECUTE;

    fn goal(trajectory: JointTrajectory) -> ExecuteHumble {
        ExecuteHumble {
            trajectory: whole(trajectory),
        }
    }

    fn outcome(result: ExecutedHumble) -> (bool, String) {
        let val = result.error_code.val;
        (val == 1, format!("code {val}, {}", code(val)))
    }
}

impl Layout for Humble {
    type Request = CartesianPathHumble;
    type Reply = CartesianReplyHumble;

    fn request(ask: Ask) -> CartesianPathHumble {
        CartesianPathHumble {
            header: ask.header,
            start_state: ask.start_state,
            group_name: ask.group_name,
            link_name: ask.link_name,
            waypoints: ask.waypoints,
            max_step: MAX_STEP,
            jump_threshold: 0.0,
            prismatic_jump_threshold: 0.0,
            revolute_jump_threshold: 0.0,
            avoid_collisions: true,
            path_constraints: free(),
        }
    }

    fn answer(reply: CartesianReplyHumble) -> Answer {
        Answer {
            solution: reply.solution.joint_trajectory,
            fraction: reply.fraction,
            code: reply.error_code.val,
            text: String::new(),
        }
    }
}

/// MoveIt of Jazzy and later.
pub(crate) struct Jazzy;

impl Execute for Jazzy {
    type Goal = ExecuteJazzy;
    type Result = ExecutedJazzy;
    type Feedback = ExecuteState;
    const KIND: Kind = EXECUTE;

    fn goal(trajectory: JointTrajectory) -> ExecuteJazzy {
        ExecuteJazzy {
            trajectory: whole(trajectory),
            controller_names: Vec::new(),
        }
    }

    fn outcome(result: ExecutedJazzy) -> (bool, String) {
        let error = result.error_code;
        let (val, message) = (error.val, error.message);
        (val == 1, format!("code {val}, {}: {message}", code(val)))
    }
}

impl Layout for Jazzy {
    type Request = CartesianPathJazzy;
    type Reply = CartesianReplyJazzy;

    fn request(ask: Ask) -> CartesianPathJazzy {
        CartesianPathJazzy {
            header: ask.header,
            start_state: ask.start_state,
            group_name: ask.group_name,
            link_name: ask.link_name,
            waypoints: ask.waypoints,
            max_step: MAX_STEP,
            jump_threshold: 0.0,
            prismatic_jump_threshold: 0.0,
            revolute_jump_threshold: 0.0,
            avoid_collisions: true,
            path_constraints: free(),
            max_velocity_scaling_factor: 1.0,
            max_acceleration_scaling_factor: 1.0,
            cartesian_speed_limited_link: String::new(),
            max_cartesian_speed: 0.0,
        }
    }

    fn answer(reply: CartesianReplyJazzy) -> Answer {
        Answer {
            solution: reply.solution.joint_trajectory,
            fraction: reply.fraction,
            code: reply.error_code.val,
            text: reply.error_code.message,
        }
    }
}
