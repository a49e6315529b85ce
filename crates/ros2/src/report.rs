//! What this program tells others: the path that is planned, how it goes, and what the robot says of
//! itself. Nothing in here commands anything, and none of it runs on the thread of the loop.

use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::clock::Clock;
use crate::dds::{Bus, Kept, Peers, Writer};
use crate::error::Error;
use crate::journal::Journal;
use crate::messages::franka::RobotState;
use crate::messages::{
    DiagnosticArray, DiagnosticStatus, Header, KeyValue, Name, Path, PoseStamped,
};
use crate::plan::Plan;

/// From one report to the next: who hears none for a second knows that this program is gone.
const BEAT: Duration = Duration::from_millis(250);
/// From pose to pose of the path [s].
const STEP: f64 = 0.05;

/// Publishes the path once, for all who come later too, and reports from then on.
pub(crate) struct Report {
    path: Writer<Path>,
    topic: String,
    frame: String,
    peers: Peers,
}

fn failed(topic: &str, reason: impl ToString) -> Error {
    Error::Network {
        what: topic.into(),
        reason: reason.to_string(),
    }
}

impl Report {
    pub(crate) fn new(
        bus: &mut Bus,
        plan: &Plan,
        frame: &str,
        franka_state: Option<&str>,
        clock: &Clock,
        journal: &Journal,
    ) -> Result<Self, Error> {
        let topic = bus.resolve("~/planned_path")?;
        let report = Self {
            path: bus.writer(&topic, ("nav_msgs", "Path"), Kept::Last)?,
            topic,
            frame: frame.into(),
            peers: bus.peers(),
        };
        report.show(plan)?;

        let robot: Arc<Mutex<String>> = Arc::default();
        if let Some(topic) = franka_state {
            let (shared, journal) = (Arc::clone(&robot), journal.clone());
            let take = move |state: RobotState| {
                let told = state.told();
                let mut last = shared.lock().unwrap_or_else(|e| e.into_inner());
                if *last != told {
                    journal.note("robot", told.clone());
                    *last = told;
                }
            };
            bus.subscribe(topic, ("franka_msgs", "FrankaRobotState"), Kept::No, take)?;
        }

        let topic = bus.resolve("/diagnostics")?;
        let kind = ("diagnostic_msgs", "DiagnosticArray");
        let diagnostics = bus.writer(&topic, kind, Kept::No)?;
        let (over, journal, clock) = (bus.over(), journal.clone(), clock.clone());
        std::thread::Builder::new()
            .name("report".into())
            .spawn(move || {
                while !over.load(Ordering::Relaxed) {
                    let robot = robot.lock().unwrap_or_else(|e| e.into_inner()).clone();
                    if let Ok(stamp) = clock.now() {
                        let frame_id = Name::new("");
                        let header = Header { stamp, frame_id };
                        let status = vec![status(&journal, robot)];
                        // Who does not hear it misses it: nothing else can be done here.
                        diagnostics.write(DiagnosticArray { header, status }).ok();
                    }
                    std::thread::sleep(BEAT);
                }
            })
            .map_err(|e| failed("a thread", e))?;
        Ok(report)
    }

    /// Publishes the path of a plan.
    pub(crate) fn show(&self, plan: &Plan) -> Result<(), Error> {
        let written = self.path.write(message(plan, &self.frame));
        written.map_err(|reason| failed(&self.topic, reason))
    }

    /// How many look at it.
    pub(crate) fn readers(&self) -> usize {
        let topic = format!("rt{}", self.topic);
        let readers = self.peers.readers();
        readers.iter().filter(|peer| peer.topic == topic).count()
    }
}

/// Without a time: RViz then shows it where the frame is now.
fn message(plan: &Plan, frame: &str) -> Path {
    let frame_id = Name::new(frame);
    let header = || Header {
        frame_id: frame_id.clone(),
        ..Header::none()
    };
    let poses = plan.segments.iter().flat_map(|segment| {
        let steps = (segment.law.length / STEP).ceil() as usize;
        (0..=steps).map(move |k| segment.pose(segment.law.length * k as f64 / steps as f64))
    });
    let poses = poses.map(|pose| PoseStamped {
        header: header(),
        pose: (&pose).into(),
    });
    Path {
        header: header(),
        poses: poses.collect(),
    }
}

fn status(journal: &Journal, robot: String) -> DiagnosticStatus {
    let (state, sent) = journal.told();
    let bad = state.starts_with("stop");
    let values = [("poses sent", sent.to_string()), ("robot", robot)];
    let values = values.map(|(key, value)| KeyValue {
        key: key.into(),
        value,
    });
    DiagnosticStatus {
        level: if bad { 2 } else { 0 },
        name: "selvedge_play: run".into(),
        message: state,
        hardware_id: String::new(),
        values: values.into(),
    }
}
