//! The loop that plays a plan on an arm and a gripper, and stops them when anything is wrong.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use selvedge_math::{Jaw, Pose};

use crate::arm::Arm;
use crate::error::Cause;
use crate::gripper::Gripper;
use crate::journal::Journal;
use crate::limits::angle;
use crate::plan::Plan;
use crate::segment::Segment;
use crate::state::{Event, State};

/// What to do when the gripper fails or does not answer in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Policy {
    /// Stay and ask again, for ever, until stopped by hand.
    Wait,
    /// Go on as if it had worked.
    Continue,
    /// Stop.
    Abort,
}

/// How a plan is played.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// From sample to sample [s].
    pub period: f64,
    /// How late the loop may be [s].
    pub overrun: f64,
    /// How old the measured state may be [s].
    pub stale: f64,
    /// How long the measured pose is repeated at first [s]. Samples that are sent while the other side
    /// has not matched yet are lost, so the first ones must not matter.
    pub hold: f64,
    /// How far the robot may be from the first pose [m], [rad], and its joints [rad].
    pub start: (f64, f64, f64),
    /// What to do when the gripper fails, or is not there.
    pub policy: Policy,
    /// What the jaws were told before, which they are not told again.
    pub jaw: Option<Jaw>,
    /// How long a stop may take in all before no more is waited for [s].
    pub give_up: f64,
    /// Whether time passes, or is only counted (for tests and for `record`).
    pub real_time: bool,
}

impl Default for Settings {
    fn default() -> Self {
        let period = 0.004;
        Self {
            period,
            overrun: 3.0 * period,
            stale: 0.2,
            hold: 0.5,
            start: (0.005, 2.0f64.to_radians(), 0.05),
            policy: Policy::Abort,
            jaw: None,
            give_up: 5.0,
            real_time: true,
        }
    }
}

/// Plays a plan to its end or to a stop; the state it ends in is [`State::Finished`] or
/// [`State::Stopped`]. `stop` may be set at any time, from a signal handler.
pub fn play(
    plan: &Plan,
    arm: &mut dyn Arm,
    gripper: &mut dyn Gripper,
    settings: &Settings,
    stop: &AtomicBool,
    journal: &Journal,
) -> State {
    let mut run = Run {
        plan,
        arm,
        gripper,
        settings,
        journal,
        state: State::Preparing,
        segments: Vec::new(),
        start: Pose::IDENTITY,
        now: 0.0,
        since: 0.0,
        jaw: settings.jaw,
        cancelled: false,
        stop,
        absent: false,
    };
    if catch_unwind(AssertUnwindSafe(|| run.prepare())).is_err() {
        run.on(Event::Fault(panicked()));
    }
    let started = Instant::now();
    let mut tick = 0u64;
    while !matches!(run.state, State::Stopped(_) | State::Finished) {
        // The time of a sample is when it is due, not when the loop wakes up: late samples follow one
        // another quickly and all of them are on the path.
        run.now = settings.period * tick as f64;
        tick += 1;
        if settings.real_time {
            let due = started + Duration::from_secs_f64(run.now);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            let late = due.elapsed().as_secs_f64();
            if late > settings.overrun {
                let bound = settings.overrun;
                run.on(Event::Fault(Cause::Overrun { late, bound }));
            }
        }
        if stop.load(Ordering::Relaxed) {
            run.on(Event::Fault(Cause::Signal));
        }
        if catch_unwind(AssertUnwindSafe(|| run.tick())).is_ok() {
            continue;
        }
        if matches!(run.state, State::Stopping(_)) {
            // Not even stopping works: the controllers' own time-outs have to.
            run.on(Event::Rest);
        } else {
            run.on(Event::Fault(panicked()));
            catch_unwind(AssertUnwindSafe(|| run.tick())).ok();
        }
    }
    run.state
}

fn panicked() -> Cause {
    Cause::Impossible {
        what: "this program".into(),
        value: "it panicked".into(),
    }
}

