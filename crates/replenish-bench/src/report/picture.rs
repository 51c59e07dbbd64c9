//! The last touches to a drawing: colours for dark screens, and a text for each mark under the
//! pointer.
//!
//! The drawings have their colours as attributes. A style sheet inside the drawing has precedence
//! over them, in a page as well as in a file of its own.

use plotters::prelude::*;
use replenish_cli::report::html::escape;

/// Colours for a screen that prefers dark ones; the pairs of light and dark.
const DARK: [(&str, &str); 8] = [
    ("#FFFFFF", "#14191F"),
    ("#000000", "#E6E9ED"),
    ("#1C2733", "#E6E9ED"),
    ("#52606D", "#A9B4BF"),
    ("#7B8794", "#8794A1"),
    ("#E4E7EB", "#2A333D"),
    ("#2563A8", "#5B9BE0"),
    ("#A9C6E6", "#3B5878"),
];

/// Marks under the pointer, with their texts.
#[derive(Debug, Default)]
pub(crate) struct Tips(String);

impl Tips {
    /// A text for the mark at this point of the drawing.
    pub(crate) fn point(&mut self, (x, y): (i32, i32), text: &str) {
        let mark = format!("<circle cx=\"{x}\" cy=\"{y}\" r=\"9\"");
        self.push(&mark, "circle", text);
    }

    /// A text for the rectangle between two corners.
    pub(crate) fn area(&mut self, from: (i32, i32), to: (i32, i32), text: &str) {
        let (x, y) = (from.0.min(to.0), from.1.min(to.1));
        let (width, height) = (from.0.abs_diff(to.0).max(1), from.1.abs_diff(to.1).max(1));
        let mark = format!("<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\"");
        self.push(&mark, "rect", text);
    }

    fn push(&mut self, mark: &str, tag: &str, text: &str) {
        let text = escape(text);
        self.0.push_str(&format!(
            "{mark} fill=\"none\" pointer-events=\"all\"><title>{text}</title></{tag}>\n"
        ));
    }
}

/// The drawing with its colours for dark screens and its texts.
pub(crate) fn finished(svg: &str, tips: &Tips) -> String {
    let (head, body) = svg.split_once('>').unwrap_or((svg, ""));
    let body = body.trim_end();
    let body = body.strip_suffix("</svg>").unwrap_or(body);
    format!("{head}>\n<style>{}</style>{body}{}</svg>\n", dark(), tips.0)
}

fn dark() -> String {
    let rules = DARK.map(|(light, dark)| {
        format!("[fill=\"{light}\"]{{fill:{dark}}}[stroke=\"{light}\"]{{stroke:{dark}}}")
    });
    format!("@media(prefers-color-scheme:dark){{{}}}", rules.concat())
}

/// The sign of a line of the legend.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Sign {
    /// A filled box.
    Box,
    /// A dot on a pale line.
    Dots,
    /// A thin line.
    Line,
    /// A dashed line.
    Dashes,
    /// A ring.
    Ring,
}

/// The width of a legend beside a plot.
pub(crate) const LEGEND: u32 = 262;
/// The height of one of its lines.
const ROW: i32 = 26;

/// Draws the legend into the area beside the plot, from the top.
pub(crate) fn legend<DB: DrawingBackend>(
    area: &DrawingArea<DB, plotters::coord::Shift>,
    lines: &[(Sign, RGBColor, String)],
) -> Result<(), Box<dyn std::error::Error>>
where
    DB::ErrorType: 'static,
{
    for (row, (sign, color, label)) in (0..).zip(lines) {
        let y = 58 + ROW * row;
        let line =
            |from: i32, to: i32, style: ShapeStyle| PathElement::new([(from, y), (to, y)], style);
        match sign {
            Sign::Box => {
                area.draw(&Rectangle::new([(6, y - 6), (24, y + 6)], color.filled()))?;
            }
            Sign::Dots => {
                area.draw(&line(4, 26, color.mix(0.35).stroke_width(4)))?;
                area.draw(&Circle::new((15, y), 4, color.filled()))?;
            }
            Sign::Line => area.draw(&line(4, 26, color.mix(0.55).stroke_width(1)))?,
            Sign::Dashes => {
                for from in [4, 14] {
                    area.draw(&line(from, from + 7, color.stroke_width(1)))?;
                }
            }
            Sign::Ring => area.draw(&Circle::new((15, y), 8, color.stroke_width(1)))?,
        }
        let font = ("sans-serif", 16).into_font().color(&BLACK);
        area.draw(&Text::new(label.as_str(), (34, y - 7), font))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_drawing_gets_texts_and_dark_colours() {
        let mut tips = Tips::default();
        tips.point((3, 4), "a < b");
        tips.area((9, 2), (5, 2), "bar");
        let svg = finished("<svg width=\"9\">\n<g/>\n</svg>\n", &tips);
        assert!(svg.starts_with("<svg width=\"9\">\n<style>@media(prefers-color-scheme:dark)"));
        assert!(svg.ends_with("</svg>\n") && svg.matches("</svg>").count() == 1);
        assert!(svg.contains("<title>a &lt; b</title></circle>"));
        assert!(
            svg.contains("x=\"5\" y=\"2\" width=\"4\" height=\"1\""),
            "{svg}"
        );
    }
}
