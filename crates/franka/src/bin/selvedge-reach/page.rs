//! A page with the arm moving along the path.

use anyhow::Result;
use selvedge_franka::{Arm, Posture, Reach, Timing, slow_down};
use selvedge_math::{Command, DVec3, Jaw, Pose};
use selvedge_trajectory::log::Log;
use selvedge_view::{Clip, Column, GripperState, Page, Recording, Rest, Sheet, Table};

/// The text of the page.
pub(crate) fn page(arm: &Arm, log: &Log, found: &Reach<'_>, timing: &Timing) -> Result<String> {
    let moving = recording(arm, found, timing)?;
    let rows = found.rows.iter();
    let above = |p: &Posture<'_>| p.clearance.table;
    let curve: Vec<(f64, f64)> = rows
        .filter_map(|row| Some((row.time, above(row.posture.as_ref()?))))
        .filter(|point| point.1.is_finite())
        .collect();
    let clip = Clip {
        case: arm.name(),
        solver: "",
        recording: &moving,
        ideal: None,
        curve: &curve,
    };
    let [x, y, z, yaw] = found.placement.numbers();
    let title = format!("{}: {}", arm.name(), log.source);
    let hand = if found.placement.flip {
        "turned by half a turn"
    } else {
        "as logged"
    };
    let facts = [
        (
            "Base".to_owned(),
            format!("x {x:.3}, y {y:.3}, z {z:.3} m, yaw {yaw:.4} rad"),
        ),
        ("Hand".to_owned(), hand.to_owned()),
        (
            "Asked".to_owned(),
            format!("{:.3} s of movement", timing.asked),
        ),
        ("Least time".to_owned(), format!("{:.3} s", timing.least)),
        ("Selvedge".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
    ];
    let page = Page {
        title: &title,
        lead: "The arm by its collision shapes, from home over the log's path and back.",
        clips: &[clip],
        tables: &[bounds(timing)],
        curves: ["Lowest point above the table", "clearance [m]"],
        facts: &facts,
        ..Page::default()
    };
    Ok(page.html()?)
}

/// The arm as a surface, the table at z = 0.
fn recording(arm: &Arm, found: &Reach<'_>, timing: &Timing) -> Result<Recording> {
    let skin = arm.skin();
    let (placement, motion) = (&found.placement, &timing.motion);
    let down = Pose::from_translation(-placement.table * DVec3::Z);
    let base = down * placement.base;
    let joints = arm.joints().len();
    let placed = |q: &[f64], closed: bool| -> Vec<DVec3> {
        let points = skin.points(q, !closed);
        points.into_iter().map(|p| base.transform(p)).collect()
    };
    let rest = placed(&motion.q[..joints], motion.closed[0]);
    let sheet = Sheet {
        quads: vec![],
        triangles: skin.triangles.clone(),
        rest: Rest::Positions(rest),
    };
    let mut recording = Recording::new(sheet, 1, "{}".into())?;
    let none = vec![0; recording.node_count()];
    for (row, &time) in motion.times.iter().enumerate() {
        let (q, closed) = (&motion.q[row * joints..][..joints], motion.closed[row]);
        let jaw = if closed { Jaw::Closed } else { Jaw::Open };
        let pose = base * arm.forward(q);
        let state = GripperState {
            command: Command { pose, jaw },
            alpha: 0.0,
        };
        recording.push(time, &placed(q, closed), &[state], &none)?;
    }
    Ok(recording)
}

/// Each bound and how far the commanded timing uses it.
fn bounds(timing: &Timing) -> Table {
    let column = |header: &str, is_number, cells: Vec<String>| Column {
        header: header.into(),
        is_number,
        cells,
    };
    let each = &timing.commanded;
    let of = |text: &dyn Fn(&selvedge_franka::Usage) -> String| each.iter().map(text).collect();
    let note = match slow_down(each) {
        slower if slower > 1.0 => format!("The log must take {slower:.3} times as long."),
        faster => format!("The log could be {:.2} times as fast.", 1.0 / faster),
    };
    Table {
        title: "Bounds, as commanded".into(),
        columns: vec![
            column("Bound", false, of(&|usage| usage.bound.to_string())),
            column("at t [s]", true, of(&|usage| format!("{:.3}", usage.time))),
            column("Value", true, of(&|usage| format!("{:.3}", usage.value))),
            column("Limit", true, of(&|usage| format!("{:.3}", usage.limit))),
        ],
        notes: vec![note],
        ..Table::default()
    }
}
