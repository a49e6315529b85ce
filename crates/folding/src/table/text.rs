//! The table for people: a line a case, its solvers side by side.

use comfy_table::{CellAlignment, Table, presets};

use selvedge_view::Column;

use super::{Row, node_text};
use crate::{Solver, Timing};

/// Rows of one case.
type Group<'a> = &'a [(Row, Option<Timing>)];

/// What stands below the table in a file.
const NOTES: &str = "\
- Paper: the error that the paper prints for its own scheme, which is the solver `published`. \
Another solver is another cloth: its errors are not expected to have these digits.
- Median, max - min: errors of the same fold from perturbed starts.
- Strain: largest edge strain in any step, see docs/SCENARIOS.md.
";

pub(crate) fn texts(header: impl Into<String>, cells: impl Iterator<Item = String>) -> Column {
    Column {
        header: header.into(),
        is_number: false,
        cells: cells.collect(),
    }
}

pub(crate) fn numbers(header: impl Into<String>, cells: impl Iterator<Item = String>) -> Column {
    Column {
        is_number: true,
        ..texts(header, cells)
    }
}

/// A table of columns that are equally long.
pub(crate) fn print<'a>(columns: impl IntoIterator<Item = &'a Column>) -> String {
    let columns: Vec<&Column> = columns.into_iter().collect();
    let mut table = Table::new();
    table.load_style(presets::ASCII_MARKDOWN);
    table.set_header(columns.iter().map(|column| &column.header));
    let rows = columns.first().map_or(0, |column| column.cells.len());
    for row in 0..rows {
        table.add_row(columns.iter().map(|column| &column.cells[row]));
    }
    for (index, column) in columns.iter().enumerate() {
        if let (true, Some(shown)) = (column.is_number, table.column_mut(index)) {
            shown.set_cell_alignment(CellAlignment::Right);
        }
    }
    table.to_string()
}

/// The rows as a Markdown table with its notes, without times.
pub(crate) fn markdown(rows: &[(Row, Option<Timing>)]) -> String {
    let (groups, solvers) = grouped(rows);
    let columns = [
        grasps(&groups),
        errors(&groups, &solvers),
        qualities(&groups, &solvers),
    ];
    let mut text = format!("{}\n\n", print(columns.iter().flatten()));
    for (row, _) in rows {
        if let Some(reason) = row.failure() {
            text += &format!("- {} {} failed: {reason}\n", row.case, row.solver);
        }
    }
    text + NOTES
}

/// The columns for a page: what came out, and how well and how fast.
pub(crate) fn columns(rows: &[(Row, Option<Timing>)]) -> [Vec<Column>; 2] {
    let (groups, solvers) = grouped(rows);
    let mut grasps = grasps(&groups);
    let names = grasps[0].clone();
    grasps.extend(errors(&groups, &solvers));
    let mut second = vec![names];
    second.extend(qualities(&groups, &solvers));
    second.extend(times(&groups, &solvers));
    [grasps, second]
}

/// The rows for a terminal: what came out, then how well and how fast.
pub fn terminal(rows: &[(Row, Option<Timing>)]) -> String {
    let (groups, solvers) = grouped(rows);
    let mut grasps = grasps(&groups);
    let errors = errors(&groups, &solvers);
    let first = print(grasps.iter().chain(&errors));
    grasps.truncate(1);
    let qualities = qualities(&groups, &solvers);
    let times = times(&groups, &solvers);
    let second = print(grasps.iter().chain(&qualities).chain(&times));
    format!("{first}\n\n{second}")
}

/// Rows of the same case together, and the solvers in their order.
fn grouped(rows: &[(Row, Option<Timing>)]) -> (Vec<Group<'_>>, Vec<Solver>) {
    let groups: Vec<Group<'_>> = rows.chunk_by(|(a, _), (b, _)| a.case == b.case).collect();
    let first = groups.first().copied().unwrap_or_default();
    let solvers = first.iter().map(|(row, _)| row.solver).collect();
    (groups, solvers)
}

