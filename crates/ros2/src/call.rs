//! A service that is called, with a deadline on each call.

use std::time::{Duration, Instant};

use crate::dds::{Bus, Kind, Message, Peer, Peers, RequestId, Service};
use crate::error::{Cause, Error};
use crate::topic::{SETTLE, wait};

/// How often a request that was not answered is repeated, at most.
pub(crate) const AGAIN: Duration = Duration::from_millis(500);

/// Waits until a service is there, and refuses one that tells requests apart in another way: it would not
/// only stay silent. What is in front of a request of Cyclone, Fast DDS reads as the request itself, so that a
/// gripper would be sent to places that nobody has named.
pub(crate) fn served(peers: &Peers, name: &str, kind: &str, seconds: f64) -> Result<(), Cause> {
    let (package, last) = kind.split_once('/').unwrap_or_default();
    let of = |part: &str| format!("{package}::dds_::{last}_{part}_");
    let (request, reply) = (format!("rq{name}Request"), format!("rr{name}Reply"));
    wait(name, seconds, || peers.readers(), &request, &of("Request"))?;
    wait(name, seconds, || peers.writers(), &reply, &of("Response"))?;
    let readers = peers.readers();
    let servers = readers.iter().filter(|peer| peer.topic == request);
    match servers
        .filter_map(Peer::make)
        .find(|(_, mapping)| *mapping != peers.mapping)
    {
        None => Ok(()),
        Some((make, mapping)) => Err(Cause::Mapping {
            name: name.into(),
            make,
            wanted: mapping.rmw(),
        }),
    }
}

/// A client of a service with one request at a time. What is asked may be asked twice: a request that
/// is sent too early is lost, so an unanswered one is repeated.
pub(crate) struct Call<Q: Message, R: Message> {
    service: Service<Q, R>,
    name: String,
    kind: String,
    peers: Peers,
    patience: f64,
    asked: Option<Asked<Q>>,
}

struct Asked<Q> {
    request: Q,
    ids: Vec<RequestId>,
    again: Instant,
    until: Instant,
    seconds: f64,
}

impl<Q, R> Call<Q, R>
where
    Q: Message + Clone + 'static,
    R: Message + 'static,
{
    pub(crate) fn new(bus: &mut Bus, name: &str, kind: Kind) -> Result<Self, Error> {
        let name = bus.resolve(name)?;
        let service = bus.service(&name, kind)?;
        Ok(Self {
            service,
            name,
            kind: format!("{}::srv/{}", kind.0, kind.1),
            peers: bus.peers(),
            patience: bus.patience,
            asked: None,
        })
    }

    /// The full name.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Waits for a server of the right type, and until it knows us too.
    pub(crate) fn wait(&self) -> Result<(), Cause> {
        served(&self.peers, &self.name, &self.kind, self.patience)?;
        std::thread::sleep(SETTLE);
        Ok(())
    }

    /// Asks; [`Call::poll`] has the answer.
    pub(crate) fn send(&mut self, request: Q, seconds: f64) {
        let now = Instant::now();
        self.asked = Some(Asked {
            request,
            ids: Vec::new(),
            again: now,
            until: now + Duration::from_secs_f64(seconds),
            seconds,
        });
    }

    /// The answer, nothing while there is none.
    pub(crate) fn poll(&mut self) -> Result<Option<R>, Cause> {
        let polled = self.step();
        if !matches!(polled, Ok(None)) {
            self.asked = None;
        }
        polled
    }

    fn step(&mut self) -> Result<Option<R>, Cause> {
        let name = || self.name.clone();
        let now = Instant::now();
        let Some(asked) = &mut self.asked else {
            return Err(Cause::NoAnswer {
                name: format!("{} without a request", self.name),
                seconds: 0.0,
            });
        };
        if now >= asked.again {
            let sent = self.service.send(asked.request.clone());
            let sent = sent.map_err(|reason| Cause::Send {
                topic: name(),
                reason,
            })?;
            asked.ids.push(sent);
            // A long job is not asked for again and again.
            asked.again = now + AGAIN.max(Duration::from_secs_f64(0.3 * asked.seconds));
        }
        loop {
            match self.service.receive() {
                Ok(Some((id, reply))) if asked.ids.contains(&id) => return Ok(Some(reply)),
                Ok(Some(_)) => {}
                Ok(None) => break,
                Err(reason) => {
                    return Err(Cause::Unreadable {
                        name: name(),
                        reason,
                    });
                }
            }
        }
        if now > asked.until {
            return Err(Cause::NoAnswer {
                name: name(),
                seconds: asked.seconds,
            });
        }
        Ok(None)
    }

    /// Asks and waits for the answer.
    pub(crate) fn call(&mut self, request: Q, seconds: f64) -> Result<R, Cause> {
        self.send(request, seconds);
        loop {
            if let Some(reply) = self.poll()? {
                return Ok(reply);
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}
