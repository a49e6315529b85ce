//! A record of everything that is commanded: one JSON object a line, with the time it was sent.
//!
//! The lines are written by a thread of their own. What is to be recorded goes there over a queue of
//! fixed size; when it is full the record is dropped and counted, for the loop must not wait.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::{SystemTime, UNIX_EPOCH};

use selvedge_math::Pose;
use serde_json::json;

use crate::error::Error;

/// Records that may wait: a quarter of a minute at 1 kHz.
const QUEUE: usize = 16_384;

enum Record {
    Pose {
        sent: f64,
        t: f64,
        pose: Pose,
    },
    Event {
        sent: f64,
        t: f64,
        kind: &'static str,
        detail: String,
    },
    End,
}

/// Where records go; clones write to the same file.
#[derive(Clone, Debug)]
pub struct Journal {
    sender: Option<SyncSender<Record>>,
    lost: Arc<AtomicU64>,
}

/// The thread that writes.
#[derive(Debug)]
pub struct Writer {
    journal: Journal,
    thread: JoinHandle<std::io::Result<()>>,
    path: String,
}

impl Journal {
    /// A journal that keeps nothing.
    pub fn none() -> Self {
        Self {
            sender: None,
            lost: Arc::default(),
        }
    }

    /// A journal in a file.
    ///
    /// # Errors
    /// [`Error::Write`] when the file cannot be made.
    pub fn create(path: &Path) -> Result<(Self, Writer), Error> {
        let name = path.display().to_string();
        let fail = |reason| Error::Write {
            path: name.clone(),
            reason,
        };
        let file = File::create(path).map_err(fail)?;
        let (sender, receiver) = sync_channel(QUEUE);
        let journal = Self {
            sender: Some(sender),
            lost: Arc::default(),
        };
        let thread = std::thread::Builder::new()
            .name("journal".into())
            .spawn(move || write(BufWriter::new(file), &receiver))
            .map_err(fail)?;
        let writer = Writer {
            journal: journal.clone(),
            thread,
            path: name,
        };
        Ok((journal, writer))
    }

    /// A pose that is sent now; `t` is the time of the run [s].
    pub fn pose(&self, t: f64, pose: &Pose) {
        self.put(Record::Pose {
            sent: unix(),
            t,
            pose: *pose,
        });
    }

    /// Anything else that happens.
    pub fn event(&self, t: f64, kind: &'static str, detail: impl Into<String>) {
        if self.sender.is_some() {
            self.put(Record::Event {
                sent: unix(),
                t,
                kind,
                detail: detail.into(),
            });
        }
    }

    fn put(&self, record: Record) {
        if let Some(sender) = &self.sender
            && sender.try_send(record).is_err()
        {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

impl Writer {
    /// Writes what is left and tells how many records were dropped.
    ///
    /// # Errors
    /// [`Error::Write`] when the file could not be written.
    pub fn finish(self) -> Result<u64, Error> {
        let Self {
            journal,
            thread,
            path,
        } = self;
        if let Some(sender) = &journal.sender {
            // An error is a thread that has ended: its result says why.
            sender.send(Record::End).ok();
        }
        let ended = thread
            .join()
            .unwrap_or_else(|_| Err(std::io::Error::other("panic")));
        ended.map_err(|reason| Error::Write { path, reason })?;
        Ok(journal.lost.load(Ordering::Relaxed))
    }
}

fn write(mut file: BufWriter<File>, records: &Receiver<Record>) -> std::io::Result<()> {
    while let Ok(record) = records.recv() {
        match record {
            Record::End => break,
            Record::Pose { sent, t, pose } => {
                let (p, q) = (pose.position(), pose.rotation());
                let pose = [p.x, p.y, p.z, q.x, q.y, q.z, q.w];
                writeln!(file, "{}", json!({"sent": sent, "t": t, "pose": pose}))?;
            }
            Record::Event {
                sent,
                t,
                kind,
                detail,
            } => {
                writeln!(
                    file,
                    "{}",
                    json!({"sent": sent, "t": t, "event": kind, "detail": detail})
                )?;
                // What happened should be there if the machine goes down.
                file.flush()?;
            }
        }
    }
    file.flush()
}

/// Seconds since 1970.
fn unix() -> f64 {
    let now = SystemTime::now().duration_since(UNIX_EPOCH);
    now.map_or(0.0, |now| now.as_secs_f64())
}

#[cfg(test)]
mod tests {
    use super::*;
    use selvedge_math::DVec3;

    #[test]
    fn lines_hold_poses_and_events_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.jsonl");
        let (journal, writer) = Journal::create(&path).unwrap();
        let before = unix();
        journal.event(0.0, "state", "holding");
        journal.pose(
            0.25,
            &Pose::from_translation(DVec3::new(0.1, 0.2, 1.0 / 3.0)),
        );
        assert_eq!(writer.finish().unwrap(), 0);
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<serde_json::Value> = text
            .lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect();
        assert_eq!(lines.len(), 2);
        assert_eq!(lines[0]["event"], "state");
        assert_eq!(lines[0]["detail"], "holding");
        assert_eq!(lines[1]["pose"][2], 1.0 / 3.0);
        assert_eq!(lines[1]["pose"][6], 1.0);
        assert_eq!(lines[1]["t"], 0.25);
        let sent = lines[1]["sent"].as_f64().unwrap();
        assert!(sent >= before && sent <= unix());
        assert!(Journal::create(&folder.path().join("no/run.jsonl")).is_err());
    }
}
