//! What each arm is sent.

use selvedge_franka::Arm;
use selvedge_math::DVec3;
use selvedge_ros2::error::Cause;
use selvedge_ros2::network::Distro;
use selvedge_ros2::state::State;
use serde_json::{Value, json};

use crate::run::{Job, Played, plan, seven};

/// What was received is what was sent, but for the first samples of the prelude, and what was sent in
/// each motion is the spline of the log.
pub(crate) fn the_stream_is_the_spline(played: &Played, timed: bool) {
    let period = played.period;
    let sent: Vec<&Value> = played
        .lines
        .iter()
        .filter(|line| line.get("pose").is_some())
        .collect();
    let got = played.got["poses"].as_array().unwrap();
    let lost = sent.len() - got.len();
    assert!(
        (lost as f64) < 0.3 / period,
        "{lost} of {} lost",
        sent.len()
    );
    for (sent, got) in sent[lost..].iter().zip(got) {
        assert_eq!(seven(&sent["pose"]), seven(got));
    }
    let plan = &played.plan;
    let start = plan.start();
    let mut motion: Option<(usize, f64)> = None;
    let mut compared = 0;
    for line in &played.lines {
        if line["event"] == "state" {
            let detail = line["detail"].as_str().unwrap();
            let t = line["t"].as_f64().unwrap();
            motion = detail
                .strip_prefix("moving ")
                .map(|k| (k.parse().unwrap(), t));
        } else if let (Some((k, begin)), true) = (motion, line.get("pose").is_some()) {
            let t = line["t"].as_f64().unwrap() - begin;
            let expected = match k {
                0 => start,
                k => plan.segments[k - 1].at(t),
            };
            let pose = seven(&line["pose"]);
            let p = DVec3::new(pose[0], pose[1], pose[2]);
            assert!(
                p.distance(expected.position()) < 1e-9,
                "motion {k} at {t}: {p}"
            );
            let q = expected.rotation().to_array();
            let dot: f64 = (0..4).map(|i| q[i] * pose[3 + i]).sum();
            assert!(dot.abs() > 1.0 - 1e-12);
            compared += 1;
        }
    }
    let expected = plan.duration() / period;
    assert!(
        f64::from(compared) > 0.99 * expected,
        "{compared} of {expected}"
    );
    let times: Vec<f64> = sent
        .iter()
        .map(|line| line["sent"].as_f64().unwrap())
        .collect();
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mean = (times[times.len() - 1] - times[0]) / steps.len() as f64;
    steps.sort_by(f64::total_cmp);
    let p99 = steps[steps.len() * 99 / 100];
    println!(
        "{} sent, {lost} before the match, {} received; mean period {:.4} ms, p99 {:.3} ms, longest {:.3} ms",
        sent.len(),
        got.len(),
        1e3 * mean,
        1e3 * p99,
        1e3 * steps[steps.len() - 1]
    );
    if timed {
        assert!((mean / period - 1.0).abs() < 0.01, "{mean}");
    }
}

#[test]
fn poses_arrive_at_250_hz_and_the_jaws_act_in_order() {
    let name = "poses_arrive_at_250_hz_and_the_jaws_act_in_order";
    let mut job = Job::new(name, "cartesian", "gripper-command");
    job.timed = true;
    let Some(played) = job.play() else {
        return;
    };
    assert_eq!(played.end, State::Finished);
    the_stream_is_the_spline(&played, true);
    assert_eq!(played.got["frames"], json!(["fr3_link0"]));
    // No stamp is zero and none goes back.
    let stamps: Vec<(i64, i64)> = serde_json::from_value(played.got["stamps"].clone()).unwrap();
    assert!(stamps.iter().all(|stamp| *stamp > (0, 0)));
    assert!(stamps.is_sorted());
    // Half the gap, and never without force.
    let asked: Vec<&Value> = played.goals().iter().map(|goal| &goal[1]).collect();
    assert_eq!(
        json!(asked),
        json!([[0.04, 20.0], [0.0, 20.0], [0.04, 20.0]])
    );
    // At rest where the segments end: the poses before and after each goal are the same.
    let poses = played.got["poses"].as_array().unwrap();
    for goal in played.goals() {
        let k = goal[2].as_u64().unwrap() as usize;
        let (before, after) = (seven(&poses[k - 1]), seven(&poses[k]));
        for i in 0..7 {
            assert!((before[i] - after[i]).abs() < 1e-6);
        }
    }
    // The path for RViz, and how it went.
    let [path] = played.got["paths"].as_array().unwrap().as_slice() else {
        panic!("{}", played.got["paths"]);
    };
    assert_eq!(path[0], "fr3_link0");
    let ends = [path[2].clone(), path[3].clone()].map(|pose| seven(&pose));
    let last = &played.plan.segments[2];
    for (end, pose) in ends
        .iter()
        .zip([played.plan.start(), last.pose(last.law.length)])
    {
        assert!(pose.position().distance(DVec3::new(end[0], end[1], end[2])) < 1e-12);
    }
    let told = played.got["diagnostics"].as_array().unwrap();
    let states: Vec<&str> = told
        .iter()
        .map(|status| status[1].as_str().unwrap())
        .collect();
    assert!(states.contains(&"moving 2"), "{states:?}");
    assert!(told.iter().all(|status| status[0] == 0));
}

