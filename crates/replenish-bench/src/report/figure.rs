//! Line figures as SVG text, in one style: measured points are marked, theory is dashed.

use plotters::coord::ranged1d::{BoldPoints, DefaultFormatting, KeyPointHint, Ranged};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use replenish_cli::outcome::Failure;
use std::ops::Range;

/// The worker with the budget.
pub(crate) const HIGH: RGBColor = RGBColor(0x25, 0x63, 0xa8);
/// The other worker.
pub(crate) const LOW: RGBColor = RGBColor(0xd9, 0x7a, 0x1e);
/// Theory.
pub(crate) const THEORY: RGBColor = RGBColor(0x1c, 0x27, 0x33);
/// Axes and remarks.
pub(crate) const INK: RGBColor = RGBColor(0x52, 0x60, 0x6d);
/// Grid lines.
pub(crate) const GRID: RGBColor = RGBColor(0xe4, 0xe7, 0xeb);

/// How a series is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Style {
    /// Measured: a line with a mark at each point.
    Measured,
    /// Theory: a dashed line.
    Theory,
    /// Simulated: rings, without a line.
    Simulated,
    /// Measured, for comparison: a thin line without marks.
    Reference,
}

/// One line of a figure.
#[derive(Debug, Clone)]
pub(crate) struct Series {
    /// Its name in the legend; a dashed line without one is not in it.
    pub label: String,
    /// Its colour.
    pub color: RGBColor,
    /// How it is drawn.
    pub style: Style,
    /// Its points.
    pub points: Vec<(f64, f64)>,
}

impl Series {
    /// A line; its `label` is for the legend.
    pub(crate) fn new(label: &str, color: RGBColor, style: Style, points: Vec<(f64, f64)>) -> Self {
        Self {
            label: label.into(),
            color,
            style,
            points,
        }
    }
}

/// The points of a line, from left to right.
pub(crate) fn line(points: impl Iterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
    let mut line: Vec<_> = points.collect();
    line.sort_by(|a, b| a.0.total_cmp(&b.0));
    line
}

/// A figure: axes from 0, a legend, lines.
#[derive(Debug, Clone)]
pub(crate) struct Figure {
    /// The title.
    pub title: String,
    /// The label of the horizontal axis, with the unit.
    pub x_label: String,
    /// The label of the vertical axis, with the unit.
    pub y_label: String,
    /// End of the horizontal axis.
    pub x_max: f64,
    /// The lines.
    pub series: Vec<Series>,
}

impl Figure {
    /// Draws the figure.
    pub(crate) fn to_svg(&self) -> Result<String, Failure> {
        let mut svg = String::new();
        self.draw(&mut svg).map_err(|e| failed(&*e))?;
        Ok(svg)
    }