struct Run<'a> {
    plan: &'a Plan,
    arm: &'a mut dyn Arm,
    gripper: &'a mut dyn Gripper,
    settings: &'a Settings,
    journal: &'a Journal,
    state: State,
    /// The approach and the plan's.
    segments: Vec<Arc<Segment>>,
    /// The measured pose at the start.
    start: Pose,
    now: f64,
    /// When the state was entered [s].
    since: f64,
    /// What the jaws were told last.
    jaw: Option<Jaw>,
    /// Whether the gripper's command was taken back.
    cancelled: bool,
    stop: &'a AtomicBool,
    /// Whether the gripper is not there, and the policy is to go on.
    absent: bool,
}

impl Run<'_> {
    fn prepare(&mut self) {
        let ready = self.arm.prepare().and_then(|()| self.find_gripper());
        let event = match ready.and_then(|()| self.find_start()) {
            Ok(()) => Event::Ready,
            Err(cause) => Event::Fault(cause),
        };
        self.on(event);
    }

    fn find_gripper(&mut self) -> Result<(), Cause> {
        while let Err(cause) = self.gripper.prepare() {
            let what = match self.settings.policy {
                Policy::Abort => return Err(cause),
                Policy::Continue => "no gripper, going on without",
                Policy::Wait if self.stop.load(Ordering::Relaxed) => return Err(Cause::Signal),
                Policy::Wait => "no gripper, waiting",
            };
            self.journal.event(self.now, what, cause.to_string());
            self.absent = self.settings.policy == Policy::Continue;
            if self.absent {
                break;
            }
        }
        Ok(())
    }

    /// S1: the robot must stand where the log begins.
    fn find_start(&mut self) -> Result<(), Cause> {
        let measured = self.fresh()?;
        let (from, first) = (measured, self.plan.start());
        let (metres, radians, joint) = self.settings.start;
        let far = |what: &str, off: f64, bound: f64| match off <= bound {
            true => Ok(()),
            false => Err(Cause::Start {
                what: what.into(),
                off,
                bound,
            }),
        };
        far(
            "the tip [m]",
            from.position().distance(first.position()),
            metres,
        )?;
        far("the rotation [rad]", angle(&from, &first), radians)?;
        let joints = self.arm.joints();
        for (k, (q, first)) in joints.iter().zip(self.plan.start_joints()).enumerate() {
            let name = &self.plan.joint_names[k];
            far(&format!("{name} [rad]"), (q - first).abs(), joint)?;
        }
        let approach = self.plan.approach(&from, joints);
        self.segments = std::iter::once(approach)
            .chain(self.plan.segments.iter().cloned())
            .map(Arc::new)
            .collect();
        self.arm.path(&mut self.segments, self.plan.brake)?;
        self.start = from;
        // Planning takes its time: the robot must still be there.
        let still = self.fresh()?;
        let moved = still.position().distance(from.position());
        far("the tip while planning [m]", moved, 0.2 * metres)
    }

    /// The measured pose, unless it is old.
    fn fresh(&mut self) -> Result<Pose, Cause> {
        let measured = self.arm.measured()?;
        if measured.age <= self.settings.stale {
            return Ok(measured.pose);
        }
        Err(Cause::Stale {
            what: "the measured state".into(),
            age: measured.age,
            bound: self.settings.stale,
        })
    }

    /// One period.
    fn tick(&mut self) {
        if let State::Stopping(_) = self.state {
            self.stopping();
            return;
        }
        let done = self.fresh().and_then(|_| self.go_on());
        match done {
            Ok(Some(event)) => self.on(event),
            Ok(None) => {}
            Err(cause) => {
                self.on(Event::Fault(cause));
                // The stop begins with this sample: a missing one would be a jolt.
                self.stopping();
            }
        }
    }

    fn go_on(&mut self) -> Result<Option<Event>, Cause> {
        match self.state {
            State::Holding => {
                self.arm.hold(self.now, &self.start)?;
                Ok((self.now - self.since >= self.settings.hold).then_some(Event::Settled))
            }
            State::Moving(k) => {
                let rest = self.arm.poll(self.now)?;
                Ok(rest.then(|| Event::Arrived {
                    jaw: !self.absent
                        && self.segments[k]
                            .jaw
                            .is_some_and(|jaw| Some(jaw) != self.jaw),
                    last: k + 1 == self.segments.len(),
                }))
            }
            State::Gripping(k) => {
                self.arm.poll(self.now)?;
                let last = k + 1 == self.segments.len();
                match (self.gripper.poll(self.now), self.settings.policy) {
                    (Ok(false), _) => Ok(None),
                    (Ok(true), _) => Ok(Some(Event::Gripped { last })),
                    (Err(cause), Policy::Abort) => Err(cause),
                    (Err(cause), Policy::Continue) => {
                        self.journal
                            .event(self.now, "gripper failed, going on", cause.to_string());
                        Ok(Some(Event::Gripped { last }))
                    }
                    (Err(cause), Policy::Wait) => {
                        self.journal.event(
                            self.now,
                            "gripper failed, asking again",
                            cause.to_string(),
                        );
                        self.grip(k)?;
                        Ok(None)
                    }
                }
            }
            _ => Ok(None),
        }
    }

    fn grip(&mut self, k: usize) -> Result<(), Cause> {
        let Some(jaw) = self.segments[k].jaw else {
            return Ok(());
        };
        self.jaw = Some(jaw);
        self.journal
            .event(self.now, "jaw", format!("{jaw:?}").to_lowercase());
        self.gripper.command(self.now, jaw)
    }

    /// Towards rest: what fails now changes nothing, but is told.
    fn stopping(&mut self) {
        let arm = self.arm.poll(self.now);
        let arm = arm.unwrap_or_else(|cause| self.tell_failed(&cause));
        if self.cancelled {
            let jaws = self.gripper.poll(self.now);
            let jaws = jaws.unwrap_or_else(|cause| self.tell_failed(&cause));
            self.cancelled = !jaws;
        }
        let jaws = !self.cancelled;
        if arm && jaws {
            self.on(Event::Rest);
        } else if self.now - self.since > self.settings.give_up {
            self.journal
                .event(self.now, "while stopping", "no answer; giving up");
            self.on(Event::Rest);
        }
    }

    /// Tells of what went wrong on the way to rest; there is no more to wait for.
    fn tell_failed(&self, cause: &Cause) -> bool {
        self.journal
            .event(self.now, "while stopping", cause.to_string());
        true
    }

    /// Changes the state, and does what belongs to the new one.
    fn on(&mut self, event: Event) {
        let before = self.state.clone();
        let state = std::mem::replace(&mut self.state, State::Finished);
        self.state = state.next(event);
        if self.state == before {
            return;
        }
        self.since = self.now;
        let detail = match &self.state {
            State::Stopping(cause) | State::Stopped(cause) => format!(": {cause}"),
            State::Moving(k) | State::Gripping(k) => format!(" {k}"),
            _ => String::new(),
        };
        self.journal
            .event(self.now, "state", format!("{}{detail}", self.state.name()));
        let done = match self.state {
            State::Moving(k) => self.arm.start(self.now, &self.segments[k]),
            State::Gripping(k) => self.grip(k),
            State::Stopping(_) => {
                self.arm.stop(self.now);
                if let State::Gripping(_) = before {
                    self.gripper.cancel(self.now);
                    self.cancelled = true;
                }
                Ok(())
            }
            _ => Ok(()),
        };
        if let Err(cause) = done {
            // A gripper that does not take the command is a matter of the policy.
            match (&self.state, self.settings.policy) {
                (State::Gripping(k), Policy::Continue) => {
                    let last = k + 1 == self.segments.len();
                    self.on(Event::Gripped { last });
                }
                _ => self.on(Event::Fault(cause)),
            }
        }
    }
}
