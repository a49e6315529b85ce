//! Where a run is, and what may come next.

use crate::error::Cause;

/// Where a run is.
#[derive(Clone, Debug, PartialEq)]
pub enum State {
    /// The robot is looked for and asked where it is; nothing is commanded.
    Preparing,
    /// The measured pose is commanded over and over, so that whoever listens is in tune.
    Holding,
    /// On the way: 0 is the way to the first pose, then the segments of the plan.
    Moving(usize),
    /// At rest at the end of a segment, the jaws act.
    Gripping(usize),
    /// On the way to rest.
    Stopping(Cause),
    /// At rest before the end, with the reason.
    Stopped(Cause),
    /// At rest at the end.
    Finished,
}

/// What happens to a run.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// Robot and gripper are there and the robot is at the start.
    Ready,
    /// The pose has been held long enough.
    Settled,
    /// The motion is over; whether the jaws have something to do, and whether it was the last.
    Arrived {
        /// The jaws change.
        jaw: bool,
        /// No motion follows.
        last: bool,
    },
    /// The jaws are done, or have failed and the policy is to go on.
    Gripped {
        /// No motion follows.
        last: bool,
    },
    /// Something is wrong, or somebody asked for a stop.
    Fault(Cause),
    /// The robot is at rest after a stop, or no more can be done.
    Rest,
}

impl State {
    /// The state after an event; an event that a state does not expect changes nothing.
    #[must_use]
    pub fn next(self, event: Event) -> Self {
        match (self, event) {
            (Self::Preparing, Event::Ready) => Self::Holding,
            (Self::Holding, Event::Settled) => Self::Moving(0),
            (Self::Moving(k), Event::Arrived { jaw: true, .. }) => Self::Gripping(k),
            (Self::Moving(_), Event::Arrived { last: true, .. })
            | (Self::Gripping(_), Event::Gripped { last: true }) => Self::Finished,
            (Self::Moving(k), Event::Arrived { .. })
            | (Self::Gripping(k), Event::Gripped { .. }) => Self::Moving(k + 1),
            // Nothing has been commanded yet.
            (Self::Preparing, Event::Fault(cause)) => Self::Stopped(cause),
            (Self::Holding | Self::Moving(_) | Self::Gripping(_), Event::Fault(cause)) => {
                Self::Stopping(cause)
            }
            (Self::Stopping(cause), Event::Rest) => Self::Stopped(cause),
            // The first cause stands.
            (state, _) => state,
        }
    }

    /// The name, for the log.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Preparing => "preparing",
            Self::Holding => "holding",
            Self::Moving(_) => "moving",
            Self::Gripping(_) => "gripping",
            Self::Stopping(_) => "stopping",
            Self::Stopped(_) => "stopped",
            Self::Finished => "finished",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_way_of_a_run() {
        let mut state = State::Preparing;
        for (event, name) in [
            (Event::Ready, "holding"),
            (Event::Settled, "moving"),
            (
                Event::Arrived {
                    jaw: true,
                    last: false,
                },
                "gripping",
            ),
            (Event::Gripped { last: false }, "moving"),
            (
                Event::Arrived {
                    jaw: false,
                    last: false,
                },
                "moving",
            ),
            (
                Event::Arrived {
                    jaw: true,
                    last: true,
                },
                "gripping",
            ),
            (Event::Gripped { last: true }, "finished"),
        ] {
            state = state.next(event);
            assert_eq!(state.name(), name);
        }
    }

    #[test]
    fn a_fault_stops_every_state_that_moves_and_the_first_cause_stands() {
        let late = Cause::Overrun {
            late: 1.0,
            bound: 0.1,
        };
        for state in [State::Holding, State::Moving(3), State::Gripping(1)] {
            let stopping = state.next(Event::Fault(Cause::Signal));
            assert_eq!(stopping, State::Stopping(Cause::Signal));
            let again = stopping.next(Event::Fault(late.clone()));
            assert_eq!(again, State::Stopping(Cause::Signal));
            // Nothing but rest ends a stop.
            let arrived = again.next(Event::Arrived {
                jaw: true,
                last: false,
            });
            assert_eq!(arrived.name(), "stopping");
            assert_eq!(arrived.next(Event::Rest), State::Stopped(Cause::Signal));
        }
        let never = State::Preparing.next(Event::Fault(late.clone()));
        assert_eq!(never, State::Stopped(late));
        let done = State::Finished.next(Event::Fault(Cause::Signal));
        assert_eq!(done, State::Finished);
        // No event leads out of a stop.
        assert_eq!(
            State::Stopped(Cause::Signal).next(Event::Ready).name(),
            "stopped"
        );
    }
}
