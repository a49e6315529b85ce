//! An action with one goal at a time and a deadline on each of its calls.
//!
//! The topic of its status is not read: it repeats old goals, and it may say nothing at all. What a goal
//! comes to is its result.

use std::time::{Duration, Instant};

use crate::call::{AGAIN, served};
use crate::dds::{Bus, Goal, GoalStatus, Goals, Kind, Message, Peers, RequestId};
use crate::error::{Cause, Error};

use crate::topic::SETTLE;

/// How an action ended.
pub(crate) struct Ended<R> {
    pub(crate) status: GoalStatus,
    pub(crate) result: R,
}

/// A client of an action with one goal at a time and a deadline on each call.
pub(crate) struct Action<G: Message + Clone, R: Message + Clone, F: Message> {
    goals: Goals<G, R, F>,
    name: String,
    kind: Kind,
    peers: Peers,
    patience: f64,
    phase: Phase<G>,
}

enum Phase<G> {
    Idle,
    /// The goal was sent, perhaps more than once, always under the same id.
    Asked {
        id: Goal,
        goal: G,
        requests: Vec<RequestId>,
        again: Instant,
        until: Instant,
        limit: f64,
        cancel: bool,
    },
    /// Accepted; the result was asked for.
    Runs {
        id: Goal,
        requests: Vec<RequestId>,
        again: Instant,
        until: Instant,
        limit: f64,
        cancel: Option<Cancel>,
    },
}

struct Cancel {
    requests: Vec<RequestId>,
    answered: bool,
    again: Instant,
    until: Instant,
}

/// Deadline of the replies to goal and cancel [s].
const REPLY: f64 = 2.0;

impl<G, R, F> Action<G, R, F>
where
    G: Message + Clone + 'static,
    R: Message + Clone + 'static,
    F: Message + 'static,
{
    pub(crate) fn new(bus: &mut Bus, name: &str, kind: Kind) -> Result<Self, Error> {
        let name = bus.resolve(name)?;
        let goals = bus.goals(&name, kind)?;
        Ok(Self {
            goals,
            name,
            kind,
            peers: bus.peers(),
            patience: bus.patience,
            phase: Phase::Idle,
        })
    }

    /// The full name.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Waits for a server: for all three services with their types, and until it knows us too.
    pub(crate) fn wait(&self) -> Result<(), Cause> {
        let (package, name) = self.kind;
        for (service, kind) in [
            ("send_goal", format!("{package}::action/{name}_SendGoal")),
            ("cancel_goal", "action_msgs::srv/CancelGoal".into()),
            ("get_result", format!("{package}::action/{name}_GetResult")),
        ] {
            let service = format!("{}/_action/{service}", self.name);
            served(&self.peers, &service, &kind, self.patience)?;
        }
        std::thread::sleep(SETTLE);
        Ok(())
    }

    /// Sends a goal that must be over within `limit` seconds.
    pub(crate) fn send(&mut self, goal: G, limit: f64) {
        let now = Instant::now();
        self.phase = Phase::Asked {
            id: Goals::<G, R, F>::id(),
            goal,
            requests: Vec::new(),
            again: now,
            until: now + Duration::from_secs_f64(REPLY),
            limit,
            cancel: false,
        };
    }

    /// Takes the goal back; [`Action::poll`] says how that went.
    pub(crate) fn cancel(&mut self) {
        let now = Instant::now();
        match &mut self.phase {
            Phase::Idle => {}
            Phase::Asked { cancel, .. } => *cancel = true,
            Phase::Runs { cancel, .. } => {
                let until = now + Duration::from_secs_f64(REPLY);
                let new = Cancel {
                    requests: Vec::new(),
                    answered: false,
                    again: now,
                    until,
                };
                cancel.get_or_insert(new);
            }
        }
    }

    /// Goes on; the result when the goal is over, nothing while it runs.
    pub(crate) fn poll(&mut self) -> Result<Option<Ended<R>>, Cause> {
        let polled = self.step();
        if !matches!(polled, Ok(None)) {
            self.phase = Phase::Idle;
        }
        polled
    }

    fn step(&mut self) -> Result<Option<Ended<R>>, Cause> {
        let now = Instant::now();
        let silent = |name: &str, call: &str, seconds| Cause::NoAnswer {
            name: format!("{name} {call}"),
            seconds,
        };
        let lost = |reason| Cause::Send {
            topic: self.name.clone(),
            reason,
        };
        let next = match &mut self.phase {
            Phase::Idle => return Err(silent(&self.name, "without a goal", 0.0)),
            Phase::Asked {
                id,
                goal,
                requests,
                again,
                until,
                limit,
                cancel,
            } => {
                if now >= *again {
                    let sent = self.goals.ask(*id, goal.clone());
                    requests.push(sent.map_err(lost)?);
                    *again = now + AGAIN;
                }
                let mut answer = None;
                while let Some((request, accepted)) = self.goals.answer() {
                    if requests.contains(&request) {
                        answer = answer.or(Some(accepted));
                    }
                }
                match answer {
                    Some(true) => Phase::Runs {
                        id: *id,
                        requests: Vec::new(),
                        again: now,
                        until: now + Duration::from_secs_f64(*limit),
                        limit: *limit,
                        cancel: cancel.then(|| Cancel {
                            requests: Vec::new(),
                            answered: false,
                            again: now,
                            until: now + Duration::from_secs_f64(REPLY),
                        }),
                    },
                    Some(false) => {
                        return Err(Cause::Rejected {
                            name: self.name.clone(),
                        });
                    }
                    None if now > *until => return Err(silent(&self.name, "send_goal", REPLY)),
                    None => return Ok(None),
                }
            }
            Phase::Runs {
                id,
                requests,
                again,
                until,
                limit,
                cancel,
            } => {
                if now >= *again {
                    let sent = self.goals.ask_result(*id);
                    requests.push(sent.map_err(lost)?);
                    *again = now + 4 * AGAIN;
                }
                self.goals.drain(*id);
                loop {
                    match self.goals.result() {
                        Ok(Some((request, status, result))) if requests.contains(&request) => {
                            return Ok(Some(Ended { status, result }));
                        }
                        Ok(Some(_)) => {}
                        Ok(None) => break,
                        Err(reason) => {
                            return Err(Cause::Unreadable {
                                name: format!("{} get_result", self.name),
                                reason,
                            });
                        }
                    }
                }
                if let Some(Cancel {
                    requests,
                    answered,
                    again,
                    until,
                }) = cancel
                {
                    if now >= *again && !*answered {
                        let sent = self.goals.ask_cancel(*id);
                        requests.push(sent.map_err(lost)?);
                        *again = now + AGAIN;
                    }
                    while let Some(request) = self.goals.cancelled() {
                        *answered |= requests.contains(&request);
                    }
                    if now > *until {
                        let call = if *answered {
                            "get_result after cancel_goal"
                        } else {
                            "cancel_goal"
                        };
                        return Err(silent(&self.name, call, REPLY));
                    }
                } else if now > *until {
                    return Err(silent(&self.name, "get_result", *limit));
                }
                return Ok(None);
            }
        };
        self.phase = next;
        Ok(None)
    }
}
