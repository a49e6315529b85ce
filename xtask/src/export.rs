//! `cargo xtask export`: a recording as a picture, a film, a mesh, or for robot tools.

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail, ensure};
use selvedge_view::{Picture, Recording, write_whole};

#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// The recording (.npz).
    recording: PathBuf,
    /// The file to write: .png (a picture), .gif (a film), .obj or .ply (a mesh), .mcap (all of it for
    /// robot tools).
    file: PathBuf,
    /// The moment to show [s]; the last one if not given.
    #[arg(long, value_name = "T", conflicts_with = "frames")]
    time: Option<f64>,
    /// Key frames side by side in a picture, from the first to the last.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=24))]
    frames: Option<u32>,
    /// Width and height of a picture [pixels].
    #[arg(long, value_name = "WxH", default_value = "800x600", value_parser = size)]
    size: [u32; 2],
    /// Pictures a second of a film.
    #[arg(long, value_name = "N", default_value = "15")]
    rate: f64,
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let parse = || {
        let (width, height) = text.split_once('x')?;
        Some([width.parse().ok()?, height.parse().ok()?])
    };
    let size = parse().filter(|size| size.iter().all(|side| (16..=8192).contains(side)));
    size.ok_or_else(|| "must be like 800x600, each 16 to 8192".into())
}

pub(crate) fn run(arguments: &Arguments) -> anyhow::Result<ExitCode> {
    let recording = Recording::read(&arguments.recording)?;
    let frame = frame(&recording, arguments.time)?;
    let [width, height] = arguments.size;
    let whole = recording.camera(width, height);
    let extension = arguments.file.extension().unwrap_or_default();
    if extension == "mcap" {
        recording.write_mcap(&arguments.file)?;
        println!("{}", arguments.file.display());
        return Ok(ExitCode::SUCCESS);
    }
    let bytes = match extension.to_str().unwrap_or_default() {
        "png" => {
            let pictures = match arguments.frames {
                None => vec![recording.picture(frame, &whole, width, height)?],
                Some(count) => {
                    let frames = recording.key_frames(count as usize).into_iter();
                    let pictures = frames.map(|k| recording.picture(k, &whole, width, height));
                    pictures.collect::<Result<_, _>>()?
                }
            };
            Picture::beside(&pictures).png()?
        }
        "gif" => recording.gif(&whole, width, height, arguments.rate)?,
        "obj" => recording.obj(frame).into_bytes(),
        "ply" => recording.ply(frame).into_bytes(),
        _ => bail!(
            "{}: the name must end in .png, .gif, .obj, .ply or .mcap",
            arguments.file.display()
        ),
    };
    write_whole(&arguments.file, |writer| Ok(writer.write_all(&bytes)?))?;
    println!("{}", arguments.file.display());
    Ok(ExitCode::SUCCESS)
}

/// The last frame that is not later than the time asked for.
fn frame(recording: &Recording, time: Option<f64>) -> anyhow::Result<usize> {
    let times = recording.times();
    let (first, last) = times.first().zip(times.last()).context("no frame")?;
    let time = time.unwrap_or(*last);
    ensure!(
        (*first..=*last).contains(&time),
        "--time {time}: must be {first} to {last} s"
    );
    Ok(times.partition_point(|t| *t <= time) - 1)
}