    fn draw(&self, svg: &mut String) -> Result<(), Box<dyn std::error::Error>> {
        let top = self
            .series
            .iter()
            .flat_map(|s| &s.points)
            .map(|p| p.1)
            .fold(1.0, f64::max);
        let root = SVGBackend::with_string(svg, (860, 520)).into_drawing_area();
        root.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(&root)
            .caption(&self.title, ("sans-serif", 21, &BLACK))
            .margin(14)
            .x_label_area_size(46)
            .y_label_area_size(62)
            .build_cartesian_2d(0.0..self.x_max, Marked::new(top * 1.6, top, 11))?;
        chart
            .configure_mesh()
            .x_desc(&self.x_label)
            .y_desc(&self.y_label)
            .x_labels(11)
            .x_label_formatter(&|x| format!("{x:.0}"))
            .y_label_formatter(&|y| match y {
                y if top < 5.0 => format!("{y:.1}"),
                y => format!("{y:.0}"),
            })
            .label_style(("sans-serif", 15, &INK))
            .axis_desc_style(("sans-serif", 17, &BLACK))
            .axis_style(INK)
            .bold_line_style(GRID)
            .light_line_style(TRANSPARENT)
            .draw()?;
        // Theory last: where both agree, its dashes are still to be seen on the measured line.
        let (theory, measured): (Vec<_>, Vec<_>) = self
            .series
            .iter()
            .partition(|s| matches!(s.style, Style::Theory | Style::Simulated));
        for s in measured.into_iter().chain(theory) {
            let color = s.color;
            let points = s.points.iter().copied();
            match s.style {
                Style::Measured => {
                    let line = color.mix(0.35).stroke_width(4);
                    chart.draw_series(LineSeries::new(points.clone(), line))?;
                    chart
                        .draw_series(points.map(|p| Circle::new(p, 4, color.filled())))?
                        .label(s.label.as_str())
                        .legend(move |(x, y)| Circle::new((x + 11, y), 4, color.filled()));
                }
                Style::Theory => {
                    let line = color.stroke_width(1);
                    let drawn = chart.draw_series(DashedLineSeries::new(points, 6, 4, line))?;
                    if s.label.is_empty() {
                        continue; // one entry in the legend stands for all dashed lines
                    }
                    drawn.label(s.label.as_str()).legend(move |(x, y)| {
                        let dash = |from, to| PathElement::new([(from, 0), (to, 0)], line);
                        EmptyElement::at((x, y)) + dash(0, 6) + dash(10, 16)
                    });
                }
                Style::Simulated => {
                    let ring = move |at| Circle::new(at, 8, color.stroke_width(1));
                    let drawn = chart
                        .draw_series(points.map(|at| Circle::new(at, 8, color.stroke_width(1))))?;
                    if !s.label.is_empty() {
                        drawn
                            .label(s.label.as_str())
                            .legend(move |(x, y)| ring((x + 11, y)));
                    }
                }
                Style::Reference => {
                    let thin = color.mix(0.55).stroke_width(1);
                    chart
                        .draw_series(LineSeries::new(points, thin))?
                        .label(s.label.as_str())
                        .legend(move |(x, y)| PathElement::new([(x, y), (x + 22, y)], thin));
                }
            }
        }
        chart
            .configure_series_labels()
            .position(SeriesLabelPosition::UpperMiddle)
            .label_font(("sans-serif", 16, &BLACK))
            .background_style(WHITE.mix(0.88))
            .border_style(GRID)
            .draw()?;
        root.present()?;
        Ok(())
    }
}

/// An axis that has marks on its lower part only: above is room for the legend, not for values.
pub(crate) struct Marked {
    axis: RangedCoordf64,
    marks: Vec<f64>,
}

impl Marked {
    /// From 0 to `end`, with up to so many marks as would fit all of it, but none above `top`.
    pub(crate) fn new(end: f64, top: f64, marks: usize) -> Self {
        let axis = RangedCoordf64::from(0.0..end);
        let mut marks = axis.key_points(BoldPoints(marks));
        marks.retain(|value| *value <= top * 1.02);
        Self { axis, marks }
    }
}

impl Ranged for Marked {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        self.axis.map(value, limit)
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.marks.clone()
    }

    fn range(&self) -> Range<f64> {
        self.axis.range()
    }
}

/// A drawing error as a failure of the command.
pub(crate) fn failed(e: &dyn std::error::Error) -> Failure {
    Failure::refused(format!("cannot draw the figure: {e}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_names_its_axes_and_lines() {
        let figure = Figure {
            title: "t".into(),
            x_label: "budget".into(),
            y_label: "answers".into(),
            x_max: 100.0,
            series: vec![Series {
                label: "high, theory".into(),
                color: HIGH,
                style: Style::Theory,
                points: vec![(10.0, 40.0), (90.0, 360.0)],
            }],
        };
        let svg = figure.to_svg().unwrap();
        assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
        for text in ["budget", "answers", "high, theory"] {
            assert!(svg.contains(text), "{text}");
        }
    }

    #[test]
    fn the_room_of_the_legend_has_no_marks() {
        let axis = Marked::new(160.0, 100.0, 9);
        assert_eq!(axis.marks, [0.0, 20.0, 40.0, 60.0, 80.0, 100.0]);
        assert_eq!(axis.range(), 0.0..160.0);
    }
}
