//! Which folds an arm can follow, and what a path, a time law and a report must keep: looked at with
//! forward kinematics and differences, not with the code that made them.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use selvedge_franka::{
    Arm, Cause, LIMIT_MARGIN, OWN_MARGIN, Offer, Part, Placement, Rates, best, joint_path, reach,
    search, slow_down, usage,
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
