//! Where a gripper's commands come from, and logs in place of the scenario's own timeline.

use selvedge_math::{Command, Jaw};
use selvedge_trajectory::Schedule;
use selvedge_trajectory::log::{Log, Sample};
use sha2::{Digest, Sha256};

use super::{Case, Scenario};
use crate::Error;

/// A time of a log is that of a step when it is so near, in steps.
const SAME: f64 = 1e-6;
/// The tip of a log is that of the gripper when it is so near [m].
const SAME_TIP: f64 = 1e-9;

/// The commands of one gripper over time.
#[derive(Clone, Debug)]
pub enum Commands {
    /// Those of the scenario's timeline.
    Schedule(Schedule),
    /// Those of a log, one a step; the last one goes on.
    Rows(Vec<Sample>),
}

impl Commands {
    /// The command at a time [s]; before the first row of a log that of the first row.
    pub fn command(&self, time: f64) -> Command {
        match self {
            Self::Schedule(schedule) => schedule.command(time),
            Self::Rows(rows) => {
                let next = rows.partition_point(|row| row.time <= time);
                rows[next.max(1) - 1].command
            }
        }
    }

    /// The jaw at a time [s].
    pub fn jaw(&self, time: f64) -> Jaw {
        self.command(time).jaw
    }
}

impl Scenario {
    /// The command log of each gripper of a case.
    pub fn logs(&self, case: &Case) -> Vec<Log> {
        let plans = case.grippers.iter().enumerate();
        let log = |(number, plan): (usize, &super::GripperPlan)| {
            let source = format!("{} {} gripper {}", self.name, case.name, number + 1);
            let mut log = Log::new(source);
            log.tip_offset = plan.tip_offset;
            let times = (0..self.steps).map(|step| self.time(step));
            log.samples = times
                .map(|time| Sample {
                    time,
                    command: plan.commands.command(time),
                })
                .collect();
            log
        };
        plans.map(log).collect()
    }

    /// Lets the one gripper of a case follow a log instead of the scenario's timeline, for instance
    /// one with another timing. When the log takes longer, every case goes on for as long.
    ///
    /// # Errors
    /// [`Error::Follow`] for a case that is not there or has several grippers, a log in another frame
    /// or of another tip, and a row that is not at the time of its step.
    pub fn follow(&mut self, case: &str, log: &Log) -> Result<(), Error> {
        let refuse = |reason: String| {
            Err(Error::Follow {
                case: case.to_owned(),
                reason,
            })
        };
        let Some(index) = self.cases.iter().position(|known| known.name == case) else {
            return refuse("there is no such case".into());
        };
        let [plan] = &self.cases[index].grippers[..] else {
            let count = self.cases[index].grippers.len();
            return refuse(format!("it has {count} grippers, a log is for one"));
        };
        if log.frame != "cloth" {
            return refuse(format!("the log's frame is {}, must be cloth", log.frame));
        }
        if plan.tip_offset.distance(log.tip_offset) > SAME_TIP {
            let (found, wanted) = (log.tip_offset, plan.tip_offset);
            return refuse(format!(
                "the log's tip is at {found} m, must be at {wanted} m"
            ));
        }
        let (Some(first), Some(last)) = (log.samples.first(), log.samples.last()) else {
            return refuse("the log has no row".into());
        };
        let mut rows = log.samples.clone();
        for (step, row) in rows.iter_mut().enumerate() {
            let time = self.time(step);
            if (row.time - time).abs() > SAME * self.frame {
                let found = row.time;
                return refuse(format!(
                    "row {} is at {found} s, its step at {time} s",
                    step + 1
                ));
            }
            row.time = time;
        }

        let turn = |a: &Sample, b: &Sample| {
            let [a, b] = [a, b].map(|row| row.command.pose.rotation());
            a.angle_between(b)
        };
        let rotation = turn(first, last);
        self.steps = self.steps.max(rows.len());
        let case = &mut self.cases[index];
        for hash in [&mut case.published_hash, &mut case.default_hash] {
            *hash = rehashed(hash, &rows);
        }
        case.grippers[0].rotation = rotation;
        case.grippers[0].commands = Commands::Rows(rows);
        Ok(())
    }
}

/// The hash of all inputs with these commands among them.
fn rehashed(hash: &str, rows: &[Sample]) -> String {
    let mut digest = Sha256::new();
    digest.update(hash);
    for Sample { time, command } in rows {
        let (p, q) = (command.pose.position(), command.pose.rotation());
        for number in [*time, p.x, p.y, p.z, q.x, q.y, q.z, q.w] {
            digest.update(number.to_le_bytes());
        }
        digest.update([u8::from(command.jaw.is_closed())]);
    }
    let digest = digest.finalize();
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Solver;

    const SMALL: &str = include_str!("../../../../fixtures/tests/small_fold.toml");

    #[test]
    fn its_own_log_is_the_same_course_and_another_one_is_followed() {
        let scenario = Scenario::parse(SMALL, "small", "small.toml").unwrap();
        let own = scenario.logs(&scenario.cases[0]).remove(0);
        let mut same = scenario.clone();
        same.follow("one", &own).unwrap();
        let hash = |scenario: &Scenario| scenario.cases[0].input_hash(Solver::Default).to_owned();
        assert_ne!(hash(&same), hash(&scenario));
        let command = |scenario: &Scenario, step| {
            let time = scenario.time(step);
            scenario.cases[0].grippers[0].commands.command(time)
        };
        assert_eq!(same.steps, scenario.steps);
        assert!((0..same.steps).all(|step| command(&same, step) == command(&scenario, step)));

        // Slower by half: longer for all cases.
        let mut slow = own.clone();
        let count = own.samples.len() * 3 / 2;
        slow.samples = (0..count)
            .map(|step| Sample {
                time: scenario.time(step),
                command: own.samples[step * 2 / 3].command,
            })
            .collect();
        let mut slower = scenario.clone();
        slower.follow("one", &slow).unwrap();
        assert_eq!(slower.steps, count);
        assert_eq!(command(&slower, 30), command(&scenario, 20));
        assert_ne!(hash(&slower), hash(&same));
    }

    #[test]
    fn a_log_of_another_task_is_refused() {
        let scenario = Scenario::parse(SMALL, "small", "small.toml").unwrap();
        let own = scenario.logs(&scenario.cases[0]).remove(0);
        let error = |case: &str, change: &dyn Fn(&mut Log)| {
            let mut log = own.clone();
            change(&mut log);
            scenario.clone().follow(case, &log).unwrap_err().to_string()
        };
        assert!(error("none", &|_| {}).contains("no such case"));
        assert!(error("two", &|_| {}).contains("2 grippers"));
        assert!(error("one", &|log| log.frame = "base".into()).contains("must be cloth"));
        assert!(error("one", &|log| log.tip_offset.x += 0.1).contains("the log's tip is at"));
        assert!(error("one", &|log| log.samples[3].time += 1e-3).contains("row 4 is at"));
        assert!(error("one", &|log| log.samples.clear()).contains("no row"));
    }
}
