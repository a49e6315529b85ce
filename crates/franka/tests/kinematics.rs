//! Forward and inverse kinematics of the Franka arms.
//!
//! `fixtures/franka/reference.json` has configurations with pose and Jacobian computed by another
//! program (pinocchio) from the maker's own description.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

use selvedge_franka::{Arm, Solution, manipulability};
use selvedge_math::{DQuat, DVec3, Pose};

/// Numbers of a fixed linear congruential generator.
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

    /// A configuration within the limits.
    fn configuration(&mut self, arm: &Arm) -> [f64; 7] {
        std::array::from_fn(|k| {
            let limits = arm.joints()[k].limits;
            self.between(limits.lower, limits.upper)
        })
    }
}

fn reference(key: &str) -> Vec<serde_json::Value> {
    let path = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../fixtures/franka/reference.json"
    );
    let text = std::fs::read_to_string(path).unwrap();
    let all: serde_json::Value = serde_json::from_str(&text).unwrap();
    all[key].as_array().unwrap().clone()
}

fn numbers(value: &serde_json::Value) -> Vec<f64> {
    serde_json::from_value(value.clone()).unwrap()
}

#[test]
fn forward_and_jacobian_agree_with_the_reference() {
    for (arm, key) in [(Arm::fr3(), "fr3_hand_tcp"), (Arm::fer(), "panda_hand_tcp")] {
        let cases = reference(key);
        assert!(cases.len() >= 100);
        for case in cases {
            let q = numbers(&case["q"]);
            let mut columns = [[0.0; 6]; 7];
            let pose = arm.jacobian(&q, &mut columns);
            assert_eq!(pose, arm.forward(&q));
            let position = DVec3::from_slice(&numbers(&case["position"]));
            let rotation = DQuat::from_slice(&numbers(&case["quaternion_xyzw"]));
            let turn = pose.rotation() * rotation.conjugate();
            assert!(pose.position().distance(position) < 1e-12);
            assert!(2.0 * DVec3::new(turn.x, turn.y, turn.z).length() < 1e-12);
            for (r, row) in case["jacobian"].as_array().unwrap().iter().enumerate() {
                for (c, value) in numbers(row).iter().enumerate() {
                    assert!((columns[c][r] - value).abs() < 1e-12);
                }
            }
        }
    }
}

#[test]
fn jacobian_is_the_derivative_of_forward() {
    let arm = Arm::fr3();
    let mut random = Random(3);
    for _ in 0..100 {
        let q = random.configuration(&arm);
        let mut columns = [[0.0; 6]; 7];
        arm.jacobian(&q, &mut columns);
        for (k, column) in columns.iter().enumerate() {
            const H: f64 = 1e-6;
            let at = |h: f64| {
                let mut moved = q;
                moved[k] += h;
                arm.forward(&moved)
            };
            let (after, before) = (at(H), at(-H));
            let linear = (after.position() - before.position()) / (2.0 * H);
            let turn = after.rotation() * before.rotation().conjugate();
            let angular = 2.0 * turn.w.signum() * DVec3::new(turn.x, turn.y, turn.z) / (2.0 * H);
            assert!(linear.distance(DVec3::from_slice(&column[..3])) < 1e-8);
            assert!(angular.distance(DVec3::from_slice(&column[3..])) < 1e-8);
        }
    }
}

/// Distance between two poses: metres plus radians.
fn off(a: &Pose, b: &Pose) -> f64 {
    let turn = a.rotation().conjugate() * b.rotation();
    a.position().distance(b.position()) + 2.0 * DVec3::new(turn.x, turn.y, turn.z).length()
}

/// What the inverse made of the pose of one configuration.
struct Answer {
    count: usize,
    /// Largest residual of the solutions, see [`off`].
    residual: f64,
    /// How far the nearest solution is from the configuration in any joint [rad].
    distance: f64,
    /// Whether that solution is within the limits.
    in_limits: bool,
    /// Whether any has a free shoulder.
    free: bool,
}

fn difference(a: f64, b: f64) -> f64 {
    let turns = (a - b) / (2.0 * PI);
    (turns - turns.round()).abs() * 2.0 * PI
}

