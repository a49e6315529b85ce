//! Which folds an arm can follow, and what a path, a time law and a report must keep: looked at with
//! forward kinematics and differences, not with the code that made them.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use selvedge_franka::{
    Arm, Cause, LIMIT_MARGIN, OWN_MARGIN, Offer, Part, Placement, Rates, best, either, joint_path,
    reach, search, slow_down, usage,
};
use selvedge_math::{Command, DQuat, DVec3, Jaw, Pose};
use selvedge_trajectory::log::{Log, Sample};

const ROWS: usize = 200;

/// A fold by 0.59 m along -y on a parabola of 0.3 m, the tip at height `z` at both ends, the hand
/// tilted about the fold axis x from one angle to the other [deg], in three seconds; the jaws close
/// along the fold axis or, `across`, along the fold.
fn fold(z: f64, from: f64, to: f64, across: bool) -> Log {
    let mut log = Log::new("a fold");
    log.frame = "table".into();
    let yaw = match across {
        true => DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2),
        false => DQuat::IDENTITY,
    };
    for k in 0..ROWS {
        let u = k as f64 / (ROWS - 1) as f64;
        let s = u * u * u * (10.0 - u * (15.0 - 6.0 * u));
        let p = DVec3::new(0.21, 0.295 - 0.59 * s, z + 1.2 * s * (1.0 - s));
        let tilt = f64::to_radians(from + s * (to - from));
        let pose = Pose::new(p, DQuat::from_rotation_x(tilt) * yaw).unwrap();
        let command = Command {
            pose,
            jaw: Jaw::Closed,
        };
        let time = 3.0 * u;
        log.samples.push(Sample { time, command });
    }
    log
}

/// How many places of the base have a path, and the least time from the best of them.
fn bases(log: &Log) -> (usize, Option<f64>) {
    let arm = Arm::fr3();
    let places = search(&arm, log, 0.0, 0.0).unwrap();
    let count = places.iter().filter(|place| place.score.is_some()).count();
    let found = best(&arm, log, &places).unwrap().unwrap();
    (count, found.timing.map(|timing| timing.least))
}

/// What is known of the folds that a Franka can do on a bare table: fingers that point down may lean
/// by 60 degrees at 15 mm, by 75 at 50 mm and lie flat at 80 mm; never can they point up at the end.
#[test]
fn rotations_by_height() {
    for (z, from, to, across, possible) in [
        (0.015, 0.0, 0.0, false, true),
        (0.015, 0.0, 60.0, false, true),
        (0.015, 45.0, -45.0, false, true),
        (0.015, 60.0, -60.0, false, true),
        (0.015, 75.0, -75.0, false, false),
        (0.05, 75.0, -75.0, false, true),
        (0.02, 90.0, -90.0, false, false),
        (0.08, 90.0, -90.0, false, true),
        (0.02, 0.0, 180.0, false, false),
        (0.02, 0.0, -180.0, false, false),
        (0.25, 0.0, -180.0, false, false),
        (0.015, 0.0, 0.0, true, true),
        (0.015, 30.0, -30.0, true, false),
    ] {
        let (count, least) = bases(&fold(z, from, to, across));
        println!("z {z} {from} -> {to} across {across}: {count} bases, {least:?} s");
        assert_eq!(
            least.is_some(),
            possible,
            "z {z} {from} -> {to} across {across}: {count}"
        );
    }
}

/// Times that a maximal velocity and acceleration law with jerk took in a grid search over straight
/// lines of q7 at one base each (TOPP-RA and a box filter); the base is searched for here.
#[test]
fn times_are_below_those_of_a_grid_search() {
    for (z, from, to, reference) in [
        (0.02, 0.0, 0.0, 1.169),
        (0.02, 0.0, 60.0, 1.619),
        (0.02, 45.0, -45.0, 1.726),
        (0.02, 60.0, -60.0, 2.245),
        (0.08, 90.0, -90.0, 2.216),
    ] {
        let (_, least) = bases(&fold(z, from, to, false));
        println!("z {z} {from} -> {to}: {least:?} s, {reference} s");
        assert!(least.unwrap() <= reference);
    }
}

const BESIDE: [f64; 4] = [-0.35, 0.0, 0.0, 0.0];

fn placement(base: [f64; 4], flip: bool) -> Placement {
    Placement {
        flip,
        ..Placement::new(base, 0.0).unwrap()
    }
}

