//! A page that stands alone: a 3D player of recordings, tables with pictures, and curves.

mod clip;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use minijinja::Environment;
use minijinja::value::Serde;
use serde::Serialize;
use serde_json::{Value, json};

use crate::{Error, Picture};

use clip::ACCURACY;
pub use clip::Clip;

const TEMPLATE: &str = include_str!("page.html");
const STYLE: &str = include_str!("page.css");
const CHART: &str = include_str!("chart.js");
/// In the order in which they build on each other.
const SCRIPTS: [&str; 3] = [
    include_str!("recording.js"),
    include_str!("draw.js"),
    include_str!("player.js"),
];

/// What a page shows, from top to bottom.
#[derive(Clone, Debug, Default)]
pub struct Page<'a> {
    /// The heading.
    pub title: &'a str,
    /// A sentence below it.
    pub lead: &'a str,
    /// What the player offers; no player if there is none.
    pub clips: &'a [Clip<'a>],
    /// The tables.
    pub tables: &'a [Table],
    /// The heading of the clips' curves, and what the values are called.
    pub curves: [&'a str; 2],
    /// The command that makes the page anew.
    pub command: &'a str,
    /// Names and values of all that it depends on.
    pub facts: &'a [(String, String)],
}

/// A table; the first column has the names of the rows.
#[derive(Clone, Debug, Default)]
pub struct Table {
    /// The heading.
    pub title: String,
    /// All of one length.
    pub columns: Vec<Column>,
    /// The heading of the pictures, and for each row its pictures with words for those who cannot
    /// see them; the row's name plays the clips of that case. Empty for a table without.
    pub pictures: (String, Vec<Vec<(String, Picture)>>),
    /// Sentences below the table.
    pub notes: Vec<String>,
}

/// A column of a table.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Column {
    /// What is in it, with the unit.
    pub header: String,
    /// Whether its cells are numbers, and stand on the right.
    pub is_number: bool,
    /// One a row.
    pub cells: Vec<String>,
}

impl Page<'_> {
    /// The text of an HTML file that needs no other file and no network; the same page gives the same
    /// text. Clips have 20 frames a second, the rest at the end once, positions to 0.09 mm and strains
    /// from 0.01 to 10 % on a logarithmic scale.
    ///
    /// # Errors
    /// [`Error::Value`] for a recording without frames or farther than 26 km away, an ideal that has
    /// not one position a node, columns of different length, or pictures for another number of rows;
    /// [`Error::Draw`] when a picture or the page cannot be made.
    ///
    /// ```
    /// use selvedge_math::DVec3;
    /// use selvedge_view::{Clip, Page, Recording, Rest, Sheet};
    ///
    /// let points = vec![DVec3::ZERO, DVec3::X, DVec3::Y];
    /// let rest = Rest::Positions(points.clone());
    /// let sheet = Sheet { quads: vec![], triangles: vec![[0, 1, 2]], rest };
    /// let mut recording = Recording::new(sheet, 0, "{}".into())?;
    /// recording.push(0.0, &points, &[], &[0; 3])?;
    /// let clip = Clip { case: "still", solver: "", recording: &recording, ideal: None, curve: &[] };
    /// let page = Page { title: "A triangle", clips: &[clip], ..Page::default() };
    /// assert!(page.html()?.contains("<title>A triangle</title>"));
    /// # Ok::<(), selvedge_view::Error>(())
    /// ```
    pub fn html(&self) -> Result<String, Error> {
        let encoded = self
            .clips
            .iter()
            .map(Clip::encode)
            .collect::<Result<Vec<_>, _>>()?;
        let (heads, clips): (Vec<Value>, Vec<String>) = encoded.into_iter().unzip();
        let tables = self
            .tables
            .iter()
            .map(Table::rows)
            .collect::<Result<Vec<_>, _>>()?;
        let data = json!({"clips": heads, "curve_name": self.curves[1]}).to_string();
        let render = || -> Result<String, minijinja::Error> {
            let mut environment = Environment::new();
            environment.add_template("page.html", TEMPLATE)?;
            let values = json!({
                "title": self.title,
                "lead": self.lead,
                "css": STYLE,
                "chart_js": CHART,
                "scripts": SCRIPTS,
                // No text can end the script that holds it.
                "data": data.replace('<', "\\u003c"),
                "clips": clips,
                "has_solvers": self.clips.iter().any(|clip| !clip.solver.is_empty()),
                "has_curves": self.clips.iter().any(|clip| !clip.curve.is_empty()),
                "curve_title": self.curves[0],
                "accuracy_mm": format!("{:.2}", 1e3 * ACCURACY),
                "tables": tables,
                "command": self.command,
                "facts": self.facts,
            });
            let values = minijinja::Value::from(Serde(values));
            environment.get_template("page.html")?.render(values)
        };
        render().map_err(|error| Error::Draw(error.to_string()))
    }
}