fn answer(arm: &Arm, q: &[f64; 7]) -> Answer {
    let target = arm.forward(q);
    let solutions = arm.inverse(&target, q[6], q[0]).unwrap();
    let mut answer = Answer {
        count: solutions.as_slice().len(),
        residual: 0.0,
        distance: f64::INFINITY,
        in_limits: false,
        free: solutions.as_slice().iter().any(|s| s.free_shoulder),
    };
    for solution in solutions.as_slice() {
        let residual = off(&arm.forward(&solution.q), &target);
        assert!(residual.is_finite(), "{q:?} -> {solution:?}");
        answer.residual = answer.residual.max(residual);
        let mut joints = solution.q.iter().zip(arm.joints());
        let within = joints.all(|(q, joint)| joint.limits.contain(*q));
        assert_eq!(within, solution.in_limits);
        let joints = solution.q.iter().zip(q);
        let distance = joints.fold(0.0_f64, |d, (a, b)| d.max(difference(*a, *b)));
        if distance < answer.distance {
            answer.distance = distance;
            answer.in_limits = within;
        }
    }
    answer
}

/// Counts over many configurations.
#[derive(Debug, Default)]
struct Tally {
    poses: usize,
    none: usize,
    wrong: usize,
    lost: usize,
    worst_residual: f64,
    worst_distance: f64,
    free: bool,
}

impl Tally {
    /// `tolerance` [rad] is what the nearest solution may be from `q`.
    fn add(&mut self, arm: &Arm, q: &[f64; 7], tolerance: f64) {
        let answer = answer(arm, q);
        self.poses += 1;
        self.none += usize::from(answer.count == 0);
        self.wrong += usize::from(answer.residual > 1e-10);
        self.lost += usize::from(answer.distance > tolerance);
        self.worst_residual = self.worst_residual.max(answer.residual);
        self.worst_distance = self.worst_distance.max(answer.distance);
        self.free |= answer.free;
    }

    /// A free shoulder spends some of what a residual may be, a joint put on its limit a little.
    fn bound(&self) -> f64 {
        if self.free { 3e-11 } else { 3e-12 }
    }

    #[track_caller]
    fn check(&self, region: &str) {
        println!("{region}: {self:?}");
        assert!(self.poses > 0, "{region}");
        assert_eq!(
            (self.none, self.wrong, self.lost),
            (0, 0, 0),
            "{region}: {self:?}"
        );
        assert!(self.worst_residual < self.bound(), "{region}: {self:?}");
    }
}

/// Where the elbow is stretched: shoulder, elbow and wrist in one line.
const STRETCH: f64 = -0.46700242365301164;

/// What the pose of `q`, rounded, tells of `q` [rad]: all digits but three, half of those that are
/// left where the elbow is stretched or folded, half of the rest where `q5` is at a quarter turn, and of `q1`
/// and `q3` less the smaller `q2` is.
fn known(q: &[f64; 7]) -> f64 {
    const DIGITS: f64 = 2e-14;
    let at_fold = |error: f64, distance: f64| error.sqrt().min(error / distance);
    let elbow = 10.0 * at_fold(DIGITS, (q[3] - STRETCH).sin().abs());
    let wrist = at_fold(elbow, q[4].cos().abs());
    if q[1].abs() <= 1e-12 && wrist < 5e-12 {
        // One of the class, for which q1 is given
        return 100.0 * wrist;
    }
    (wrist.min(1e-3) / q[1].sin().abs()).min(PI)
}

/// Whether the pose determines the configuration to less than 1e-7.
fn near_a_fold(q: &[f64; 7]) -> bool {
    known(q) > 1e-7
}

#[test]
fn a_million_poses_have_no_wrong_and_no_lost_solution() {
    let mut random = Random(1);
    for arm in [Arm::fr3(), Arm::fer()] {
        let (mut away, mut near) = (Tally::default(), Tally::default());
        for _ in 0..500_000 {
            let q = random.configuration(&arm);
            if near_a_fold(&q) {
                near.add(&arm, &q, known(&q));
            } else {
                away.add(&arm, &q, 1e-7);
            }
        }
        away.check("random");
        near.check("random, near a fold");
        assert!(near.poses < 500, "{near:?}");
    }
}