/// The better turn of the hand, and the joint positions of each row.
fn path(log: &Log, base: [f64; 4]) -> (Placement, Vec<f64>) {
    let arm = Arm::fr3();
    let found = either(&arm, log, &placement(base, false)).unwrap();
    let path = joint_path(&arm, log, &found.placement).unwrap();
    (found.placement, path.unwrap())
}

/// The maker's capsules: link, ends and radius; and the boxes of a finger, one finger's worth.
const CAPSULES: [(&str, [f64; 3], [f64; 3], f64); 12] = [
    ("fr3_link0", [-0.09, 0.0, 0.06], [-0.06, 0.0, 0.06], 0.06),
    ("fr3_link1", [0.0, 0.0, -0.333], [0.0, 0.0, -0.05], 0.06),
    ("fr3_link2", [0.0, 0.0, -0.06], [0.0, 0.0, 0.06], 0.06),
    ("fr3_link3", [0.0, 0.0, -0.22], [0.0, 0.0, -0.07], 0.06),
    ("fr3_link4", [0.0, 0.0, -0.06], [0.0, 0.0, 0.06], 0.06),
    ("fr3_link5", [0.0, 0.0, -0.31], [0.0, 0.0, -0.21], 0.06),
    ("fr3_link5", [0.0, 0.08, -0.2], [0.0, 0.08, -0.06], 0.025),
    ("fr3_link6", [0.0, 0.0, -0.07], [0.0, 0.0, 0.01], 0.05),
    ("fr3_link7", [0.0, 0.0, -0.06], [0.0, 0.0, 0.08], 0.04),
    (
        "fr3_link7",
        [0.0459619, 0.0459619, 0.082],
        [0.0388909, 0.0388909, 0.082],
        0.03,
    ),
    ("fr3_hand", [0.0, -0.05, 0.04], [0.0, 0.05, 0.04], 0.04),
    ("fr3_hand", [0.0, -0.05, 0.1], [0.0, 0.05, 0.1], 0.02),
];

/// Where a capsule's axis is, point by point.
fn axis(arm: &Arm, q: &[f64], capsule: usize) -> Vec<DVec3> {
    let (link, a, b, _) = CAPSULES[capsule];
    let pose = arm.link_pose(q, link).unwrap();
    let (a, b) = (DVec3::from_array(a), DVec3::from_array(b));
    (0..=40)
        .map(|k| pose.transform(a.lerp(b, f64::from(k) / 40.0)))
        .collect()
}

/// Corners of the fingertips and their shanks with the jaws closed.
fn fingers(arm: &Arm, q: &[f64]) -> Vec<DVec3> {
    let hand = arm.link_pose(q, "fr3_hand").unwrap();
    let mut corners = Vec::new();
    for side in [1.0, -1.0] {
        for (centre, size) in [
            ([0.0, 0.0185, 0.011], [0.022, 0.015, 0.02]),
            ([0.0, 0.0068, 0.0022], [0.022, 0.0088, 0.0038]),
            ([0.0, 0.00758, 0.04525], [0.0175, 0.0152, 0.0185]),
        ] {
            for corner in 0..8 {
                let half = |k: usize| if corner >> k & 1 == 0 { -0.5 } else { 0.5 };
                let at = |k: usize| centre[k] + half(k) * size[k];
                // The other finger faces this one.
                let p = DVec3::new(side * at(0), side * at(1), 0.0584 + at(2));
                corners.push(hand.transform(p));
            }
        }
    }
    corners
}

