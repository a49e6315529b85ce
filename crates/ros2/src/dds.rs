//! Topics and actions on the network: the only file that names ros2-client.
//!
//! What is known of that library and worked around here: it has no deadline on any call; "matched"
//! means that our side matched, so what is sent at once may be lost; it matches readers of other
//! types; it reads no environment.

use std::net::{IpAddr, Ipv4Addr};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use ros2_client::action::{
    ActionClient, ActionClientQosPolicies, GoalId, GoalStatusEnum, SendGoalRequest,
};
use ros2_client::dds::rustdds::{DomainParticipant, DomainParticipantBuilder, GUID};
use ros2_client::qos::{Durability, History, QosProfile, WhenFull};
use ros2_client::{
    ActionTypeName, Context, Message, MessageTypeName, Node, NodeName, NodeOptions, RmwRequestId,
    ServiceMapping,
};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::{Cause, Error};
use crate::messages;
use crate::network::{Mapping, Network};

/// Between our match and theirs [s].
const SETTLE: Duration = Duration::from_millis(300);
/// How often the network is looked at while waiting, and by the watcher.
const LOOK: Duration = Duration::from_millis(20);
/// How often a request that was not answered is repeated.
const AGAIN: Duration = Duration::from_millis(500);

/// Our node.
pub(crate) struct Bus {
    node: Node,
    participant: DomainParticipant,
    mapping: ServiceMapping,
    watched: Arc<Mutex<Vec<Watched>>>,
    over: Arc<AtomicBool>,
}

struct Watched {
    topic: String,
    own: GUID,
    counts: Arc<Counts>,
}

/// Peers on a topic, as of the last look.
#[derive(Default)]
struct Counts {
    readers: AtomicUsize,
    other_writers: AtomicUsize,
}

fn network(what: &str, reason: impl ToString) -> Error {
    Error::Network {
        what: what.into(),
        reason: reason.to_string(),
    }
}

fn reliable(depth: usize) -> QosProfile {
    QosProfile::publisher_default()
        .reliability_reliable(WhenFull::Fail)
        .history(History::KeepLast { depth })
}

