//! The files of an experiment.

use std::io::Write;
use std::path::{Path, PathBuf};

use selvedge_trajectory::log::write;
use selvedge_view::{Chart, Picture, Recording, write_whole};

use crate::table::{Row, markdown, write_csv, write_timings};
use crate::{Case, Error, Export, Scenario, Timing};

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

/// The page, and the picture of a solver's ends.
pub(crate) const REPORT: &str = "report.html";
const ENDS: &str = "ends.png";

/// Removes what an earlier run left, so that no file of it stands beside files of this one; finished
/// folds stay if they may be used again.
pub(crate) fn remove_old(
    out: &Path,
    folder: &Path,
    cases: &[&Case],
    resume: bool,
) -> Result<(), Error> {
    let tables = [
        REPORT,
        "table.csv",
        "table.md",
        "timings.csv",
        "curves.csv",
        "curves.svg",
    ];
    let mut old: Vec<PathBuf> = tables.iter().map(|name| out.join(name)).collect();
    old.push(folder.join(ENDS));
    for case in cases {
        let endings = ["png", "frames.png", "gif", "mcap"];
        old.extend(endings.map(|ending| folder.join(format!("{}.{ending}", case.name))));
        if !resume {
            old.push(folder.join(format!("{}.npz", case.name)));
        }
        old.extend((0..case.grippers.len()).map(|number| commands_path(folder, case, number)));
    }
    if !resume {
        old.extend(members(folder, cases)?);
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

/// Ends of members of these cases.
fn members(folder: &Path, cases: &[&Case]) -> Result<Vec<PathBuf>, Error> {
    let folder = folder.join("members");
    let entries = match std::fs::read_dir(&folder) {
        Ok(entries) => entries,
        Err(reason) if reason.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(reason) => {
            return Err(Error::File {
                path: folder,
                reason,
            });
        }
    };
    let is_one = |path: &PathBuf| {
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let case = name.rsplit_once('.').map(|(case, _)| case);
        cases.iter().any(|known| Some(known.name.as_str()) == case)
    };
    Ok(entries
        .flatten()
        .map(|entry| entry.path())
        .filter(is_one)
        .collect())
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
    for (number, log) in scenario.logs(case).iter().enumerate() {
        write_whole(commands_path(folder, case, number), |writer| {
            Ok(write(writer, log)?)
        })?;
    }
    Ok(())
}

/// A picture of a case's end, and what else is wanted of its recording.
pub(crate) fn write_pictures(
    folder: &Path,
    case: &Case,
    recording: &Recording,
    exports: &[Export],
) -> Result<(), Error> {
    const END: [u32; 2] = [1200, 900];
    const STRIP: [u32; 2] = [480, 400];
    const STRIP_FRAMES: usize = 6;
    const FILM: [u32; 2] = [640, 480];
    const RATE: f64 = 15.0;
    let path = |ending: &str| folder.join(format!("{}.{ending}", case.name));
    let put = |ending: &str, bytes: &[u8]| {
        write_whole(path(ending), |writer| Ok(writer.write_all(bytes)?))
    };
    put("png", &end_picture(recording, END)?.png()?)?;
    for export in exports {
        match export {
            Export::Frames => {
                let [width, height] = STRIP;
                let camera = recording.camera(width, height);
                let frames = recording.key_frames(STRIP_FRAMES).into_iter();
                let pictures = frames.map(|k| recording.picture(k, &camera, width, height));
                let strip = Picture::beside(&pictures.collect::<Result<Vec<_>, _>>()?);
                put("frames.png", &strip.png()?)?;
            }
            Export::Video => {
                let [width, height] = FILM;
                let camera = recording.camera(width, height);
                put("gif", &recording.gif(&camera, width, height, RATE)?)?;
            }
            Export::Mcap => recording.write_mcap(path("mcap"))?,
        }
    }
    Ok(())
}

/// The last frame from near.
pub(crate) fn end_picture(
    recording: &Recording,
    [width, height]: [u32; 2],
) -> Result<Picture, Error> {
    let last = recording.frame_count() - 1;
    let camera = recording.close_camera(last, width, height);
    Ok(recording.picture(last, &camera, width, height)?)
}

/// The ends of all cases of a solver that ran to the end, four in a row.
pub(crate) fn write_ends(folder: &Path, recordings: &[&Recording]) -> Result<(), Error> {
    const SIZE: [u32; 2] = [360, 270];
    const COLUMNS: usize = 4;
    let columns = COLUMNS.min(recordings.len());
    if columns == 0 {
        return Ok(());
    }
    let mut ends = Vec::with_capacity(recordings.len());
    for recording in recordings {
        ends.push(end_picture(recording, SIZE)?);
    }
    ends.resize(ends.len().next_multiple_of(columns), Picture::blank(SIZE));
    let rows: Vec<Picture> = ends.chunks(columns).map(Picture::beside).collect();
    let bytes = Picture::below(&rows).png()?;
    Ok(write_whole(folder.join(ENDS), |writer| {
        Ok(writer.write_all(&bytes)?)
    })?)
}

pub(crate) fn write_text(path: &Path, text: &str) -> Result<(), Error> {
    Ok(write_whole(path, |writer| {
        Ok(writer.write_all(text.as_bytes())?)
    })?)
}

pub(crate) fn write_tables(folder: &Path, rows: &[(Row, Option<Timing>)]) -> Result<(), Error> {
    let only_rows: Vec<Row> = rows.iter().map(|(row, _)| row.clone()).collect();
    write_whole(folder.join("table.csv"), |writer| {
        Ok(write_csv(&only_rows, writer)?)
    })?;
    write_text(&folder.join("table.md"), &markdown(rows))?;
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
    write_text(&folder.join("curves.svg"), &chart.svg()?)
}
