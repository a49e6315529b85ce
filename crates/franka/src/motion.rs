//! From joint positions along the rows of a log to motions in time.

use selvedge_math::Command;
use selvedge_trajectory::log::{Log, Sample};

use crate::fastest::{self, Law};
use crate::route::{Station, lengths};
use crate::spline::{Ends, Spline};
use crate::timing::{TICK, slow_down, usage};
use crate::{Arm, Placement, Rates, Usage, task};

/// Rows of a moving part that the path's spline goes through, about.
const KNOTS: usize = 200;
/// A motion that must take more times as long than this is none.
const SLOWEST: f64 = 100.0;
/// A part of the log that is shorter than this does not move [m].
const STILL: f64 = 1e-7;
/// Poses of a straight line in joint space.
const LINE: usize = 5;

/// A motion of the whole arm: rows of joint positions, joined as [`usage`](crate::usage()) does.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    /// Times of the rows [s], from 0.
    pub times: Vec<f64>,
    /// Joint positions, one number a joint for each row [rad or m].
    pub q: Vec<f64>,
    /// Whether the jaws are closed.
    pub closed: Vec<bool>,
}

impl Motion {
    fn push(&mut self, time: f64, q: &[f64], closed: bool) {
        self.times.push(time);
        self.q.extend_from_slice(q);
        self.closed.push(closed);
    }

    fn end(&self) -> f64 {
        self.times.last().copied().unwrap_or_default()
    }
}

/// First and last row of a part of the log, and its path and law if it moves.
type Part = (usize, usize, Option<(Spline, Law)>);

/// How a path is timed.
#[derive(Clone, Debug)]
pub struct Timing {
    /// How much of each bound the rows of the log use as they are timed.
    pub commanded: Vec<Usage>,
    /// By which factor all of the log must take longer; 1 when it is fine as it is.
    pub slow_down: f64,
    /// The least time for what moves in the log, sampled at 1 kHz [s], and the time the log takes for
    /// it.
    pub least: f64,
    /// See `least`.
    pub asked: f64,
    /// The log with its moving parts as fast as rows at its period can be, at rest where the jaws
    /// act and where the log rests.
    pub fastest: Log,
    /// Joint positions of its rows, one number a joint for each. From the poses alone another choice
    /// of the redundant joint may come out, with other needs of time.
    pub fastest_q: Vec<f64>,
    /// Home, over the cloth, down to the grasp, the log (slower where it must be), up, home.
    pub motion: Motion,
}

/// What the path is made of.
pub(crate) struct Path<'a> {
    pub(crate) arm: &'a Arm,
    pub(crate) log: &'a Log,
    pub(crate) placement: &'a Placement,
    pub(crate) stations: &'a [Station],
    /// Of each row of the log.
    pub(crate) rows: &'a [usize],
    /// Of each station.
    pub(crate) q: &'a [f64],
    pub(crate) home: &'a [f64],
}