#[test]
fn at_the_stretch_and_beside_it() {
    let mut random = Random(2);
    for arm in [Arm::fr3(), Arm::fer()] {
        for offset in [0.0, 1e-10, 1e-9, 1e-8, 3e-8, 1e-7, 1e-6, 1e-5, 1e-3] {
            for q4 in [STRETCH - offset, STRETCH + offset] {
                let mut tally = Tally::default();
                for _ in 0..3000 {
                    let mut q = random.configuration(&arm);
                    q[3] = q4;
                    tally.add(&arm, &q, known(&q));
                }
                tally.check(&format!("stretch and {offset:e}"));
            }
        }
    }
    let arm = Arm::fr3();
    let q = [0.3, -0.4, 0.2, STRETCH, 0.1, 1.8, 0.6];
    let answer = answer(&arm, &q);
    assert!(answer.distance < 1e-7 && answer.in_limits);
    assert!(answer.count >= 4 && answer.residual < 1e-13);
}

/// What no Franka can do its geometry still can: the folded elbow, joints turned all the way.
#[test]
fn out_of_the_limits_nothing_is_wrong_or_lost() {
    let folded = STRETCH - PI;
    let mut random = Random(8);
    let arm = Arm::fr3();
    let (mut any, mut inner) = (Tally::default(), Tally::default());
    for k in 0..100_000 {
        let mut q: [f64; 7] = std::array::from_fn(|_| random.between(-PI, PI));
        if !near_a_fold(&q) && difference(q[3], folded) > 1e-3 && q[3].abs() > 1e-3 {
            any.add(&arm, &q, 1e-7);
        }
        q[3] = folded + [0.0, 1e-8, -1e-8, 3e-8, -3e-8, 1e-6, -1e-6][k % 7];
        inner.add(&arm, &q, known(&q));
        q[4] = if k % 2 == 0 { FRAC_PI_2 } else { -FRAC_PI_2 };
        inner.add(&arm, &q, known(&q));
    }
    any.check("any angles");
    inner.check("folded elbow");
}

#[test]
fn just_out_of_reach_is_not_rounding() {
    let arm = Arm::fr3();
    let mut random = Random(7);
    for _ in 0..1000 {
        let mut q = random.configuration(&arm);
        q[3] = STRETCH;
        q[4] = random.between(-1.0, 1.0);
        let target = arm.forward(&q);
        let wrist = arm.link_pose(&q, "fr3_link5").unwrap().position();
        let outward = (wrist - DVec3::new(0.0, 0.0, 0.333)).normalize();
        let count = |distance: f64| {
            let target = Pose::from_unit(target.position() + distance * outward, target.rotation());
            let solutions = arm.inverse(&target, q[6], q[0]).unwrap();
            for solution in solutions.as_slice() {
                assert!(off(&arm.forward(&solution.q), &target) < 1e-12);
            }
            solutions.as_slice().len()
        };
        assert_eq!((count(1e-9), count(1e-13)), (0, 0), "{q:?}");
        assert_eq!((count(0.0) >= 4, count(-1e-9)), (true, 8), "{q:?}");
    }
}

#[test]
fn at_the_fold_of_the_wrist_and_beside_it() {
    let mut random = Random(3);
    for arm in [Arm::fr3(), Arm::fer()] {
        for offset in [0.0, 1e-12, 1e-8, 3e-8, 1e-6, 1e-4] {
            let mut tally = Tally::default();
            let mut both = Tally::default();
            for k in 0..10_000 {
                let mut q = random.configuration(&arm);
                let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                q[4] = sign * (FRAC_PI_2 - offset);
                tally.add(&arm, &q, known(&q));
                q[4] = sign * (FRAC_PI_2 + offset);
                tally.add(&arm, &q, known(&q));
                // Both folds at once
                q[1] = if k % 3 == 0 { 0.5 } else { -0.9 };
                q[3] = STRETCH + [0.0, 1e-8, -1e-8, 3e-8, -3e-8, 1e-6, -1e-6][k % 7];
                both.add(&arm, &q, known(&q));
            }
            tally.check(&format!("quarter turn of q5 and {offset:e}"));
            both.check(&format!("both folds and {offset:e}"));
        }
    }
    let arm = Arm::fr3();
    let q = [
        -2.0909, -1.0132, -0.6545, -0.4959, FRAC_PI_2, 2.3840, -0.1160,
    ];
    assert!(answer(&arm, &q).distance < 1e-6);
}

