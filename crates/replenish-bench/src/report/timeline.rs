//! Two figures of a run: who had the CPU in one window, and the shares of every window.

use super::figure::{self, GRID, HIGH, INK, LOW};
use super::picture::{self, LEGEND, Sign, Tips};
use crate::load::Nanos;
use crate::load::grid::Grid;
use crate::testbench::summary::as_f64;
use crate::testbench::windows::Window;
use plotters::prelude::*;
use replenish_cli::outcome::Failure;

/// A light shade of the high worker's colour: its background priority.
const BACKGROUND: RGBColor = RGBColor(0xa9, 0xc6, 0xe6);

/// Ends of periods.
const MARK: RGBColor = RGBColor(0x7b, 0x87, 0x94);

/// Draws when each worker had the CPU in `window`; `period` draws the ends of the periods.
pub(crate) fn one_window(window: &Window, grid: &Grid, period: Nanos) -> Result<String, Failure> {
    let (mut svg, mut tips) = (String::new(), Tips::default());
    let drawn = draw_window((&mut svg, &mut tips), window, grid, period);
    drawn.map_err(|e| figure::failed(&*e))?;
    Ok(picture::finished(&svg, &tips))
}

fn draw_window(
    (svg, tips): (&mut String, &mut Tips),
    window: &Window,
    grid: &Grid,
    period: Nanos,
) -> Result<(), Box<dyn std::error::Error>> {
    let ms = |t: Nanos| as_f64(t) / 1e6;
    let root = SVGBackend::with_string(svg, (860, 210)).into_drawing_area();
    root.fill(&WHITE)?;
    let mut chart = ChartBuilder::on(&root)
        .margin(14)
        .x_label_area_size(44)
        .y_label_area_size(62)
        .build_cartesian_2d(0.0..ms(grid.window), 0.0..2.0)?;
    chart
        .configure_mesh()
        .disable_mesh()
        .x_desc("time in the window, ms")
        .x_labels(11)
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_labels(0)
        .label_style(("sans-serif", 15, &INK))
        .axis_desc_style(("sans-serif", 17, &BLACK))
        .axis_style(INK)
        .draw()?;
    let mut t = period.max(1);
    while t < grid.window {
        chart.draw_series(std::iter::once(PathElement::new(
            [(ms(t), 0.0), (ms(t), 2.0)],
            MARK,
        )))?;
        t += period.max(1);
    }
    let rows = [
        ("high", &window.pong.high_slices, 1.0, HIGH),
        ("low", &window.pong.low_slices, 0.0, LOW),
    ];
    for (name, slices, row, color) in rows {
        for (from, to) in slices {
            let upper_left = chart.backend_coord(&(ms(*from), row + 0.85));
            let (x, y) = chart.backend_coord(&(ms(*to), row + 0.15));
            let lower_right = (x.max(upper_left.0 + 1), y); // a bar without width is not drawn
            root.draw(&Rectangle::new([upper_left, lower_right], color.filled()))?;
            let text = format!("{name}: {:.2} to {:.2} ms", ms(*from), ms(*to));
            tips.area(upper_left, lower_right, &text);
        }
    }
    for (name, row) in [("high", 1.5), ("low", 0.5)] {
        let (x, y) = chart.backend_coord(&(0.0, row));
        let style = ("sans-serif", 15).into_font().color(&BLACK);
        root.draw(&Text::new(name, (x - 44, y - 8), style))?;
    }
    root.present()?;
    Ok(())
}

/// Draws the CPU shares of every window as stacked bars, with a line at the budget's share.
pub(crate) fn shares(
    windows: &[Window],
    grid: &Grid,
    budget_percent: Option<f64>,
) -> Result<String, Failure> {
    let (mut svg, mut tips) = (String::new(), Tips::default());
    let drawn = draw_shares((&mut svg, &mut tips), windows, grid, budget_percent);
    drawn.map_err(|e| figure::failed(&*e))?;
    Ok(picture::finished(&svg, &tips))
}

fn draw_shares(
    (svg, tips): (&mut String, &mut Tips),
    windows: &[Window],
    grid: &Grid,
    budget_percent: Option<f64>,
) -> Result<(), Box<dyn std::error::Error>> {
    let percent = |t: Nanos| as_f64(t) * 100.0 / as_f64(grid.window.max(1));
    let count = windows.len().max(1) as f64;
    let root = SVGBackend::with_string(svg, (1000, 360)).into_drawing_area();
    root.fill(&WHITE)?;
    let (plot, beside) = root.split_horizontally(1000 - LEGEND);
    let mut chart = ChartBuilder::on(&plot)
        .margin(14)
        .x_label_area_size(44)
        .y_label_area_size(62)
        .build_cartesian_2d(0.0..count, 0.0..104.0)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .x_desc("window")
        .y_desc("CPU time, % of the window")
        .x_labels(11)
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| format!("{y:.0}"))
        .label_style(("sans-serif", 15, &INK))
        .axis_desc_style(("sans-serif", 17, &BLACK))
        .axis_style(INK)
        .bold_line_style(GRID)
        .light_line_style(TRANSPARENT)
        .draw()?;
    type Part = (
        &'static str,
        RGBColor,
        fn(&Window) -> Nanos,
        fn(&Window) -> Nanos,
    );
    let parts: [Part; 3] = [
        (
            "high, within its budget (measured)",
            HIGH,
            |_| 0,
            |w| w.pong.high.cpu_high,
        ),
        ("low (measured)", LOW, |w| w.pong.high.cpu_high, low),
        (
            "high, in the background (measured)",
            BACKGROUND,
            |w| w.pong.high.cpu_high + low(w),
            |w| w.pong.high.cpu_low,
        ),
    ];
    let mut lines = Vec::new();
    for (label, color, from, length) in parts {
        let bars = windows.iter().enumerate().map(|(n, w)| {
            let (x, y) = (n as f64, percent(from(w)));
            let corner = (x + 0.88, y + percent(length(w)));
            Rectangle::new([(x + 0.12, y), corner], color.filled())
        });
        chart.draw_series(bars)?;
        lines.push((Sign::Box, color, label.to_string()));
    }
    for (n, w) in windows.iter().enumerate() {
        let x = n as f64;
        let said = parts.map(|(label, _, _, length)| {
            let label = label.trim_end_matches(" (measured)");
            format!("{label} {:.1} %", percent(length(w)))
        });
        let text = format!("window {n}: {}", said.join("; "));
        let corners = [(x + 0.12, 0.0), (x + 0.88, 100.0)].map(|at| chart.backend_coord(&at));
        tips.area(corners[0], corners[1], &text);
    }
    if let Some(b) = budget_percent {
        let line = DashedLineSeries::new([(0.0, b), (count, b)], 7, 5, BLACK.stroke_width(1));
        chart.draw_series(line)?;
        let label = format!("the budget, {b:.0} % (theory)");
        lines.push((Sign::Dashes, BLACK, label));
    }
    picture::legend(&beside, &lines)?;
    root.present()?;
    Ok(())
}

/// CPU time of the low worker at any priority.
fn low(w: &Window) -> Nanos {
    w.pong.low.cpu_high + w.pong.low.cpu_low
}
