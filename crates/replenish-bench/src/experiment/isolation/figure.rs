//! The picture: the control loop's response times, a panel per case, a logarithmic scale.

use super::case::Case;
use super::scenario::{CALM, Disturbance, PERIOD, WINDOW};
use crate::load::{MS, Nanos};
use crate::report::figure::{GRID, HIGH, INK, LOW, THEORY, failed};
use crate::report::picture::{self, Tips};
use plotters::coord::Shift;
use plotters::prelude::*;
use replenish_cli::outcome::Failure;

const SIZE: (u32, u32) = (1100, 640);
const LEGEND: u32 = 46;
/// Response times shown, in ms.
const RANGE: std::ops::Range<f64> = 1.0..1_000.0;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Draws the four panels.
pub(super) fn draw(cases: &[Case]) -> Result<String, Failure> {
    let (mut svg, mut tips) = (String::new(), Tips::default());
    draw_all((&mut svg, &mut tips), cases).map_err(|e| failed(&*e))?;
    Ok(picture::finished(&svg, &tips))
}

fn draw_all(
    (svg, tips): (&mut String, &mut Tips),
    cases: &[Case],
) -> Result<(), Box<dyn std::error::Error>> {
    let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let (legend, body) = root.split_vertically(LEGEND);
    draw_legend(&legend)?;
    let panels = body.split_evenly((2, 2));
    for (panel, disturbance) in panels.iter().zip(Disturbance::ALL) {
        draw_panel(panel, disturbance, cases, tips)?;
    }
    root.present()?;
    Ok(())
}

fn draw_legend(area: &Area<'_>) -> Result<(), Box<dyn std::error::Error>> {
    let text = ("sans-serif", 16).into_font().color(&BLACK);
    let entries = [(24, LOW, "without budgets"), (190, HIGH, "with budgets")];
    for (x, color, name) in entries {
        area.draw(&Circle::new((x, 26), 5, color.filled()))?;
        area.draw(&Text::new(name, (x + 12, 18), text.clone()))?;
    }
    area.draw(&TriangleMarker::new((340, 28), 6, LOW.filled()))?;
    area.draw(&Text::new("had not ended", (352, 18), text.clone()))?;
    for x in [500, 512, 524] {
        area.draw(&PathElement::new([(x, 26), (x + 7, 26)], THEORY))?;
    }
    area.draw(&Text::new("deadline", (538, 18), text.clone()))?;
    let what = "response time of a control loop, 2 ms of CPU every 10 ms";
    area.draw(&Text::new(what, (660, 18), text))?;
    Ok(())
}

fn draw_panel(
    panel: &Area<'_>,
    disturbance: Disturbance,
    cases: &[Case],
    tips: &mut Tips,
) -> Result<(), Box<dyn std::error::Error>> {
    let ms = |t: Nanos| t as f64 / MS as f64;
    let mut chart = ChartBuilder::on(panel)
        .caption(disturbance.title(), ("sans-serif", 17, &BLACK))
        .margin(8)
        .margin_right(16)
        .x_label_area_size(38)
        .y_label_area_size(54)
        .build_cartesian_2d(0.0..ms(WINDOW), RANGE.log_scale())?;
    chart
        .configure_mesh()
        .x_desc("release, ms")
        .y_desc("response, ms")
        .x_labels(6)
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| format!("{y:.0}"))
        .label_style(("sans-serif", 13, &INK))
        .axis_desc_style(("sans-serif", 13, &INK))
        .axis_style(INK)
        .bold_line_style(GRID)
        .light_line_style(TRANSPARENT)
        .draw()?;
    if disturbance != Disturbance::None {
        let from = [(ms(CALM), RANGE.end), (ms(WINDOW), RANGE.start)];
        let shade = Rectangle::new(from, RGBColor(0xd9, 0x7a, 0x1e).mix(0.07).filled());
        chart.draw_series(std::iter::once(shade))?;
    }
    for (budgets, color) in [(false, LOW), (true, HIGH)] {
        let of = cases
            .iter()
            .filter(|c| c.disturbance == disturbance && c.budgets == budgets);
        let points: Vec<_> = of
            .flat_map(|c| &c.responses)
            .map(|r| {
                let at = (ms(r.release), ms(r.took).clamp(RANGE.start, RANGE.end));
                (at, r.ended)
            })
            .collect();
        for ((release, took), ended) in &points {
            let mark = chart.backend_coord(&(*release, *took));
            let end = if *ended { "" } else { ", not ended" };
            let with = if budgets { "with" } else { "without" };
            let text = format!("{with} budgets: {took:.2} ms, released at {release:.0} ms{end}");
            tips.point(mark, &text);
        }
        let ended = points.iter().filter(|p| p.1);
        chart.draw_series(ended.map(|p| Circle::new(p.0, 3, color.mix(0.7).filled())))?;
        let open = points.iter().filter(|p| !p.1);
        chart.draw_series(open.map(|p| TriangleMarker::new(p.0, 5, color.mix(0.7).filled())))?;
    }
    let deadline = [(0.0, ms(PERIOD)), (ms(WINDOW), ms(PERIOD))];
    chart.draw_series(DashedLineSeries::new(
        deadline,
        7,
        5,
        THEORY.stroke_width(1),
    ))?;
    Ok(())
}
