//! What holds for every path, schedule and log, on random ones.

use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use selvedge_math::{Command, DQuat, DVec3, Jaw, Pose};
use selvedge_trajectory::log::{self, Log, Sample};
use selvedge_trajectory::{
    FoldTimes, Law, Motion, Orientation, QuadBezier, Rates, Schedule, Sweep,
};

/// The same cases in every run, and none of them written to a file.
fn config() -> ProptestConfig {
    ProptestConfig {
        cases: 256,
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(1),
        ..ProptestConfig::default()
    }
}

fn vector() -> impl Strategy<Value = DVec3> {
    [-1.0..1.0, -1.0..1.0, -1.0..1.0_f64].prop_map(DVec3::from)
}

fn quaternion() -> impl Strategy<Value = DQuat> {
    [-1.0..1.0, -1.0..1.0, -1.0..1.0, -1.0..1.0_f64]
        .prop_map(DQuat::from_array)
        .prop_filter("not near zero", |q| q.length() > 0.1)
        .prop_map(DQuat::normalize)
}

fn bezier() -> impl Strategy<Value = QuadBezier> {
    (vector(), vector(), vector()).prop_map(|(start, mid, end)| QuadBezier { start, mid, end })
}

fn orientation() -> impl Strategy<Value = Orientation> {
    prop_oneof![Just(Orientation::Slerp), Just(Orientation::Nlerp)]
}

fn law() -> impl Strategy<Value = Law> {
    prop_oneof![Just(Law::Linear), Just(Law::Cubic), Just(Law::Quintic)]
}

fn sweep() -> impl Strategy<Value = Sweep> {
    let parts = (
        bezier(),
        quaternion(),
        quaternion(),
        orientation(),
        vector(),
    );
    parts.prop_map(|(path, from, to, orientation, tip)| {
        Sweep::new(path, from, to, orientation, tip).expect("finite numbers")
    })
}

/// The derivative at 0 by central differences of fourth order.
fn slope<T>(h: f64, f: impl Fn(f64) -> T) -> T
where
    T: std::ops::Sub<Output = T> + std::ops::Add<Output = T> + std::ops::Mul<f64, Output = T>,
{
    (f(h) - f(-h)) * (8.0 / (12.0 * h)) + (f(-2.0 * h) - f(2.0 * h)) * (1.0 / (12.0 * h))
}

/// Velocity, acceleration and jerk of `at(0)` against differences of `at` over times of order `h`.
fn check_rates(h: f64, at: impl Fn(f64) -> Motion) -> Result<(), TestCaseError> {
    let near = |got: DVec3, expected: DVec3, what: &str| {
        let off = (got - expected).length() / (1.0 + expected.length());
        prop_assert!(
            off < 1e-6,
            "{what}: {got} is not {expected}, off by {off:e}"
        );
        Ok(())
    };
    let motion = at(0.0);
    // 2 dq/dt q* is the angular velocity.
    let turn = slope(h, |t| at(t).pose.rotation()) * motion.pose.rotation().conjugate();
    near(
        motion.velocity.angular,
        2.0 * turn.xyz(),
        "angular velocity",
    )?;
    near(
        motion.velocity.linear,
        slope(h, |t| at(t).pose.position()),
        "velocity",
    )?;
    for (what, got, below) in [
        (
            "acceleration",
            motion.acceleration,
            (|m| m.velocity) as fn(Motion) -> Rates,
        ),
        ("jerk", motion.jerk, |m| m.acceleration),
    ] {
        near(got.angular, slope(h, |t| below(at(t)).angular), what)?;
        near(got.linear, slope(h, |t| below(at(t)).linear), what)?;
    }
    Ok(())
}

fn same_rotation(a: DQuat, b: DQuat) -> bool {
    (a - b).length().min((a + b).length()) < 1e-14
}

/// Adaptive Simpson, from the values at the ends and the middle.
fn simpson(f: &impl Fn(f64) -> f64, a: f64, b: f64, depth: u32, tolerance: f64) -> f64 {
    let rule = |a: f64, b: f64| (b - a) / 6.0 * (f(a) + 4.0 * f(0.5 * (a + b)) + f(b));
    let m = 0.5 * (a + b);
    let (whole, halves) = (rule(a, b), rule(a, m) + rule(m, b));
    if depth == 0 || (halves - whole).abs() < 15.0 * tolerance {
        halves + (halves - whole) / 15.0
    } else {
        simpson(f, a, m, depth - 1, 0.5 * tolerance) + simpson(f, m, b, depth - 1, 0.5 * tolerance)
    }
}