/// Every row is on its pose and one continuous branch, within limits, above the table and clear of
/// the arm itself: by forward kinematics and by bodies written down here.
#[test]
fn a_path_keeps_what_it_must() {
    let arm = Arm::fr3();
    for (z, from, to, base) in [
        (0.02, 0.0, 0.0, BESIDE),
        (0.02, 30.0, -30.0, BESIDE),
        (0.02, 0.0, 45.0, [0.77, 0.0, 0.0, 3.0]),
        (0.05, 60.0, -60.0, BESIDE),
    ] {
        let log = fold(z, from, to, false);
        let (placement, path) = path(&log, base);
        let mut before: Option<&[f64]> = None;
        for (sample, q) in log.samples.iter().zip(path.chunks(7)) {
            let tip = placement.tip(&sample.command.pose, log.tip_offset);
            let reached = arm.forward(q);
            assert!(reached.position().distance(tip.position()) < 1e-9);
            assert!(reached.rotation().dot(tip.rotation()).abs() > 1.0 - 1e-12);
            for (joint, q) in arm.joints().iter().zip(q) {
                assert!(joint.limits.margin(*q) >= LIMIT_MARGIN);
            }
            if let Some(before) = before {
                for (a, b) in q.iter().zip(before) {
                    // 5 mm from row to row at most.
                    assert!((a - b).abs() < 0.1, "{a} after {b}");
                }
            }
            before = Some(q);
            let told = arm.clearance(q, false, 0.0);
            // Height: all capsules but base, first link and the one around the fingers.
            let mut lowest = f64::INFINITY;
            for (capsule, (.., radius)) in CAPSULES.iter().enumerate().take(11).skip(2) {
                let points = axis(&arm, q, capsule);
                let down = points.iter().fold(f64::INFINITY, |z, p| z.min(p.z));
                lowest = lowest.min(down - radius);
            }
            lowest = fingers(&arm, q).iter().fold(lowest, |z, p| z.min(p.z));
            assert!(lowest >= 0.0);
            // The slanted shank is not written down here, so the program may only tell less.
            assert!(told.table <= lowest + 1e-9 && told.table > lowest - 2e-3);
            // Self: three joints or more apart; points every few millimetres overestimate a little.
            let number = |k: usize| match CAPSULES[k].0 {
                "fr3_hand" => 7,
                link => link[8..].parse::<usize>().unwrap(),
            };
            let mut nearest = f64::INFINITY;
            for (a, (.., r)) in CAPSULES.iter().enumerate() {
                for (b, (.., s)) in CAPSULES.iter().enumerate().skip(a + 1) {
                    if number(b).abs_diff(number(a)) < 3 {
                        continue;
                    }
                    for p in axis(&arm, q, a) {
                        for x in axis(&arm, q, b) {
                            nearest = nearest.min(p.distance(x) - r - s);
                        }
                    }
                }
            }
            assert!(nearest >= OWN_MARGIN);
            assert!(
                told.own <= nearest + 1e-6 && told.own > nearest - 2e-3,
                "{told:?} {nearest}"
            );
        }
    }
}

/// A spline through rows by its slopes, at rest at both ends: not the form that the crate uses.
fn interpolated(times: &[f64], rows: &[f64], n: usize, at: &[f64]) -> Vec<Vec<f64>> {
    let count = times.len();
    let h: Vec<f64> = times.windows(2).map(|t| t[1] - t[0]).collect();
    let mut slopes = vec![vec![0.0; n]; count];
    for j in 0..n {
        let y = |k: usize| rows[k * n + j];
        // m[k-1]/h[k-1] + 2 m[k] (1/h[k-1] + 1/h[k]) + m[k+1]/h[k] = 3 (d[k-1]/h[k-1] + d[k]/h[k])
        let (mut c, mut d) = (vec![0.0; count], vec![0.0; count]);
        for k in 1..count - 1 {
            let (l, r) = (1.0 / h[k - 1], 1.0 / h[k]);
            let right = 3.0 * ((y(k) - y(k - 1)) * l * l + (y(k + 1) - y(k)) * r * r);
            let pivot = 2.0 * (l + r) - l * c[k - 1];
            c[k] = r / pivot;
            d[k] = (right - l * d[k - 1]) / pivot;
        }
        for k in (1..count - 1).rev() {
            slopes[k][j] = d[k] - c[k] * slopes[k + 1][j];
        }
    }
    at.iter()
        .map(|&t| {
            let k = times.partition_point(|x| *x <= t).clamp(1, count - 1) - 1;
            let s = ((t - times[k]) / h[k]).clamp(0.0, 1.0);
            let (a, b) = (
                (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s),
                s * (1.0 - s) * (1.0 - s),
            );
            let (c, d) = (s * s * (3.0 - 2.0 * s), -s * s * (1.0 - s));
            (0..n)
                .map(|j| {
                    a * rows[k * n + j]
                        + b * h[k] * slopes[k][j]
                        + c * rows[(k + 1) * n + j]
                        + d * h[k] * slopes[k + 1][j]
                })
                .collect()
        })
        .collect()
}

