//! The figure of `experiment nuttx-history`: a panel per experiment, with the bugs and without.

use super::history_row::HistoryRow;
use crate::report::figure::{GRID, HIGH, INK, LOW, failed};
use crate::report::picture::{self, Tips};
use plotters::coord::Shift;
use plotters::prelude::*;
use replenish_cli::outcome::Failure;

/// The second sporadic thread.
const SECOND: RGBColor = RGBColor(0x2f, 0x85, 0x5a);
/// Names, colours and what they are, in the order of the columns of experiments 2 to 4.
const THREADS: [(&str, RGBColor); 3] = [("S1", HIGH), ("S2", SECOND), ("FIFO", LOW)];
/// The titles of the panels: the number of each experiment, and the variable.
const TITLES: [&str; 4] = [
    "1: S1 varies, no S2",
    "2: S1 varies, S2 30 ms",
    "3: S1 30 ms, S2 varies",
    "4: as 2, same priority",
];
const SIZE: (u32, u32) = (1120, 660);
const LEGEND: u32 = 40;

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
type Times = fn(&HistoryRow) -> &[u64];

/// Draws the two rows of four panels.
pub(super) fn draw(rows: &[HistoryRow]) -> Result<String, Failure> {
    let (mut svg, mut tips) = (String::new(), Tips::default());
    draw_all((&mut svg, &mut tips), rows).map_err(|e| failed(&*e))?;
    Ok(picture::finished(&svg, &tips))
}

fn draw_all(
    (svg, tips): (&mut String, &mut Tips),
    rows: &[HistoryRow],
) -> Result<(), Box<dyn std::error::Error>> {
    let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    root.fill(&WHITE)?;
    let (legend, body) = root.split_vertically(LEGEND);
    draw_legend(&legend)?;
    let (upper, lower) = body.split_vertically((SIZE.1 - LEGEND) / 2);
    let halves: [(Area<'_>, &str, Times); 2] = [
        (upper, "with the two bugs of the paper's kernel", |r| {
            &r.simulated_ms
        }),
        (lower, "without the bugs", |r| &r.without_bugs_ms),
    ];
    for (half, what, simulated) in halves {
        let half = half.titled(
            &format!("Simulated {what}"),
            ("sans-serif", 17, &BLACK).into_text_style(&root),
        )?;
        for (panel, experiment) in half.split_evenly((1, 4)).iter().zip(1..) {
            draw_panel(panel, experiment, (rows, simulated), tips)?;
        }
    }
    root.present()?;
    Ok(())
}

fn draw_legend(area: &Area<'_>) -> Result<(), Box<dyn std::error::Error>> {
    let text = ("sans-serif", 16).into_font().color(&BLACK);
    let remark = "circles: measured on the board, lines: simulated; ms of CPU in 10 s";
    area.draw(&Text::new(remark, (24, 14), text.clone()))?;
    for (n, (name, color)) in (0..).zip(THREADS) {
        let x = 640 + 90 * n;
        area.draw(&PathElement::new(
            [(x, 22), (x + 26, 22)],
            color.stroke_width(2),
        ))?;
        area.draw(&Circle::new((x + 13, 22), 4, color.filled()))?;
        area.draw(&Text::new(name, (x + 32, 14), text.clone()))?;
    }
    Ok(())
}

fn draw_panel(
    panel: &Area<'_>,
    experiment: u32,
    (rows, simulated): (&[HistoryRow], Times),
    tips: &mut Tips,
) -> Result<(), Box<dyn std::error::Error>> {
    let title = usize::try_from(experiment - 1)
        .ok()
        .and_then(|n| TITLES.get(n))
        .copied()
        .unwrap_or_default();
    let mut chart = ChartBuilder::on(panel)
        .caption(title, ("sans-serif", 15, &INK))
        .margin(6)
        .margin_right(14)
        .x_label_area_size(36)
        .y_label_area_size(50)
        .build_cartesian_2d(0.0..100.0, 0.0..10_400.0)?;
    chart
        .configure_mesh()
        .x_desc("varied budget, ms per 100 ms")
        .x_labels(6)
        .y_labels(6)
        .x_label_formatter(&|x| format!("{x:.0}"))
        .y_label_formatter(&|y| format!("{y:.0}"))
        .label_style(("sans-serif", 13, &INK))
        .axis_desc_style(("sans-serif", 13, &INK))
        .axis_style(INK)
        .bold_line_style(GRID)
        .light_line_style(TRANSPARENT)
        .draw()?;
    let rows: Vec<_> = rows.iter().filter(|r| r.experiment == experiment).collect();
    for (n, (name, color)) in THREADS.into_iter().enumerate() {
        // Without S2 the FIFO thread is the second column.
        let column = |times: &[u64]| match (times.len(), n) {
            (2, 1) => None,
            (2, 2) => times.get(1).copied(),
            _ => times.get(n).copied(),
        };
        let points = |times: Times| -> Vec<(f64, f64)> {
            let point = |r: &&HistoryRow| {
                let y = column(times(r))?;
                Some((f64::from(r.swept_budget_ms), y as f64))
            };
            rows.iter().filter_map(point).collect()
        };
        chart.draw_series(LineSeries::new(points(simulated), color.stroke_width(2)))?;
        let marks = points(|r| &r.measured_ms);
        for (x, y) in &marks {
            let text = format!("{name}: {y} ms measured at a budget of {x} ms");
            tips.point(chart.backend_coord(&(*x, *y)), &text);
        }
        chart.draw_series(
            marks
                .into_iter()
                .map(|p| Circle::new(p, 4, color.mix(0.75).filled())),
        )?;
    }
    Ok(())
}
