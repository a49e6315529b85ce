//! A topic that is written, and who else is on it.

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde::Serialize;

use crate::dds::{Bus, Id, Kept, Kind, LOOK, Peer, Peers, Writer};
use crate::error::{Cause, Error};

/// Between our match and theirs.
pub(crate) const SETTLE: Duration = Duration::from_millis(300);

/// How long after the first message others that publish the same may be found.
const FOUND: Duration = Duration::from_secs(2);

/// A topic whose peers the watcher looks at.
pub(crate) struct Watched {
    topic: String,
    own: Id,
    counts: Arc<Counts>,
}

/// Peers of a topic, as of the last look.
#[derive(Default)]
struct Counts {
    /// Those that read when the topic was waited for.
    readers: Mutex<Vec<Id>>,
    lost: AtomicBool,
    other_writers: AtomicUsize,
    /// Those that wrote until then.
    writers: Mutex<Option<(Vec<Id>, Instant)>>,
    new_writer: AtomicBool,
}

/// Looks at the peers of each watched topic.
pub(crate) fn look(peers: &Peers, watched: &Mutex<Vec<Watched>>) {
    let (readers, writers) = (peers.readers(), peers.writers());
    let watched = watched.lock().unwrap_or_else(|e| e.into_inner());
    for Watched { topic, own, counts } in watched.iter() {
        let known = counts.readers.lock().unwrap_or_else(|e| e.into_inner());
        let gone = known.iter().any(|id| !readers.iter().any(|r| r.id == *id));
        counts.lost.store(gone, Ordering::Relaxed);
        let other = |w: &&Peer| w.topic == *topic && !w.id.same_program(own);
        let others = writers.iter().filter(other).count();
        counts.other_writers.store(others, Ordering::Relaxed);
        let mut known = counts.writers.lock().unwrap_or_else(|e| e.into_inner());
        if let Some((known, until)) = &mut *known {
            let on = writers.iter().filter(other).map(|w| w.id);
            let new: Vec<Id> = on.filter(|id| !known.contains(id)).collect();
            if Instant::now() < *until {
                known.extend(new);
            } else {
                counts.new_writer.store(!new.is_empty(), Ordering::Relaxed);
            }
        }
    }
}

/// Who writes a topic that is read.
pub(crate) struct Writers {
    topic: String,
    counts: Arc<Counts>,
}

impl Writers {
    pub(crate) fn new(bus: &Bus, topic: &str) -> Result<Self, Error> {
        let topic = bus.resolve(topic)?;
        let counts = Arc::new(Counts::default());
        bus.watch(Watched {
            topic: format!("rt{topic}"),
            own: bus.id(),
            counts: Arc::clone(&counts),
        });
        Ok(Self { topic, counts })
    }

    /// Takes those that write now, or are found soon, for the right ones: several may tell of a robot.
    pub(crate) fn know(&self) {
        let writers = &self.counts.writers;
        let mut known = writers.lock().unwrap_or_else(|e| e.into_inner());
        *known = Some((Vec::new(), Instant::now() + FOUND));
        self.counts.new_writer.store(false, Ordering::Relaxed);
    }

    /// Whether nobody else writes.
    pub(crate) fn check(&self) -> Result<(), Cause> {
        match self.counts.new_writer.load(Ordering::Relaxed) {
            false => Ok(()),
            true => Err(Cause::NewPublisher {
                topic: self.topic.clone(),
            }),
        }
    }
}

/// Waits until somebody of the right type is on a topic, and says otherwise who is not.
pub(crate) fn wait(
    name: &str,
    seconds: f64,
    mut find: impl FnMut() -> Vec<Peer>,
    topic: &str,
    expected: &str,
) -> Result<(), Cause> {
    let until = Instant::now() + Duration::from_secs_f64(seconds);
    loop {
        let found = find();
        let mut on = found.iter().filter(|peer| peer.topic == topic);
        if on.clone().any(|peer| peer.type_name == expected) {
            return Ok(());
        }
        if Instant::now() > until {
            return Err(match on.next() {
                Some(other) => Cause::TypeMismatch {
                    topic: name.into(),
                    found: other.type_name.clone(),
                    expected: expected.into(),
                },
                None => Cause::Absent {
                    name: name.into(),
                    seconds,
                },
            });
        }
        std::thread::sleep(LOOK);
    }
}

/// A publisher that knows who else is on its topic.
pub(crate) struct Out<M: Serialize> {
    writer: Writer<M>,
    topic: String,
    counts: Arc<Counts>,
    peers: Peers,
    patience: f64,
}

impl<M: Serialize> Out<M> {
    pub(crate) fn new(bus: &mut Bus, topic: &str, kind: Kind) -> Result<Self, Error> {
        let topic = bus.resolve(topic)?;
        let writer = bus.writer(&topic, kind, Kept::No)?;
        let counts = Arc::new(Counts::default());
        bus.watch(Watched {
            topic: format!("rt{topic}"),
            own: writer.own,
            counts: Arc::clone(&counts),
        });
        let peers = bus.peers();
        Ok(Self {
            writer,
            topic,
            counts,
            peers,
            patience: bus.patience,
        })
    }

    /// Waits for a reader of the right type, and until it knows us too.
    pub(crate) fn wait(&self) -> Result<(), Cause> {
        let dds_name = format!("rt{}", self.topic);
        let expected = &self.writer.type_name;
        let find = || self.peers.readers();
        wait(&self.topic, self.patience, find, &dds_name, expected)?;
        std::thread::sleep(SETTLE);
        let mut readers = self.peers.readers();
        readers.retain(|peer| peer.topic == dds_name && peer.type_name == *expected);
        let mut known = self
            .counts
            .readers
            .lock()
            .unwrap_or_else(|e| e.into_inner());
        *known = readers.iter().map(|peer| peer.id).collect();
        drop(known);
        std::thread::sleep(2 * LOOK);
        self.check()
    }

    /// Whether all those that read at first still do, and nobody else writes.
    pub(crate) fn check(&self) -> Result<(), Cause> {
        let topic = || self.topic.clone();
        match self.counts.other_writers.load(Ordering::Relaxed) {
            0 if !self.counts.lost.load(Ordering::Relaxed) => Ok(()),
            0 => Err(Cause::LostReader { topic: topic() }),
            count => Err(Cause::SecondPublisher {
                topic: topic(),
                count,
            }),
        }
    }

    pub(crate) fn send(&self, message: M) -> Result<(), Cause> {
        let sent = self.writer.write(message);
        sent.map_err(|reason| self.unsent(reason))
    }

    pub(crate) fn unsent(&self, reason: String) -> Cause {
        Cause::Send {
            topic: self.topic.clone(),
            reason,
        }
    }
}