/// Differences of positions at 1 kHz, joints and tip, as a robot sees them.
fn assert_within(arm: &Arm, times: &[f64], rows: &[f64], slack: f64) {
    const DT: f64 = 1e-3;
    let rates = Rates::of(arm);
    let end = times[times.len() - 1];
    let ticks: Vec<f64> = (-4..(1e3 * end) as i32 + 5)
        .map(|k| f64::from(k) * DT + times[0])
        .collect();
    let q = interpolated(
        times,
        rows,
        7,
        &ticks
            .iter()
            .map(|t| t.clamp(times[0], end))
            .collect::<Vec<_>>(),
    );
    let tips: Vec<Pose> = q.iter().map(|q| arm.forward(q)).collect();
    let mut last: Option<[DVec3; 2]> = None;
    for k in 3..q.len() {
        for (j, bounds) in rates.joints.iter().enumerate() {
            let [a, b, c, d] = [0, 1, 2, 3].map(|m| q[k - m][j]);
            let v = (a - b) / DT;
            let acceleration = (a - 2.0 * b + c) / (DT * DT);
            let jerk = (a - 3.0 * b + 3.0 * c - d) / (DT * DT * DT);
            let [low, high] = rates.velocity(j, a);
            assert!(v >= low * slack && v <= high * slack, "v{j} {v}");
            assert!(
                acceleration.abs() <= bounds[1] * slack,
                "a{j} {acceleration}"
            );
            assert!(jerk.abs() <= bounds[2] * slack + 1.0, "j{j} {jerk}");
        }
        let v = (tips[k].position() - tips[k - 1].position()) / DT;
        let turn = tips[k].rotation() * tips[k - 1].rotation().conjugate();
        let w = 2.0 * turn.w.signum() * DVec3::new(turn.x, turn.y, turn.z) / DT;
        assert!(
            v.length() <= rates.translation[0] * slack && w.length() <= rates.rotation[0] * slack
        );
        if let Some([v0, w0]) = last {
            assert!((v - v0).length() / DT <= rates.translation[1] * slack);
            assert!((w - w0).length() / DT <= rates.rotation[1] * slack);
        }
        last = Some([v, w]);
    }
}

#[test]
fn timed_motions_violate_nothing() {
    let arm = Arm::fr3();
    for (from, to, seconds) in [(0.0, 0.0, 3.0), (30.0, -30.0, 1.0)] {
        let mut log = fold(0.02, from, to, false);
        for sample in &mut log.samples {
            sample.time *= seconds / 3.0;
        }
        let (placement, path) = path(&log, BESIDE);
        let found = reach(&arm, &log, &placement).unwrap();
        let timing = found.timing.unwrap();
        // The whole motion, home to home.
        let motion = &timing.motion;
        assert_within(&arm, &motion.times, &motion.q, 1.005);
        let ends = motion.q[..7].iter().zip(&motion.q[motion.q.len() - 7..]);
        assert!(ends.into_iter().all(|(a, b)| (a - b).abs() < 1e-12));
        // The log as fast as can be; rows at its own period that start and end where it does.
        let fastest = &timing.fastest;
        let ends = |log: &Log| {
            [
                log.samples[0].command,
                log.samples[log.samples.len() - 1].command,
            ]
        };
        assert_eq!(ends(fastest), ends(&log));
        let times: Vec<f64> = fastest.samples.iter().map(|sample| sample.time).collect();
        assert_within(&arm, &times, &timing.fastest_q, 1.005);
        for (sample, q) in fastest.samples.iter().zip(timing.fastest_q.chunks(7)) {
            let tip = placement.tip(&sample.command.pose, log.tip_offset);
            assert!(arm.forward(q).position().distance(tip.position()) < 1e-9);
        }
        // Hardly slower than it has to be.
        let used = slow_down(&usage(&arm, &Rates::of(&arm), &times, &timing.fastest_q));
        assert!(used > 0.95 && used <= 1.0, "{used}");
        assert!(times[times.len() - 1] < timing.least * 1.1);
        // The smallest slow-down: with it the bounds are just kept, with a little less they are not.
        let times: Vec<f64> = log.samples.iter().map(|sample| sample.time).collect();
        let slowed = |factor: f64| {
            let times: Vec<f64> = times.iter().map(|t| factor * t).collect();
            slow_down(&usage(&arm, &Rates::of(&arm), &times, &path))
        };
        if seconds < 3.0 {
            assert!(timing.slow_down > 1.05);
            assert!((slowed(timing.slow_down) - 1.0).abs() < 2e-3);
            assert!(slowed(0.99 * timing.slow_down) > 1.005);
        } else {
            assert_eq!(timing.slow_down, 1.0);
            assert!(slowed(1.0) < 1.0);
        }
    }
}

