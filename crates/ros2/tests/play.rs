//! Whole runs without a network, in time that is counted only: the way of a run, and every fault.
#![allow(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use selvedge_franka::Placement;
use selvedge_math::{Command, DVec3, Jaw, Pose};
use selvedge_ros2::arm::{Arm, Measured, Recorded, Sink, Stream};
use selvedge_ros2::error::Cause;
use selvedge_ros2::gripper::{Gripper, RecordedJaws};
use selvedge_ros2::journal::Journal;
use selvedge_ros2::limits::Limits;
use selvedge_ros2::plan::{Plan, Request, Workspace};
use selvedge_ros2::play::{Policy, Settings, play};
use selvedge_ros2::segment::Segment;
use selvedge_ros2::state::State;
use selvedge_trajectory::log::{Log, Sample};

fn plan() -> Plan {
    let mut log = Log::new("sideways");
    for k in 0..=120 {
        let t = f64::from(k) / 60.0;
        let u = (t - 0.5).clamp(0.0, 1.0);
        let s = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
        let pose = Pose::from_translation(DVec3::new(0.0, 0.05 - 0.1 * s, 0.05));
        let closed = t > 0.25 && t < 1.75;
        let jaw = if closed { Jaw::Closed } else { Jaw::Open };
        let command = Command { pose, jaw };
        log.samples.push(Sample { time: t, command });
    }
    let placement = Placement::new([-0.5, 0.0, 0.0, 0.0], 0.0).unwrap();
    Plan::new(&Request {
        log: &log,
        placement: &placement,
        arm: None,
        speed: 0.5,
        limits: Limits::default(),
        workspace: Workspace::franka(0.0),
    })
    .unwrap()
}

fn counted() -> Settings {
    Settings {
        real_time: false,
        ..Settings::default()
    }
}

/// A robot that does something wrong after a number of poses.
struct Broken {
    inner: Recorded,
    after: usize,
    fault: fn(&mut Broken) -> Result<(), Cause>,
    age: f64,
}

impl Sink for Broken {
    fn prepare(&mut self) -> Result<(), Cause> {
        Ok(())
    }
    fn measured(&mut self) -> Result<Measured, Cause> {
        Ok(Measured {
            pose: self.inner.pose,
            age: self.age,
        })
    }
    fn send(&mut self, pose: &Pose) -> Result<(), Cause> {
        self.inner.send(pose)
    }
    fn watch(&mut self) -> Result<(), Cause> {
        if self.inner.sent.len() >= self.after {
            return (self.fault)(self);
        }
        Ok(())
    }
}

/// Plays on a robot that breaks, and what it was sent.
fn broken(after: usize, fault: fn(&mut Broken) -> Result<(), Cause>) -> (State, Vec<Pose>) {
    let plan = plan();
    let sink = Broken {
        inner: Recorded::at(plan.start()),
        after,
        fault,
        age: 0.0,
    };
    let mut arm = Stream::new(sink, plan.limits, Journal::none());
    let mut jaws = RecordedJaws::default();
    let stop = AtomicBool::new(false);
    let end = play(
        &plan,
        &mut arm,
        &mut jaws,
        &counted(),
        &stop,
        &Journal::none(),
    );
    (end, arm.sink().inner.sent.clone())
}

/// No step, change of step or change of that is larger than the limits allow, and the end is at rest.
fn smooth_to_rest(sent: &[Pose]) {
    let dt = 0.004;
    let p: Vec<DVec3> = sent.iter().map(Pose::position).collect();
    let v: Vec<DVec3> = p.windows(2).map(|w| (w[1] - w[0]) / dt).collect();
    let a: Vec<DVec3> = v.windows(2).map(|w| (w[1] - w[0]) / dt).collect();
    assert!(v.iter().all(|v| v.length() <= 0.25));
    assert!(
        a.iter().all(|a| a.length() <= 1.02),
        "{:?}",
        a.iter().map(|a| a.length()).fold(0.0, f64::max)
    );
    assert!(v[v.len() - 40..].iter().all(|v| v.length() < 1e-9));
}

#[test]
fn a_run_follows_the_plan_and_the_jaws_act_at_rest() {
    let plan = plan();
    let off = DVec3::new(0.003, 0.0, 0.0);
    let start = Pose::from_unit(plan.start().position() + off, plan.start().rotation());
    let mut arm = Stream::new(Recorded::at(start), plan.limits, Journal::none());
    let mut jaws = RecordedJaws::default();
    let stop = AtomicBool::new(false);
    let end = play(
        &plan,
        &mut arm,
        &mut jaws,
        &counted(),
        &stop,
        &Journal::none(),
    );
    assert_eq!(end, State::Finished);
    let order: Vec<Jaw> = jaws.commands.iter().map(|(_, jaw)| *jaw).collect();
    assert_eq!(order, [Jaw::Open, Jaw::Closed, Jaw::Open]);
    let sent = &arm.sink().sent;
    smooth_to_rest(sent);
    // The prelude repeats the measured pose, then the way to the first one, then the log.
    assert!(sent[..125].iter().all(|pose| *pose == start));
    for (time, _) in &jaws.commands {
        let k = (time / 0.004).round() as usize;
        let step = sent[k].position().distance(sent[k - 1].position());
        assert!(step < 1e-6, "{time}: {step}");
    }
    let last = plan.segments.last().unwrap();
    let (end, goal) = (sent[sent.len() - 1], last.pose(last.law.length));
    assert!(end.position().distance(goal.position()) < 1e-12);
}