#[test]
fn at_the_limits_and_near_the_shoulder_singularity() {
    let mut random = Random(5);
    for arm in [Arm::fr3(), Arm::fer()] {
        let (mut shoulder, mut elbow, mut limit, mut corner) = Default::default();
        let tallies: [&mut Tally; 4] = [&mut shoulder, &mut elbow, &mut limit, &mut corner];
        let [shoulder, elbow, limit, corner] = tallies;
        let tolerance = |q: &[f64; 7]| known(q).max(1e-7);
        for _ in 0..50_000 {
            let mut q = random.configuration(&arm);
            q[1] = random.between(-0.045, 0.045);
            shoulder.add(&arm, &q, tolerance(&q));
            let mut q = random.configuration(&arm);
            q[3] = random.between(-0.48, arm.joints()[3].limits.upper);
            elbow.add(&arm, &q, tolerance(&q));
            let mut q = random.configuration(&arm);
            let joint = (random.next() * 7.0) as usize;
            let limits = arm.joints()[joint].limits;
            q[joint] = [limits.lower, limits.upper][usize::from(random.next() < 0.5)];
            limit.add(&arm, &q, tolerance(&q));
            // All joints at a limit
            let q: [f64; 7] = std::array::from_fn(|k| {
                let limits = arm.joints()[k].limits;
                [limits.lower, limits.upper][usize::from(random.next() < 0.5)]
            });
            corner.add(&arm, &q, 1e-7);
        }
        shoulder.check("near the shoulder singularity");
        elbow.check("stretched branch");
        limit.check("at a limit");
        corner.check("all at a limit");
        for tiny in [1e-3, 1e-6, 1e-9, 1e-10, 2e-11, 9e-12, 1e-12, 1e-15, 0.0] {
            let mut tally = Tally::default();
            for _ in 0..3000 {
                let mut q = random.configuration(&arm);
                q[1] = tiny;
                tally.add(&arm, &q, known(&q));
            }
            tally.check(&format!("q2 = {tiny:e}"));
        }
    }
}

/// A joint at its limit is not told to be beyond it because of rounding.
#[test]
fn at_a_limit_is_within_the_limits() {
    let mut random = Random(9);
    for arm in [Arm::fr3(), Arm::fer()] {
        for k in 0..20_000 {
            let mut q = random.configuration(&arm);
            let limits = arm.joints()[k % 7].limits;
            q[k % 7] = [limits.lower, limits.upper][k / 7 % 2];
            if known(&q) < 3e-12 {
                assert!(answer(&arm, &q).in_limits, "{q:?}");
            }
        }
    }
}

#[test]
fn at_multiples_of_an_eighth_turn() {
    for arm in [Arm::fr3(), Arm::fer()] {
        let choices: Vec<Vec<f64>> = arm
            .joints()
            .iter()
            .map(|joint| {
                let all = (-4..=8).map(|k| f64::from(k) * FRAC_PI_4);
                all.filter(|q| joint.limits.contain(*q)).collect()
            })
            .collect();
        let mut tally = Tally::default();
        let mut index = [0; 7];
        loop {
            let q: [f64; 7] = std::array::from_fn(|k| choices[k][index[k]]);
            tally.add(&arm, &q, known(&q));
            let Some(k) = (0..7).find(|&k| index[k] + 1 < choices[k].len()) else {
                break;
            };
            index[k] += 1;
            index[..k].fill(0);
        }
        tally.check("eighths of a turn");
        assert!(tally.poses > 10_000, "{tally:?}");
    }
}