#[test]
fn poses_of_a_faster_log_stay_on_the_path() {
    let arm = Arm::fr3();
    let log = fold(0.02, 30.0, -30.0, false);
    let (placement, _) = path(&log, BESIDE);
    let timing = reach(&arm, &log, &placement).unwrap().timing.unwrap();
    for sample in &timing.fastest.samples {
        let p = sample.command.pose.position();
        // z over y is the parabola, whatever the time.
        let s = (0.295 - p.y) / 0.59;
        assert!((p.z - (0.02 + 1.2 * s * (1.0 - s))).abs() < 2e-6, "{p}");
        assert!((p.x - 0.21).abs() < 2e-6);
        let tilt = f64::to_radians(30.0 - 60.0 * s);
        let turn = sample
            .command
            .pose
            .rotation()
            .dot(DQuat::from_rotation_x(tilt))
            .abs();
        assert!(turn > 1.0 - 1e-10);
    }
}

#[test]
fn the_same_input_gives_the_same_bits() {
    let arm = Arm::fr3();
    let log = fold(0.02, 20.0, -20.0, false);
    let [a, b] =
        [0, 1].map(|_| format!("{:?}", reach(&arm, &log, &placement(BESIDE, true)).unwrap()));
    assert_eq!(a, b);
    let [a, b] = [0, 1].map(|_| format!("{:?}", search(&arm, &log, 0.0, 0.0).unwrap()));
    assert_eq!(a, b);
}

#[test]
fn signs_of_quaternions_change_nothing() {
    let arm = Arm::fr3();
    let log = fold(0.02, 30.0, -30.0, false);
    let mut flipped = log.clone();
    for sample in flipped.samples.iter_mut().step_by(3) {
        let pose = sample.command.pose;
        sample.command.pose = Pose::from_unit(pose.position(), -pose.rotation());
    }
    let (placement, path) = path(&log, BESIDE);
    let other = joint_path(&arm, &flipped, &placement).unwrap().unwrap();
    assert!(path.iter().zip(&other).all(|(a, b)| (a - b).abs() < 1e-9));
}

#[test]
fn what_is_in_the_way_is_told() {
    let arm = Arm::fr3();
    let log = fold(0.05, 0.0, 0.0, false);
    let stop = |base: [f64; 4], log: &Log| reach(&arm, log, &placement(base, false)).unwrap();
    // The straight line from shoulder to wrist: a base further away by a millimetre misses by one.
    let far = |x: f64| match stop([x, 0.295, 0.0, 0.0], &log).blocked.unwrap().cause {
        Cause::OutOfReach { metres } => metres,
        cause => panic!("{cause}"),
    };
    let (near, further) = (far(-1.2), far(-1.201));
    assert!(further > near && (further - near) < 0.0011 && (further - near) > 0.0008);
    let text = stop([-1.2, 0.295, 0.0, 0.0], &log)
        .blocked
        .unwrap()
        .to_string();
    assert!(
        text.starts_with("on the way down to the grasp: out of reach by "),
        "{text}"
    );
    // Within reach at the start, not at the end.
    let late = stop([-0.2, 0.75, 0.0, -0.8], &log).blocked.unwrap();
    assert!(
        matches!(late.part, Part::Row(row, _) if row > 60 && row < 180),
        "{late}"
    );
    // In its own base.
    let text = stop([0.21, 0.2, 0.0, 0.0], &log)
        .blocked
        .unwrap()
        .to_string();
    println!("{text}");
    // Under the table, a centimetre too low.
    let low = fold(0.005, 0.0, 0.0, false);
    let blocked = stop(BESIDE, &low).blocked.unwrap();
    assert_eq!(blocked.part, Part::Row(0, 0.0));
    match blocked.cause {
        Cause::Table {
            below,
            any_base,
            link,
        } => {
            assert!(any_base && link.ends_with("finger"));
            // 9.5 mm of finger beyond a tip at 5 mm.
            assert!((below - 0.0045).abs() < 1e-4);
        }
        cause => panic!("{cause}"),
    }
    let raised = stop(BESIDE, &low).offers;
    assert!(
        raised.contains(&Offer::Raise { metres: 0.01 }),
        "{raised:?}"
    );
}

