//! Why a log is not played, and why a robot was stopped.

/// Why nothing moves.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A value cannot be used.
    #[error("{place}: {field} is {value}, must be {bound}")]
    Value {
        /// Where it was found.
        place: String,
        /// Which value.
        field: &'static str,
        /// What was found.
        value: String,
        /// What must be there.
        bound: String,
    },
    /// The arm cannot do what the log asks.
    #[error("the arm cannot follow the log: {0}")]
    Blocked(String),
    /// The log could not be read or cannot be followed by any arm.
    #[error("{0}")]
    Log(String),
    /// The network could not be used.
    #[error("{what}: {reason}")]
    Network {
        /// What was tried.
        what: String,
        /// What the library says.
        reason: String,
    },
    /// A file could not be written.
    #[error("{path} cannot be written: {reason}")]
    Write {
        /// The file.
        path: String,
        /// Why.
        reason: std::io::Error,
    },
}

impl Error {
    pub(crate) fn value(
        place: impl Into<String>,
        field: &'static str,
        value: impl ToString,
        bound: impl Into<String>,
    ) -> Self {
        Self::Value {
            place: place.into(),
            field,
            value: value.to_string(),
            bound: bound.into(),
        }
    }
}

/// Why a motion was stopped, or never begun though the log was fine.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Cause {
    /// Somebody asked for it.
    #[error("Ctrl-C or SIGTERM")]
    Signal,
    /// The robot is not where the log begins.
    #[error("the robot is not at the start of the log: {what} is off by {off:.4}, at most {bound}")]
    Start {
        /// Position [m], angle [rad] or a joint [rad].
        what: String,
        /// By how much.
        off: f64,
        /// The bound.
        bound: f64,
    },
    /// What the robot tells about itself is old, or nothing has come.
    #[error("{what} is {age:.3} s old, at most {bound} s")]
    Stale {
        /// The topic.
        what: String,
        /// Its age, infinity for never [s].
        age: f64,
        /// The bound [s].
        bound: f64,
    },
    /// What the robot tells cannot be.
    #[error("{what} is impossible: {value}")]
    Impossible {
        /// The topic and field.
        what: String,
        /// What was told.
        value: String,
    },
    /// Our own loop came too late.
    #[error("the loop was late by {late:.4} s, at most {bound:.4} s")]
    Overrun {
        /// By how much [s].
        late: f64,
        /// The bound [s].
        bound: f64,
    },
    /// Nobody listens any more.
    #[error("nobody reads {topic} any more")]
    LostReader {
        /// The topic.
        topic: String,
    },
    /// Somebody else commands the robot too.
    #[error("{topic} has {count} publishers besides this one, none may be there")]
    SecondPublisher {
        /// The topic.
        topic: String,
        /// How many others.
        count: usize,
    },
    /// Who tells the robot's state has changed.
    #[error("somebody new publishes {topic}: was the robot, or a part of it, started again?")]
    NewPublisher {
        /// The topic.
        topic: String,
    },
    /// A peer of another type.
    #[error("{topic} is read as {found}, this program writes {expected}: type mismatch")]
    TypeMismatch {
        /// The topic.
        topic: String,
        /// Their type.
        found: String,
        /// Ours.
        expected: String,
    },
    /// A server that would misread what it is asked.
    #[error(
        "{name} is served by {make}, which would misread what this program sends: RMW_IMPLEMENTATION must be \
         {wanted}"
    )]
    Mapping {
        /// Service or action.
        name: String,
        /// Its DDS.
        make: &'static str,
        /// The RMW that goes with it.
        wanted: &'static str,
    },
    /// Nobody is there.
    #[error("nobody serves or reads {name} within {seconds} s")]
    Absent {
        /// Topic, service or action.
        name: String,
        /// How long we waited [s].
        seconds: f64,
    },
    /// A call was not answered.
    #[error(
        "{name} did not answer within {seconds} s; what became of the request is unknown. A server \
         that is there but does not understand is silent too: are RMW_IMPLEMENTATION and --distro \
         those of the robot?"
    )]
    NoAnswer {
        /// Service or action, and which of its calls.
        name: String,
        /// The deadline [s].
        seconds: f64,
    },
    /// An answer that cannot be read.
    #[error(
        "{name} answered with bytes that are no message of the kind expected ({reason}): is --distro \
         that of the other side?"
    )]
    Unreadable {
        /// Service or action.
        name: String,
        /// What the decoder says.
        reason: String,
    },
    /// Two sources do not tell the same.
    #[error("{first} and {second} differ by {off:.4} in {what}, at most {bound}: {hint}")]
    Disagree {
        /// A source.
        first: String,
        /// Another.
        second: String,
        /// Position [m] or angle [rad].
        what: &'static str,
        /// By how much.
        off: f64,
        /// The bound.
        bound: f64,
        /// What it comes from, most often.
        hint: &'static str,
    },
    /// A plan of the other side that cannot be taken.
    #[error("the plan of {name} for motion {motion} is refused: {reason}")]
    Plan {
        /// Who planned.
        name: String,
        /// Which motion, 0 for the way to the first pose.
        motion: usize,
        /// Why.
        reason: String,
    },
    /// A goal was not accepted.
    #[error("{name} rejected the goal")]
    Rejected {
        /// The action.
        name: String,
    },
    /// A goal ended otherwise than by success.
    #[error("{name} ended as {status}: {detail}")]
    Failed {
        /// The action or service.
        name: String,
        /// Its last status.
        status: String,
        /// What the result says.
        detail: String,
    },
    /// A sample would have been too far from the one before.
    #[error("a sample would move {what} by {step:.6}, at most {bound:.6} in one period")]
    Guard {
        /// Tip or rotation.
        what: &'static str,
        /// Step [m or rad].
        step: f64,
        /// Bound [m or rad].
        bound: f64,
    },
    /// A sample could not be sent.
    #[error("{topic}: a sample was not sent: {reason}")]
    Send {
        /// The topic.
        topic: String,
        /// What the library says.
        reason: String,
    },
}