fn grasps(groups: &[Group<'_>]) -> Vec<Column> {
    let of_first = |cell: fn(&Row) -> String| {
        let rows = groups.iter().map(|group| &group[0].0);
        rows.map(cell)
    };
    vec![
        texts("Case", of_first(|row| row.case.clone())),
        texts("Support", groups.iter().map(|group| support(group))),
        texts("Volume", of_first(Row::volume)),
        texts("Orientation", of_first(Row::orientation)),
    ]
}

fn errors(groups: &[Group<'_>], solvers: &[Solver]) -> Vec<Column> {
    let digits = |value: Option<f64>| value.map_or(dash(), |v| format!("{v:.8}"));
    let mut columns = Vec::new();
    for &solver in solvers {
        let error = column(title(solver), groups, solver, |row, _| match &row.outcome {
            Ok(measured) => digits(measured.error),
            Err(_) => "failed".to_owned(),
        });
        match solver {
            Solver::Published => columns.extend([
                column("Paper", groups, solver, |row, _| digits(row.published)),
                error,
                column("Published - paper", groups, solver, |row, _| {
                    row.difference().map_or(dash(), |d| format!("{d:+.1e}"))
                }),
            ]),
            Solver::Default => columns.push(error),
        }
    }
    columns
}

fn qualities(groups: &[Group<'_>], solvers: &[Solver]) -> Vec<Column> {
    let mut columns = Vec::new();
    let rows = || groups.iter().copied().flatten().map(|(row, _)| row);
    if rows().any(|row| row.ensemble().is_some()) {
        columns.extend(solvers.iter().map(|&solver| {
            let header = format!("{}: median, max - min", title(solver));
            column(&header, groups, solver, |row, _| {
                let numbers = row.ensemble().and_then(|e| e.median().zip(e.range()));
                numbers.map_or(dash(), |(median, [min, max])| {
                    // The reference against itself differs by its own noise only.
                    let median = match median < 1e-4 {
                        true => format!("{median:.0e}"),
                        false => format!("{median:.6}"),
                    };
                    format!("{median}, {:.0e}", max - min)
                })
            })
        }));
    }
    columns.extend(solvers.iter().map(|&solver| {
        let header = format!("{}: strain", title(solver));
        column(&header, groups, solver, |row, _| match &row.outcome {
            Ok(measured) => format!("{:.3} %", measured.worst.strain * 100.0),
            Err(_) => dash(),
        })
    }));
    columns
}

fn times(groups: &[Group<'_>], solvers: &[Solver]) -> Vec<Column> {
    let gripper = groups.iter().map(|group| {
        let timing = group.iter().find_map(|(_, timing)| *timing);
        timing.map_or(dash(), |t| format!("{} ns", t.gripper_step.as_nanos()))
    });
    let mut columns = vec![numbers("Gripper/step", gripper)];
    columns.extend(solvers.iter().map(|&solver| {
        let header = format!("{}: x real time", title(solver));
        column(&header, groups, solver, |_, timing| {
            timing.map_or(dash(), |t| format!("{:.1}", t.real_time_factor))
        })
    }));
    columns
}

/// A column of numbers of one solver.
fn column(
    header: &str,
    groups: &[Group<'_>],
    solver: Solver,
    cell: impl Fn(&Row, Option<Timing>) -> String,
) -> Column {
    let cells = groups.iter().map(|group| {
        let found = group.iter().find(|(row, _)| row.solver == solver);
        found.map_or(dash(), |(row, timing)| cell(row, *timing))
    });
    numbers(header, cells)
}

/// The held nodes; once if they are the same on all solvers that ran to the end.
fn support(group: Group<'_>) -> String {
    let finished = group.iter().filter_map(|(row, _)| {
        let measured = row.outcome.as_ref().ok()?;
        Some((row.solver, node_list(&measured.support)))
    });
    let texts: Vec<(Solver, String)> = finished.collect();
    match texts.as_slice() {
        [] => dash(),
        [(_, first), rest @ ..] if rest.iter().all(|(_, text)| text == first) => first.clone(),
        _ => {
            let named = texts
                .iter()
                .map(|(solver, text)| format!("{solver}: {text}"));
            named.collect::<Vec<_>>().join("; ")
        }
    }
}

/// Nodes for a cell: all of a few, the first of many.
fn node_list(nodes: &[u32]) -> String {
    const SHOWN: usize = 8;
    let plural = if nodes.len() == 1 { "node" } else { "nodes" };
    let more = if nodes.len() > SHOWN { " ..." } else { "" };
    let shown = &nodes[..nodes.len().min(SHOWN)];
    format!("{} {plural}: {}{more}", nodes.len(), node_text(shown))
}

fn title(solver: Solver) -> &'static str {
    match solver {
        Solver::Published => "Published",
        Solver::Default => "Default",
    }
}

fn dash() -> String {
    "-".to_owned()
}
