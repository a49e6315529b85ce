//! Margins over time and the map of bases, as SVG.

use anyhow::Result;
use selvedge_franka::{Place, Posture, Reach};
use selvedge_view::{Chart, HeatMap};

/// How near the path comes to limits, table, itself and singular postures.
pub(crate) fn margins(found: &Reach<'_>) -> Result<String> {
    let line = |name: &str, value: fn(&Posture<'_>) -> f64| {
        let rows = found.rows.iter();
        let points = rows.filter_map(|row| Some((row.time, value(row.posture.as_ref()?))));
        let points = points.filter(|point| point.1.is_finite()).collect();
        (name.to_owned(), points)
    };
    let series = [
        line("nearest joint limit [rad]", |p| p.margin),
        line("table [m]", |p| p.clearance.table),
        line("itself [m]", |p| p.clearance.own),
        line("smallest singular value", |p| p.sigma),
    ];
    let chart = Chart {
        title: "Margins of the arm",
        x_label: "t [s]",
        y_label: "margin",
        series: &series,
    };
    Ok(chart.svg()?)
}

/// The score of each place, the better of its turns of base and hand.
pub(crate) fn bases(found: &Reach<'_>, places: &[Place]) -> Result<String> {
    let at = |place: &Place| {
        let [x, y, ..] = place.placement.numbers();
        [x, y]
    };
    // Places of one column or row differ by rounding only.
    let distinct = |axis: usize| {
        let mut values: Vec<f64> = places.iter().map(|place| at(place)[axis]).collect();
        values.sort_by(f64::total_cmp);
        values.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
        values
    };
    let (x, y) = (distinct(0), distinct(1));
    let mut values = vec![None; x.len() * y.len()];
    for place in places {
        let index = |all: &[f64], value: f64| all.iter().position(|v| (v - value).abs() < 1e-6);
        let [px, py] = at(place);
        if let (Some(i), Some(j)) = (index(&x, px), index(&y, py)) {
            let value: &mut Option<f64> = &mut values[j * x.len() + i];
            *value = match (*value, place.score) {
                (Some(a), Some(b)) => Some(a.max(b)),
                (a, b) => a.or(b),
            };
        }
    }
    let [bx, by, ..] = found.placement.numbers();
    let map = HeatMap {
        title: "Where the base may stand: worst margin of the path",
        x_label: "x [m]",
        y_label: "y [m]",
        x: &x,
        y: &y,
        values: &values,
        marked: Some([bx, by]),
    };
    Ok(map.svg()?)
}
