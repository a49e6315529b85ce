//! Forward and inverse kinematics of the Franka arms.
//!
//! `fixtures/franka/reference.json` has configurations with pose and Jacobian computed by another
//! program (pinocchio) from the maker's own description.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use std::f64::consts::PI;

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
            assert!(pose.position().distance(position) < 1e-12);
            assert!(1.0 - pose.rotation().dot(rotation).abs() < 1e-12);
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

/// Asserts that every solution reaches the pose and returns whether `q` is among them.
fn check(arm: &Arm, q: &[f64; 7], tolerance: f64) -> bool {
    let target = arm.forward(q);
    let solutions = arm.inverse(&target, q[6], q[0]).unwrap();
    for solution in solutions.as_slice() {
        let residual = off(&arm.forward(&solution.q), &target);
        assert!(
            residual < 1e-10,
            "{q:?} -> {solution:?}: off by {residual:e}"
        );
        let within = solution
            .q
            .iter()
            .zip(arm.joints())
            .all(|(q, joint)| joint.limits.contain(*q));
        assert_eq!(within, solution.in_limits);
    }
    let same = |solution: &Solution| {
        solution.q.iter().zip(q).all(|(a, b)| {
            let turns = (a - b) / (2.0 * PI);
            (turns - turns.round()).abs() * 2.0 * PI < tolerance
        })
    };
    solutions.as_slice().iter().any(same)
}

#[test]
fn a_million_poses_have_no_wrong_and_no_lost_solution() {
    let mut random = Random(1);
    for arm in [Arm::fr3(), Arm::fer()] {
        let mut near_folds = 0;
        for _ in 0..500_000 {
            let q = random.configuration(&arm);
            if !check(&arm, &q, 1e-7) {
                // Near a fold two solutions meet, and each is determined to half the digits only.
                assert!(check(&arm, &q, 1e-4), "{q:?} was lost");
                near_folds += 1;
            }
        }
        assert!(near_folds < 50, "{near_folds}");
    }
}

#[test]
fn the_regions_where_others_fail() {
    let arm = Arm::fr3();
    let mut random = Random(2);
    for _ in 0..50_000 {
        // Upper arm nearly along the axis of joint 1
        let mut q = random.configuration(&arm);
        q[1] = random.between(-0.045, 0.045);
        assert!(check(&arm, &q, 1e-6), "{q:?}");
        // Nearly or fully stretched elbow, on both sides of the stretch
        let mut q = random.configuration(&arm);
        q[3] = random.between(-0.48, -0.1518);
        assert!(check(&arm, &q, 1e-4), "{q:?}");
        let mut q = random.configuration(&arm);
        q[3] = -0.467002423653011;
        check(&arm, &q, 1e-4);
        // At a limit
        let mut q = random.configuration(&arm);
        let joint = (random.next() * 7.0) as usize;
        q[joint] = arm.joints()[joint].limits.lower;
        assert!(check(&arm, &q, 1e-4), "{q:?}");
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
