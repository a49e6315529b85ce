//! A record of everything that is commanded: one JSON object a line, with the time it was sent, and
//! the same as a bag.
//!
//! The lines are written by a thread of their own. What is to be recorded goes there over a queue of
//! fixed size; when it is full the record is dropped and counted, for the loop must not wait.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{SystemTime, UNIX_EPOCH};

use selvedge_math::Pose;
use serde_json::json;

use crate::bag::Bag;
use crate::error::Error;
use crate::messages::{self, Header, JointTrajectory, Name, PoseStamped, Time};

/// The topic of events in a bag.
const EVENTS: &str = "/selvedge_play/events";
/// Records that may wait: a quarter of a minute at 1 kHz.
const QUEUE: usize = 16_384;

enum Record {
    Pose {
        sent: f64,
        t: f64,
        pose: Pose,
    },
    Trajectory {
        sent: f64,
        t: f64,
        topic: String,
        trajectory: JointTrajectory,
    },
    Event {
        sent: f64,
        t: f64,
        kind: &'static str,
        detail: String,
    },
    End,
}

/// Where poses go as MCAP: topic and frame.
#[derive(Clone, Debug)]
pub struct Target {
    /// The topic they are sent on.
    pub topic: String,
    /// The frame they are in.
    pub frame: String,
}

/// Where records go; clones write to the same file.
#[derive(Clone, Debug)]
pub struct Journal {
    sender: Option<SyncSender<Record>>,
    shared: Arc<Shared>,
    waits: bool,
}

#[derive(Debug, Default)]
struct Shared {
    lost: AtomicU64,
    poses: AtomicU64,
    /// The time of the run, as bits.
    time: AtomicU64,
    state: Mutex<String>,
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
            shared: Arc::default(),
            waits: false,
        }
    }

    /// A journal in a file, and beside it, with the ending `mcap`, the same as a bag. Files that are
    /// there are kept, as `name.1.jsonl` and `name.1.mcap` or with the next number that is free.
    ///
    /// # Errors
    /// [`Error::Write`] when a file cannot be made or moved, [`Error::Value`] when both would be one file.
    pub fn create(path: &Path, bag: Option<Target>) -> Result<(Self, Writer), Error> {
        let name = path.display().to_string();
        let fail = |reason| Error::Write {
            path: name.clone(),
            reason,
        };
        if bag.is_some() && path.extension().is_some_and(|ending| ending == "mcap") {
            let bound = "another ending than mcap, which the bag beside it has";
            return Err(Error::value("the command line", "--journal", name, bound));
        }
        let mut files = vec![path.to_path_buf()];
        files.extend(bag.is_some().then(|| path.with_extension("mcap")));
        keep(&files).map_err(fail)?;
        let file = BufWriter::new(File::create(path).map_err(fail)?);
        let bag = match bag {
            Some(target) => {
                let path = path.with_extension("mcap");
                let bag = Bag::create(&path).map_err(|reason| Error::Write {
                    path: path.display().to_string(),
                    reason,
                })?;
                Some((bag, target))
            }
            None => None,
        };
        let (sender, receiver) = sync_channel(QUEUE);
        let journal = Self {
            sender: Some(sender),
            shared: Arc::default(),
            waits: false,
        };
        let thread = std::thread::Builder::new()
            .name("journal".into())
            .spawn(move || write(file, bag, &receiver))
            .map_err(fail)?;
        let writer = Writer {
            journal: journal.clone(),
            thread,
            path: name,
        };
        Ok((journal, writer))
    }

    /// One that waits when the file is slow, and so drops nothing: for a run whose time is only counted.
    #[must_use]
    pub fn waiting(self) -> Self {
        Self {
            waits: true,
            ..self
        }
    }

    /// A pose that is sent now; `t` is the time of the run [s].
    pub fn pose(&self, t: f64, pose: &Pose) {
        self.shared.poses.fetch_add(1, Ordering::Relaxed);
        self.put(Record::Pose {
            sent: unix(),
            t,
            pose: *pose,
        });
    }

    /// A trajectory that is sent now.
    pub fn trajectory(&self, t: f64, topic: &str, trajectory: &JointTrajectory) {
        if self.sender.is_some() {
            self.put(Record::Trajectory {
                sent: unix(),
                t,
                topic: topic.into(),
                trajectory: trajectory.clone(),
            });
        }
    }

    /// Anything else that happens; of the kind `state` it is what [`Journal::told`] tells.
    pub fn event(&self, t: f64, kind: &'static str, detail: impl Into<String>) {
        let detail = detail.into();
        self.shared.time.store(t.to_bits(), Ordering::Relaxed);
        if kind == "state" {
            let mut state = self.shared.state.lock().unwrap_or_else(|e| e.into_inner());
            state.clone_from(&detail);
        }
        self.put(Record::Event {
            sent: unix(),
            t,
            kind,
            detail,
        });
    }

    /// What another thread than that of the run has to say.
    pub fn note(&self, kind: &'static str, detail: impl Into<String>) {
        self.put(Record::Event {
            sent: unix(),
            t: f64::from_bits(self.shared.time.load(Ordering::Relaxed)),
            kind,
            detail: detail.into(),
        });
    }

    /// The state of the run, and how many poses were sent.
    pub fn told(&self) -> (String, u64) {
        let state = self.shared.state.lock().unwrap_or_else(|e| e.into_inner());
        (state.clone(), self.shared.poses.load(Ordering::Relaxed))
    }

    fn put(&self, record: Record) {
        let Some(sender) = &self.sender else {
            return;
        };
        let kept = match self.waits {
            true => sender.send(record).is_ok(),
            false => sender.try_send(record).is_ok(),
        };
        if !kept {
            self.shared.lost.fetch_add(1, Ordering::Relaxed);
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
        Ok(journal.shared.lost.load(Ordering::Relaxed))
    }
}