impl Bus {
    pub(crate) fn new(settings: &Network, name: &str) -> Result<Self, Error> {
        let mut builder = DomainParticipantBuilder::new(settings.domain);
        if settings.loopback {
            builder = builder.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)]);
        }
        let participant = builder
            .build()
            .map_err(|e| network("the DDS participant", e))?;
        let context = Context::from_domain_participant(participant.clone())
            .map_err(|e| network("the ROS context", e))?;
        let name =
            NodeName::new("/", name).map_err(|e| network("the node's name", format!("{e:?}")))?;
        let options = NodeOptions::new()
            .enable_rosout(false)
            .start_parameter_services(false);
        let mut node = context
            .new_node(name, options)
            .map_err(|e| network("the node", format!("{e:?}")))?;
        let spinner = node.spinner().map_err(|e| network("the node", e))?;
        let thread = |name: &str| std::thread::Builder::new().name(name.into());
        thread("spinner")
            .spawn(move || futures::executor::block_on(spinner.spin()).ok())
            .map_err(|e| network("a thread", e))?;
        let watched: Arc<Mutex<Vec<Watched>>> = Arc::default();
        let over = Arc::new(AtomicBool::new(false));
        let (list, end, from) = (Arc::clone(&watched), Arc::clone(&over), participant.clone());
        thread("watcher")
            .spawn(move || {
                while !end.load(Ordering::Relaxed) {
                    look(&from, &list);
                    std::thread::sleep(LOOK);
                }
            })
            .map_err(|e| network("a thread", e))?;
        let mapping = match settings.mapping {
            Mapping::Enhanced => ServiceMapping::Enhanced,
            Mapping::Cyclone => ServiceMapping::Cyclone,
        };
        Ok(Self {
            node,
            participant,
            mapping,
            watched,
            over,
        })
    }

    /// A reliable publisher.
    pub(crate) fn publisher<M: Serialize>(
        &mut self,
        topic: &str,
        package: &str,
        kind: &str,
    ) -> Result<Out<M>, Error> {
        let what = |e: &dyn ToString| network(topic, e.to_string());
        let message = MessageTypeName::new(package, kind);
        let expected = message.dds_msg_type();
        let name = ros2_client::Name::parse(topic).map_err(|e| network(topic, format!("{e:?}")))?;
        let qos = reliable(10);
        let handle = self
            .node
            .create_topic(&name, message, &qos)
            .map_err(|e| what(&e))?;
        let publisher = self
            .node
            .create_publisher(&handle, None)
            .map_err(|e| what(&e))?;
        let counts = Arc::new(Counts::default());
        let watched = Watched {
            topic: format!("rt{topic}"),
            own: publisher.guid(),
            counts: Arc::clone(&counts),
        };
        self.watched
            .lock()
            .unwrap_or_else(|e| e.into_inner())
            .push(watched);
        Ok(Out {
            publisher,
            topic: topic.into(),
            expected,
            counts,
            participant: self.participant.clone(),
        })
    }

    /// A best-effort subscription whose messages go to `take` on a thread of its own.
    pub(crate) fn subscribe<M: DeserializeOwned + Send + 'static>(
        &mut self,
        topic: &str,
        package: &str,
        kind: &str,
        mut take: impl FnMut(M) + Send + 'static,
    ) -> Result<(), Error> {
        let name = ros2_client::Name::parse(topic).map_err(|e| network(topic, format!("{e:?}")))?;
        let qos = QosProfile::subscription_default().history(History::KeepLast { depth: 10 });
        let message = MessageTypeName::new(package, kind);
        let handle = self
            .node
            .create_topic(&name, message, &qos)
            .map_err(|e| network(topic, e))?;
        let subscription = self
            .node
            .create_subscription::<M>(&handle, None)
            .map_err(|e| network(topic, e))?;
        let end = Arc::clone(&self.over);
        std::thread::Builder::new()
            .name("state".into())
            .spawn(move || {
                while !end.load(Ordering::Relaxed) {
                    // What cannot be read is not there: the state gets old, and that is looked at.
                    match subscription.take() {
                        Ok(Some((message, _))) => take(message),
                        _ => std::thread::sleep(Duration::from_millis(1)),
                    }
                }
            })
            .map_err(|e| network("a thread", e))?;
        Ok(())
    }

    /// A client of an action.
    pub(crate) fn action<G, R, F>(
        &mut self,
        name: &str,
        package: &str,
        kind: &str,
    ) -> Result<Action<G, R, F>, Error>
    where
        G: Message + Clone + 'static,
        R: Message + Clone + 'static,
        F: Message + 'static,
    {
        let action = ros2_client::Name::parse(name).map_err(|e| network(name, format!("{e:?}")))?;
        let status = reliable(1).durability(Durability::TransientLocal);
        let policies = ActionClientQosPolicies {
            goal_service: reliable(10),
            result_service: reliable(10),
            cancel_service: reliable(10),
            feedback_subscription: reliable(10),
            status_subscription: status,
        };
        let kind = ActionTypeName::new(package, kind);
        let client = self
            .node
            .create_action_client(self.mapping, &action, &kind, policies)
            .map_err(|e| network(name, e))?;
        let participant = self.participant.clone();
        Ok(Action {
            client,
            name: name.into(),
            participant,
            phase: Phase::Idle,
        })
    }
}

impl Drop for Bus {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
    }
}

/// Counts the peers of each watched topic.
fn look(participant: &DomainParticipant, watched: &Mutex<Vec<Watched>>) {
    let (readers, writers) = (
        participant.discovered_readers(),
        participant.discovered_writers(),
    );
    let watched = watched.lock().unwrap_or_else(|e| e.into_inner());
    for Watched { topic, own, counts } in watched.iter() {
        let on = readers
            .iter()
            .filter(|r| r.subscription_topic_data.topic_name == *topic);
        counts.readers.store(on.count(), Ordering::Relaxed);
        let on = writers.iter().filter(|w| {
            let data = &w.publication_topic_data;
            data.topic_name == *topic && data.key.prefix != own.prefix
        });
        counts.other_writers.store(on.count(), Ordering::Relaxed);
    }
}

/// A publisher that knows who else is on its topic.
pub(crate) struct Out<M: Serialize> {
    publisher: ros2_client::dds::Publisher<M>,
    topic: String,
    expected: String,
    counts: Arc<Counts>,
    participant: DomainParticipant,
}

