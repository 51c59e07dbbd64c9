//! The report of Experiment 1: table, JSON, CSV, the figure in the shape of the paper's, the page.

use super::deviation::{self, Deviation};
use super::output::{self, Files};
use crate::load::simulated::Costs;
use crate::report::figure::{self, Figure, HIGH, INK, LOW, Series, Style, THEORY};
use crate::roles::protocol::{Mode, Overrun};
use crate::testbench::orchestrator::Run;
use crate::testbench::summary::PerWindow;
use crate::testbench::windows::Repeated;
use replenish_cli::outcome::Outcome;
use replenish_cli::report::html::Page;
use replenish_cli::report::table::{Table, count, percent, signed_percent};

/// The columns of the CSV: names of the JSON.
const COLUMNS: [&str; 17] = [
    "budget_ms",
    "high_answered",
    "expected_high",
    "simulated_high_answered",
    "low_answered",
    "expected_low",
    "simulated_low_answered",
    "simulated_difference_per_window",
    "simulated_worst_difference",
    "high_cpu_percent",
    "low_cpu_percent",
    "budget_percent",
    "budget_error_percent",
    "sent",
    "windows",
    "windows_repeated",
    "windows_disturbed",
];

/// One budget of Experiment 1. The first seven names are a contract.
#[derive(Debug, Clone, serde::Serialize)]
pub(crate) struct SweepPoint {
    /// Absent for the case of two FIFO workers.
    budget_ms: Option<u64>,
    high_cpu_percent: f64,
    low_cpu_percent: f64,
    high_answered: u64,
    low_answered: u64,
    expected_high: u64,
    expected_low: u64,
    /// Answers that the simulator gives for these windows.
    simulated_high_answered: Option<u64>,
    simulated_low_answered: Option<u64>,
    /// Difference of measured and simulated counts per window, for the topic that is worse.
    simulated_difference_per_window: Option<f64>,
    /// The largest difference of one topic in one window.
    simulated_worst_difference: Option<u64>,
    #[serde(skip)]
    deviation: Option<Deviation>,
    budget_percent: Option<f64>,
    budget_error_percent: Option<f64>,
    high_priority_cpu_percent: f64,
    background_cpu_percent: f64,
    sent: u64,
    windows: u64,
    windows_repeated: u64,
    windows_repeated_because: Repeated,
    windows_disturbed: u64,
    /// Costs of this machine, measured in this run, that the simulator was given.
    simulated_with_ns: Costs,
    overrun_us: Overrun,
    per_window: Vec<PerWindow>,
    mode: Mode,
}

impl SweepPoint {
    /// The point of one run.
    pub(crate) fn new(budget_ms: Option<u64>, period_ms: u64, run: &Run) -> Self {
        let s = &run.summary;
        let deviation = Deviation::of(s);
        Self {
            budget_ms,
            high_cpu_percent: s.high.cpu_percent,
            low_cpu_percent: s.low.cpu_percent,
            high_answered: s.high.answered,
            low_answered: s.low.answered,
            expected_high: s.high.expected,
            expected_low: s.low.expected,
            simulated_high_answered: s.high.simulated,
            simulated_low_answered: s.low.simulated,
            simulated_difference_per_window: deviation.map(|a| a.per_window),
            simulated_worst_difference: deviation.map(|a| a.worst_window),
            deviation,
            budget_percent: budget_ms.map(|b| b as f64 * 100.0 / period_ms as f64),
            budget_error_percent: s.high.budget_error_percent,
            high_priority_cpu_percent: s.high.high_priority_cpu_percent,
            background_cpu_percent: s.high.background_cpu_percent,
            sent: s.high.sent,
            simulated_with_ns: run.end.costs,
            windows: s.windows,
            windows_repeated: s.windows_repeated,
            windows_repeated_because: s.windows_repeated_because,
            windows_disturbed: s.windows_disturbed,
            overrun_us: run.end.overrun_us.clone(),
            per_window: s.per_window.clone(),
            mode: run.mode,
        }
    }

    fn row(&self) -> [String; 12] {
        [
            self.budget_ms
                .map_or_else(|| "FIFO/FIFO".to_string(), |b| b.to_string()),
            self.high_answered.to_string(),
            self.expected_high.to_string(),
            count(self.simulated_high_answered),
            self.low_answered.to_string(),
            self.expected_low.to_string(),
            count(self.simulated_low_answered),
            self.deviation
                .map_or_else(|| "-".to_string(), |a| format!("{:.1}", a.per_window)),
            percent(self.high_cpu_percent),
            percent(self.low_cpu_percent),
            self.budget_error_percent
                .map_or_else(|| "-".to_string(), signed_percent),
            self.windows_repeated.to_string(),
        ]
    }
}

