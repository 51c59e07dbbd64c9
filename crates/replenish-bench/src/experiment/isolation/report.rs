//! The report of the isolation experiment: table, JSON, CSV, the figure, the page.

use super::super::output::{self, Files};
use super::case::Case;
use super::figure;
use super::scenario::{CALM, PERIOD, WINDOW};
use crate::load::{MS, Nanos};
use replenish_cli::outcome::Outcome;
use replenish_cli::report::files;
use replenish_cli::report::html::Page;
use replenish_cli::report::table::Table;

/// One case. The first six names are a contract.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
struct Row {
    name: &'static str,
    budgets: bool,
    releases: usize,
    deadline_ms: f64,
    /// The worst response; for a release that did not end, its age when the window ended.
    worst_ms: f64,
    misses: usize,
    median_ms: f64,
    unfinished: usize,
    messages_sent: u64,
    windows: u64,
    windows_repeated: u64,
    /// Windows that count although the machine stood still.
    windows_stalled: u64,
    mode: &'static str,
}

impl Row {
    fn new(case: &Case) -> Self {
        let mut took: Vec<Nanos> = case.responses.iter().map(|r| r.took).collect();
        took.sort_unstable();
        Self {
            name: case.disturbance.name(),
            budgets: case.budgets,
            releases: case.responses.len(),
            deadline_ms: ms(PERIOD),
            worst_ms: ms(case.worst()),
            misses: case.misses(),
            median_ms: ms(took.get(took.len() / 2).copied().unwrap_or(0)),
            unfinished: case.responses.iter().filter(|r| !r.ended).count(),
            messages_sent: case.sent,
            windows: case.windows,
            windows_repeated: case.windows_repeated,
            windows_stalled: case.windows_stalled,
            mode: if case.deferred {
                "deferred"
            } else {
                "enforced"
            },
        }
    }
}

/// Writes and prints the result.
pub(super) fn write(to: &Files, cases: &[Case]) -> Outcome {
    let rows: Vec<Row> = cases.iter().map(Row::new).collect();
    let mut table = Table::new(&[
        "case",
        "budgets",
        "releases",
        "median response",
        "worst response",
        "deadline",
        "missed",
        "repeated windows",
    ]);
    for row in &rows {
        table.row([
            row.name.to_string(),
            if row.budgets { "yes" } else { "no" }.to_string(),
            row.releases.to_string(),
            format!("{:.2} ms", row.median_ms),
            format!("{:.2} ms", row.worst_ms),
            format!("{:.0} ms", row.deadline_ms),
            row.misses.to_string(),
            row.windows_repeated.to_string(),
        ]);
    }
    let verdict = verdict(&rows);
    println!("{}", table.to_text());
    println!("{verdict}");
    let deferred = cases.iter().any(|c| c.deferred);
    output::warn(deferred);
    let mut fallbacks: Vec<&String> = cases.iter().flat_map(|c| &c.fallbacks).collect();
    fallbacks.sort();
    fallbacks.dedup();
    for fallback in &fallbacks {
        println!("Not guaranteed: {fallback}");
    }

    let json = serde_json::json!({
        "experiment": "isolation",
        "cases": rows,
        "window_ms": ms(WINDOW),
        "disturbed_after_ms": ms(CALM),
        "fallbacks": fallbacks,
    });
    let svg = figure::draw(cases)?;
    let page = page(&table, &svg, &verdict, deferred);
    output::write(to, "experiment-isolation", &csv(cases), &json, &svg, page)
}

fn verdict(rows: &[Row]) -> String {
    let sum = |budgets: bool| -> (usize, usize) {
        let of = rows.iter().filter(|r| r.budgets == budgets);
        of.fold((0, 0), |(misses, all), r| {
            (misses + r.misses, all + r.releases)
        })
    };
    let (without, all_without) = sum(false);
    let (with, all_with) = sum(true);
    format!(
        "Without budgets the control loop missed {without} of {all_without} deadlines, with budgets \
         {with} of {all_with}."
    )
}

fn page(table: &Table, svg: &str, verdict: &str, deferred: bool) -> Page {
    let mut page = Page::new(
        "Isolation: what others can do to a control loop",
        "Measured on this machine by `replenish experiment isolation`.",
    );
    page.answer(verdict);
    if deferred {
        page.warning(
            "Without real-time priority: budgets were held at callback boundaries only. \
             `replenish doctor` says how to get it.",
        );
    }
    page.figure(
        svg,
        "Response times of the control loop, from release to end, over the time of the release. \
         Orange: without budgets. Blue: with budgets. Triangles: releases that had not ended when \
         the window did. The disturbance begins at 100 ms.",
    );
    page.table(table);
    page.text(
        "Three workers share one CPU: a control loop that needs 2 ms every 10 ms, a neighbour with 1 \
         ms every 5 ms, and a subscription that takes 0.1 ms per message, with a message every 5 \
         ms. The two have shorter periods and are therefore more urgent. After 100 ms one of them \
         misbehaves: the neighbour needs 4.8 ms every 5 ms, or its callback does not return, or a \
         sender publishes messages without pause.",
    );
    page.text(
        "Without budgets the workers are FIFO threads. With budgets each has a guarantee (control: \
         100 Hz taking 2.5 ms; neighbour: 1.2 ms every 5 ms; messages: 0.5 ms every 5 ms), and the \
         executor chooses priorities and limits its own thread as well. Windows in which the machine \
         itself stood still for more than 2 ms, as a probe above everything else tells, are repeated.",
    );
    page
}

/// One line per release.
fn csv(cases: &[Case]) -> String {
    let head = ["case", "budgets", "release_ms", "response_ms", "ended"].map(String::from);
    let lines = cases.iter().flat_map(|case| {
        case.responses.iter().map(|r| {
            [
                case.disturbance.name().to_string(),
                case.budgets.to_string(),
                format!("{:.3}", ms(r.release)),
                format!("{:.3}", ms(r.took)),
                r.ended.to_string(),
            ]
        })
    });
    files::csv(std::iter::once(head).chain(lines))
}

fn ms(t: Nanos) -> f64 {
    (t as f64 / MS as f64 * 1e3).round() / 1e3
}