impl<M: Serialize> Out<M> {
    /// Waits for a reader of the right type, and until it knows us too.
    pub(crate) fn wait(&self, seconds: f64) -> Result<(), Cause> {
        let until = Instant::now() + Duration::from_secs_f64(seconds);
        let dds_name = format!("rt{}", self.topic);
        loop {
            let readers = self.participant.discovered_readers();
            let types = readers.iter().map(|r| &r.subscription_topic_data);
            let types: Vec<&String> = types
                .filter(|t| t.topic_name == dds_name)
                .map(|t| t.type_name())
                .collect();
            if types.iter().any(|t| **t == self.expected) {
                break;
            }
            if Instant::now() > until {
                let topic = self.topic.clone();
                return Err(match types.first() {
                    Some(found) => Cause::TypeMismatch {
                        topic,
                        found: (*found).clone(),
                        expected: self.expected.clone(),
                    },
                    None => Cause::Absent {
                        name: topic,
                        seconds,
                    },
                });
            }
            std::thread::sleep(LOOK);
        }
        std::thread::sleep(SETTLE);
        self.check()
    }

    /// Whether somebody reads and nobody else writes.
    pub(crate) fn check(&self) -> Result<(), Cause> {
        let topic = || self.topic.clone();
        match self.counts.other_writers.load(Ordering::Relaxed) {
            0 if self.counts.readers.load(Ordering::Relaxed) > 0 => Ok(()),
            0 => Err(Cause::LostReader { topic: topic() }),
            count => Err(Cause::SecondPublisher {
                topic: topic(),
                count,
            }),
        }
    }

    pub(crate) fn send(&self, message: M) -> Result<(), Cause> {
        self.publisher
            .publish(message)
            .map_err(|error| Cause::Send {
                topic: self.topic.clone(),
                reason: error.to_string(),
            })
    }
}

/// How an action ended.
pub(crate) struct Ended<R> {
    pub(crate) status: GoalStatus,
    pub(crate) result: R,
}

/// The last status of a goal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum GoalStatus {
    Succeeded,
    Canceled,
    Aborted,
    Other,
}

/// A client of an action with one goal at a time and a deadline on each call.
pub(crate) struct Action<G: Message + Clone, R: Message + Clone, F: Message> {
    client: ActionClient<G, R, F>,
    name: String,
    participant: DomainParticipant,
    phase: Phase<G>,
}

enum Phase<G> {
    Idle,
    /// The goal was sent, perhaps more than once, always under the same id.
    Asked {
        id: GoalId,
        goal: G,
        requests: Vec<RmwRequestId>,
        again: Instant,
        until: Instant,
        limit: f64,
        cancel: bool,
    },
    /// Accepted; the result was asked for.
    Runs {
        id: GoalId,
        requests: Vec<RmwRequestId>,
        again: Instant,
        until: Instant,
        limit: f64,
        cancel: Option<Cancel>,
    },
}

