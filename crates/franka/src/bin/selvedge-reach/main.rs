//! Whether a robot arm can follow a command log, before anything moves.
//!
//! Exit code 0: it can. 3: it cannot. 2: the input cannot be used.

#![forbid(unsafe_code)]

mod files;
mod page;
mod plots;

use std::fs;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, Result, bail, ensure};
use clap::Parser;
use selvedge_franka::{
    Arm, Place, Placement, Posture, Rates, Reach, Usage, best, either, search, slow_down,
};
use selvedge_trajectory::log;

/// Tell whether a robot arm can follow a command log, why not, and how fast it could.
#[derive(Parser)]
#[command(version)]
struct Arguments {
    /// Command log, as `cargo xtask experiments` writes it.
    log: PathBuf,
    /// `fr3`, `fer`, or a URDF file.
    #[arg(long, value_name = "fr3|fer|URDF")]
    robot: String,
    /// Base and tip link of a URDF file; found by the names `*_link0` and `*_hand_tcp` if left out.
    #[arg(long, value_name = "BASE,TIP", value_delimiter = ',', num_args = 1)]
    links: Vec<String>,
    /// The robot's base in the frame of the log: metres, and radians about the vertical. Searched
    /// for if left out.
    #[arg(long, value_name = "X,Y,Z,YAW", allow_hyphen_values = true)]
    base: Option<String>,
    /// Height of the table in the frame of the log [m].
    #[arg(
        long,
        value_name = "Z",
        default_value_t = 0.0,
        allow_hyphen_values = true
    )]
    table: f64,
    /// Search for the best base; with --base at its height.
    #[arg(long)]
    search_base: bool,
    /// Write reach.json, bases.svg and, of a path that is possible, joints.csv, margins.svg, reach.html
    /// with the moving arm, retimed.commands.csv and retimed.joints.csv into this folder.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(3),
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::from(2)
        }
    }
}

/// Whether the arm can follow the log.
fn run(arguments: &Arguments) -> Result<bool> {
    let name = arguments.log.display().to_string();
    let file = fs::File::open(&arguments.log).with_context(|| format!("cannot open {name}"))?;
    let log = log::read(file, &name)?;
    let arm = arm(arguments)?;
    let given = arguments.base.as_deref().map(base).transpose()?;

    let seconds = log.samples.last().map_or(0.0, |last| last.time) - log.samples[0].time;
    let rows = log.samples.len();
    println!("{name}: {rows} rows, {seconds:.3} s; robot {}", arm.name());
    if arm.mesh_count() > 0 {
        println!(
            "note     {} collision meshes are left out",
            arm.mesh_count()
        );
    }
    if arm
        .clearance(&selvedge_franka::home(&arm), false, 0.0)
        .own
        .is_infinite()
    {
        println!("note     the description has no shapes to measure the arm's distance to itself");
    }
    if Rates::of(&arm).assumed {
        println!("note     no bounds of acceleration and jerk known: 10 /s^2, 5000 /s^3 assumed");
    }

    let mut places = Vec::new();
    let found = if let (Some(base), false) = (given, arguments.search_base) {
        let placement = Placement::new(base, arguments.table)?;
        either(&arm, &log, &placement).with_context(|| name.clone())?
    } else {
        let height = given.map_or(arguments.table, |base| base[2]);
        let all = search(&arm, &log, height, arguments.table).with_context(|| name.clone())?;
        let found = best(&arm, &log, &all).with_context(|| name.clone())?;
        places = all;
        found.context("every place of the search is on the cloth; give a --base")?
    };
    let possible = found.blocked.is_none() && found.timing.is_some();
    report(&arm, &found, &places);
    if let Some(folder) = &arguments.out {
        files::write(folder, &arm, &log, &found, &places)?;
    }
    Ok(possible)
}

fn arm(arguments: &Arguments) -> Result<Arm> {
    let robot = arguments.robot.as_str();
    if robot == "fr3" || robot == "fer" {
        ensure!(
            arguments.links.is_empty(),
            "--links is for URDF files, not for {robot}"
        );
        return Ok(if robot == "fr3" {
            Arm::fr3()
        } else {
            Arm::fer()
        });
    }
    let text = fs::read_to_string(robot)
        .with_context(|| format!("--robot is {robot}, must be fr3, fer or a URDF file"))?;
    let (base, tip) = match arguments.links.as_slice() {
        [base, tip] => (base.clone(), tip.clone()),
        [] => match Arm::ends(&text).with_context(|| robot.to_owned())? {
            Some(ends) => ends,
            None => bail!("{robot}: name its base and tip link with --links BASE,TIP"),
        },
        _ => bail!("--links must be BASE,TIP"),
    };
    Arm::from_urdf(&text, &base, &tip).with_context(|| robot.to_owned())
}

