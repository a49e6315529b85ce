//! Line charts as SVG: the only file that names plotters.

use plotters::element::DashedPathElement;
use plotters::prelude::*;

use crate::Error;

/// Lines over a common axis, with a logarithmic y axis.
#[derive(Clone, Copy, Debug)]
pub struct Chart<'a> {
    /// What is shown.
    pub title: &'a str,
    /// What x is, with its unit.
    pub x_label: &'a str,
    /// What y is, with its unit.
    pub y_label: &'a str,
    /// Names and points `(x, y)`; points whose y is not above zero are left out, since a
    /// logarithmic axis has no place for them.
    pub series: &'a [(String, Vec<(f64, f64)>)],
}

/// Colours that people with any colour vision tell apart (Okabe and Ito 2008).
const COLOURS: [RGBColor; 8] = [
    RGBColor(0, 0, 0),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 158, 115),
    RGBColor(213, 94, 0),
    RGBColor(0, 114, 178),
    RGBColor(204, 121, 167),
    RGBColor(150, 140, 20),
];

/// Length of a dash and of the gap after it [pixels]; lines beyond the eighth are dashed.
const DASH: u32 = 6;
const GAP: u32 = 4;

/// The axis shows so many decades below the largest value at most.
const DECADES: i32 = 4;

impl Chart<'_> {
    /// The chart as the text of an SVG file, 900 by 520 pixels; the same text for the same points.
    ///
    /// # Errors
    /// [`Error::Draw`] when the chart cannot be drawn.
    pub fn svg(&self) -> Result<String, Error> {
        let mut text = String::new();
        self.draw(&mut text)
            .map_err(|error| Error::Draw(error.to_string()))?;
        Ok(text)
    }

    fn draw(&self, text: &mut String) -> Result<(), Box<dyn std::error::Error>> {
        let points = || self.series.iter().flat_map(|(_, points)| points);
        let x_end = points().map(|p| p.0).fold(1e-3, f64::max);
        let y_end = points().map(|p| p.1).fold(f64::MIN_POSITIVE, f64::max);
        let lowest = points()
            .map(|p| p.1)
            .filter(|y| *y > 0.0)
            .fold(y_end, f64::min);
        let top = y_end.log10().ceil() as i32;
        let bottom = (lowest.log10().floor() as i32).clamp(top - DECADES, top - 1);
        let floor = 10f64.powi(bottom);

        let root = SVGBackend::with_string(text, (900, 520)).into_drawing_area();
        root.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(&root)
            .caption(self.title, ("sans-serif", 22))
            .margin(16)
            .x_label_area_size(44)
            .y_label_area_size(64)
            .build_cartesian_2d(0.0..x_end, (floor..10f64.powi(top)).log_scale())?;
        chart
            .configure_mesh()
            .x_desc(self.x_label)
            .y_desc(self.y_label)
            .x_labels(12)
            .y_label_formatter(&|y| format!("{y:.0e}"))
            .light_line_style(BLACK.mix(0.06))
            .bold_line_style(BLACK.mix(0.18))
            .label_style(("sans-serif", 15))
            .draw()?;
        for (number, (name, points)) in self.series.iter().enumerate() {
            let style = COLOURS[number % COLOURS.len()].stroke_width(2);
            let line = points.iter().copied().filter(|p| p.1 >= floor);
            let key = |(x, y): (i32, i32)| [(x, y), (x + 22, y)];
            if number < COLOURS.len() {
                chart
                    .draw_series(LineSeries::new(line, style))?
                    .label(name)
                    .legend(move |at| PathElement::new(key(at), style));
            } else {
                chart
                    .draw_series(DashedLineSeries::new(line, DASH, GAP, style))?
                    .label(name)
                    .legend(move |at| DashedPathElement::new(key(at), DASH, GAP, style));
            }
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::LowerLeft)
            .background_style(WHITE.mix(0.85))
            .border_style(BLACK.mix(0.3))
            .label_font(("sans-serif", 15))
            .draw()?;
        root.present()?;
        Ok(())
    }
}

/// A number for each of a grid of places, as colours.
#[derive(Clone, Copy, Debug)]
pub struct HeatMap<'a> {
    /// What is shown.
    pub title: &'a str,
    /// What x is, with its unit.
    pub x_label: &'a str,
    /// What y is, with its unit.
    pub y_label: &'a str,
    /// The columns, ascending and evenly apart.
    pub x: &'a [f64],
    /// The rows, likewise.
    pub y: &'a [f64],
    /// Row by row; none where there is no number.
    pub values: &'a [Option<f64>],
    /// A place with a ring around it.
    pub marked: Option<[f64; 2]>,
}

