//! A long stream of poses through the bridge to a robot of another make on 127.0.0.1: nothing is lost, the
//! period is kept, and memory stays what it is.
//!
//! `soak [MINUTES [HERTZ]]`, one minute at 250 Hz if it is not told. The robot is that of the tests, on Cyclone
//! DDS: the Python in `SELVEDGE_PYTHON`, else `python3`, must have `cyclonedds`, or the run is skipped.
#![allow(
    clippy::unwrap_used,
    reason = "an example stops at what it cannot have"
)]

#[path = "../tests/peer/mod.rs"]
mod peer;
#[path = "../tests/interop/run.rs"]
#[allow(dead_code, reason = "not all of it is needed")]
mod run;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use selvedge_math::{Command, DVec3, Jaw, Pose};
use selvedge_ros2::state::State;
use selvedge_trajectory::log::{Log, Sample};

/// A stroke there and back [s].
const STROKE: f64 = 8.0;
/// Rows of the log a second: the way is as smooth as its spline.
const ROWS: f64 = 5.0;
/// How much more memory the program may have at the end [kB].
const GROWTH: f64 = 2048.0;

/// 10 cm there and back, for so many seconds.
fn log(seconds: f64) -> Log {
    let mut log = Log::new("there and back");
    for k in 0..=(seconds * ROWS).ceil() as u32 {
        let time = f64::from(k) / ROWS;
        let turn = std::f64::consts::TAU * time / STROKE;
        let pose = Pose::from_translation(DVec3::new(0.0, 0.05 * turn.cos(), 0.05));
        let jaw = Jaw::Open;
        let command = Command { pose, jaw };
        log.samples.push(Sample { time, command });
    }
    log
}

/// Memory that this program has [kB].
fn resident() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmRSS:"))?;
    line.split_whitespace().nth(1)?.parse().ok()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let mut number = |default: f64| {
        let text = arguments.next();
        text.map_or(default, |text| text.parse().unwrap())
    };
    let (minutes, hertz) = (number(1.0), number(250.0));
    let mut job = run::Job::new("soak", "cartesian", "none");
    job.settings.period = 1.0 / hertz;
    job.plan = run::planned(&log(60.0 * minutes), 1.0);

    // Memory is looked at once a second.
    let over = AtomicBool::new(false);
    let (played, memory) = std::thread::scope(|scope| {
        let watch = scope.spawn(|| {
            let mut memory = Vec::new();
            while !over.load(Ordering::Relaxed) {
                memory.extend(resident());
                std::thread::sleep(Duration::from_secs(1));
            }
            memory
        });
        let played = job.play_with(|arm, play| {
            let end = play(arm);
            // What is read and compared afterwards is not the bridge.
            over.store(true, Ordering::Relaxed);
            end
        });
        over.store(true, Ordering::Relaxed);
        (played, watch.join().unwrap())
    });
    let Some(played) = played else { return };
    assert_eq!(played.end, State::Finished);

    // Everything from the first pose that came on, in order.
    let sent = played.sent();
    let got = played.got["poses"].as_array().unwrap();
    let before = sent.len() - got.len();
    assert!(
        (before as f64) < 0.3 * hertz,
        "{before} of {} lost",
        sent.len()
    );
    for (sent, got) in sent[before..].iter().zip(got) {
        assert_eq!(*sent, run::seven(got));
    }
    let arrivals = played.got["arrivals"].as_array().unwrap().iter();
    let arrivals: Vec<f64> = arrivals.map(|t| t.as_f64().unwrap()).collect();
    let poses = played
        .lines
        .iter()
        .filter(|line| line.get("pose").is_some());
    let times: Vec<f64> = poses.map(|line| line["sent"].as_f64().unwrap()).collect();
    let tell = |what: &str, times: &[f64]| {
        let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let period = (times[times.len() - 1] - times[0]) / steps.len() as f64;
        steps
            .iter_mut()
            .for_each(|step| *step = (*step - 1.0 / hertz).abs());
        steps.sort_by(f64::total_cmp);
        let p99 = steps[steps.len() * 99 / 100];
        let worst = steps[steps.len() - 1];
        println!(
            "{what}: mean period {:.4} ms, jitter p99 {:.3} ms, worst {:.3} ms",
            1e3 * period,
            1e3 * p99,
            1e3 * worst
        );
        period
    };
    println!(
        "{} poses in {minutes} min, {before} before the match, 0 lost after",
        sent.len()
    );
    let period = tell("sent", &times);
    tell("received", &arrivals);
    assert!(
        (period * hertz - 1.0).abs() < 0.01,
        "the period is {period} s"
    );

    // Once all threads are there and the queues have been used, memory is what it is.
    let settled = memory.len() / 5;
    let parts = (memory.len() - settled) / 4;
    let (first, last) = (
        mean(&memory[settled..settled + parts]),
        mean(&memory[memory.len() - parts..]),
    );
    println!("memory: {first:.0} kB, at the end {last:.0} kB");
    assert!(last - first < GROWTH, "memory grows");
}
