//! The files of an experiment.

use std::io::Write;
use std::path::{Path, PathBuf};

use selvedge_trajectory::log::{Log, Sample, write};
use selvedge_view::{Chart, write_whole};

use crate::table::{Row, markdown, write_csv, write_timings};
use crate::{Case, Error, Scenario, Timing};

/// Makes the folder and finds out now, not after the run, whether it can be written to.
pub(crate) fn make_folder(folder: &Path) -> Result<(), Error> {
    let failed = |reason| Error::File {
        path: folder.to_owned(),
        reason,
    };
    std::fs::create_dir_all(folder).map_err(failed)?;
    let probe = folder.join(format!(".writable.{}", std::process::id()));
    std::fs::write(&probe, b"")
        .and_then(|()| std::fs::remove_file(&probe))
        .map_err(failed)
}

/// Removes what an earlier run left, so that no file of it stands beside files of this one.
pub(crate) fn remove_old(out: &Path, folder: &Path, cases: &[&Case]) -> Result<(), Error> {
    let tables = [
        "table.csv",
        "table.md",
        "timings.csv",
        "curves.csv",
        "curves.svg",
    ];
    let mut old: Vec<PathBuf> = tables.iter().map(|name| out.join(name)).collect();
    for case in cases {
        old.push(folder.join(format!("{}.npz", case.name)));
        old.extend((0..case.grippers.len()).map(|number| commands_path(folder, case, number)));
    }
    for path in old {
        match std::fs::remove_file(&path) {
            Err(reason) if reason.kind() != std::io::ErrorKind::NotFound => {
                return Err(Error::File { path, reason });
            }
            _ => {}
        }
    }
    Ok(())
}

/// `CASE.commands.csv`, or `CASE.gripperN.commands.csv` of several.
fn commands_path(folder: &Path, case: &Case, number: usize) -> PathBuf {
    let gripper = match case.grippers.len() {
        1 => String::new(),
        _ => format!(".gripper{}", number + 1),
    };
    folder.join(format!("{}{gripper}.commands.csv", case.name))
}

/// The command log of each gripper.
pub(crate) fn write_commands(folder: &Path, scenario: &Scenario, case: &Case) -> Result<(), Error> {
    for (number, plan) in case.grippers.iter().enumerate() {
        let mut log = Log::new(format!(
            "{} {} gripper {}",
            scenario.name,
            case.name,
            number + 1
        ));
        log.tip_offset = plan.tip_offset;
        log.samples = (0..scenario.steps)
            .map(|step| scenario.time(step))
            .map(|time| Sample {
                time,
                command: plan.schedule.command(time),
            })
            .collect();
        write_whole(commands_path(folder, case, number), |writer| {
            Ok(write(writer, &log)?)
        })?;
    }
    Ok(())
}

pub(crate) fn write_tables(folder: &Path, rows: &[(Row, Option<Timing>)]) -> Result<(), Error> {
    let only_rows: Vec<Row> = rows.iter().map(|(row, _)| row.clone()).collect();
    write_whole(folder.join("table.csv"), |writer| {
        Ok(write_csv(&only_rows, writer)?)
    })?;
    write_whole(folder.join("table.md"), |writer| {
        Ok(writer.write_all(markdown(rows).as_bytes())?)
    })?;
    write_whole(folder.join("timings.csv"), |writer| {
        Ok(write_timings(rows, writer)?)
    })?;
    Ok(())
}

/// `E(t)` of all cases: one row a time in `curves.csv`, on a logarithmic axis in `curves.svg`.
pub(crate) fn write_curves(
    folder: &Path,
    curves: &[(String, Vec<(f64, f64)>)],
) -> Result<(), Error> {
    write_whole(folder.join("curves.csv"), |writer| {
        let mut csv = csv::Writer::from_writer(writer);
        csv.write_record(
            ["t".to_owned()]
                .iter()
                .chain(curves.iter().map(|(name, _)| name)),
        )?;
        let times = curves
            .first()
            .map(|(_, points)| points.as_slice())
            .unwrap_or_default();
        for (row, (time, _)) in times.iter().enumerate() {
            let values = curves.iter().map(|(_, points)| points[row].1.to_string());
            csv.write_record([time.to_string()].into_iter().chain(values))?;
        }
        csv.flush()?;
        Ok(())
    })?;
    let chart = Chart {
        title: "Folding error",
        x_label: "t [s]",
        y_label: "E(t)",
        series: curves,
    };
    let svg = chart.svg()?;
    write_whole(folder.join("curves.svg"), |writer| {
        Ok(writer.write_all(svg.as_bytes())?)
    })?;
    Ok(())
}