impl HeatMap<'_> {
    /// The map as the text of an SVG file, 760 by 620 pixels, each number in its cell; the same text
    /// for the same numbers.
    ///
    /// # Errors
    /// [`Error::Value`] unless there is one value a place and at least one place, [`Error::Draw`] when
    /// the map cannot be drawn.
    pub fn svg(&self) -> Result<String, Error> {
        let places = self.x.len() * self.y.len();
        if self.values.len() != places || places == 0 {
            let value = format!("{} for {places} places", self.values.len());
            return Err(Error::value(
                "values",
                value,
                "one a place, one place at least",
            ));
        }
        let mut text = String::new();
        self.draw(&mut text)
            .map_err(|error| Error::Draw(error.to_string()))?;
        Ok(text)
    }

    fn draw(&self, text: &mut String) -> Result<(), Box<dyn std::error::Error>> {
        // Half a cell around the outer places
        let span = |places: &[f64]| {
            let [first, last] = [places[0], places[places.len() - 1]];
            let cell = (last - first) / (places.len().max(2) - 1) as f64;
            let half = if cell > 0.0 { 0.5 * cell } else { 0.5 };
            (first - half, last + half, half)
        };
        let ((left, right, wide), (bottom, top, high)) = (span(self.x), span(self.y));
        let most = self
            .values
            .iter()
            .flatten()
            .fold(f64::MIN_POSITIVE, |a, b| a.max(*b));

        let root = SVGBackend::with_string(text, (760, 620)).into_drawing_area();
        root.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(&root)
            .caption(self.title, ("sans-serif", 20))
            .margin(16)
            .x_label_area_size(44)
            .y_label_area_size(64)
            .build_cartesian_2d(left..right, bottom..top)?;
        chart
            .configure_mesh()
            .disable_mesh()
            .x_desc(self.x_label)
            .y_desc(self.y_label)
            .label_style(("sans-serif", 15))
            .draw()?;
        let places = || {
            self.y
                .iter()
                .flat_map(|y| self.x.iter().map(move |x| (*x, *y)))
        };
        chart.draw_series(places().zip(self.values).map(|((x, y), value)| {
            let style = match value {
                // From white to the blue of the charts
                Some(value) => {
                    let share = (value / most).clamp(0.0, 1.0);
                    RGBColor(0, 114, 178).mix(0.15 + 0.75 * share).filled()
                }
                None => BLACK.mix(0.06).filled(),
            };
            Rectangle::new([(x - wide, y - high), (x + wide, y + high)], style)
        }))?;
        let known = places()
            .zip(self.values)
            .filter_map(|(place, value)| Some((place, (*value)?)));
        chart.draw_series(known.map(|((x, y), value)| {
            Text::new(
                format!("{value:.2}"),
                (x - 0.6 * wide, y + 0.35 * high),
                ("sans-serif", 13),
            )
        }))?;
        if let Some([x, y]) = self.marked {
            let ring = RGBColor(213, 94, 0).stroke_width(3);
            chart.draw_series([Circle::new((x, y), 16, ring)])?;
        }
        root.present()?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_beyond_the_eighth_are_dashed() {
        let line = |number: usize| {
            let points = vec![(0.0, 0.1), (1.0, 0.2 * (number + 1) as f64)];
            (format!("line {number}"), points)
        };
        let lines: Vec<_> = (0..9).map(line).collect();
        let elements = |count: usize| {
            let chart = Chart {
                title: "T",
                x_label: "t [s]",
                y_label: "E",
                series: &lines[..count],
            };
            chart.svg().unwrap().matches("<polyline").count()
        };
        // A line and its key, or many dashes.
        let before = elements(8) - elements(7);
        assert!(elements(9) - elements(8) > 20 * before);
    }

    #[test]
    fn a_map_has_a_cell_a_place_and_a_number_where_there_is_one() {
        let map = HeatMap {
            title: "M",
            x_label: "x [m]",
            y_label: "y [m]",
            x: &[0.0, 1.0, 2.0],
            y: &[0.0, 1.0],
            values: &[Some(0.25), None, Some(0.5), None, None, Some(1.0)],
            marked: Some([2.0, 1.0]),
        };
        let svg = map.svg().unwrap();
        // One more for the background.
        assert_eq!(svg.matches("<rect").count(), 7);
        assert_eq!(svg.matches("<circle").count(), 1);
        for number in ["0.25", "0.50", "1.00", "x [m]"] {
            assert!(svg.contains(number), "{number}");
        }
        let wrong = HeatMap {
            values: &[None],
            ..map
        };
        assert!(
            wrong
                .svg()
                .unwrap_err()
                .to_string()
                .contains("1 for 6 places")
        );
    }

    #[test]
    fn draws_every_line_and_leaves_out_zeros() {
        let series = [
            (
                "falling".to_owned(),
                vec![(0.0, 0.3), (1.0, 0.02), (2.0, 0.0)],
            ),
            ("flat".to_owned(), vec![(0.0, 0.1), (2.0, 0.1)]),
        ];
        let chart = Chart {
            title: "T",
            x_label: "t [s]",
            y_label: "E",
            series: &series,
        };
        let svg = chart.svg().unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        for word in ["falling", "flat", "t [s]", "1e-1"] {
            assert!(svg.contains(word), "{word}");
        }
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        assert_eq!(svg, chart.svg().unwrap());
        let nothing = Chart {
            series: &[],
            ..chart
        };
        assert!(nothing.svg().is_ok());
    }
}
