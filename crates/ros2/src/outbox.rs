//! A topic that a loop writes without waiting: what it hands over, a thread of its own puts on the
//! network. Making bytes of a message allocates, and the library has locks; the loop meets neither.

use std::sync::mpsc::{SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, OnceLock};
use std::thread::JoinHandle;

use serde::Serialize;

use crate::dds::{Bus, Kind};
use crate::error::{Cause, Error};
use crate::topic::Out;

/// Messages that may wait: a quarter of a second at 250 Hz. More, and the other side gets old poses.
const QUEUE: usize = 64;

/// A publisher behind a queue. What is in it when it is dropped is still sent.
pub(crate) struct Outbox<M: Serialize> {
    out: Arc<Out<M>>,
    queue: Option<SyncSender<M>>,
    failed: Arc<OnceLock<Cause>>,
    thread: Option<JoinHandle<()>>,
}

impl<M: Serialize + Send + Sync + 'static> Outbox<M> {
    pub(crate) fn new(bus: &mut Bus, topic: &str, kind: Kind) -> Result<Self, Error> {
        let out = Arc::new(Out::new(bus, topic, kind)?);
        let failed = Arc::new(OnceLock::new());
        let (queue, messages) = sync_channel(QUEUE);
        let (writer, failure) = (Arc::clone(&out), Arc::clone(&failed));
        let thread = std::thread::Builder::new()
            .name("outbox".into())
            .spawn(move || {
                for message in messages {
                    if let Err(cause) = writer.send(message) {
                        // The first one counts: the loop stops.
                        failure.set(cause).ok();
                    }
                }
            })
            .map_err(|reason| Error::Network {
                what: "a thread".into(),
                reason: reason.to_string(),
            })?;
        Ok(Self {
            out,
            queue: Some(queue),
            failed,
            thread: Some(thread),
        })
    }

    /// Waits for a reader of the right type, and until it knows us too.
    pub(crate) fn wait(&self) -> Result<(), Cause> {
        self.out.wait()
    }

    /// Whether all is sent, all those that read at first still do, and nobody else writes.
    pub(crate) fn check(&self) -> Result<(), Cause> {
        match self.failed.get() {
            Some(cause) => Err(cause.clone()),
            None => self.out.check(),
        }
    }

    /// Hands a message over; never waits.
    pub(crate) fn put(&self, message: M) -> Result<(), Cause> {
        let reason = match self.queue.as_ref().map(|queue| queue.try_send(message)) {
            Some(Ok(())) => return Ok(()),
            Some(Err(TrySendError::Full(_))) => format!("{QUEUE} messages wait to be sent"),
            _ => "nobody sends any more".into(),
        };
        Err(self.out.unsent(reason))
    }
}

impl<M: Serialize> Drop for Outbox<M> {
    fn drop(&mut self) {
        self.queue = None;
        if let Some(thread) = self.thread.take() {
            thread.join().ok();
        }
    }
}