/// Fingers down at the start and up at the end: for no base; but less, or symmetric and higher.
#[test]
fn a_flip_is_answered_with_what_is_possible() {
    let arm = Arm::fr3();
    let log = fold(0.02, 0.0, 180.0, false);
    let found = reach(&arm, &log, &placement(BESIDE, true)).unwrap();
    let blocked = found.blocked.unwrap();
    let text = blocked.to_string();
    println!("{text}\n{:?}", found.offers);
    assert!(text.contains("whatever the posture and the base"), "{text}");
    let Part::Row(row, _) = blocked.part else {
        panic!("{blocked}");
    };
    // Low again towards the end.
    assert!(row > ROWS / 2);
    let mut turned = false;
    let mut symmetric = false;
    for offer in &found.offers {
        match *offer {
            Offer::Turn { asked, possible } => {
                assert!((asked.to_degrees() - 180.0).abs() < 1e-6);
                assert!(possible.to_degrees() > 30.0 && possible.to_degrees() < 80.0);
                turned = true;
            }
            Offer::Symmetric { possible, .. } => symmetric |= possible.to_degrees() > 60.0,
            _ => {}
        }
    }
    assert!(turned && symmetric);
}

#[test]
fn an_arm_of_another_shape_is_followed_by_numbers() {
    let text = include_str!("../../../fixtures/franka/fr3.urdf");
    // A millimetre off the pattern: no exact inverse.
    let other = text.replacen(
        "<origin xyz=\"0.088 0 0\"",
        "<origin xyz=\"0.088 0.001 0\"",
        1,
    );
    let arm = Arm::from_urdf(&other, "fr3_link0", "fr3_hand_tcp").unwrap();
    assert!(arm.inverse(&Pose::IDENTITY, 0.0, 0.0).is_err());
    let log = fold(0.05, 0.0, 0.0, false);
    let found = reach(&arm, &log, &placement(BESIDE, true)).unwrap();
    assert!(found.blocked.is_none(), "{:?}", found.blocked);
    for (sample, row) in log.samples.iter().zip(&found.rows) {
        let tip = found.placement.tip(&sample.command.pose, log.tip_offset);
        let q = &row.posture.as_ref().unwrap().q;
        assert!(arm.forward(q).position().distance(tip.position()) < 1e-9);
    }
    assert!(Rates::of(&arm).assumed && found.timing.is_some());
    let far = reach(&arm, &log, &placement([-1.5, 0.0, 0.0, 0.0], false)).unwrap();
    assert!(
        far.blocked
            .unwrap()
            .to_string()
            .contains("no posture was found")
    );
}

#[test]
fn a_log_that_no_arm_should_follow_is_refused() {
    let arm = Arm::fr3();
    let refusal = |change: &dyn Fn(&mut Log)| {
        let mut log = fold(0.02, 0.0, 0.0, false);
        change(&mut log);
        let error = reach(&arm, &log, &placement(BESIDE, false)).unwrap_err();
        assert_eq!(
            search(&arm, &log, 0.0, 0.0).unwrap_err().to_string(),
            error.to_string()
        );
        error.to_string()
    };
    let shifted = |pose: Pose, by: f64| Pose::from_translation(pose.position() + DVec3::X * by);
    for (message, words) in [
        (
            refusal(&|log| log.samples.clear()),
            "the log: rows is 0, must be 2 at least",
        ),
        (
            refusal(&|log| log.samples.truncate(1)),
            "rows is 1, must be 2 at least",
        ),
        (
            refusal(&|log| log.samples[3].command.pose = Pose::from_translation(DVec3::NAN)),
            "row 4 (t = 0.04522613065326633 s): px is NaN, must be a finite number of metres",
        ),
        (
            refusal(&|log| {
                for sample in &mut log.samples {
                    let p = sample.command.pose.position();
                    sample.command.pose = Pose::from_translation(1e3 * p);
                }
            }),
            "row 1 (t = 0 s): px is 210, must be a finite number of metres, at most 10 (is it in \
             millimetres?)",
        ),
        (
            refusal(&|log| log.tip_offset.z = -37.0),
            "tip_offset_m: z is -37, must be",
        ),
        (
            refusal(&|log| log.samples[9].time = log.samples[8].time),
            "row 10 (t = 0.12060301507537688 s): t is 0.12060301507537688 after",
        ),
        (
            refusal(&|log| log.samples[9].time = f64::INFINITY),
            "row 10 (t = inf s): t is inf",
        ),
        (
            refusal(&|log| log.samples.iter_mut().for_each(|sample| sample.time *= 1e3)),
            "must be within 600 s of the first (is it in milliseconds?)",
        ),
        (
            refusal(&|log| log.samples[9].time = log.samples[8].time + 1e-9),
            "must be 0.1 ms after the one before at least",
        ),
        (
            refusal(&|log| {
                log.samples[99].command.pose = shifted(log.samples[99].command.pose, 0.2);
            }),
            "position is 0.2",
        ),
        (
            refusal(&|log| {
                let pose = log.samples[50].command.pose;
                let turned = DQuat::from_rotation_z(1.0);
                log.samples[50].command.pose = Pose::from_unit(pose.position(), turned);
            }),
            "rotation is 1.0000 rad from it, must be 0.5 rad from the row before at most",
        ),
    ] {
        assert!(message.contains(words), "{message}");
    }
    let degrees = include_str!("../../../fixtures/franka/fr3.urdf").replace("2.7437", "157.2");
    let arm = Arm::from_urdf(&degrees, "fr3_link0", "fr3_hand_tcp").unwrap();
    let error = reach(
        &arm,
        &fold(0.02, 0.0, 0.0, false),
        &placement(BESIDE, false),
    )
    .unwrap_err();
    assert!(
        error
            .to_string()
            .contains("fr3_joint1: limits is -157.2 to 157.2"),
        "{error}"
    );
}

