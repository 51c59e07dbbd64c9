//! Line figures as SVG text, in one style: measured points are marked, theory is dashed.

use super::picture::{self, LEGEND, Sign, Tips};
use plotters::prelude::*;
use replenish_cli::outcome::Failure;

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

/// Style of a series.
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
    /// Its style.
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

/// A figure: axes from 0, lines, a legend beside them.
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

/// Width and height, legend included.
const SIZE: (u32, u32) = (1000, 460);

impl Figure {
    /// Draws the figure.
    pub(crate) fn to_svg(&self) -> Result<String, Failure> {
        let (mut svg, mut tips) = (String::new(), Tips::default());
        self.draw(&mut svg, &mut tips).map_err(|e| failed(&*e))?;
        Ok(picture::finished(&svg, &tips))
    }

    fn draw(&self, svg: &mut String, tips: &mut Tips) -> Result<(), Box<dyn std::error::Error>> {
        let values = self.series.iter().flat_map(|s| &s.points).map(|p| p.1);
        let top = values.fold(1.0, f64::max);
        let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
        root.fill(&WHITE)?;
        let (plot, beside) = root.split_horizontally(SIZE.0 - LEGEND);
        let mut chart = ChartBuilder::on(&plot)
            .caption(&self.title, ("sans-serif", 21, &BLACK))
            .margin(14)
            .x_label_area_size(46)
            .y_label_area_size(62)
            .build_cartesian_2d(0.0..self.x_max, 0.0..top * 1.06)?;
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
                    chart.draw_series(points.map(|p| Circle::new(p, 4, color.filled())))?;
                }
                Style::Theory => {
                    let line = color.stroke_width(1);
                    chart.draw_series(DashedLineSeries::new(points, 6, 4, line))?;
                }
                Style::Simulated => {
                    chart
                        .draw_series(points.map(|at| Circle::new(at, 8, color.stroke_width(1))))?;
                }
                Style::Reference => {
                    let thin = color.mix(0.55).stroke_width(1);
                    chart.draw_series(LineSeries::new(points, thin))?;
                }
            }
        }
        // Behind the drawing, so that the pointer finds measured marks before simulated ones.
        for s in self.series.iter().rev().filter(|s| s.style.has_marks()) {
            for (x, y) in &s.points {
                let text = format!("{}: {y} at {x} ({})", s.label, self.x_label);
                tips.point(chart.backend_coord(&(*x, *y)), &text);
            }
        }
        let lines: Vec<_> = self
            .series
            .iter()
            .filter(|s| !s.label.is_empty()) // one line stands for all dashed ones
            .map(|s| (s.style.sign(), s.color, s.label.clone()))
            .collect();
        picture::legend(&beside, &lines)?;
        root.present()?;
        Ok(())
    }
}

impl Style {
    fn sign(self) -> Sign {
        match self {
            Self::Measured => Sign::Dots,
            Self::Theory => Sign::Dashes,
            Self::Simulated => Sign::Ring,
            Self::Reference => Sign::Line,
        }
    }

    fn has_marks(self) -> bool {
        matches!(self, Self::Measured | Self::Simulated)
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
    fn the_legend_stands_beside_the_plot_and_marks_have_texts() {
        let figure = Figure {
            title: "t".into(),
            x_label: "budget, ms".into(),
            y_label: "answers".into(),
            x_max: 100.0,
            series: vec![Series::new(
                "high, measured",
                HIGH,
                Style::Measured,
                vec![(30.0, 120.0)],
            )],
        };
        let svg = figure.to_svg().unwrap();
        assert!(svg.contains("<title>high, measured: 120 at 30 (budget, ms)</title>"));
        // The only text with the label is right of the plot.
        let label = svg.find("\nhigh, measured\n").unwrap();
        let tag = svg[..label].rfind("<text x=\"").unwrap();
        let x: String = svg[tag + 9..]
            .chars()
            .take_while(char::is_ascii_digit)
            .collect();
        assert!(x.parse::<u32>().unwrap() >= SIZE.0 - LEGEND, "{x}");
    }
}
