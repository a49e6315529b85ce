//! A run against the peer, and what is looked at afterwards.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use selvedge_franka::{Arm, Placement};
use selvedge_math::{Command, DVec3, Jaw, Pose};
use selvedge_ros2::arm::Arm as Robot;
use selvedge_ros2::connect::{Choice, connect};
use selvedge_ros2::gripper::jaws::Jaws;
use selvedge_ros2::journal::{Journal, Target};
use selvedge_ros2::limits::Limits;
use selvedge_ros2::names::Names;
use selvedge_ros2::network::{Distro, Mapping, Network};
use selvedge_ros2::plan::{Plan, Request, Workspace};
use selvedge_ros2::play::{Settings, play};
use selvedge_ros2::security::Enclave;
use selvedge_ros2::state::State;
use selvedge_trajectory::log::{Log, Sample};
use serde_json::{Value, json};

use crate::peer::{Domain, Peer};

/// 10 cm sideways within a second, fingers down, closed on the way.
pub(crate) fn plan(speed: f64) -> Plan {
    let mut log = Log::new("sideways");
    for k in 0..=90 {
        let t = f64::from(k) / 60.0;
        let u = (t - 0.25).clamp(0.0, 1.0);
        let s = u * u * u * (10.0 - 15.0 * u + 6.0 * u * u);
        let pose = Pose::from_translation(DVec3::new(0.0, 0.05 - 0.1 * s, 0.05));
        let jaw = if t > 0.1 && t < 1.4 {
            Jaw::Closed
        } else {
            Jaw::Open
        };
        log.samples.push(Sample {
            time: t,
            command: Command { pose, jaw },
        });
    }
    planned(&log, speed)
}

/// A log on an FR3 half a metre behind the cloth.
pub(crate) fn planned(log: &Log, speed: f64) -> Plan {
    let placement = Placement::new([-0.5, 0.0, 0.0, 0.0], 0.0).unwrap();
    Plan::new(&Request {
        log,
        placement: &placement,
        arm: Some(&Arm::fr3()),
        speed,
        limits: Limits::default(),
        workspace: Workspace::franka(0.0),
    })
    .unwrap()
}

/// A run: change what is not as usual, then [`Job::play`].
pub(crate) struct Job {
    test: &'static str,
    /// What the peer is told.
    pub(crate) told: Value,
    pub(crate) choice: Choice,
    pub(crate) names: Names,
    pub(crate) jaws: Jaws,
    pub(crate) plan: Plan,
    pub(crate) settings: Settings,
    pub(crate) mapping: Mapping,
    pub(crate) security: Option<Enclave>,
    /// When it is stopped from outside [s].
    pub(crate) stop_after: Option<f64>,
    /// Whether the peer comes again when it has gone.
    pub(crate) again: bool,
    /// Whether its timing is looked at, which wants the machine alone.
    pub(crate) timed: bool,
    /// How late the peer comes [s].
    pub(crate) late: f64,
}

pub(crate) struct Played {
    pub(crate) end: State,
    /// What the peer has received.
    pub(crate) got: Value,
    /// The journal.
    pub(crate) lines: Vec<Value>,
    pub(crate) plan: Plan,
    pub(crate) period: f64,
}

impl Job {
    pub(crate) fn new(test: &'static str, arm: &str, gripper: &str) -> Self {
        let period = 0.004;
        Self {
            test,
            told: json!({}),
            choice: Choice {
                arm: arm.into(),
                arm_name: (arm == "joints").then(|| "/arm/follow_joint_trajectory".into()),
                gripper: gripper.into(),
                gripper_name: Some(
                    match gripper {
                        "franka" => "/hand",
                        "parallel" => "/parallel",
                        "bool" | "set-bool" => "/close",
                        _ => "/gripper",
                    }
                    .into(),
                ),
                gripper_joint: "finger".into(),
                frame: "fr3_link0".into(),
                tip: "fr3_hand_tcp".into(),
                group: "fr3_arm".into(),
                joint_states: "joint_states".into(),
                current_pose: None,
                frames: false,
                franka_state: None,
                sim_time: false,
                distro: Distro::Jazzy,
                patience: 3.0,
                parameters: Vec::new(),
            },
            names: Names::default(),
            jaws: Jaws {
                blind: 0.2,
                ..Jaws::default()
            },
            plan: plan(1.0),
            // Other programs share the machine: late is fine here, lost is not.
            settings: Settings {
                period,
                overrun: 2.0,
                hold: 0.3,
                stale: 0.4,
                ..Settings::default()
            },
            mapping: Mapping::Cyclone,
            security: None,
            stop_after: None,
            again: false,
            timed: false,
            late: 0.0,
        }
    }

    /// Sets what the peer is told.
    pub(crate) fn told(mut self, told: Value) -> Self {
        self.told = told;
        self
    }

    pub(crate) fn play(self) -> Option<Played> {
        self.play_with(|arm, play| play(arm))
    }