/// Numbers in [0, 1) from a fixed generator.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }
}

/// Whatever the log does and wherever the base is there is an answer, and when that is a motion the
/// motion keeps its bounds.
#[test]
fn odd_logs_and_places_have_an_answer() {
    let mut random = Random(11);
    let mut possible = 0;
    for number in 0..60 {
        let arm = if number % 2 == 0 {
            Arm::fr3()
        } else {
            Arm::fer()
        };
        let rows = 2 + (60.0 * random.next()) as usize;
        let period = random.between(0.005, 0.1);
        let start = DVec3::new(0.2, 0.2, random.between(0.01, 0.3));
        let step = DVec3::new(
            random.between(-0.02, 0.02),
            random.between(-0.02, 0.02),
            random.between(-0.002, 0.005),
        );
        let turn = random.between(-0.1, 0.1);
        let mut log = Log::new("odd");
        let mut at = 0.0;
        for k in 0..rows {
            // On and on, back and forth, at rest, at rest but for rounding, or with pauses.
            at += match number % 5 {
                0 => 1.0,
                1 if k % 8 < 4 => 1.0,
                1 => -1.0,
                2 => 0.0,
                3 => 0.9e-8 * (random.next() - 0.5),
                _ if k % 12 < 6 => 1.0,
                _ => 0.0,
            };
            let pose = Pose::new(start + step * at, DQuat::from_rotation_x(turn * at)).unwrap();
            let jaw = match random.next() < 0.1 * f64::from(number % 3) {
                true => Jaw::Open,
                false => Jaw::Closed,
            };
            let command = Command { pose, jaw };
            let time = period * k as f64;
            log.samples.push(Sample { time, command });
        }
        let base = [
            random.between(-0.6, 0.8),
            random.between(-0.6, 0.8),
            random.between(-0.2, 0.2),
            random.between(-3.0, 3.0),
        ];
        let found = either(&arm, &log, &placement(base, false)).unwrap();
        assert_eq!(found.rows.len(), rows);
        let Some(timing) = &found.timing else {
            let words = found
                .blocked
                .map(|blocked| blocked.to_string())
                .unwrap_or_default();
            assert!(!words.contains("NaN") && !words.contains("inf"), "{words}");
            continue;
        };
        possible += 1;
        let rates = Rates::of(&arm);
        let motion = &timing.motion;
        assert!(slow_down(&usage(&arm, &rates, &motion.times, &motion.q)) <= 1.0);
        let times: Vec<f64> = timing
            .fastest
            .samples
            .iter()
            .map(|sample| sample.time)
            .collect();
        assert!(slow_down(&usage(&arm, &rates, &times, &timing.fastest_q)) <= 1.0);
        for row in &found.rows {
            let posture = row.posture.as_ref().unwrap();
            assert!(posture.margin >= LIMIT_MARGIN && posture.clearance.own >= OWN_MARGIN);
            assert!(posture.clearance.table >= 0.0);
        }
    }
    println!("{possible} of 60 are possible");
    assert!(possible >= 10, "{possible}");
}