struct Cancel {
    requests: Vec<RmwRequestId>,
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
    /// Waits for a server: for all three services, and until it knows us too.
    pub(crate) fn wait(&self, seconds: f64) -> Result<(), Cause> {
        let until = Instant::now() + Duration::from_secs_f64(seconds);
        let names = ["send_goal", "cancel_goal", "get_result"];
        loop {
            let (readers, writers) = (
                self.participant.discovered_readers(),
                self.participant.discovered_writers(),
            );
            let there = |service: &&str| {
                let request = format!("rq{}/_action/{service}Request", self.name);
                let reply = format!("rr{}/_action/{service}Reply", self.name);
                readers
                    .iter()
                    .any(|r| r.subscription_topic_data.topic_name == request)
                    && writers
                        .iter()
                        .any(|w| w.publication_topic_data.topic_name == reply)
            };
            if names.iter().all(there) {
                std::thread::sleep(SETTLE);
                return Ok(());
            }
            if Instant::now() > until {
                return Err(Cause::Absent {
                    name: self.name.clone(),
                    seconds,
                });
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Sends a goal that must be over within `limit` seconds.
    pub(crate) fn send(&mut self, goal: G, limit: f64) {
        let now = Instant::now();
        self.phase = Phase::Asked {
            id: ros2_client::unique_identifier_msgs::UUID::new_random(),
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
        let lost = |error: &dyn ToString| Cause::Send {
            topic: self.name.clone(),
            reason: error.to_string(),
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
                    let request = SendGoalRequest {
                        goal_id: *id,
                        goal: goal.clone(),
                    };
                    let sent = self.client.goal_client().send_request(request);
                    requests.push(sent.map_err(|e| lost(&e))?);
                    *again = now + AGAIN;
                }
                let mut answer = None;
                while let Ok(Some((request, reply))) = self.client.goal_client().receive_response()
                {
                    if requests.contains(&request) {
                        answer = answer.or(Some(reply.accepted));
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
                    let sent = self.client.request_result(*id);
                    requests.push(sent.map_err(|e| lost(&e))?);
                    *again = now + 4 * AGAIN;
                }
                while let Ok(Some(_)) = self.client.receive_feedback(*id) {}
                let mut ended = None;
                while let Ok(Some((request, reply))) =
                    self.client.result_client().receive_response()
                {
                    if requests.contains(&request) {
                        ended = ended.or(Some(reply));
                    }
                }
                if let Some(reply) = ended {
                    let status = match reply.status {
                        GoalStatusEnum::Succeeded => GoalStatus::Succeeded,
                        GoalStatusEnum::Canceled => GoalStatus::Canceled,
                        GoalStatusEnum::Aborted => GoalStatus::Aborted,
                        _ => GoalStatus::Other,
                    };
                    return Ok(Some(Ended {
                        status,
                        result: reply.result,
                    }));
                }
                if let Some(Cancel {
                    requests,
                    answered,
                    again,
                    until,
                }) = cancel
                {
                    if now >= *again && !*answered {
                        let sent = self.client.cancel_goal(*id);
                        requests.push(sent.map_err(|e| lost(&e))?);
                        *again = now + AGAIN;
                    }
                    while let Ok(Some((request, _))) =
                        self.client.cancel_client().receive_response()
                    {
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

macro_rules! message {
    ($($name:ident),*) => { $(impl Message for messages::$name {})* };
}
message!(
    FollowGoal,
    FollowResult,
    FollowFeedback,
    GripperGoal,
    GripperState,
    GraspGoal,
    MoveGoal,
    FrankaResult,
    FrankaFeedback
);

#[cfg(test)]
mod tests {
    use super::*;
    use byteorder::LittleEndian;
    use messages::{
        Header, JointState, JointTrajectory, JointTrajectoryPoint, Name, Pose, PoseStamped, Time,
    };
    use ros2_client::dds::rustdds::cdr_encoding::{from_bytes, to_vec};

    fn header() -> Header {
        let stamp = Time { sec: 3, nanosec: 5 };
        let frame_id = Name::new("fr3");
        Header { stamp, frame_id }
    }

    /// Both ways against what the encoder of rosbags 0.11.9 makes of the definitions of Jazzy; without
    /// its four bytes that tell the encoding.
    fn golden<T: Serialize + DeserializeOwned + PartialEq + std::fmt::Debug>(value: &T, hex: &str) {
        let bytes: Vec<u8> = (0..hex.len() / 2)
            .map(|k| u8::from_str_radix(&hex[2 * k..2 * k + 2], 16).unwrap())
            .collect();
        assert_eq!(to_vec::<T, LittleEndian>(value).unwrap(), bytes);
        let (back, _) = from_bytes::<T, LittleEndian>(&bytes).unwrap();
        assert_eq!(&back, value);
    }

    #[test]
    fn bytes_are_those_of_another_encoder() {
        let (position, orientation) = ([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]);
        let pose = Pose {
            position,
            orientation,
        };
        golden(
            &PoseStamped {
                header: header(),
                pose,
            },
            "03000000050000000400000066723300000000000000f03f00000000000000400000000000000840\
             000000000000000000000000000000000000000000000000000000000000f03f",
        );
        golden(
            &JointState {
                header: header(),
                name: vec!["a".into(), "bcd".into()],
                position: vec![0.5, 1.0],
                velocity: vec![],
                effort: vec![2.0],
            },
            "0300000005000000040000006672330002000000020000006100000004000000626364000200000000\
             0000000000e03f000000000000f03f00000000010000000000000000000040",
        );
        let point = JointTrajectoryPoint {
            positions: vec![0.5],
            velocities: vec![1.0],
            accelerations: vec![],
            effort: vec![],
            time_from_start: messages::Duration { sec: 1, nanosec: 7 },
        };
        golden(
            &JointTrajectory {
                header: header(),
                joint_names: vec![Name::new("a")],
                points: vec![point.clone(), point],
            },
            "0300000005000000040000006672330001000000020000006100000002000000010000000000000000\
             0000000000e03f0100000000000000000000000000f03f000000000000000001000000070000000100\
             000000000000000000000000e03f0100000000000000000000000000f03f0000000000000000010000\
             0007000000",
        );
    }
}
