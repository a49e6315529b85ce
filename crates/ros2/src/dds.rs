//! Topics, services and actions on the network: the only file that names ros2-client.
//!
//! What is known of that library and worked around by `topic`, `call` and `action`: it has no deadline
//! on any call; "matched" means that our side matched, so what is sent at once may be lost; it matches
//! readers of other types; it reads no environment; its own reader of `/clock` expects another type.

use std::net::{IpAddr, Ipv4Addr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use byteorder::LittleEndian;
pub(crate) use ros2_client::Message;
use ros2_client::action::{
    ActionClient, ActionClientQosPolicies, GoalId, GoalStatusEnum, SendGoalRequest,
};
use ros2_client::dds::rustdds::cdr_encoding;
use ros2_client::dds::rustdds::{DomainParticipant, DomainParticipantBuilder, RTPSEntity};
use ros2_client::qos::{Durability, History, QosProfile, WhenFull};
use ros2_client::{
    ActionTypeName, Context, MessageTypeName, Node, NodeName, NodeOptions, ParameterValue,
    RmwRequestId, ServiceMapping, ServiceTypeName,
};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::Error;
use crate::names::Names;
use crate::network::{Mapping, Network};
use crate::security::Enclave;
use crate::topic::{Watched, look};

/// How often the network is looked at while waiting, and by the watcher.
pub(crate) const LOOK: Duration = Duration::from_millis(20);

/// A type of messages, services or actions: package and name.
pub(crate) type Kind = (&'static str, &'static str);

/// What tells a reply from others.
pub(crate) type RequestId = RmwRequestId;

/// Our node.
pub(crate) struct Bus {
    node: Node,
    peers: Peers,
    mapping: ServiceMapping,
    names: Names,
    watched: Arc<Mutex<Vec<Watched>>>,
    over: Arc<AtomicBool>,
    /// How long others are waited for [s].
    pub(crate) patience: f64,
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

fn transient(depth: usize) -> QosProfile {
    reliable(depth).durability(Durability::TransientLocal)
}

/// Whether samples are kept for those who come later.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kept {
    No,
    Last,
}

impl Bus {
    /// Joins the network; `parameters` are shown to `ros2 param` and cannot be set from outside.
    pub(crate) fn new(
        settings: &Network,
        names: &Names,
        parameters: &[(String, String)],
        patience: f64,
    ) -> Result<Self, Error> {
        let mut builder = DomainParticipantBuilder::new(settings.domain);
        if settings.loopback {
            builder = builder.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)]);
        }
        if let Some(enclave) = &settings.security {
            builder = secured(builder, enclave);
        }
        let participant = builder
            .build()
            .map_err(|e| network("the DDS participant", e))?;
        let context = Context::from_domain_participant(participant.clone())
            .map_err(|e| network("the ROS context", e))?;
        let name = NodeName::new(names.namespace(), names.node())
            .map_err(|e| network("the node's name", e))?;
        // The library's parameter services always tell requests apart as Enhanced does: with another
        // mapping nobody would get an answer.
        let served = settings.mapping == Mapping::Enhanced && settings.security.is_none();
        let mut options = NodeOptions::new()
            .enable_rosout(false)
            .start_parameter_services(served);
        for (name, value) in parameters {
            options = options.declare_parameter(name, ParameterValue::String(value.clone()));
        }
        let declared = Arc::new(AtomicBool::new(false));
        let closed = Arc::clone(&declared);
        options = options.parameter_validator(Box::new(move |_, _| {
            if closed.load(Ordering::Relaxed) {
                return Err("read only: the command line of selvedge-play decides".into());
            }
            Ok(())
        }));
        let mut node = context
            .new_node(name, options)
            .map_err(|e| network("the node", e))?;
        declared.store(true, Ordering::Relaxed);
        let thread = |name: &str| std::thread::Builder::new().name(name.into());
        // The library's spinner makes readers of its own while we make ours, and under security two
        // threads that make some block each other for good. Nothing but the parameters needs it.
        if served {
            let spinner = node.spinner().map_err(|e| network("the node", e))?;
            thread("spinner")
                .spawn(move || futures::executor::block_on(spinner.spin()).ok())
                .map_err(|e| network("a thread", e))?;
        }
        let watched: Arc<Mutex<Vec<Watched>>> = Arc::default();
        let over = Arc::new(AtomicBool::new(false));
        let (list, end) = (Arc::clone(&watched), Arc::clone(&over));
        let peers = Peers {
            participant,
            mapping: settings.mapping,
            making: Arc::default(),
        };
        let others = peers.clone();
        thread("watcher")
            .spawn(move || {
                while !end.load(Ordering::Relaxed) {
                    look(&others, &list);
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
            peers,
            mapping,
            names: names.clone(),
            watched,
            over,
            patience,
        })
    }

    /// Any identity of this program.
    pub(crate) fn id(&self) -> Id {
        Id(self.peers.participant.guid().to_bytes())
    }

    /// Who is there.
    pub(crate) fn peers(&self) -> Peers {
        self.peers.clone()
    }

    /// A name as the network has it, with namespace and remaps.
    pub(crate) fn resolve(&self, name: &str) -> Result<String, Error> {
        self.names.resolve(name)
    }

    /// True when the program ends.
    pub(crate) fn over(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.over)
    }

    /// Has the peers of a topic counted.
    pub(crate) fn watch(&self, watched: Watched) {
        let mut list = self.watched.lock().unwrap_or_else(|e| e.into_inner());
        list.push(watched);
    }

    /// A reliable writer of a topic with its full name.
    pub(crate) fn writer<M: Serialize>(
        &mut self,
        topic: &str,
        kind: Kind,
        kept: Kept,
    ) -> Result<Writer<M>, Error> {
        let _guard = self.peers.lock();
        let name = parsed(topic)?;
        let qos = match kept {
            Kept::No => reliable(10),
            Kept::Last => transient(1),
        };
        let kind = MessageTypeName::new(kind.0, kind.1);
        let type_name = kind.dds_msg_type();
        let handle = self.node.create_topic(&name, kind, &qos);
        let handle = handle.map_err(|e| network(topic, e))?;
        let publisher = self.node.create_publisher(&handle, None);
        let publisher = publisher.map_err(|e| network(topic, e))?;
        Ok(Writer {
            own: Id(publisher.guid().to_bytes()),
            publisher,
            type_name,
        })
    }

    /// A subscription, best effort unless what was written before us is wanted; its messages go to
    /// `take` on a thread of its own.
    pub(crate) fn subscribe<M: DeserializeOwned + Send + 'static>(
        &mut self,
        topic: &str,
        kind: Kind,
        kept: Kept,
        mut take: impl FnMut(M) + Send + 'static,
    ) -> Result<(), Error> {
        let topic = self.resolve(topic)?;
        let _guard = self.peers.lock();
        let name = parsed(&topic)?;
        let qos = match kept {
            Kept::No => QosProfile::subscription_default().history(History::KeepLast { depth: 10 }),
            Kept::Last => transient(100),
        };
        let kind = MessageTypeName::new(kind.0, kind.1);
        let handle = self.node.create_topic(&name, kind, &qos);
        let handle = handle.map_err(|e| network(&topic, e))?;
        let subscription = self.node.create_subscription::<M>(&handle, None);
        let subscription = subscription.map_err(|e| network(&topic, e))?;
        let end = self.over();
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

    /// A client of a service with its full name.
    pub(crate) fn service<Q, R>(&mut self, name: &str, kind: Kind) -> Result<Service<Q, R>, Error>
    where
        Q: Message + Clone + 'static,
        R: Message + 'static,
    {
        let _guard = self.peers.lock();
        let parsed = parsed(name)?;
        let kind = ServiceTypeName::new(kind.0, kind.1);
        let client = self
            .node
            .create_client(self.mapping, &parsed, &kind, reliable(10), reliable(10))
            .map_err(|e| network(name, e))?;
        Ok(Service(client))
    }

    /// A client of an action with its full name.
    pub(crate) fn goals<G, R, F>(&mut self, name: &str, kind: Kind) -> Result<Goals<G, R, F>, Error>
    where
        G: Message + Clone + 'static,
        R: Message + Clone + 'static,
        F: Message + 'static,
    {
        let _guard = self.peers.lock();
        let parsed = parsed(name)?;
        let policies = ActionClientQosPolicies {
            goal_service: reliable(10),
            result_service: reliable(10),
            cancel_service: reliable(10),
            feedback_subscription: reliable(10),
            status_subscription: transient(1),
        };
        let kind = ActionTypeName::new(kind.0, kind.1);
        let client = self
            .node
            .create_action_client(self.mapping, &parsed, &kind, policies)
            .map_err(|e| network(name, e))?;
        Ok(Goals(client))
    }
}

