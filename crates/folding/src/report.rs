//! The page that an experiment leaves: what came out, to be looked at.

use std::time::SystemTime;

use selvedge_view::{Clip, Page, Picture, Table};
use serde_json::Value;

use crate::compare::Results;
use crate::files::end_picture;
use crate::table::columns;
use crate::{Error, Experiment, Options, Run, Scenario, Solver};

/// Pixels of a picture in the table.
const THUMBNAIL: [u32; 2] = [288, 216];

/// The text of the page.
pub(crate) fn report(
    results: &Results<'_>,
    experiment: &Experiment,
    options: &Options,
) -> Result<String, Error> {
    let scenario = results.scenario;
    let ideal = results.ideal();
    let finished = |number: usize| -> Option<&Run> { results.runs[number].as_ref().ok() };
    let curves: Vec<Vec<(f64, f64)>> = (0..results.pairs.len())
        .map(|number| results.curve(number, &ideal).unwrap_or_default())
        .collect();
    let clips: Vec<Clip<'_>> = results
        .pairs
        .iter()
        .enumerate()
        .filter_map(|(number, (case, solver))| {
            Some(Clip {
                case: &case.name,
                solver: solver.name(),
                recording: &finished(number)?.recording,
                ideal: results.reference(number, &ideal),
                curve: &curves[number],
            })
        })
        .collect();

    let pairs = results.pairs.iter().enumerate();
    let mut pictures: Vec<Vec<(String, Picture)>> = Vec::new();
    let mut last = None;
    for (number, (case, solver)) in pairs {
        if last != Some(&case.name) {
            pictures.push(Vec::new());
            last = Some(&case.name);
        }
        if let (Some(run), Some(row)) = (finished(number), pictures.last_mut()) {
            let words = format!("End of {} on the {solver} solver", case.name);
            row.push((words, end_picture(&run.recording, THUMBNAIL)?));
        }
    }
    let [grasps, qualities] = columns(&experiment.rows);
    let failures = experiment.rows.iter().filter_map(|(row, _)| {
        Some(format!(
            "{} {} failed: {}",
            row.case,
            row.solver,
            row.failure()?
        ))
    });
    let mut notes = vec![
        "Error: root mean square distance of the nodes at the end to the ideal fold, as a share of \
         the sheet's diagonal. The ideal fold of a case is the end of its reference on the same \
         solver. Paper: what the paper prints for its own scheme, which is the published one; \
         another solver is another cloth."
            .to_owned(),
    ];
    notes.extend(failures);
    let mut tables = vec![
        Table {
            title: "Folding errors".into(),
            columns: grasps,
            pictures: (ends(&options.solvers), pictures),
            notes,
        },
        Table {
            title: "Accuracy and time".into(),
            columns: qualities,
            notes: vec![
                "Strain: largest edge strain of the run. Median, max - min: errors of the same fold \
                 from perturbed starts. Gripper/step: pose, targets and velocities of one step. Times \
                 real time: simulated time over time spent in gripper and cloth, with other folds \
                 running beside it."
                    .into(),
            ],
            ..Table::default()
        },
    ];
    tables.extend(options.tables.iter().cloned());
    let title = format!("Selvedge: {}", scenario.name);
    let lead = "How a gripper takes hold of a cloth decides how well it folds it.";
    let page = Page {
        title: &title,
        lead,
        clips: &clips,
        tables: &tables,
        curves: ["Folding error over time", "E"],
        command: &options.command,
        facts: &facts(scenario, options),
    };
    Ok(page.html()?)
}

/// The heading of the pictures.
fn ends(solvers: &[Solver]) -> String {
    let names: Vec<&str> = solvers.iter().map(|solver| solver.name()).collect();
    format!("End: {}", names.join(", "))
}

/// All that the numbers depend on.
fn facts(scenario: &Scenario, options: &Options) -> Vec<(String, String)> {
    let mesh = &scenario.mesh;
    let grid = mesh.as_grid().map(|grid| {
        let ([a, b], [na, nb]) = (grid.sides, grid.nodes);
        format!("{a} x {b} m, {na} x {nb} nodes")
    });
    let times = scenario.times;
    let mut facts = vec![
        ("Scenario".to_owned(), scenario.name.clone()),
        (
            "Cloth".to_owned(),
            grid.unwrap_or_else(|| format!("{} nodes", mesh.node_count())),
        ),
        (
            "Times".to_owned(),
            format!(
                "jaws close at {} s, gripper moves from {} s, jaws open at {} s, end {} s; a command \
                 every {:.4} s, {} steps",
                times.close, times.start, times.open, times.end, scenario.frame, scenario.steps
            ),
        ),
    ];
    for solver in &options.solvers {
        let (settings, _, material) = solver.meta(scenario);
        facts.push((format!("Material, {solver}"), listed(&material)));
        facts.push((format!("Settings, {solver}"), listed(&settings)));
    }
    let ensemble = match options.ensemble {
        0 => "none".to_owned(),
        number => format!(
            "{number} a case, starts differ by up to {:e} m",
            options.noise
        ),
    };
    let now = humantime::format_rfc3339_seconds(SystemTime::now());
    facts.extend([
        ("Perturbed starts".to_owned(), ensemble),
        (
            "Folds at the same time".to_owned(),
            options.jobs.to_string(),
        ),
        ("Selvedge".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("Made".to_owned(), now.to_string()),
    ]);
    facts
}

/// Fields and values, SI units.
fn listed(fields: &Value) -> String {
    let Some(fields) = fields.as_object() else {
        return fields.to_string();
    };
    let text = |value: &Value| match value.as_f64() {
        // Five digits: a period of 1/120 s is no number to read.
        Some(number) => format!("{number:.4e}")
            .parse::<f64>()
            .unwrap_or(number)
            .to_string(),
        None => value.to_string(),
    };
    let fields = fields
        .iter()
        .map(|(name, value)| format!("{} {}", name.replace('_', " "), text(value)));
    fields.collect::<Vec<_>>().join(", ")
}