/// Writes and prints Experiment 1.
pub(super) fn sweep(
    to: &Files,
    period: u64,
    points: &[SweepPoint],
    fifo: Option<&SweepPoint>,
) -> Outcome {
    let mut table = Table::new(&[
        "budget ms",
        "high answered",
        "theory",
        "simulated",
        "low answered",
        "theory",
        "simulated",
        "off per window",
        "high CPU",
        "low CPU",
        "budget error",
        "repeated",
    ]);
    for p in points.iter().chain(fifo) {
        table.row(p.row());
    }
    println!("{}", table.to_text());
    let agreement = deviation::agreement(points.iter().chain(fifo).map(|p| p.deviation));
    println!("{agreement}");
    let told = points
        .iter()
        .chain(fifo)
        .map(|p| (p.windows_repeated_because, p.windows_disturbed));
    output::tell_repeated(told);
    output::warn(points.iter().chain(fifo).any(|p| p.mode == Mode::Deferred));

    let json = serde_json::json!({
        "experiment": "budget-sweep",
        "period_ms": period,
        "points": points,
        "fifo": fifo,
    });
    let svg = figure(period, points, fifo).to_svg()?;
    let mut page = Page::new(
        "Experiment 1: FIFO against budgets",
        &to.source("budget-sweep"),
    );
    page.text(&format!(
        "Topics high and low send a message every 10 ms; answering one costs 10 ms of CPU time on \
         one CPU. The worker of high has a budget per {period} ms at high priority, the worker of \
         low runs at a priority in between. Theory: high gets its budget, low gets the rest, so both \
         lines are straight. With two FIFO workers high takes everything."
    ));
    page.answer(&agreement);
    page.figure(
        &svg,
        "Answers that ping received. Marks: measured. Rings: simulated, the same servers in virtual time. Dashed: theory, whole answers per window of load; \
         one less per window is normal for low, whose last answer the end of the window cuts off.",
    );
    page.table(&table);
    output::write(
        to,
        "experiment-budget-sweep",
        &output::csv(&COLUMNS, &json),
        &json,
        &svg,
        page,
    )
}

fn figure(period: u64, points: &[SweepPoint], fifo: Option<&SweepPoint>) -> Figure {
    let line = |y: fn(&SweepPoint) -> u64| -> Vec<(f64, f64)> {
        figure::line(
            points
                .iter()
                .map(|p| (p.budget_ms.unwrap_or(0) as f64, y(p) as f64)),
        )
    };
    let mut all = vec![
        Series::new(
            "high, measured",
            HIGH,
            Style::Measured,
            line(|p| p.high_answered),
        ),
        Series::new(
            "low, measured",
            LOW,
            Style::Measured,
            line(|p| p.low_answered),
        ),
        Series::new("theory", THEORY, Style::Theory, line(|p| p.expected_high)),
        Series::new("", THEORY, Style::Theory, line(|p| p.expected_low)),
    ];
    if points.iter().any(|p| p.deviation.is_some()) {
        all.extend([
            Series::new(
                "simulated",
                INK,
                Style::Simulated,
                line(|p| p.simulated_high_answered.unwrap_or(0)),
            ),
            Series::new(
                "",
                INK,
                Style::Simulated,
                line(|p| p.simulated_low_answered.unwrap_or(0)),
            ),
        ]);
    }
    if let Some(f) = fifo {
        let flat = |y: u64| vec![(0.0, y as f64), (period as f64, y as f64)];
        all.push(Series::new(
            "high, both FIFO, measured",
            HIGH,
            Style::Reference,
            flat(f.high_answered),
        ));
        all.push(Series::new(
            "low, both FIFO, measured",
            LOW,
            Style::Reference,
            flat(f.low_answered),
        ));
    }
    let sent = points.iter().chain(fifo).map(|p| p.sent).max().unwrap_or(0);
    Figure {
        title: "FIFO against sporadic scheduling with varying budgets".into(),
        x_label: format!("budget of the high worker, ms per {period} ms"),
        y_label: format!("pong messages received, of {sent} sent"),
        x_max: period as f64,
        series: all,
    }
}
