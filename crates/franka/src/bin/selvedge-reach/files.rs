//! What the program writes.

use std::fs;
use std::io::Write;
use std::path::Path;

use anyhow::{Context, Result};
use selvedge_franka::{Arm, Place, Placement, Reach};
use selvedge_trajectory::log::{self, Log};
use selvedge_view::write_whole;
use serde_json::{Value, json};

use crate::page::page;
use crate::plots::{bases, margins};

/// Writes reach.json, bases.svg when places were tried, and what can be made of a path that is possible.
pub(crate) fn write(
    folder: &Path,
    arm: &Arm,
    log: &Log,
    found: &Reach<'_>,
    places: &[Place],
) -> Result<()> {
    fs::create_dir_all(folder)
        .with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let mut text = serde_json::to_vec_pretty(&document(arm, log, found, places))?;
    text.push(b'\n');
    put(&folder.join("reach.json"), &text)?;
    if !places.is_empty() {
        put(&folder.join("bases.svg"), bases(found, places)?.as_bytes())?;
    }
    let Some(timing) = &found.timing else {
        return Ok(());
    };
    let motion = &timing.motion;
    let text = joint_rows(arm, &motion.times, &motion.q, &motion.closed);
    put(&folder.join("joints.csv"), text.as_bytes())?;
    let samples = &timing.fastest.samples;
    let times: Vec<f64> = samples.iter().map(|sample| sample.time).collect();
    let closed: Vec<bool> = samples.iter().map(|s| s.command.jaw.is_closed()).collect();
    let text = joint_rows(arm, &times, &timing.fastest_q, &closed);
    put(&folder.join("retimed.joints.csv"), text.as_bytes())?;
    let mut text = Vec::new();
    log::write(&mut text, &timing.fastest)?;
    put(&folder.join("retimed.commands.csv"), &text)?;
    put(&folder.join("margins.svg"), margins(found)?.as_bytes())?;
    put(
        &folder.join("reach.html"),
        page(arm, log, found, timing)?.as_bytes(),
    )
}

fn put(path: &Path, bytes: &[u8]) -> Result<()> {
    Ok(write_whole(path, |writer| Ok(writer.write_all(bytes)?))?)
}

/// `t,q1,...,jaw`, numbers in the shortest form that reads back to the same bits.
fn joint_rows(arm: &Arm, times: &[f64], q: &[f64], closed: &[bool]) -> String {
    let n = arm.joints().len();
    let mut text = "t".to_owned();
    for k in 1..=n {
        text += &format!(",q{k}");
    }
    text += ",jaw\n";
    for ((time, q), closed) in times.iter().zip(q.chunks(n)).zip(closed) {
        text += &time.to_string();
        for q in q {
            text += &format!(",{q}");
        }
        text += if *closed { ",1\n" } else { ",0\n" };
    }
    text
}

fn document(arm: &Arm, log: &Log, found: &Reach<'_>, places: &[Place]) -> Value {
    let finite = |x: f64| x.is_finite().then_some(x);
    let rows = found.rows.iter().map(|row| {
        let posture = row.posture.as_ref().map(|p| {
            json!({
                "q": p.q,
                "limit_margin_rad": finite(p.margin),
                "joint": arm.joints()[p.joint].name,
                "table_m": finite(p.clearance.table),
                "lowest": p.clearance.lowest,
                "self_m": finite(p.clearance.own),
                "nearest": p.clearance.nearest,
                "smallest_singular_value": p.sigma,
            })
        });
        json!({
            "t": row.time,
            "cause": row.cause.as_ref().map(ToString::to_string),
            "posture": posture,
        })
    });
    let timing = found.timing.as_ref().map(|timing| {
        let bounds = timing.commanded.iter().map(|usage| {
            json!({
                "bound": usage.bound,
                "t": usage.time,
                "value": usage.value,
                "limit": usage.limit,
                "slow_down": finite(usage.slow_down()),
            })
        });
        json!({
            "slow_down": timing.slow_down,
            "moves_s": timing.asked,
            "fastest_s": timing.least,
            "bounds": bounds.collect::<Vec<_>>(),
        })
    });
    let place = |placement: &Placement| json!({"base_xyz_yaw": placement.numbers(), "flip": placement.flip});
    let map = places.iter().map(|at| {
        json!({
            "place": place(&at.placement),
            "on_cloth": at.on_cloth,
            "score": at.score,
        })
    });
    json!({
        "schema": 1,
        "units": "m, rad, s",
        "robot": arm.name(),
        "source": log.source,
        "feasible": found.blocked.is_none() && found.timing.is_some(),
        "place": place(&found.placement),
        "table_m": found.placement.table,
        "blocked": found.blocked.as_ref().map(ToString::to_string),
        "possible_instead": found.offers.iter().map(ToString::to_string).collect::<Vec<_>>(),
        "timing": timing,
        "rows": rows.collect::<Vec<_>>(),
        "map": map.collect::<Vec<_>>(),
    })
}