/// Moves the files that are there to a number that none of them has yet.
fn keep(paths: &[PathBuf]) -> std::io::Result<()> {
    let numbered = |path: &Path, number: u32| {
        let ending = path.extension().map(|ending| ending.to_string_lossy());
        path.with_extension(match ending {
            Some(ending) => format!("{number}.{ending}"),
            None => number.to_string(),
        })
    };
    // A terminal or a pipe is not moved.
    if !paths.iter().any(|path| path.is_file()) {
        return Ok(());
    }
    let free = |number: &u32| !paths.iter().any(|path| numbered(path, *number).exists());
    let number = (1..).find(free).unwrap_or_default();
    for path in paths.iter().filter(|path| path.is_file()) {
        std::fs::rename(path, numbered(path, number))?;
    }
    Ok(())
}

fn write(
    mut file: BufWriter<File>,
    mut bag: Option<(Bag, Target)>,
    records: &Receiver<Record>,
) -> std::io::Result<()> {
    while let Ok(record) = records.recv() {
        match record {
            Record::End => break,
            Record::Pose { sent, t, pose } => {
                if let Some((bag, target)) = &mut bag {
                    let header = Header {
                        stamp: Time::from_seconds(sent),
                        frame_id: Name::new(&target.frame),
                    };
                    let pose = messages::Pose::from(&pose);
                    let message = PoseStamped { header, pose };
                    bag.put(
                        sent,
                        &target.topic,
                        "geometry_msgs/msg/PoseStamped",
                        &message,
                    )?;
                }
                let (p, q) = (pose.position(), pose.rotation());
                let pose = [p.x, p.y, p.z, q.x, q.y, q.z, q.w];
                writeln!(file, "{}", json!({"sent": sent, "t": t, "pose": pose}))?;
            }
            Record::Trajectory {
                sent,
                t,
                topic,
                trajectory,
            } => {
                if let Some((bag, _)) = &mut bag {
                    let kind = "trajectory_msgs/msg/JointTrajectory";
                    bag.put(sent, &format!("{topic}/trajectory"), kind, &trajectory)?;
                }
                let line = json!({"sent": sent, "t": t, "event": "trajectory", "detail": topic, "trajectory": trajectory});
                writeln!(file, "{line}")?;
            }
            Record::Event {
                sent,
                t,
                kind,
                detail,
            } => {
                let line = json!({"sent": sent, "t": t, "event": kind, "detail": detail});
                if let Some((bag, _)) = &mut bag {
                    bag.put(sent, EVENTS, "std_msgs/msg/String", &line.to_string())?;
                }
                writeln!(file, "{line}")?;
                // What happened should be there if the machine goes down.
                file.flush()?;
            }
        }
    }
    if let Some((bag, _)) = bag {
        bag.finish()?;
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
        let (journal, writer) = Journal::create(&path, None).unwrap();
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
        assert!(Journal::create(&folder.path().join("no/run.jsonl"), None).is_err());
        let target = Target {
            topic: "/a".into(),
            frame: "b".into(),
        };
        let same = Journal::create(&folder.path().join("run.mcap"), Some(target));
        assert!(same.unwrap_err().to_string().contains("another ending"));
    }

    #[test]
    fn earlier_journals_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.jsonl");
        for run in ["first", "second", "third"] {
            let target = Target {
                topic: "/a".into(),
                frame: "b".into(),
            };
            let (journal, writer) = Journal::create(&path, Some(target)).unwrap();
            journal.event(0.0, "run", run);
            assert_eq!(writer.finish().unwrap(), 0);
        }
        for (name, run) in [("run.1", "first"), ("run.2", "second"), ("run", "third")] {
            let text = std::fs::read_to_string(folder.path().join(format!("{name}.jsonl")));
            assert!(text.unwrap().contains(run), "{name}");
            assert!(folder.path().join(format!("{name}.mcap")).is_file());
        }
    }
}