#[cfg(feature = "security")]
fn secured(builder: DomainParticipantBuilder, enclave: &Enclave) -> DomainParticipantBuilder {
    use ros2_client::dds::rustdds::DomainParticipantSecurityConfigFiles as Files;
    let files = Files::with_ros_default_names(enclave.folder(), String::new());
    builder.builtin_security(files)
}

/// There is no enclave without the feature: its variables are refused.
#[cfg(not(feature = "security"))]
fn secured(builder: DomainParticipantBuilder, _: &Enclave) -> DomainParticipantBuilder {
    builder
}

impl Drop for Bus {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
    }
}

fn parsed(name: &str) -> Result<ros2_client::Name, Error> {
    ros2_client::Name::parse(name).map_err(|e| network(name, e))
}

/// The identity of a reader or writer; its first twelve bytes are those of the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Id([u8; 16]);

impl Id {
    pub(crate) fn same_program(&self, other: &Self) -> bool {
        self.0[..12] == other.0[..12]
    }
}

/// A reader or writer that was discovered.
pub(crate) struct Peer {
    pub(crate) id: Id,
    pub(crate) topic: String,
    pub(crate) type_name: String,
}

/// What programs are known to make of the first two bytes of their identities, which are those of the
/// vendor of their DDS (RTPS 2.2 and later, 9.3.1.5).
const MAKES: [([u8; 2], &str, Mapping); 3] = [
    ([0x01, 0x0f], "Fast DDS", Mapping::Enhanced),
    ([0x01, 0x10], "Cyclone DDS", Mapping::Cyclone),
    ([0x01, 0x01], "Connext", Mapping::Enhanced),
];

