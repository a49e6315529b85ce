//! Which folds of an experiment an arm can do: the part of `experiments` that `--robot` asks for.

use std::fmt::Write as _;
use std::fs;
use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result};
use clap::ValueEnum;
use selvedge_folding::Scenario;
use selvedge_franka::{Arm, best, search};
use selvedge_trajectory::log::Log;
use selvedge_view::{Column, Table, write_whole};

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

/// What is known of an arm and the cases.
pub(crate) struct Found {
    rows: Vec<[String; 11]>,
}

/// Looks for a base for each gripper of the cases that are asked for, the table at height 0.
pub(crate) fn find(robot: Robot, scenario: &Scenario, chosen: &[String]) -> Result<Found> {
    let arm = match robot {
        Robot::Fr3 => Arm::fr3(),
        Robot::Fer => Arm::fer(),
    };
    let mut rows = Vec::new();
    for case in &scenario.cases {
        if !chosen.is_empty() && !chosen.contains(&case.name) {
            continue;
        }
        let logs = scenario.logs(case);
        for (number, log) in logs.iter().enumerate() {
            let name = match logs.len() {
                1 => case.name.clone(),
                _ => format!("{}.gripper{}", case.name, number + 1),
            };
            rows.push(row(&arm, &name, log).with_context(|| name.clone())?);
        }
    }
    Ok(Found { rows })
}

impl Found {
    /// Prints the table, appends it to `table.md` in a folder and writes `reach.csv` there.
    pub(crate) fn write(&self, out: &Path) -> Result<()> {
        let (mut csv, mut markdown) = (COLUMNS.join(",") + "\n", String::new());
        let dashes = vec!["---"; COLUMNS.len()];
        writeln!(markdown, "\n| {} |", COLUMNS.join(" | "))?;
        writeln!(markdown, "|{}|", dashes.join("|"))?;
        for cells in &self.rows {
            writeln!(markdown, "| {} |", cells.join(" | "))?;
            // A cause has commas.
            let cells = cells.each_ref().map(|cell| match cell.contains(',') {
                true => format!("\"{}\"", cell.replace('"', "\"\"")),
                false => cell.clone(),
            });
            writeln!(csv, "{}", cells.join(","))?;
        }
        println!("{markdown}");
        put(&out.join(FILE), &csv)?;
        let table = out.join("table.md");
        let before = fs::read_to_string(&table).with_context(|| format!("{}", table.display()))?;
        put(&table, &(before + &markdown))
    }

    /// The table for the page.
    pub(crate) fn table(&self) -> Table {
        let columns = COLUMNS.iter().enumerate().map(|(k, header)| Column {
            header: (*header).to_owned(),
            is_number: [3, 4, 5, 7, 8, 9, 10].contains(&k),
            cells: self.rows.iter().map(|row| row[k].clone()).collect(),
        });
        Table {
            title: "Can an arm do it?".into(),
            columns: columns.collect(),
            notes: vec![
                "The best of 286 places of the base beside the cloth, which lies at height 0. Slow-down: \
                 how many times as long the log must take, 1 when it can be followed as it is; least \
                 time: of the movement."
                    .into(),
            ],
            ..Table::default()
        }
    }
}

fn row(arm: &Arm, name: &str, log: &Log) -> Result<[String; 11]> {
    let places = search(arm, log, 0.0, 0.0)?;
    let mut cells: [String; 11] = Default::default();
    (cells[0], cells[1]) = (name.to_owned(), arm.name().to_owned());
    let Some(found) = best(arm, log, &places)? else {
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

fn put(path: &Path, text: &str) -> Result<()> {
    Ok(write_whole(path, |writer| {
        Ok(writer.write_all(text.as_bytes())?)
    })?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workspace;

    #[test]
    fn each_case_has_a_row_on_the_page_and_in_the_files() {
        let path = workspace::root()
            .unwrap()
            .join("fixtures/scenarios/corner_fold.toml");
        let scenario = Scenario::load(path).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        fs::write(folder.join("table.md"), "before\n").unwrap();
        // One that can be done, and one that puts the fingers into the table.
        let chosen = ["C1".to_owned(), "C8".to_owned()];
        let found = find(Robot::Fr3, &scenario, &chosen).unwrap();
        found.write(folder).unwrap();
        let csv = fs::read_to_string(folder.join(FILE)).unwrap();
        let lines: Vec<&str> = csv.lines().collect();
        assert_eq!(lines.len(), 3);
        assert!(lines[1].starts_with("C1,fr3,yes,"), "{csv}");
        assert!(lines[2].starts_with("C8,fr3,\"no: ") && lines[2].contains("below the table"));
        let table = fs::read_to_string(folder.join("table.md")).unwrap();
        assert!(table.starts_with("before\n\n| case |") && table.contains("| C1 | fr3 | yes |"));
        let columns = found.table().columns;
        assert_eq!(columns.len(), COLUMNS.len());
        assert!(columns.iter().all(|column| column.cells.len() == 2));
        let other = find(Robot::Fer, &scenario, &["C1".into()]).unwrap();
        assert_eq!(other.rows.len(), 1);
    }
}
