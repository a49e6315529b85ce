//! Which folds of an experiment an arm can do: the part of `experiments` that `--robot` asks for.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::ValueEnum;
use selvedge_folding::{Case, Scenario};
use selvedge_franka::{Arm, best, search};
use selvedge_trajectory::log;

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum Robot {
    /// Franka Research 3.
    Fr3,
    /// Franka Emika Robot, the "Panda".
    Fer,
}

/// What is written beside the table.
pub(crate) const FILE: &str = "reach.csv";

const COLUMNS: [&str; 11] = [
    "case",
    "robot",
    "reach",
    "base x m",
    "base y m",
    "base yaw rad",
    "hand",
    "limits rad",
    "table mm",
    "slow-down",
    "least time s",
];

/// Looks for a base for each gripper of the cases, with their command logs in `folder`, the table at
/// height 0; prints a table, appends it to `table.md` in `out` and writes `reach.csv` there.
pub(crate) fn run(
    robot: Robot,
    scenario: &Scenario,
    chosen: &[String],
    folder: &Path,
    out: &Path,
) -> Result<()> {
    let arm = match robot {
        Robot::Fr3 => Arm::fr3(),
        Robot::Fer => Arm::fer(),
    };
    let (mut csv, mut markdown) = (COLUMNS.join(",") + "\n", String::new());
    let dashes = vec!["---"; COLUMNS.len()];
    writeln!(markdown, "\n| {} |", COLUMNS.join(" | "))?;
    writeln!(markdown, "|{}|", dashes.join("|"))?;
    for case in &scenario.cases {
        let asked = chosen.is_empty() || chosen.contains(&case.name);
        for (name, path) in logs(folder, case).filter(|(_, path)| asked && path.exists()) {
            let cells = row(&arm, &name, &path)?;
            writeln!(markdown, "| {} |", cells.join(" | "))?;
            // A cause has commas.
            let cells = cells.map(|cell| match cell.contains(',') {
                true => format!("\"{}\"", cell.replace('"', "\"\"")),
                false => cell,
            });
            writeln!(csv, "{}", cells.join(","))?;
        }
    }
    println!("{markdown}");
    write_whole(&out.join(FILE), &csv)?;
    let table = out.join("table.md");
    let before = fs::read_to_string(&table).with_context(|| format!("{}", table.display()))?;
    write_whole(&table, &(before + &markdown))
}

/// Name and command log of each gripper of a case.
fn logs(folder: &Path, case: &Case) -> impl Iterator<Item = (String, PathBuf)> {
    let count = case.grippers.len();
    (1..=count).map(move |number| {
        let name = match count {
            1 => case.name.clone(),
            _ => format!("{}.gripper{number}", case.name),
        };
        let path = folder.join(format!("{name}.commands.csv"));
        (name, path)
    })
}

fn row(arm: &Arm, name: &str, path: &Path) -> Result<[String; 11]> {
    let file = fs::File::open(path).with_context(|| format!("{}", path.display()))?;
    let log = log::read(file, &path.display().to_string())?;
    let places = search(arm, &log, 0.0, 0.0).with_context(|| format!("{}", path.display()))?;
    let mut cells: [String; 11] = Default::default();
    (cells[0], cells[1]) = (name.to_owned(), arm.name().to_owned());
    let Some(found) = best(arm, &log, &places)? else {
        cells[2] = "no: every place is on the cloth".into();
        return Ok(cells);
    };
    if let Some(blocked) = &found.blocked {
        cells[2] = format!("no: {blocked}");
        return Ok(cells);
    }
    let Some(timing) = &found.timing else {
        cells[2] = "no: no timing is possible".into();
        return Ok(cells);
    };
    let [x, y, _, yaw] = found.placement.numbers();
    let hand = if found.placement.flip {
        "turned"
    } else {
        "as logged"
    };
    let postures = || found.rows.iter().filter_map(|row| row.posture.as_ref());
    let margin = postures().map(|p| p.margin).fold(f64::INFINITY, f64::min);
    let table = postures()
        .map(|p| p.clearance.table)
        .fold(f64::INFINITY, f64::min);
    let number = |x: f64, digits: usize| format!("{x:.digits$}");
    let rest = [
        "yes".to_owned(),
        number(x, 3),
        number(y, 3),
        number(yaw, 4),
        hand.to_owned(),
        number(margin, 3),
        number(1e3 * table, 1),
        number(timing.slow_down, 3),
        number(timing.least, 3),
    ];
    for (cell, value) in cells[2..].iter_mut().zip(rest) {
        *cell = value;
    }
    Ok(cells)
}

/// Written beside and renamed.
fn write_whole(path: &Path, text: &str) -> Result<()> {
    let beside = path.with_extension(format!("{}.tmp", std::process::id()));
    let written = fs::write(&beside, text).and_then(|()| fs::rename(&beside, path));
    written.with_context(|| format!("cannot write {}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workspace;
    use selvedge_math::{Command, DVec3, Jaw, Pose};
    use selvedge_trajectory::log::{Log, Sample};

    #[test]
    fn each_case_with_a_log_has_a_row() {
        let path = workspace::root()
            .unwrap()
            .join("fixtures/scenarios/franka_fold.toml");
        let scenario = Scenario::load(path).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        // One that can be done, and one in the table.
        for (name, z) in [("F1", 0.05), ("F2", -0.05)] {
            let mut log = Log::new("a test");
            for k in 0..=60 {
                let p = DVec3::new(0.21, 0.295 - 0.005 * f64::from(k), z);
                let pose = Pose::from_translation(p);
                let jaw = Jaw::Closed;
                let command = Command { pose, jaw };
                let time = f64::from(k) / 20.0;
                log.samples.push(Sample { time, command });
            }
            let mut file = fs::File::create(folder.join(format!("{name}.commands.csv"))).unwrap();
            log::write(&mut file, &log).unwrap();
        }
        fs::write(folder.join("table.md"), "before\n").unwrap();
        run(Robot::Fr3, &scenario, &[], folder, folder).unwrap();
        let csv = fs::read_to_string(folder.join(FILE)).unwrap();
        let lines: Vec<&str> = csv.lines().collect();
        assert_eq!(lines.len(), 3);
        assert!(lines[1].starts_with("F1,fr3,yes,"), "{csv}");
        assert!(lines[2].starts_with("F2,fr3,\"no: ") && lines[2].contains("below the table"));
        let table = fs::read_to_string(folder.join("table.md")).unwrap();
        assert!(table.starts_with("before\n\n| case |") && table.contains("| F1 | fr3 | yes |"));
        // One case only.
        run(Robot::Fer, &scenario, &["F1".into()], folder, folder).unwrap();
        let csv = fs::read_to_string(folder.join(FILE)).unwrap();
        assert_eq!(csv.lines().count(), 2);
    }
}