impl Peer {
    /// Whose DDS it is, and how that RMW tells requests apart; nothing for one that is not known.
    pub(crate) fn make(&self) -> Option<(&'static str, Mapping)> {
        let known = MAKES
            .iter()
            .find(|(vendor, ..)| self.id.0.starts_with(vendor));
        known.map(|(_, name, mapping)| (*name, *mapping))
    }
}

/// Who is on the network.
#[derive(Clone)]
pub(crate) struct Peers {
    participant: DomainParticipant,
    /// How we tell requests apart.
    pub(crate) mapping: Mapping,
    /// Held while readers and writers are made: the library's locks are taken in another order for that
    /// than for looking.
    making: Arc<Mutex<()>>,
}

impl Peers {
    fn lock(&self) -> MutexGuard<'_, ()> {
        self.making.lock().unwrap_or_else(|e| e.into_inner())
    }

    pub(crate) fn readers(&self) -> Vec<Peer> {
        let _guard = self.lock();
        let found = self.participant.discovered_readers().into_iter();
        found
            .map(|r| Peer {
                id: Id(r.reader_proxy.remote_reader_guid.to_bytes()),
                type_name: r.subscription_topic_data.type_name().clone(),
                topic: r.subscription_topic_data.topic_name,
            })
            .collect()
    }

    pub(crate) fn writers(&self) -> Vec<Peer> {
        let _guard = self.lock();
        let found = self.participant.discovered_writers().into_iter();
        found
            .map(|w| Peer {
                id: Id(w.publication_topic_data.key.to_bytes()),
                type_name: w.publication_topic_data.type_name.clone(),
                topic: w.publication_topic_data.topic_name,
            })
            .collect()
    }
}