#[test]
fn a_robot_elsewhere_is_not_moved() {
    let plan = plan();
    let first = plan.start();
    let turned = first.rotation() * selvedge_math::DQuat::from_rotation_z(0.04);
    for (pose, what) in [
        (
            Pose::from_unit(first.position() + DVec3::Z * 0.006, first.rotation()),
            "the tip [m]",
        ),
        (
            Pose::from_unit(first.position(), turned),
            "the rotation [rad]",
        ),
        (Pose::from_translation(DVec3::NAN), "the tip [m]"),
    ] {
        let mut arm = Stream::new(Recorded::at(pose), plan.limits, Journal::none());
        let mut jaws = RecordedJaws::default();
        let stop = AtomicBool::new(false);
        let end = play(
            &plan,
            &mut arm,
            &mut jaws,
            &counted(),
            &stop,
            &Journal::none(),
        );
        assert!(
            matches!(&end, State::Stopped(Cause::Start { what: w, .. }) if w == what),
            "{end:?}"
        );
        assert!(arm.sink().sent.is_empty() && jaws.commands.is_empty());
    }
}

#[test]
fn every_fault_of_the_other_side_ends_at_rest_with_its_reason() {
    // While holding, in the approach, and in the middle of the motion.
    for after in [50, 200, 950, 1100] {
        let (end, sent) = broken(after, |_| {
            Err(Cause::LostReader {
                topic: "/target".into(),
            })
        });
        assert_eq!(
            end,
            State::Stopped(Cause::LostReader {
                topic: "/target".into()
            })
        );
        smooth_to_rest(&sent);
        let (end, sent) = broken(after, |_| {
            Err(Cause::SecondPublisher {
                topic: "/target".into(),
                count: 1,
            })
        });
        assert!(matches!(end, State::Stopped(Cause::SecondPublisher { .. })));
        smooth_to_rest(&sent);
        let (end, sent) = broken(after, |broken| {
            broken.age = 0.3;
            Ok(())
        });
        assert!(
            matches!(end, State::Stopped(Cause::Stale { age: 0.3, .. })),
            "{end:?}"
        );
        smooth_to_rest(&sent);
        let (end, sent) = broken(after, |_| panic!("on purpose"));
        assert!(
            matches!(end, State::Stopped(Cause::Impossible { .. })),
            "{end:?}"
        );
        smooth_to_rest(&sent);
    }
}

#[test]
fn a_signal_stops_on_the_path() {
    let plan = plan();
    /// Sets the flag after some calls, as a signal does.
    struct Signal<'a>(Stream<Recorded>, &'a AtomicBool);
    impl Arm for Signal<'_> {
        fn prepare(&mut self) -> Result<(), Cause> {
            self.0.prepare()
        }
        fn measured(&mut self) -> Result<Measured, Cause> {
            self.0.measured()
        }
        fn path(&mut self, s: &mut [Arc<Segment>], brake: f64) -> Result<(), Cause> {
            self.0.path(s, brake)
        }
        fn hold(&mut self, now: f64, pose: &Pose) -> Result<(), Cause> {
            self.0.hold(now, pose)
        }
        fn start(&mut self, now: f64, s: &Arc<Segment>) -> Result<(), Cause> {
            self.0.start(now, s)
        }
        fn poll(&mut self, now: f64) -> Result<bool, Cause> {
            self.1.fetch_or(now > 4.1, Ordering::Relaxed);
            self.0.poll(now)
        }
        fn stop(&mut self, now: f64) {
            self.0.stop(now);
        }
    }
    let stop = AtomicBool::new(false);
    let inner = Stream::new(Recorded::at(plan.start()), plan.limits, Journal::none());
    let mut arm = Signal(inner, &stop);
    let mut jaws = RecordedJaws::default();
    let end = play(
        &plan,
        &mut arm,
        &mut jaws,
        &counted(),
        &stop,
        &Journal::none(),
    );
    assert_eq!(end, State::Stopped(Cause::Signal));
    let sent = &arm.0.sink().sent;
    smooth_to_rest(sent);
    let y = sent[sent.len() - 1].position().y;
    assert!(y.abs() < 0.045, "in the middle of the way: {y}");
    // The jaws were closed and stay so.
    assert_eq!(jaws.commands.last().unwrap().1, Jaw::Closed);
}

/// A gripper that fails a number of times, at once or when it is asked.
struct Failing {
    times: usize,
    commands: usize,
    cancelled: bool,
}

