//! How fast, how hard and how suddenly an arm may move.

use crate::Arm;
use crate::limits::Limits;

/// Bounds of velocity, acceleration and jerk.
#[derive(Clone, Debug, PartialEq)]
pub struct Rates {
    /// Of each joint [rad/s, rad/s^2, rad/s^3; m for a prismatic joint].
    pub joints: Vec<[f64; 3]>,
    /// Where a joint's velocity is bounded more tightly near the ends of its range.
    pub windows: Vec<Option<Window>>,
    /// Of the tip [m/s, m/s^2, m/s^3].
    pub translation: [f64; 3],
    /// Of the tip's rotation [rad/s, rad/s^2, rad/s^3].
    pub rotation: [f64; 3],
    /// Of the elbow, which is joint 3 [rad/s, rad/s^2, rad/s^3].
    pub elbow: [f64; 3],
    /// Whether the description told too little, so that some bounds are assumed.
    pub assumed: bool,
}

/// FR3's velocity bounds: `-c + sqrt(k (upper - q))` upwards and `-c + sqrt(k (q - lower))`
/// downwards, not below zero (libfranka, `rate_limiting.h`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window {
    /// `k` [rad/s^2].
    pub k: f64,
    /// `c` [rad/s].
    pub c: f64,
    /// Where the bound downwards ends [rad].
    pub lower: f64,
    /// Where the bound upwards ends [rad].
    pub upper: f64,
}

impl Rates {
    /// The bounds of an arm: those of the maker for FR3 and FER, known by shape and joint limits
    /// (frankaemika/docs, control parameters, and libfranka for the windows). For the elbow of FR3
    /// that page says 2.62 rad/s, libfranka's limiter 1.5; it bounds motions that are commanded as
    /// poses, and is 2.62 here. Any other description has velocities only: acceleration
    /// 10 rad/s^2 and jerk 5000 rad/s^3 (or metres) and the tip's bounds of FR3 are then assumed.
    pub fn of(arm: &Arm) -> Self {
        let ranges = |lower: [f64; 7], upper: [f64; 7]| {
            let same = |(l, (a, b)): (Limits, (f64, f64))| l.lower == a && l.upper == b;
            let limits = arm.joints().iter().map(|joint| joint.limits);
            arm.geometry().is_some() && limits.zip(lower.into_iter().zip(upper)).all(same)
        };
        let q = [2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159];
        let fr3 = ranges([-q[0], -q[1], -q[2], -3.0421, -q[4], 0.5445, -q[6]], q);
        let q = [2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973];
        let fer = ranges([-q[0], -q[1], -q[2], -3.0718, -q[4], -0.0175, -q[6]], q);
        let velocity = |k: usize| arm.joints()[k].limits.velocity;
        if fer {
            let acceleration = [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0];
            return Self {
                joints: acceleration
                    .iter()
                    .enumerate()
                    .map(|(k, &a)| [velocity(k), a, 500.0 * a])
                    .collect(),
                windows: vec![None; 7],
                translation: [1.7, 13.0, 6500.0],
                rotation: [2.5, 25.0, 12500.0],
                elbow: [2.175, 10.0, 5000.0],
                assumed: false,
            };
        }
        let k = [12.0, 5.17, 7.0, 8.0, 34.0, 11.0, 34.0];
        let c = [0.3, 0.2, 0.2, 0.3, 0.35, 0.35, 0.35];
        let upper = [2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196];
        let lower = [
            -2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196,
        ];
        let count = arm.joints().len();
        Self {
            joints: (0..count).map(|k| [velocity(k), 10.0, 5000.0]).collect(),
            windows: (0..count)
                .map(|j| {
                    fr3.then(|| Window {
                        k: k[j],
                        c: c[j],
                        lower: lower[j],
                        upper: upper[j],
                    })
                })
                .collect(),
            translation: [3.0, 9.0, 4500.0],
            rotation: [2.5, 17.0, 8500.0],
            elbow: match arm.geometry() {
                Some(_) => [2.62, 10.0, 5000.0],
                None => [f64::INFINITY; 3],
            },
            assumed: !fr3,
        }
    }

    /// The lowest and the highest velocity of joint `j` at position `q`.
    pub fn velocity(&self, j: usize, q: f64) -> [f64; 2] {
        let bound = self.joints[j][0];
        match self.windows[j] {
            None => [-bound, bound],
            Some(w) => {
                let slack = |distance: f64| (w.k * distance.max(0.0)).sqrt() - w.c;
                [
                    -slack(q - w.lower).max(0.0).min(bound),
                    slack(w.upper - q).max(0.0).min(bound),
                ]
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bounds_are_those_of_the_file() {
        let path = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../../fixtures/franka/limits.json"
        );
        let all: serde_json::Value =
            serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap();
        for (arm, key) in [(Arm::fr3(), "fr3"), (Arm::fer(), "panda")] {
            let rates = Rates::of(&arm);
            assert!(!rates.assumed);
            let of = &all[key];
            for j in 0..7 {
                let file = ["dq_max", "ddq_max", "dddq_max"].map(|k| of[k][j].as_f64().unwrap());
                assert_eq!(rates.joints[j], file);
                let window = &of["position_dependent_velocity"];
                let Some(w) = rates.windows[j] else {
                    assert!(window.is_null());
                    continue;
                };
                let number = |k: &str| window[k][j].as_f64().unwrap();
                let file = ["k", "c", "q_up", "q_lo"].map(number);
                assert_eq!([w.k, w.c, w.upper, -w.lower], file);
            }
            let tip = &of["cartesian"];
            for (name, ours) in [
                ("translation", rates.translation),
                ("rotation", rates.rotation),
                ("elbow", rates.elbow),
            ] {
                assert_eq!(
                    ["v", "a", "j"].map(|k| tip[name][k].as_f64().unwrap()),
                    ours
                );
            }
        }
    }

    #[test]
    fn velocity_falls_towards_a_limit() {
        let rates = Rates::of(&Arm::fr3());
        assert_eq!(rates.velocity(0, 0.0), [-2.62, 2.62]);
        // -0.3 + sqrt(12 0.1)
        let upper = rates.velocity(0, 2.6501)[1];
        assert!((upper - (1.2f64.sqrt() - 0.3)).abs() < 1e-12);
        assert_eq!(rates.velocity(0, 2.7501)[1], 0.0);
        assert_eq!(rates.velocity(0, -3.0)[0], 0.0);
        assert_eq!(rates.velocity(6, -3.0)[1], 5.26);
    }
}