impl Path<'_> {
    fn station(&self, k: usize) -> &[f64] {
        let n = self.arm.joints().len();
        &self.q[k * n..(k + 1) * n]
    }

    /// None where a velocity bound is zero on the way, or where it must take [`SLOWEST`] times as long.
    pub(crate) fn timing(&self, rates: &Rates) -> Option<Timing> {
        let samples = &self.log.samples;
        let times: Vec<f64> = samples.iter().map(|sample| sample.time).collect();
        let rows: Vec<f64> = self
            .rows
            .iter()
            .flat_map(|&k| self.station(k))
            .copied()
            .collect();
        let commanded = usage(self.arm, rates, &times, &rows);
        let slower = slow_down(&commanded).max(1.0);
        if slower.is_nan() || slower > SLOWEST {
            return None;
        }
        let period = period(&times);
        let (mut least, mut asked) = (0.0, 0.0);
        let mut laws = Vec::new();
        for (first, last) in parts(self.log) {
            let stations = &self.stations[self.rows[first]..=self.rows[last]];
            let length = lengths(stations).last().copied().unwrap_or_default();
            let law = match task::rests(self.log, first) || length < STILL {
                true => None,
                false => {
                    asked += samples[last].time - samples[first].time;
                    let path = self.curve(self.rows[first], self.rows[last]);
                    least += fastest::fastest(self.arm, rates, &path, TICK)?.duration();
                    let law = fastest::fastest(self.arm, rates, &path, period)?;
                    Some((path, law))
                }
            };
            laws.push((first, last, law));
        }
        // Each part keeps its bounds; the spline through all of them has to as well.
        let mut stretch = 1.0;
        let (fastest, fastest_q) = (0..10).find_map(|_| {
            let (log, rows) = self.retimed(&laws, period, stretch);
            let times: Vec<f64> = log.samples.iter().map(|sample| sample.time).collect();
            let whole = slow_down(&usage(self.arm, rates, &times, &rows));
            stretch *= whole * (1.0 + 1e-6);
            (whole <= 1.0).then_some((log, rows))
        })?;
        Some(Timing {
            motion: self.motion(rates, &times, slower, period)?,
            commanded,
            slow_down: slower,
            least,
            asked,
            fastest,
            fastest_q,
        })
    }

    /// The log with its moving parts by their laws, each `stretch` times as long or a little more, and
    /// the joint positions of its rows.
    fn retimed(&self, laws: &[Part], period: f64, stretch: f64) -> (Log, Vec<f64>) {
        let samples = &self.log.samples;
        let mut log = Log {
            samples: Vec::new(),
            source: format!("{}, as fast as {} allows", self.log.source, self.arm.name()),
            ..self.log.clone()
        };
        let mut rows = Vec::new();
        let mut time = samples[0].time;
        let mut q = vec![0.0; self.arm.joints().len()];
        for (first, last, law) in laws {
            let Some((path, law)) = law else {
                for row in *first..*last {
                    log.samples.push(Sample {
                        time,
                        ..samples[row]
                    });
                    rows.extend_from_slice(self.station(self.rows[row]));
                    time += samples[row + 1].time - samples[row].time;
                }
                continue;
            };
            let count = (law.duration() * stretch / period - 1e-6).ceil();
            let law = law.clone().lasting(count * period);
            for k in 0..count as usize {
                path.position(law.at(period * k as f64), &mut q);
                // The first row keeps its pose to the bit.
                let pose = match k {
                    0 => samples[*first].command.pose,
                    _ => {
                        let tip = self.arm.forward(&q);
                        self.placement.gripper(&tip, self.log.tip_offset)
                    }
                };
                let jaw = samples[*first].command.jaw;
                let command = Command { pose, jaw };
                log.samples.push(Sample { time, command });
                rows.extend_from_slice(&q);
                time += period;
            }
        }
        let end = samples[samples.len() - 1];
        log.samples.push(Sample { time, ..end });
        rows.extend_from_slice(self.station(self.rows[samples.len() - 1]));
        even(&mut log.samples, period);
        (log, rows)
    }

    /// The joint path through some stations, at distances that a spline can be differentiated at.
    fn curve(&self, first: usize, last: usize) -> Spline {
        let n = self.arm.joints().len();
        let lengths = lengths(&self.stations[first..=last]);
        let whole = lengths[lengths.len() - 1];
        let least = 0.4 * whole / KNOTS as f64;
        let (mut u, mut q) = (vec![0.0], self.station(first).to_vec());
        for k in first + 1..=last {
            let length = lengths[k - first];
            let is_last = k == last;
            if length - u[u.len() - 1] < least && is_last && u.len() > 1 {
                u.pop();
                q.truncate(q.len() - n);
            }
            if length - u[u.len() - 1] >= least || is_last {
                u.push(length.max(u[u.len() - 1] + 1e-12));
                q.extend_from_slice(self.station(k));
            }
        }
        Spline::new(&u, &q, n, Ends::Free)
    }

    /// Straight in joint space.
    fn line(&self, from: &[f64], to: &[f64]) -> Option<Spline> {
        let furthest = from
            .iter()
            .zip(to)
            .fold(0.0_f64, |d, (a, b)| d.max((a - b).abs()));
        if furthest < 1e-6 {
            return None;
        }
        let u: Vec<f64> = (0..LINE)
            .map(|k| furthest * k as f64 / (LINE - 1) as f64)
            .collect();
        let q = line(from, to, LINE);
        Some(Spline::new(&u, &q, from.len(), Ends::Free))
    }

    fn motion(&self, rates: &Rates, times: &[f64], slower: f64, period: f64) -> Option<Motion> {
        let n = self.arm.joints().len();
        let (first, last) = (self.rows[0], self.rows[self.rows.len() - 1]);
        let end = self.stations.len() - 1;
        let mut motion = Motion {
            times: Vec::new(),
            q: Vec::new(),
            closed: Vec::new(),
        };
        let mut q = vec![0.0; n];
        let mut go = |motion: &mut Motion, path: &Spline, closed: bool| {
            let law = fastest::fastest(self.arm, rates, path, period)?;
            let start = motion.end();
            let count = (law.duration() / period).round() as usize;
            for k in usize::from(!motion.times.is_empty())..=count {
                path.position(law.at(period * k as f64), &mut q);
                motion.push(start + period * k as f64, &q, closed);
            }
            Some(())
        };
        let closed = |row: usize| self.log.samples[row].command.jaw.is_closed();
        if let Some(path) = self.line(self.home, self.station(0)) {
            go(&mut motion, &path, closed(0))?;
        }
        go(&mut motion, &self.curve(0, first), closed(0))?;
        // The log, its first row at the end of the approach.
        let start = motion.end();
        for (row, &station) in self.rows.iter().enumerate() {
            let time = start + slower * (times[row] - times[0]);
            if row > 0 {
                motion.push(time, self.station(station), closed(row));
            } else if let Some(last) = motion.closed.last_mut() {
                *last = closed(0);
            }
        }
        let row = self.rows.len() - 1;
        go(&mut motion, &self.curve(last, end), closed(row))?;
        if let Some(path) = self.line(self.station(end), self.home) {
            go(&mut motion, &path, closed(row))?;
        }
        // The parts keep their bounds; the spline through all of them has to as well.
        for _ in 0..10 {
            let whole = slow_down(&usage(self.arm, rates, &motion.times, &motion.q));
            if whole <= 1.0 {
                return Some(motion);
            }
            if whole.is_nan() || whole > SLOWEST {
                return None;
            }
            for time in &mut motion.times {
                *time *= whole * (1.0 + 1e-9);
            }
        }
        None
    }
}