impl Gripper for Failing {
    fn prepare(&mut self) -> Result<(), Cause> {
        Ok(())
    }
    fn command(&mut self, _now: f64, _jaw: Jaw) -> Result<(), Cause> {
        self.commands += 1;
        Ok(())
    }
    fn poll(&mut self, _now: f64) -> Result<bool, Cause> {
        if self.cancelled || self.times == 0 {
            return Ok(true);
        }
        self.times -= 1;
        Err(Cause::Rejected {
            name: "/gripper".into(),
        })
    }
    fn cancel(&mut self, _now: f64) {
        self.cancelled = true;
    }
}

#[test]
fn a_failing_gripper_is_a_matter_of_the_policy() {
    let plan = plan();
    for (policy, commands, finished) in [
        (Policy::Abort, 1, false),
        (Policy::Continue, 3, true),
        (Policy::Wait, 5, true),
    ] {
        let start = Recorded::at(plan.start());
        let mut arm = Stream::new(start, plan.limits, Journal::none());
        let mut jaws = Failing {
            times: 2,
            commands: 0,
            cancelled: false,
        };
        let settings = Settings {
            policy,
            ..counted()
        };
        let stop = AtomicBool::new(false);
        let end = play(
            &plan,
            &mut arm,
            &mut jaws,
            &settings,
            &stop,
            &Journal::none(),
        );
        assert_eq!(end == State::Finished, finished, "{policy:?}: {end:?}");
        assert_eq!(jaws.commands, commands, "{policy:?}");
        assert_eq!(jaws.cancelled, !finished);
    }
}

/// A gripper that is not there a number of times, or whose finding panics.
struct Absent {
    times: usize,
    panics: bool,
    commands: usize,
}

impl Gripper for Absent {
    fn prepare(&mut self) -> Result<(), Cause> {
        assert!(!self.panics, "on purpose");
        if self.times == 0 {
            return Ok(());
        }
        self.times -= 1;
        Err(Cause::Absent {
            name: "/gripper".into(),
            seconds: 1.0,
        })
    }
    fn command(&mut self, _now: f64, _jaw: Jaw) -> Result<(), Cause> {
        self.commands += 1;
        Ok(())
    }
    fn poll(&mut self, _now: f64) -> Result<bool, Cause> {
        Ok(true)
    }
    fn cancel(&mut self, _now: f64) {}
}

#[test]
fn a_missing_gripper_is_a_matter_of_the_policy() {
    let plan = plan();
    let absent = Cause::Absent {
        name: "/gripper".into(),
        seconds: 1.0,
    };
    let panicked = Cause::Impossible {
        what: "this program".into(),
        value: "it panicked".into(),
    };
    for (policy, panics, asked, end, commands) in [
        (Policy::Abort, false, false, State::Stopped(absent), 0),
        (Policy::Continue, false, false, State::Finished, 0),
        (Policy::Wait, false, false, State::Finished, 3),
        (Policy::Wait, false, true, State::Stopped(Cause::Signal), 0),
        (Policy::Abort, true, false, State::Stopped(panicked), 0),
    ] {
        let start = Recorded::at(plan.start());
        let mut arm = Stream::new(start, plan.limits, Journal::none());
        let mut jaws = Absent {
            times: 3,
            panics,
            commands: 0,
        };
        let settings = Settings {
            policy,
            ..counted()
        };
        let stop = AtomicBool::new(asked);
        let journal = Journal::none();
        let ended = play(&plan, &mut arm, &mut jaws, &settings, &stop, &journal);
        assert_eq!((ended, jaws.commands), (end, commands), "{policy:?}");
        assert_eq!(
            arm.sink().sent.is_empty(),
            commands == 0 && policy != Policy::Continue
        );
    }
}

#[test]
fn a_late_loop_is_stopped() {
    let plan = plan();
    struct Slow(Recorded);
    impl Sink for Slow {
        fn prepare(&mut self) -> Result<(), Cause> {
            Ok(())
        }
        fn measured(&mut self) -> Result<Measured, Cause> {
            self.0.measured()
        }
        fn send(&mut self, pose: &Pose) -> Result<(), Cause> {
            if self.0.sent.len() == 20 {
                std::thread::sleep(std::time::Duration::from_millis(150));
            }
            self.0.send(pose)
        }
        fn watch(&mut self) -> Result<(), Cause> {
            Ok(())
        }
    }
    let mut arm = Stream::new(
        Slow(Recorded::at(plan.start())),
        plan.limits,
        Journal::none(),
    );
    let settings = Settings {
        overrun: 0.1,
        ..Settings::default()
    };
    let stop = AtomicBool::new(false);
    let end = play(
        &plan,
        &mut arm,
        &mut RecordedJaws::default(),
        &settings,
        &stop,
        &Journal::none(),
    );
    assert!(
        matches!(end, State::Stopped(Cause::Overrun { .. })),
        "{end:?}"
    );
}