fn base(text: &str) -> Result<[f64; 4]> {
    let numbers: Option<Vec<f64>> = text
        .split(',')
        .map(|part| part.trim().parse().ok())
        .collect();
    match numbers.as_deref() {
        Some(&[x, y, z, yaw]) => Ok([x, y, z, yaw]),
        _ => bail!("--base is {text}, must be four numbers x,y,z,yaw [m, m, m, rad]"),
    }
}

// ---- The report

fn report(arm: &Arm, found: &Reach<'_>, places: &[Place]) {
    let [x, y, z, yaw] = found.placement.numbers();
    let hand = match found.placement.flip {
        true => "hand turned by half a turn about its approach",
        false => "hand as logged",
    };
    println!("base     x {x:.3} y {y:.3} z {z:.3} m, yaw {yaw:.4} rad; {hand}");
    if !places.is_empty() {
        let possible = places.iter().filter(|place| place.score.is_some()).count();
        println!(
            "search   {possible} of {} bases look possible",
            places.len()
        );
    }
    if let Some(blocked) = &found.blocked {
        println!("INFEASIBLE  {blocked}");
        let bad = found.rows.iter().filter(|row| row.cause.is_some()).count();
        if bad > 0 {
            println!(
                "         {bad} of {} rows are impossible by themselves",
                found.rows.len()
            );
        }
        for offer in &found.offers {
            println!("possible {offer}");
        }
        if found.offers.is_empty() {
            println!("possible nothing was found from this base; try --search-base");
        }
        return;
    }
    println!(
        "{}",
        if found.timing.is_some() {
            "FEASIBLE"
        } else {
            "INFEASIBLE  timing"
        }
    );
    let least = |value: fn(&Posture<'_>) -> f64| {
        let postures = found
            .rows
            .iter()
            .filter_map(|row| Some((row.time, row.posture.as_ref()?)));
        postures.min_by(|a, b| value(a.1).total_cmp(&value(b.1)))
    };
    if let Some((t, p)) = least(|p| p.margin) {
        let joint = &arm.joints()[p.joint].name;
        println!(
            "limits   {:.3} rad to the nearest, of {joint}, at t = {t:.3} s",
            p.margin
        );
    }
    if let Some((t, p)) = least(|p| p.clearance.table) {
        let (height, link) = (1e3 * p.clearance.table, p.clearance.lowest);
        println!("table    {height:.1} mm under {link} at t = {t:.3} s");
    }
    if let Some((t, p)) = least(|p| p.clearance.own) {
        let (apart, [a, b]) = (1e3 * p.clearance.own, p.clearance.nearest);
        println!("self     {apart:.0} mm between {a} and {b} at t = {t:.3} s");
    }
    if let Some((t, p)) = least(|p| p.sigma) {
        println!(
            "singular least singular value {:.3} at t = {t:.3} s",
            p.sigma
        );
    }
    let Some(timing) = &found.timing else {
        println!(
            "timing   none: a velocity bound is zero on the path, or 100 times as long is not enough"
        );
        return;
    };
    let tightest = timing
        .commanded
        .iter()
        .max_by(|a, b| a.slow_down().total_cmp(&b.slow_down()));
    if let Some(Usage {
        bound,
        time,
        value,
        limit,
        ..
    }) = tightest
    {
        let of = format!("{bound} {value:.3} of {limit:.3} at t = {time:.3} s");
        match timing.slow_down > 1.0 {
            true => println!(
                "timing   must take {:.4} times as long: {of}",
                timing.slow_down
            ),
            false => println!(
                "timing   as logged it keeps every bound; it could be {:.2} times as fast: {of}",
                1.0 / slow_down(&timing.commanded)
            ),
        }
    }
    let (asked, least) = (timing.asked, timing.least);
    println!("fastest  {least:.3} s for what the log moves in {asked:.3} s");
}