impl Table {
    /// The table row by row, as the template wants it.
    fn rows(&self) -> Result<Value, Error> {
        let count = self.columns.first().map_or(0, |column| column.cells.len());
        if let Some(column) = self
            .columns
            .iter()
            .find(|column| column.cells.len() != count)
        {
            let value = format!("{} cells in {}", column.cells.len(), column.header);
            return Err(Error::value(
                "table",
                value,
                format!("{count} as in the first column"),
            ));
        }
        let (picture_header, pictures) = &self.pictures;
        if !(pictures.is_empty() || pictures.len() == count) {
            let value = format!("pictures for {} rows", pictures.len());
            return Err(Error::value(
                "table",
                value,
                format!("{count}, the number of rows"),
            ));
        }
        let mut rows = Vec::with_capacity(count);
        for row in 0..count {
            let cells: Vec<&String> = self
                .columns
                .iter()
                .map(|column| &column.cells[row])
                .collect();
            let mut shown = Vec::new();
            for (words, picture) in pictures.get(row).into_iter().flatten() {
                shown.push(json!({
                    "words": words,
                    "width": picture.width,
                    "height": picture.height,
                    "base64": STANDARD.encode(picture.png()?),
                }));
            }
            rows.push(json!({"name": cells[0], "cells": cells, "pictures": shown}));
        }
        let heads = self.columns.iter();
        let heads =
            heads.map(|column| json!({"header": column.header, "is_number": column.is_number}));
        Ok(json!({
            "title": self.title,
            "columns": heads.collect::<Vec<_>>(),
            "rows": rows,
            "pictures": !pictures.is_empty(),
            "picture_header": picture_header,
            "notes": self.notes,
        }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Recording;
    use crate::testing::rising;
    use selvedge_math::DVec3;

    #[test]
    fn words_are_escaped_and_wrong_tables_are_named() {
        let recording = rising(5, 1.0);
        let clip = Clip {
            case: "</script><b>",
            solver: "",
            recording: &recording,
            ideal: None,
            curve: &[],
        };
        let column = |header: &str, cells: &[&str]| Column {
            header: header.into(),
            is_number: false,
            cells: cells.iter().map(|cell| (*cell).to_owned()).collect(),
        };
        let table = |columns: Vec<Column>| Table {
            title: "<T>".into(),
            columns,
            ..Table::default()
        };
        let html = |table: Table| {
            let page = Page {
                title: "a < b",
                clips: std::slice::from_ref(&clip),
                tables: &[table],
                ..Page::default()
            };
            page.html()
        };
        let text = html(table(vec![column("x<y", &["<i>"])])).unwrap();
        for bad in ["</script><b>", "<T>", "x<y", "<i>", "a < b"] {
            assert!(!text.contains(bad), "{bad}");
        }
        assert!(text.contains("&lt;i&gt;") && text.contains("a &lt; b"));
        let uneven = html(table(vec![column("x", &["1"]), column("y", &[])])).unwrap_err();
        assert!(uneven.to_string().contains("0 cells in y"), "{uneven}");
        let mut odd = table(vec![column("x", &["1"])]);
        odd.pictures.1 = vec![vec![]; 2];
        assert!(
            html(odd)
                .unwrap_err()
                .to_string()
                .contains("pictures for 2 rows")
        );
    }

    #[test]
    fn what_cannot_be_shown_is_named() {
        let recording = rising(5, 1.0);
        let short = [DVec3::ZERO];
        let page = |recording: &Recording, ideal: Option<&[DVec3]>| {
            let clip = Clip {
                case: "a",
                solver: "b",
                recording,
                ideal,
                curve: &[],
            };
            let page = Page {
                clips: &[clip],
                ..Page::default()
            };
            page.html()
        };
        let error = page(&recording, Some(&short)).unwrap_err().to_string();
        assert!(error.contains("ideal: 1 positions"), "{error}");
        let empty = Recording::new(recording.sheet().clone(), 0, "{}".into()).unwrap();
        assert!(
            page(&empty, None)
                .unwrap_err()
                .to_string()
                .contains("no frame")
        );
        let mut far = empty;
        far.push(0.0, &[1e6 * DVec3::X, DVec3::X, DVec3::Y], &[], &[0; 3])
            .unwrap();
        let error = page(&far, None).unwrap_err().to_string();
        assert!(error.contains("node 0 is at 1000000"), "{error}");
    }
}