/// The forearm's axis through the shoulder, as it is with `q4 = 0`, outside the limits.
#[test]
fn with_the_elbow_free_the_whole_class_is_told() {
    let arm = Arm::fr3();
    let mut random = Random(6);
    for offset in [0.0, 1e-15, 1e-13, 1e-12, 3e-12, 1e-10, 1e-8, 1e-6, 1e-3] {
        for _ in 0..3000 {
            let mut q = random.configuration(&arm);
            q[3] = offset * (2.0 * random.next() - 1.0);
            let target = arm.forward(&q);
            let answer = answer(&arm, &q);
            assert!(answer.count > 0, "{q:?}");
            assert!(answer.residual < 1e-11, "{q:?}: {:e}", answer.residual);
            let solutions = arm.inverse(&target, q[6], q[0]).unwrap();
            let free = |s: &&Solution| s.free_elbow;
            for solution in solutions.as_slice().iter().filter(free) {
                assert!(solution.q[4] == 0.0 && !solution.in_limits);
                let mut other = solution.q;
                other[2] += 0.3;
                other[4] -= 0.3;
                assert!(off(&arm.forward(&other), &target) < 1e-10);
            }
            let sum = q[2] + q[4];
            let same = |s: &Solution| s.free_elbow && difference(s.q[2] + s.q[4], sum) < 1e-9;
            if offset == 0.0 {
                let known = q[1].abs() < 1e-2 || solutions.as_slice().iter().any(same);
                assert!(known, "{q:?}");
            } else if offset >= 1e-8 && q[3].abs() > 1e-2 * offset && q[1].abs() > 1e-2 {
                let bound = 1e-12 / q[3].abs() / q[4].cos().abs();
                assert!(
                    answer.distance < bound.max(1e-9),
                    "{q:?} {}",
                    answer.distance
                );
            }
        }
    }
}

#[test]
fn at_the_shoulder_singularity_the_whole_class_is_told() {
    let arm = Arm::fr3();
    let mut random = Random(4);
    for _ in 0..1000 {
        let mut q = random.configuration(&arm);
        q[1] = 0.0;
        let target = arm.forward(&q);
        let solutions = arm.inverse(&target, q[6], q[0]).unwrap();
        let free: Vec<&Solution> = solutions
            .as_slice()
            .iter()
            .filter(|solution| solution.free_shoulder)
            .collect();
        assert!(!free.is_empty(), "{q:?}");
        for solution in free {
            // q1 is the one given, and any other with the same sum q1 + q3 does as well.
            assert!((solution.q[0] - q[0]).abs() < 1e-12);
            let mut other = solution.q;
            other[0] += 0.3;
            other[2] -= 0.3;
            assert!(off(&arm.forward(&other), &target) < 1e-10);
        }
    }
}

#[test]
fn what_is_out_of_reach_has_no_solution() {
    let arm = Arm::fr3();
    for p in [
        DVec3::new(2.0, 0.0, 0.5),
        DVec3::new(0.0, 0.0, 5.0),
        DVec3::new(0.0, 0.0, 0.333),
    ] {
        let target = Pose::from_translation(p);
        let solutions = arm.inverse(&target, 0.5, 0.0).unwrap();
        for solution in solutions.as_slice() {
            assert!(off(&arm.forward(&solution.q), &target) < 1e-10);
        }
        if p.length() > 1.5 {
            assert!(solutions.as_slice().is_empty());
        }
    }
    assert!(arm.inverse(&Pose::IDENTITY, f64::NAN, 0.0).is_err());
}

#[test]
fn limits_of_the_two_arms_filter_the_same_solutions() {
    let (fr3, fer) = (Arm::fr3(), Arm::fer());
    let q = [0.3, -0.4, 0.2, -2.1, 0.1, 3.9, 0.6];
    let in_limits = |arm: &Arm| {
        let solutions = arm.inverse(&arm.forward(&q), q[6], 0.0).unwrap();
        let near = |s: &Solution| s.q.iter().zip(&q).all(|(a, b)| (a - b).abs() < 1e-9);
        solutions.as_slice().iter().any(|s| s.in_limits && near(s))
    };
    // Joint 6 of the FR3 goes up to 4.5169, that of the FER to 3.7525.
    assert!(in_limits(&fr3) && !in_limits(&fer));
}

#[test]
fn manipulability_vanishes_where_the_arm_is_stretched() {
    let arm = Arm::fr3();
    let at = |q: [f64; 7]| {
        let mut columns = [[0.0; 6]; 7];
        arm.jacobian(&q, &mut columns);
        manipulability(&columns)
    };
    assert!(at([0.0, -0.5, 0.0, -2.2, 0.0, 1.8, 0.7]) > 0.05);
    // Shoulder, elbow and wrist in one line: a pull along it has no effect.
    assert!(at([0.0, 0.4, 0.0, -0.467002423653011, 0.0, 1.8, 0.7]) < 1e-3);
}