/// What a topic is written with.
pub(crate) struct Writer<M: Serialize> {
    publisher: ros2_client::dds::Publisher<M>,
    pub(crate) own: Id,
    /// The type as the network has it.
    pub(crate) type_name: String,
}

impl<M: Serialize> Writer<M> {
    pub(crate) fn write(&self, message: M) -> Result<(), String> {
        self.publisher.publish(message).map_err(|e| e.to_string())
    }
}

/// A client of a service, without deadlines.
pub(crate) struct Service<Q, R>(ros2_client::dds::Client<Q, R>)
where
    Q: Message,
    R: Message;

impl<Q: Message + Clone + 'static, R: Message + 'static> Service<Q, R> {
    pub(crate) fn send(&self, request: Q) -> Result<RequestId, String> {
        self.0.send_request(request).map_err(|e| e.to_string())
    }

    /// The next reply, to whichever request.
    pub(crate) fn receive(&self) -> Result<Option<(RequestId, R)>, String> {
        self.0.receive_response().map_err(|e| e.to_string())
    }
}

/// The last status of a goal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum GoalStatus {
    Succeeded,
    Canceled,
    Aborted,
    Other,
}

/// A client of an action, without deadlines.
pub(crate) struct Goals<G: Message + Clone, R: Message + Clone, F: Message>(ActionClient<G, R, F>);

/// The id of a goal.
pub(crate) type Goal = GoalId;

impl<G, R, F> Goals<G, R, F>
where
    G: Message + Clone + 'static,
    R: Message + Clone + 'static,
    F: Message + 'static,
{
    pub(crate) fn id() -> Goal {
        ros2_client::unique_identifier_msgs::UUID::new_random()
    }

    pub(crate) fn ask(&self, goal_id: Goal, goal: G) -> Result<RequestId, String> {
        let client = self.0.goal_client();
        let sent = client.send_request(SendGoalRequest { goal_id, goal });
        sent.map_err(|e| e.to_string())
    }

    /// The next answer to a goal: whether it was accepted.
    pub(crate) fn answer(&self) -> Option<(RequestId, bool)> {
        let (id, reply) = self.0.goal_client().receive_response().ok()??;
        Some((id, reply.accepted))
    }

    pub(crate) fn ask_result(&self, goal: Goal) -> Result<RequestId, String> {
        self.0.request_result(goal).map_err(|e| e.to_string())
    }

    /// The next result.
    pub(crate) fn result(&self) -> Result<Option<(RequestId, GoalStatus, R)>, String> {
        let reply = self.0.result_client().receive_response();
        let reply = reply.map_err(|e| e.to_string())?;
        Ok(reply.map(|(id, reply)| {
            let status = match reply.status {
                GoalStatusEnum::Succeeded => GoalStatus::Succeeded,
                GoalStatusEnum::Canceled => GoalStatus::Canceled,
                GoalStatusEnum::Aborted => GoalStatus::Aborted,
                _ => GoalStatus::Other,
            };
            (id, status, reply.result)
        }))
    }

    pub(crate) fn ask_cancel(&self, goal: Goal) -> Result<RequestId, String> {
        self.0.cancel_goal(goal).map_err(|e| e.to_string())
    }

    /// The next answer to a cancel.
    pub(crate) fn cancelled(&self) -> Option<RequestId> {
        let (id, _) = self.0.cancel_client().receive_response().ok()??;
        Some(id)
    }

    /// Throws feedback away.
    pub(crate) fn drain(&self, goal: Goal) {
        while let Ok(Some(_)) = self.0.receive_feedback(goal) {}
    }
}

/// The bytes of a message on the network, without the four that tell the encoding.
pub(crate) fn encode<T: Serialize>(message: &T) -> Result<Vec<u8>, String> {
    cdr_encoding::to_vec::<T, LittleEndian>(message).map_err(|e| e.to_string())
}

/// A message from its bytes.
pub(crate) fn decode<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, String> {
    let decoded = cdr_encoding::from_bytes::<T, LittleEndian>(bytes);
    decoded.map(|(value, _)| value).map_err(|e| e.to_string())
}
