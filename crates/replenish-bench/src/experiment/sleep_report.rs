//! The report of Experiment 2: table, JSON, CSV, the figure in the shape of the paper's, the page.

use super::deviation::{self, Deviation};
use super::output::{self, Files};
use crate::load::simulated::Costs;
use crate::report::figure::{self, Figure, HIGH, INK, LOW, Series, Style, THEORY};
use crate::roles::protocol::Mode;
use crate::testbench::orchestrator::Run;
use crate::testbench::summary::{PerWindow, round};
use crate::testbench::windows::Repeated;
use replenish_cli::outcome::Outcome;
use replenish_cli::report::html::Page;
use replenish_cli::report::table::{Table, count, percent};

/// The columns of the CSV: names of the JSON.
const COLUMNS: [&str; 21] = [
    "sleep_percent",
    "high_cpu_percent",
    "theory_percent",
    "high_priority_cpu_percent",
    "background_cpu_percent",
    "high_answered",
    "expected_high",
    "simulated_high_answered",
    "low_answered",
    "simulated_low_answered",
    "simulated_difference_per_window",
    "simulated_worst_difference",
    "windows",
    "windows_repeated",
    "windows_disturbed",
    "to_be_had_percent",
    "dispatcher_cpu_percent",
    "enforcer_cpu_percent",
    "stolen_percent",
    "idle_percent",
    "others_percent",
];

/// The budget of the high worker, in percent.
const BUDGET: f64 = 30.0;

/// One point of Experiment 2. The first three names are a contract.
#[derive(Debug, Clone, serde::Serialize)]
pub(crate) struct SleepPoint {
    sleep_percent: u8,
    high_cpu_percent: f64,
    theory_percent: f64,
    low_cpu_percent: f64,
    high_answered: u64,
    low_answered: u64,
    expected_high: u64,
    /// Answers that the simulator gives for these windows.
    simulated_high_answered: Option<u64>,
    simulated_low_answered: Option<u64>,
    /// Difference of measured and simulated counts per window, for the topic that is worse.
    simulated_difference_per_window: Option<f64>,
    /// The largest difference of one topic in one window.
    simulated_worst_difference: Option<u64>,
    #[serde(skip)]
    deviation: Option<Deviation>,
    high_priority_cpu_percent: f64,
    background_cpu_percent: f64,
    /// The theory for what was there: without what the next ones but idle time took.
    to_be_had_percent: f64,
    dispatcher_cpu_percent: f64,
    enforcer_cpu_percent: f64,
    stolen_percent: f64,
    idle_percent: f64,
    /// Interrupts and other programs.
    others_percent: f64,
    windows: u64,
    /// Costs of this machine, measured in this run, that the simulator was given.
    simulated_with_ns: Costs,
    windows_repeated: u64,
    windows_repeated_because: Repeated,
    windows_disturbed: u64,
    per_window: Vec<PerWindow>,
    mode: Mode,
}

impl SleepPoint {
    /// The point of one run.
    pub(crate) fn new(sleep_percent: u8, run: &Run) -> Self {
        let s = &run.summary;
        let deviation = Deviation::of(s);
        Self {
            sleep_percent,
            high_cpu_percent: s.high.cpu_percent,
            theory_percent: s.high.expected_cpu_percent,
            low_cpu_percent: s.low.cpu_percent,
            high_answered: s.high.answered,
            low_answered: s.low.answered,
            expected_high: s.high.expected,
            simulated_high_answered: s.high.simulated,
            simulated_low_answered: s.low.simulated,
            simulated_difference_per_window: deviation.map(|a| a.per_window),
            simulated_worst_difference: deviation.map(|a| a.worst_window),
            deviation,
            high_priority_cpu_percent: s.high.high_priority_cpu_percent,
            background_cpu_percent: s.high.background_cpu_percent,
            to_be_had_percent: s.to_be_had_percent(BUDGET),
            dispatcher_cpu_percent: round(s.support_cpu_percent - s.enforcer_cpu_percent),
            enforcer_cpu_percent: s.enforcer_cpu_percent,
            stolen_percent: s.stolen_percent,
            idle_percent: s.idle_percent,
            others_percent: s.others_percent(),
            simulated_with_ns: run.end.costs,
            windows: s.windows,
            windows_repeated: s.windows_repeated,
            windows_repeated_because: s.windows_repeated_because,
            windows_disturbed: s.windows_disturbed,
            per_window: s.per_window.clone(),
            mode: run.mode,
        }
    }

