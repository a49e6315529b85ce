//! Plays a command log on a robot, or says why not. Without `--execute` nothing is sent.

mod arguments;

use std::fs::File;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel, sync_channel};
use std::time::Duration;

use anyhow::{Context, Result};
use selvedge_math::Jaw;
use selvedge_ros2::connect::{Choice, Robots, connect, show};
use selvedge_ros2::error::Error;
use selvedge_ros2::journal::{Journal, Target, Writer};
use selvedge_ros2::live::Motions;
use selvedge_ros2::names::Names;
use selvedge_ros2::network::Network;
use selvedge_ros2::plan::{Plan, Request};
use selvedge_ros2::play::play;
use selvedge_ros2::state::State;
use selvedge_trajectory::log::Log;

use arguments::{Arguments, setting};

fn main() -> ExitCode {
    match run() {
        Ok(code) => code,
        Err(error) => {
            eprintln!("selvedge-play: {error:#}");
            let refused = matches!(
                error.downcast_ref(),
                Some(Error::Blocked(_) | Error::Value { .. })
            );
            ExitCode::from(if refused { 3 } else { 2 })
        }
    }
}

fn run() -> Result<ExitCode> {
    let (arguments, names, parameters) = arguments::read()?;
    let choice = arguments.choice(parameters)?;
    let stop = Arc::new(AtomicBool::new(false));
    // A dry run may just end.
    if arguments.execute || arguments.live || arguments.preview {
        let flag = Arc::clone(&stop);
        ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed))?;
    }
    let mut run = Run {
        arguments,
        names,
        choice,
        stop,
        robots: None,
        jaw: None,
    };
    if run.arguments.live {
        return run.live();
    }
    let path = run.arguments.log.clone().unwrap_or_default();
    let name = path.display().to_string();
    let file = File::open(&path).with_context(|| format!("{name} cannot be read"))?;
    let log = selvedge_trajectory::log::read(file, &name)?;
    let end = run.log(&log)?;
    run.finish(end)
}

/// What is there from log to log.
struct Run {
    arguments: Arguments,
    names: Names,
    choice: Choice,
    stop: Arc<AtomicBool>,
    robots: Option<(Robots, Journal, Writer)>,
    /// What the jaws were told last.
    jaw: Option<Jaw>,
}

impl Run {
    /// Checks a log, and plays it if that is asked for.
    fn log(&mut self, log: &Log) -> Result<Option<State>> {
        let Arguments {
            speed,
            execute,
            preview,
            ..
        } = self.arguments;
        let (model, placement) = (self.arguments.model()?, self.arguments.placement()?);
        let mut plan = Plan::new(&Request {
            log,
            placement: &placement,
            arm: Some(&model),
            speed,
            limits: self.arguments.limits()?,
            workspace: self.arguments.workspace(&placement)?,
        })?;
        if let Some(prefix) = &self.arguments.prefix {
            let numbered = 1..=plan.joint_names.len();
            plan.joint_names = numbered.map(|k| format!("{prefix}_joint{k}")).collect();
        }
        print(&plan);
        let settings = self.arguments.settings(self.jaw)?;
        if preview {
            self.preview(&plan)?;
        }
        if !execute && self.choice.arm != "record" {
            println!("dry run: nothing was sent; --execute moves the robot");
            return Ok(None);
        }
        let (robots, journal, writer) = match self.robots.take() {
            Some(there) => {
                there.0.show(&plan)?;
                there
            }
            None => {
                let target = Target {
                    topic: self
                        .names
                        .resolve(&self.choice.arm_name()?)
                        .unwrap_or("/pose".into()),
                    frame: self.choice.frame.clone(),
                };
                let made = Journal::create(&self.arguments.journal, Some(target));
                let (journal, writer) = setting(made)?;
                let journal = match self.choice.arm.as_str() {
                    "record" => journal.waiting(),
                    _ => journal,
                };
                let line: Vec<String> = std::env::args().collect();
                journal.event(0.0, "command line", line.join(" "));
                let robots = if self.choice.arm == "record" {
                    Robots::recorded(&plan, &journal)
                } else {
                    let network =
                        setting(Network::from_environment(|name| std::env::var(name).ok()))?;
                    let (names, choice) = (&self.names, &self.choice);
                    let jaws = self.arguments.jaws();
                    let late = overdue("joining the network", JOIN);
                    let there = connect(&network, names, choice, &model, &plan, jaws, &journal);
                    drop(late);
                    setting(there)?
                };
                (robots, journal, writer)
            }
        };
        let (robots, journal, _) = self.robots.insert((robots, journal, writer));
        let (arm, gripper) = (&mut *robots.arm, &mut *robots.gripper);
        let end = play(&plan, arm, gripper, &settings, &self.stop, journal);
        self.jaw = Some(plan.last_jaw());
        Ok(Some(end))
    }