/// Joint positions on a straight line, ends included.
pub(crate) fn line(from: &[f64], to: &[f64], count: usize) -> Vec<f64> {
    let shares = (0..count).map(|k| k as f64 / (count - 1) as f64);
    shares
        .flat_map(|share| from.iter().zip(to).map(move |(a, b)| a + share * (b - a)))
        .collect()
}

/// The moving and the resting parts of a log as first and last row, one after the other; a change of
/// the jaws is an end of a part.
fn parts(log: &Log) -> Vec<(usize, usize)> {
    let rows = log.samples.len();
    let mut parts = Vec::new();
    let mut first = 0;
    for row in 1..rows {
        let jaw = |k: usize| log.samples[k].command.jaw;
        let ends = row + 1 == rows
            || jaw(row) != jaw(row - 1)
            || task::rests(log, row) != task::rests(log, row - 1);
        if ends {
            parts.push((first, row));
            first = row;
        }
    }
    parts
}

/// The time from row to row: the median.
fn period(times: &[f64]) -> f64 {
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    steps[steps.len() / 2]
}

/// Puts rows that are a period apart, but for rounding, on whole multiples of it.
fn even(samples: &mut [Sample], period: f64) {
    let start = samples[0].time;
    let rate = (1.0 / period).round();
    let whole = |k: usize| match (rate * period - 1.0).abs() < 1e-9 {
        true => k as f64 / rate,
        false => k as f64 * period,
    };
    let near = |(k, sample): (usize, &Sample)| (sample.time - start - whole(k)).abs() < 1e-6;
    if samples.iter().enumerate().all(near) {
        for (k, sample) in samples.iter_mut().enumerate() {
            sample.time = start + whole(k);
        }
    }
}