    fn row(&self) -> [String; 12] {
        [
            self.sleep_percent.to_string(),
            percent(self.high_cpu_percent),
            percent(self.theory_percent),
            percent(self.high_priority_cpu_percent),
            percent(self.background_cpu_percent),
            self.high_answered.to_string(),
            self.expected_high.to_string(),
            count(self.simulated_high_answered),
            self.low_answered.to_string(),
            count(self.simulated_low_answered),
            self.deviation
                .map_or_else(|| "-".to_string(), |a| format!("{:.1}", a.per_window)),
            self.windows_repeated.to_string(),
        ]
    }
}

/// Writes and prints Experiment 2.
pub(super) fn sleep(to: &Files, points: &[SleepPoint]) -> Outcome {
    let mut table = Table::new(&[
        "low sleeps %",
        "high CPU",
        "theory",
        "at its priority",
        "in background",
        "high answered",
        "theory",
        "simulated",
        "low answered",
        "simulated",
        "off per window",
        "repeated",
    ]);
    for p in points {
        table.row(p.row());
    }
    println!("{}", table.to_text());
    println!("{}", missing(points).to_text());
    let agreement = deviation::agreement(points.iter().map(|p| p.deviation));
    println!("{agreement}");
    let told = points
        .iter()
        .map(|p| (p.windows_repeated_because, p.windows_disturbed));
    output::tell_repeated(told);
    output::warn(points.iter().any(|p| p.mode == Mode::Deferred));

    let json = serde_json::json!({
        "experiment": "work-conserving",
        "budget_ms": 30,
        "period_ms": 100,
        "points": points,
    });
    let svg = figure(points).to_svg()?;
    let mut page = Page::new(
        "Experiment 2: what nobody else uses goes to the background",
        &to.source("work-conserving"),
    );
    page.text(
        "The worker of topic high has 30 ms per 100 ms at high priority and goes on in the \
         background when they are used up. The callback of topic low sleeps for a part of its \
         10 ms. Theory: high gets 30 % and all that low sleeps, 30 + 70 x percent.",
    );
    page.answer(&agreement);
    page.figure(
        &svg,
        "CPU time of the high worker. Marks: measured. Dashed: theory.",
    );
    page.table(&table);
    output::write(
        to,
        "experiment-work-conserving",
        &output::csv(&COLUMNS, &json),
        &json,
        &svg,
        page,
    )
}

/// Shares of the CPU in each point: the high worker's, the largest that it could have had, and
/// everything else.
fn missing(points: &[SleepPoint]) -> Table {
    let mut table = Table::new(&[
        "low sleeps %",
        "high CPU",
        "to be had",
        "low CPU",
        "dispatcher",
        "enforcer",
        "stolen",
        "idle",
        "interrupts, others",
    ]);
    for p in points {
        table.row([
            p.sleep_percent.to_string(),
            percent(p.high_cpu_percent),
            percent(p.to_be_had_percent),
            percent(p.low_cpu_percent),
            percent(p.dispatcher_cpu_percent),
            percent(p.enforcer_cpu_percent),
            percent(p.stolen_percent),
            percent(p.idle_percent),
            percent(p.others_percent),
        ]);
    }
    table
}

fn figure(points: &[SleepPoint]) -> Figure {
    let line = |y: fn(&SleepPoint) -> f64| -> Vec<(f64, f64)> {
        figure::line(points.iter().map(|p| (f64::from(p.sleep_percent), y(p))))
    };
    Figure {
        title: "Work conserving nature of the sporadic scheduler".into(),
        x_label: "time that the low callback sleeps, %".into(),
        y_label: "CPU time, % of the windows".into(),
        x_max: 100.0,
        series: vec![
            Series::new(
                "high, measured",
                HIGH,
                Style::Measured,
                line(|p| p.high_cpu_percent),
            ),
            Series::new(
                "high, theory: 30 + 70 x",
                THEORY,
                Style::Theory,
                line(|p| p.theory_percent),
            ),
            Series::new(
                "high within its budget, measured",
                INK,
                Style::Reference,
                line(|p| p.high_priority_cpu_percent),
            ),
            Series::new(
                "low, measured",
                LOW,
                Style::Measured,
                line(|p| p.low_cpu_percent),
            ),
        ],
    }
}