    fn preview(&self, plan: &Plan) -> Result<()> {
        let network = setting(Network::from_environment(|name| std::env::var(name).ok()))?;
        let late = overdue("joining the network", JOIN);
        let shown = show(&network, &self.names, &self.choice, plan)?;
        drop(late);
        let topic = self.names.resolve("~/planned_path")?;
        println!("the path is on {topic} until Ctrl-C");
        while !self.stop.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(50));
        }
        println!("{} programs looked at it", shown.readers());
        Ok(())
    }

    /// Motions from standard input, each checked and played when it is complete.
    fn live(&mut self) -> Result<ExitCode> {
        let motions = motions()?;
        let mut end = None;
        loop {
            let log = match motions.recv_timeout(Duration::from_millis(50)) {
                Ok(log) => log,
                Err(RecvTimeoutError::Timeout) if self.stop.load(Ordering::Relaxed) => break,
                Err(RecvTimeoutError::Timeout) => continue,
                Err(RecvTimeoutError::Disconnected) => break,
            };
            // What is wrong with the next motion is found while the robot rests.
            let ended = log
                .map_err(anyhow::Error::from)
                .and_then(|log| self.log(&log));
            match ended {
                Ok(state) => end = state,
                Err(error) => {
                    self.close()?;
                    return Err(error);
                }
            }
            if matches!(end, Some(State::Stopped(_))) {
                break;
            }
        }
        self.finish(end)
    }

    /// Closes the journal and leaves the network.
    fn close(&mut self) -> Result<()> {
        let Some((robots, _, writer)) = self.robots.take() else {
            return Ok(());
        };
        let lost = writer.finish()?;
        if lost > 0 {
            eprintln!("selvedge-play: {lost} records are not in the journal");
        }
        let _late = overdue("leaving the network", JOIN);
        drop(robots);
        Ok(())
    }

    fn finish(&mut self, end: Option<State>) -> Result<ExitCode> {
        let code = match end {
            None => ExitCode::SUCCESS,
            Some(State::Finished) => {
                println!("finished");
                ExitCode::SUCCESS
            }
            Some(State::Stopped(cause)) => {
                eprintln!("stopped: {cause}");
                ExitCode::FAILURE
            }
            Some(other) => anyhow::bail!("ended in state {}", other.name()),
        };
        self.close()?;
        Ok(code)
    }
}

/// How long the network library may take to join or leave [s]. The arm rests then.
const JOIN: Duration = Duration::from_secs(30);

/// Ends the program unless what is returned is dropped in time: a library that is blocked cannot be
/// asked to stop.
fn overdue(what: &'static str, bound: Duration) -> Sender<()> {
    let (done, waiting) = channel();
    std::thread::spawn(move || {
        if waiting.recv_timeout(bound) == Err(RecvTimeoutError::Timeout) {
            let seconds = bound.as_secs_f64();
            eprintln!("selvedge-play: {what} is not over after {seconds} s: ended");
            std::process::exit(2);
        }
    });
    done
}

/// Motions as they are read, on a thread of their own: a signal must not wait for a row.
fn motions() -> Result<Receiver<Result<Log, Error>>> {
    let (sender, receiver) = sync_channel(1);
    std::thread::Builder::new()
        .name("input".into())
        .spawn(move || {
            let mut motions = match Motions::new(std::io::stdin().lock()) {
                Ok(motions) => motions,
                Err(error) => return sender.send(Err(error)).ok(),
            };
            loop {
                match motions.next() {
                    Ok(Some(log)) => sender.send(Ok(log)).ok()?,
                    Ok(None) => return None,
                    Err(error) => return sender.send(Err(error)).ok(),
                }
            }
        })?;
    Ok(receiver)
}

fn print(plan: &Plan) {
    let p = plan.start().position();
    let q = plan.start().rotation();
    println!(
        "start: tip at ({:.4}, {:.4}, {:.4}) m, xyzw ({:.4}, {:.4}, {:.4}, {:.4})",
        p.x, p.y, p.z, q.x, q.y, q.z, q.w
    );
    println!("start: joints {:.4?} rad", plan.start_joints());
    for (k, segment) in plan.segments.iter().enumerate() {
        let jaw = segment.jaw.map_or(String::new(), |jaw| {
            format!(", then {jaw:?}").to_lowercase()
        });
        println!("motion {}: {:.2} s{jaw}", k + 1, segment.law.duration());
    }
    let all = plan
        .peaks
        .0
        .iter()
        .zip([plan.limits.translation, plan.limits.rotation].concat());
    let used: Vec<String> = all
        .map(|(peak, limit)| format!("{peak:.4} of {limit}"))
        .collect();
    println!("tip v, a, jerk, then rotation: {}", used.join(", "));
    println!(
        "joints: {:.0} % of their bounds; a stop takes {:.2} s at most",
        100.0 * plan.joint_usage,
        plan.brake
    );
}