    /// Plays on what `wrap` makes of the arm.
    pub(crate) fn play_with(
        self,
        wrap: impl FnOnce(&mut dyn Robot, &mut dyn FnMut(&mut dyn Robot) -> State) -> State,
    ) -> Option<Played> {
        let plan = &self.plan;
        let mut told = self.told.clone();
        (told["arm_kind"], told["gripper_kind"]) =
            (json!(self.choice.arm), json!(self.choice.gripper));
        let told = &told;
        let domain = Domain::free(self.timed);
        let stage = Stage::new(self.test);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.jsonl");
        let target = Target {
            topic: "/target_pose".into(),
            frame: "fr3_link0".into(),
        };
        let (journal, writer) = Journal::create(&path, Some(target)).unwrap();
        let network = Network {
            domain: domain.id,
            loopback: true,
            mapping: self.mapping,
            security: self.security.clone(),
        };
        let start = || {
            Peer::start(
                self.test,
                &domain,
                plan.start_joints(),
                &plan.joint_names,
                told,
            )
        };
        stage.enter("waiting for the peer and joining the network");
        // A peer that comes late is started while we wait for it.
        let (mut robots, mut peer);
        let join = || {
            let (names, choice) = (&self.names, &self.choice);
            connect(
                &network,
                names,
                choice,
                &Arm::fr3(),
                plan,
                self.jaws,
                &journal,
            )
            .unwrap()
        };
        if self.late > 0.0 {
            robots = join();
            std::thread::sleep(Duration::from_secs_f64(self.late));
            peer = start()?;
        } else {
            peer = start()?;
            robots = join();
        }
        let stop = Arc::new(AtomicBool::new(false));
        if let Some(seconds) = self.stop_after {
            let stop = Arc::clone(&stop);
            std::thread::spawn(move || {
                std::thread::sleep(Duration::from_secs_f64(seconds));
                stop.store(true, Ordering::Relaxed);
            });
        }
        stage.enter("playing");
        let (arm, gripper) = (&mut *robots.arm, &mut *robots.gripper);
        let end = std::thread::scope(|scope| {
            let again = self.again.then(|| {
                scope.spawn(|| {
                    peer.gone();
                    let mut told = told.clone();
                    told.as_object_mut().unwrap().remove("kill_after");
                    let (joints, names) = (plan.start_joints(), &plan.joint_names);
                    Peer::start(self.test, &domain, joints, names, &told)
                })
            });
            let mut run =
                |arm: &mut dyn Robot| play(plan, arm, gripper, &self.settings, &stop, &journal);
            let end = wrap(arm, &mut run);
            again.map(|again| again.join().unwrap());
            end
        });
        std::thread::sleep(Duration::from_millis(300));
        stage.enter("leaving the network");
        drop(robots);
        stage.enter("closing the journal");
        assert_eq!(writer.finish().unwrap(), 0);
        stage.enter("waiting for what the peer has received");
        let lines = std::fs::read_to_string(&path).unwrap();
        let lines = lines.lines();
        Some(Played {
            end,
            got: peer.finish(),
            lines: lines
                .map(|line| serde_json::from_str(line).unwrap())
                .collect(),
            period: self.settings.period,
            plan: self.plan,
        })
    }
}

/// How long a run may take [s]: many times what the longest one needs on a busy machine.
const DEADLINE: Duration = Duration::from_secs(180);

/// What a run is at. One that is not over in time ends the whole test program and says where it was:
/// a thread that is blocked inside a library cannot be ended alone.
struct Stage {
    at: Arc<Mutex<&'static str>>,
    _over: Sender<()>,
}

impl Stage {
    fn new(test: &'static str) -> Self {
        let at = Arc::new(Mutex::new("making its files"));
        let (over, ended) = channel::<()>();
        let seen = Arc::clone(&at);
        std::thread::spawn(move || {
            if ended.recv_timeout(DEADLINE) == Err(RecvTimeoutError::Timeout) {
                let at = seen.lock().unwrap();
                eprintln!("{test}: not over after {DEADLINE:?}, {at}");
                std::process::abort();
            }
        });
        Self { at, _over: over }
    }

    fn enter(&self, stage: &'static str) {
        *self.at.lock().unwrap() = stage;
    }
}

/// Plays two at a time, most of which is waiting; nothing where there is no peer.
pub(crate) fn all(jobs: Vec<Job>) -> Vec<Played> {
    let mut jobs = jobs.into_iter();
    let mut played = Vec::new();
    while let Some(first) = jobs.next() {
        let second = jobs.next();
        std::thread::scope(|scope| {
            let beside = second.map(|job| scope.spawn(|| job.play()));
            played.extend(first.play());
            played.extend(beside.and_then(|beside| beside.join().unwrap()));
        });
    }
    played
}

pub(crate) fn seven(value: &Value) -> [f64; 7] {
    let numbers = value.as_array().unwrap().iter();
    let numbers: Vec<f64> = numbers.map(|x| x.as_f64().unwrap()).collect();
    numbers.try_into().unwrap()
}

impl Played {
    /// Why it was stopped.
    pub(crate) fn cause(&self) -> String {
        let State::Stopped(cause) = &self.end else {
            panic!("{:?}", self.end);
        };
        cause.to_string()
    }

    /// Poses by the journal.
    pub(crate) fn sent(&self) -> Vec<[f64; 7]> {
        let poses = self.lines.iter().filter_map(|line| line.get("pose"));
        poses.map(seven).collect()
    }

    pub(crate) fn goals(&self) -> &[Value] {
        self.got["goals"].as_array().unwrap()
    }

    /// What was sent is smooth and ends at rest.
    pub(crate) fn rests(&self) {
        let sent: Vec<DVec3> = self
            .sent()
            .iter()
            .map(|p| DVec3::new(p[0], p[1], p[2]))
            .collect();
        let rates = |x: &[DVec3]| -> Vec<DVec3> {
            x.windows(2).map(|p| (p[1] - p[0]) / self.period).collect()
        };
        let v = rates(&sent);
        let a = rates(&v).iter().map(|a| a.length()).fold(0.0, f64::max);
        assert!(a < 1.02, "{a}");
        let end = v.len().saturating_sub(40);
        assert!(v[end..].iter().all(|v| v.length() < 1e-9), "not at rest");
    }
}