#[test]
fn poses_arrive_at_1_khz() {
    let mut job = Job::new("poses_arrive_at_1_khz", "cartesian", "franka");
    (job.settings.period, job.plan, job.timed) = (0.001, plan(0.5), true);
    let Some(played) = job.play() else { return };
    assert_eq!(played.end, State::Finished);
    the_stream_is_the_spline(&played, true);
}

#[test]
fn servo_is_put_into_its_mode_before_the_first_pose() {
    let name = "servo_is_put_into_its_mode_before_the_first_pose";
    let job = Job::new(name, "servo", "gripper-command");
    // Slow near a singularity is no reason to stop.
    let Some(played) = job.told(json!({"servo": "ok", "slow": 1})).play() else {
        return;
    };
    assert_eq!(played.end, State::Finished);
    the_stream_is_the_spline(&played, false);
    // Poses, then not paused, and no pose before.
    assert_eq!(
        played.got["calls"],
        json!([["type", 2, 0], ["pause", false, 0]])
    );

    let job = Job::new(name, "servo", "gripper-command");
    let halts = json!({"servo": "ok", "halt_after": 300});
    let played = job.told(halts).play().unwrap();
    let expected = "/servo_node ended as HALT_FOR_SINGULARITY: close to a singularity";
    assert_eq!(played.cause(), expected);
    played.rests();

    let job = Job::new(name, "servo", "gripper-command");
    let played = job.told(json!({"servo": "refuse"})).play().unwrap();
    let expected = "/servo_node/switch_command_type ended as refused: servo does not follow poses";
    assert_eq!(played.cause(), expected);
    assert_eq!(played.got["poses"], json!([]));
}

/// Rows of joint positions by their poses, for a planner that knows what we want.
fn rows() -> Value {
    let plan = plan(1.0);
    let mut rows = Vec::new();
    for segment in &plan.segments {
        for (tau, q) in segment.tau.iter().zip(segment.joints.chunks(7)) {
            let pose = segment.pose(*tau);
            let (p, r) = (pose.position(), pose.rotation());
            rows.push(json!([[p.x, p.y, p.z, r.x, r.y, r.z, r.w], q]));
        }
    }
    json!(rows)
}

/// The goals of an arm, after the way to the first pose, are the plan's trajectories: names, times, and
/// places within so many metres.
pub(crate) fn trajectories(played: &Played, action: &str, within: f64) {
    let plan = &played.plan;
    let model = Arm::fr3();
    let goals = played.goals().iter().filter(|goal| goal[0] == action);
    assert_eq!(goals.clone().count(), plan.segments.len() + 1);
    for (goal, segment) in goals.skip(1).zip(&plan.segments) {
        assert_eq!(goal[1][0], json!(plan.joint_names));
        let points = goal[1][1].as_array().unwrap();
        assert_eq!(points.len(), segment.tau.len());
        for point in points {
            let numbers = point.as_array().unwrap().iter();
            let numbers: Vec<f64> = numbers.map(|x| x.as_f64().unwrap()).collect();
            let tip = model.forward(&numbers[1..]).position();
            let expected = segment.at(numbers[0]).position();
            assert!(
                tip.distance(expected) < within,
                "{}: {tip} {expected}",
                numbers[0]
            );
        }
    }
}