proptest! {
    #![proptest_config(config())]

    /// Each point is the convex combination of the control points that Bernstein wrote down, and
    /// so inside their bounding box.
    #[test]
    fn a_bezier_stays_in_its_hull(path in bezier(), s in 0.0..=1.0_f64) {
        let p = path.eval(s);
        let r = 1.0 - s;
        let weighted = r * r * path.start + 2.0 * r * s * path.mid + s * s * path.end;
        prop_assert!((p - weighted).length() < 1e-15);
        let low = path.start.min(path.mid).min(path.end) - DVec3::splat(1e-15);
        let high = path.start.max(path.mid).max(path.end) + DVec3::splat(1e-15);
        prop_assert!(p.cmpge(low).all() && p.cmple(high).all());
    }

    #[test]
    fn derivatives_of_a_bezier(path in bezier(), s in -0.5..1.5_f64) {
        let first = slope(1e-2, |h| path.eval(s + h));
        prop_assert!((first - path.derivative(s)).length() < 1e-12);
        let second = slope(1e-2, |h| path.derivative(s + h));
        prop_assert!((second - path.second_derivative()).length() < 1e-12);
    }

    #[test]
    fn arc_length_is_the_integral_of_the_speed(path in bezier(), s in 0.0..=1.0_f64) {
        let speed = |s: f64| path.derivative(s).length();
        let expected = simpson(&speed, 0.0, s, 40, 1e-12);
        prop_assert!((path.length_to(s) - expected).abs() < 1e-10);
        prop_assert!((path.length_to(1.0) - path.length()).abs() < 1e-14);
        prop_assert!(path.length() >= path.start.distance(path.end) - 1e-15);
    }

    #[test]
    fn derivatives_of_a_law(law in law(), u in 0.01..0.99_f64) {
        let got = law.derivatives(u);
        let h = 1e-3;
        prop_assert!((slope(h, |h| law.eval(u + h)) - got[0]).abs() < 1e-9);
        prop_assert!((slope(h, |h| law.derivatives(u + h)[0]) - got[1]).abs() < 1e-9);
        prop_assert!((slope(h, |h| law.derivatives(u + h)[1]) - got[2]).abs() < 1e-9);
        prop_assert!(law.eval(u) < law.eval(u + 1e-3), "a law goes forward");
    }

    #[test]
    fn motion_of_a_sweep(
        sweep in sweep(),
        s in 0.1..0.9_f64,
        ds in -2.0..2.0_f64,
        dds in -2.0..2.0_f64,
        ddds in -2.0..2.0_f64,
    ) {
        check_rates(5e-4, |t| {
            let s = s + t * (ds + t * (dds / 2.0 + t * ddds / 6.0));
            sweep.motion(s, ds + t * (dds + t * ddds / 2.0), dds + t * ddds, ddds)
        })?;
        prop_assert_eq!(sweep.motion(s, ds, dds, ddds).pose, sweep.pose(s));
    }

    #[test]
    fn motion_of_a_schedule(sweep in sweep(), law in law(), u in 0.01..0.99_f64) {
        let times = FoldTimes { close: 0.5, start: 0.9, open: 2.4, end: 3.0 };
        let schedule = Schedule::fold(sweep, law, times).unwrap();
        let moving = times.start + u * (times.open - times.start);
        for t in [0.2, 0.7, moving, 2.7] {
            check_rates(5e-4, |h| schedule.motion(t + h))?;
            prop_assert_eq!(schedule.motion(t).pose, schedule.command(t).pose);
        }
    }

    #[test]
    fn the_tip_is_on_the_path(
        path in bezier(),
        from in quaternion(),
        to in quaternion(),
        orientation in orientation(),
        tip in vector(),
        s in 0.0..=1.0_f64,
    ) {
        let sweep = Sweep::new(path, from, to, orientation, tip).unwrap();
        prop_assert!((sweep.pose(s).transform(tip) - path.eval(s)).length() < 1e-14);
        prop_assert!((sweep.pose(s).rotation().length() - 1.0).abs() < 1e-15);
        prop_assert!(same_rotation(sweep.pose(0.0).rotation(), from));
        prop_assert!(same_rotation(sweep.pose(1.0).rotation(), to));
    }

    #[test]
    fn a_quaternion_and_its_negative_are_one_rotation(
        path in bezier(),
        from in quaternion(),
        to in quaternion(),
        orientation in orientation(),
        tip in vector(),
        s in 0.0..=1.0_f64,
    ) {
        let sweep = |from, to| Sweep::new(path, from, to, orientation, tip).unwrap();
        let expected = sweep(from, to).motion(s, 1.0, 2.0, 3.0);
        prop_assert_eq!(sweep(from, -to).motion(s, 1.0, 2.0, 3.0), expected);
        for to in [to, -to] {
            let got = sweep(-from, to).motion(s, 1.0, 2.0, 3.0);
            prop_assert_eq!(-got.pose.rotation(), expected.pose.rotation());
            prop_assert_eq!(got.pose.position(), expected.pose.position());
            prop_assert_eq!(got.jerk, expected.jerk);
        }
    }

    #[test]
    fn a_rigid_motion_of_the_path_moves_the_poses(
        path in bezier(),
        from in quaternion(),
        to in quaternion(),
        orientation in orientation(),
        tip in vector(),
        frame in (vector(), quaternion()).prop_map(|(p, q)| Pose::new(p, q).unwrap()),
        s in 0.0..=1.0_f64,
    ) {
        let turn = frame.rotation();
        let moved = QuadBezier {
            start: frame.transform(path.start),
            mid: frame.transform(path.mid),
            end: frame.transform(path.end),
        };
        let here = Sweep::new(path, from, to, orientation, tip).unwrap();
        let there = Sweep::new(moved, turn * from, turn * to, orientation, tip).unwrap();
        // The axis of a turn near a half turn jumps with a rounding of its ends.
        prop_assume!(here.angle() < 3.1);
        let (here, there) = (here.motion(s, 1.0, 2.0, 3.0), there.motion(s, 1.0, 2.0, 3.0));
        let expected = frame * here.pose;
        prop_assert!((there.pose.position() - expected.position()).length() < 1e-14);
        prop_assert!(same_rotation(there.pose.rotation(), expected.rotation()));
        for (there, here) in [
            (there.velocity, here.velocity),
            (there.acceleration, here.acceleration),
            (there.jerk, here.jerk),
        ] {
            let bound = 1e-13 * (1.0 + here.linear.length() + here.angular.length());
            prop_assert!((there.linear - turn * here.linear).length() < bound);
            prop_assert!((there.angular - turn * here.angular).length() < bound);
        }
    }

    /// Against the textbook formula, `(sin((1-s) w) q0 + sin(s w) q1) / sin w`.
    #[test]
    fn slerp_is_the_textbook_one(
        path in bezier(),
        from in quaternion(),
        to in quaternion(),
        s in 0.0..=1.0_f64,
    ) {
        let sweep = Sweep::new(path, from, to, Orientation::Slerp, DVec3::ZERO).unwrap();
        let to = if from.dot(to) < 0.0 { -to } else { to };
        let w = from.dot(to).acos();
        prop_assume!(w > 1e-3);
        prop_assert!((sweep.angle() - 2.0 * w).abs() < 1e-12);
        let expected = (from * ((1.0 - s) * w).sin() + to * (s * w).sin()) / w.sin();
        prop_assert!((sweep.pose(s).rotation() - expected).length() < 1e-12);
    }

    /// Nlerp passes through the orientations of slerp, later or earlier.
    #[test]
    fn nlerp_runs_along_slerp(
        path in bezier(),
        from in quaternion(),
        to in quaternion(),
        s in 0.0..=1.0_f64,
    ) {
        let sweep = |orientation| Sweep::new(path, from, to, orientation, DVec3::ZERO).unwrap();
        let (slerp, nlerp) = (sweep(Orientation::Slerp), sweep(Orientation::Nlerp));
        let w = 0.5 * slerp.angle();
        prop_assume!(w > 1e-3);
        let phi = (s * w.sin()).atan2(1.0 - s + s * w.cos());
        let expected = slerp.pose(phi / w).rotation();
        prop_assert!((nlerp.pose(s).rotation() - expected).length() < 1e-12);
    }

    #[test]
    fn a_log_reads_back_to_the_bit(
        times in prop::collection::btree_set(-1000_i64..1000, 1..20),
        step in 1e-6..1.0_f64,
        poses in prop::collection::vec(
            ([prop::num::f64::NORMAL | prop::num::f64::SUBNORMAL | prop::num::f64::ZERO; 3],
             quaternion(), any::<bool>()),
            20,
        ),
        source in "[^\\p{Cc}]{0,40}",
        tip in vector(),
    ) {
        let samples = times.iter().zip(poses).map(|(&k, (p, q, closed))| Sample {
            time: k as f64 * step,
            command: Command {
                pose: Pose::new(DVec3::from(p), q).unwrap(),
                jaw: if closed { Jaw::Closed } else { Jaw::Open },
            },
        });
        let log = Log { tip_offset: tip, samples: samples.collect(), ..Log::new(source) };
        let mut bytes = Vec::new();
        log::write(&mut bytes, &log).unwrap();
        let back = log::read(bytes.as_slice(), "log").unwrap();
        prop_assert_eq!(&back, &log);
        // Equality takes 0 and -0 for one; the text does not.
        let mut again = Vec::new();
        log::write(&mut again, &back).unwrap();
        prop_assert_eq!(again, bytes);
    }

    #[test]
    fn no_text_makes_the_reader_panic(text in "(# [a-z_: ]{0,20}|[-0-9a-z.,\"]{0,40}|\n){0,12}") {
        let head = "# selvedge-log 1\n# frame: cloth\n# tip_offset_m: 0,0,0\n# source:\n";
        for text in [text.clone(), format!("{head}{text}")] {
            prop_assert!(log::read(text.as_bytes(), "log").is_err());
        }
    }
}
