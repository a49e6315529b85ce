//! What every arm does, and the arms that are led by a stream of poses.

pub(crate) mod cartesian;
pub(crate) mod joints;
pub(crate) mod layout;
pub(crate) mod moveit;
pub(crate) mod servo;

use std::sync::Arc;

use selvedge_math::Pose;

use crate::error::Cause;
use crate::journal::Journal;
use crate::limits::{Guard, Limits};
use crate::segment::{Brake, Segment};

/// How long the pose is repeated after a stop [s].
const HOLD_AFTER: f64 = 0.2;

/// What a robot tells about itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// The tip in the base.
    pub pose: Pose,
    /// How old that is, infinity for never [s].
    pub age: f64,
}

impl Measured {
    /// Nothing has come yet.
    pub const NEVER: Self = Self {
        pose: Pose::IDENTITY,
        age: f64::INFINITY,
    };
}

/// An arm that follows one segment after the other. All times are those of the run [s]; no call but
/// `prepare` waits.
pub trait Arm {
    /// Finds the robot and puts its controllers into the right mode; may take seconds.
    ///
    /// # Errors
    /// Why it cannot be commanded.
    fn prepare(&mut self) -> Result<(), Cause>;

    /// The newest measured state.
    ///
    /// # Errors
    /// [`Cause::Impossible`] for a state that cannot be.
    fn measured(&mut self) -> Result<Measured, Cause>;

    /// Measured joint positions, empty when the arm does not need them.
    fn joints(&self) -> &[f64] {
        &[]
    }

    /// Looks at all segments before the first of them begins; may take seconds, and may put other joint
    /// positions into them. Stops may take `brake` seconds ([`Plan::brake`](crate::plan::Plan)).
    ///
    /// # Errors
    /// Why one of them cannot be followed.
    fn path(&mut self, _segments: &mut [Arc<Segment>], _brake: f64) -> Result<(), Cause> {
        Ok(())
    }

    /// Commands to stay at the measured pose.
    ///
    /// # Errors
    /// Why that was not sent.
    fn hold(&mut self, now: f64, pose: &Pose) -> Result<(), Cause>;

    /// Begins a segment.
    ///
    /// # Errors
    /// Why not.
    fn start(&mut self, now: f64, segment: &Arc<Segment>) -> Result<(), Cause>;

    /// Goes on; true when at rest.
    ///
    /// # Errors
    /// Why it cannot go on.
    fn poll(&mut self, now: f64) -> Result<bool, Cause>;

    /// Begins to stop; [`Arm::poll`] says when it is at rest.
    fn stop(&mut self, now: f64);
}

/// Where the poses of a stream go.
pub trait Sink {
    /// As [`Arm::prepare`].
    ///
    /// # Errors
    /// Why it cannot be commanded.
    fn prepare(&mut self) -> Result<(), Cause>;
    /// As [`Arm::measured`].
    ///
    /// # Errors
    /// For a state that cannot be.
    fn measured(&mut self) -> Result<Measured, Cause>;
    /// Sends a pose.
    ///
    /// # Errors
    /// Why it was not sent.
    fn send(&mut self, pose: &Pose) -> Result<(), Cause>;
    /// Whether the other side is as it should be.
    ///
    /// # Errors
    /// What is wrong with it.
    fn watch(&mut self) -> Result<(), Cause>;
}

/// An arm that is led by a pose every period.
#[derive(Debug)]
pub struct Stream<S> {
    sink: S,
    guard: Guard,
    journal: Journal,
    /// How long a stop takes [s].
    brake: f64,
    mode: Mode,
}

#[derive(Debug)]
enum Mode {
    /// Nothing has been commanded.
    Silent,
    /// At rest there.
    At(Pose),
    /// On a segment that began then.
    On(Arc<Segment>, f64),
    /// On the way to rest since then.
    Braking(Arc<Segment>, Brake, f64),
}

impl<S: Sink> Stream<S> {
    /// An arm behind a sink.
    pub fn new(sink: S, limits: Limits, journal: Journal) -> Self {
        Self {
            sink,
            guard: Guard::new(limits),
            journal,
            // As long as any, until it is told better.
            brake: 3.2,
            mode: Mode::Silent,
        }
    }

    /// Where the poses go.
    pub fn sink(&self) -> &S {
        &self.sink
    }

    fn send(&mut self, now: f64, pose: &Pose) -> Result<(), Cause> {
        self.guard.pass(now, pose)?;
        self.sink.send(pose)?;
        self.journal.pose(now, pose);
        Ok(())
    }
}

impl<S: Sink> Arm for Stream<S> {
    fn prepare(&mut self) -> Result<(), Cause> {
        self.sink.prepare()
    }

    fn measured(&mut self) -> Result<Measured, Cause> {
        self.sink.measured()
    }

    fn path(&mut self, _segments: &mut [Arc<Segment>], brake: f64) -> Result<(), Cause> {
        self.brake = brake;
        // Time begins anew.
        self.guard = Guard::new(self.guard.limits());
        self.mode = Mode::Silent;
        Ok(())
    }

    fn hold(&mut self, now: f64, pose: &Pose) -> Result<(), Cause> {
        self.mode = Mode::At(*pose);
        self.poll(now).map(drop)
    }

    fn start(&mut self, now: f64, segment: &Arc<Segment>) -> Result<(), Cause> {
        self.mode = Mode::On(Arc::clone(segment), now);
        Ok(())
    }

    fn poll(&mut self, now: f64) -> Result<bool, Cause> {
        let (pose, rest) = match &self.mode {
            Mode::Silent => return Ok(true),
            Mode::At(pose) => (*pose, true),
            Mode::On(segment, start) => {
                let t = now - start;
                (segment.at(t), t >= segment.law.duration())
            }
            Mode::Braking(segment, brake, start) => {
                let t = now - start;
                (segment.pose(brake.at(t).0), t >= brake.within + HOLD_AFTER)
            }
        };
        if matches!(self.mode, Mode::Braking(..)) {
            // On the way to rest the other side may be gone: the samples go out all the same.
            self.send(now, &pose).ok();
        } else {
            self.sink.watch()?;
            self.send(now, &pose)?;
        }
        if rest {
            self.mode = Mode::At(pose);
        }
        Ok(rest)
    }

    fn stop(&mut self, now: f64) {
        if let Mode::On(segment, start) = &self.mode {
            let brake = segment.law.brake(now - start, self.brake);
            self.mode = Mode::Braking(Arc::clone(segment), brake, now);
        }
    }
}

/// No robot: every pose is taken and, if there is a journal, written there.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// The last pose that was sent, and the measured one before any is.
    pub pose: Pose,
    /// Everything that was sent.
    pub sent: Vec<Pose>,
}

impl Recorded {
    /// A robot that stands at a pose.
    pub fn at(pose: Pose) -> Self {
        Self {
            pose,
            sent: Vec::new(),
        }
    }
}

impl Sink for Recorded {
    fn prepare(&mut self) -> Result<(), Cause> {
        Ok(())
    }

    fn measured(&mut self) -> Result<Measured, Cause> {
        Ok(Measured {
            pose: self.pose,
            age: 0.0,
        })
    }

    fn send(&mut self, pose: &Pose) -> Result<(), Cause> {
        self.pose = *pose;
        self.sent.push(*pose);
        Ok(())
    }

    fn watch(&mut self) -> Result<(), Cause> {
        Ok(())
    }
}