#[test]
fn moveit_plans_the_path_and_our_law_times_it() {
    let name = "moveit_plans_the_path_and_our_law_times_it";
    for (distro, told) in [(Distro::Jazzy, "jazzy"), (Distro::Humble, "humble")] {
        let mut job = Job::new(name, "moveit", "gripper-command");
        job.choice.distro = distro;
        let told = json!({"moveit": "ok", "moveit_distro": told, "rows": rows()});
        let Some(played) = job.told(told).play() else {
            return;
        };
        assert_eq!(played.end, State::Finished);
        // As near as straight joint motion between points 0.1 mm apart.
        trajectories(&played, "/execute_trajectory", 1e-5);
        // The jaws act between motions.
        let order: Vec<&str> = played
            .goals()
            .iter()
            .map(|g| g[0].as_str().unwrap())
            .collect();
        let (arm, jaw) = ("/execute_trajectory", "/gripper");
        assert_eq!(order, [arm, jaw, arm, jaw, arm, jaw, arm]);
        // Only the motion that moves was planned: frame, group, link, and the state as a difference.
        let calls = played.got["calls"].as_array().unwrap();
        assert_eq!(calls.len(), 1, "{calls:?}");
        let [_, frame, group, link, count, step, diff] = calls[0].as_array().unwrap().as_slice()
        else {
            panic!("{calls:?}");
        };
        assert_eq!(
            json!([frame, group, link]),
            json!(["fr3_link0", "fr3_arm", "fr3_hand_tcp"])
        );
        assert!(count.as_u64().unwrap() > 50 && step.as_f64().unwrap() > 0.0);
        assert_eq!(diff, true);
    }
}

#[test]
fn what_moveit_cannot_do_is_refused_before_anything_moves() {
    let name = "what_moveit_cannot_do_is_refused_before_anything_moves";
    let refused = "the plan of /compute_cartesian_path for motion 2 is refused: ";
    for (how, text) in [
        (
            "part",
            "only 40.0 % of the path were found, code -31, NO_IK_SOLUTION as told",
        ),
        ("jump", "fr3_joint4 jumps by 0.5"),
        ("off", "it leaves the path by"),
    ] {
        let job = Job::new(name, "moveit", "gripper-command");
        let told = json!({"moveit": how, "rows": rows()});
        let Some(played) = job.told(told).play() else {
            return;
        };
        let cause = played.cause();
        assert!(cause.starts_with(&format!("{refused}{text}")), "{cause}");
        assert_eq!(played.goals().len(), 0, "{how}");
    }
    // The messages of another distribution: it cannot read ours, or we cannot read its.
    let mut job = Job::new(name, "moveit", "gripper-command");
    job.choice.distro = Distro::Humble;
    let told = json!({"moveit": "ok", "rows": rows()});
    let played = job.told(told).play().unwrap();
    let cause = played.cause();
    assert!(cause.contains("--distro"), "{cause}");
    assert_eq!(played.goals().len(), 0);
}

#[test]
fn joint_trajectories_are_those_of_the_plan() {
    let name = "joint_trajectories_are_those_of_the_plan";
    let Some(played) = Job::new(name, "joints", "gripper-command").play() else {
        return;
    };
    assert_eq!(played.end, State::Finished);
    // Times are told to the nanosecond.
    trajectories(&played, "/arm/follow_joint_trajectory", 1e-8);
    for (arm, how, text) in [
        (
            "joints",
            "abort",
            "/arm/follow_joint_trajectory ended as Aborted: code -4, PATH_TOLERANCE_VIOLATED: path \
             tolerance",
        ),
        (
            "joints",
            "reject",
            "/arm/follow_joint_trajectory rejected the goal",
        ),
        (
            "moveit",
            "abort",
            "/execute_trajectory ended as Aborted: code -4, CONTROL_FAILED: as told",
        ),
    ] {
        let job = Job::new(name, arm, "gripper-command");
        let told = match arm {
            "moveit" => json!({"arm": how, "moveit": "ok", "rows": rows()}),
            _ => json!({"arm": how}),
        };
        let played = job.told(told).play().unwrap();
        assert_eq!(played.cause(), text);
    }
}

#[test]
fn a_stop_cancels_the_trajectory_and_waits_for_the_answer() {
    let name = "a_stop_cancels_the_trajectory_and_waits_for_the_answer";
    for arm in ["joints", "moveit"] {
        let mut job = Job::new(name, arm, "none");
        // In the motion, which takes 1.8 s after some 4 s.
        job.stop_after = Some(4.3);
        let told = json!({"moveit": "ok", "rows": rows()});
        let Some(played) = job.told(told).play() else {
            return;
        };
        assert_eq!(played.end, State::Stopped(Cause::Signal));
        assert_eq!(played.got["cancels"], 1);
        let ended = |line: &&Value| line["event"] == "trajectory ended";
        let ended = played.lines.iter().rfind(ended).unwrap();
        assert!(
            ended["detail"].as_str().unwrap().starts_with("Canceled"),
            "{ended}"
        );
    }
}
