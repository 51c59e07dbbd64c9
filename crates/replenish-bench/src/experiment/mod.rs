//! `replenish experiment …`: the paper's two experiments, its open question, what budgets protect
//! from, and the files that these write.

mod budget_sweep;
mod history_figure;
mod isolation;
mod nuttx_history;
mod sleep_report;
mod sweep_report;
mod work_conserving;

use crate::testbench::summary::{Summary, Topic, round};
use crate::testbench::windows::Repeated;
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::Outcome;
use replenish_cli::report::files;
use replenish_cli::report::html::Page;
use std::path::PathBuf;

/// An experiment with its options.
#[derive(Debug, clap::Subcommand)]
pub(crate) enum Experiment {
    /// Experiment 1: answers over the budget, and both workers under plain FIFO
    BudgetSweep(budget_sweep::Args),
    /// Experiment 2: the low worker sleeps; the high one uses what is left in the background
    WorkConserving(work_conserving::Args),
    /// What a neighbour, a runaway callback and a flood do to a control loop, without and with budgets
    Isolation(isolation::Args),
    /// The paper's open question: its measurements on NuttX, replayed with and without two bugs
    NuttxHistory(nuttx_history::Args),
}

/// Runs it.
pub(crate) fn run(which: Experiment) -> Outcome {
    match which {
        Experiment::BudgetSweep(args) => budget_sweep::run(&args),
        Experiment::WorkConserving(args) => work_conserving::run(&args),
        Experiment::Isolation(args) => isolation::run(&args),
        Experiment::NuttxHistory(args) => nuttx_history::run(&args),
    }
}

/// Where results go.
#[derive(Debug, clap::Args)]
struct Files {
    #[command(flatten)]
    json: JsonOption,

    /// Also write the points as CSV
    #[arg(long, value_name = "PATH")]
    csv: Option<PathBuf>,

    /// Also write the figure as SVG
    #[arg(long, value_name = "PATH")]
    svg: Option<PathBuf>,

    /// Also write a page with figure, table and explanation
    #[arg(long, value_name = "PATH")]
    html: Option<PathBuf>,

    /// Report what was measured on a board instead of measuring; `cargo xtask board` writes the file
    #[arg(long, value_name = "PATH", hide = true)]
    measured: Option<PathBuf>,
}

impl Files {
    /// Where the numbers of experiment `name` come from, in one sentence.
    fn source(&self, name: &str) -> String {
        if self.measured.is_some() {
            format!("Measured on an emulated board by `cargo xtask board experiment {name}`.")
        } else {
            format!("Measured on this machine by `replenish experiment {name}`.")
        }
    }

    /// Fails early on a file that cannot be written.
    fn check(&self) -> Outcome {
        for path in [&self.json.json, &self.csv, &self.svg, &self.html] {
            files::check_writable(path.as_deref())?;
        }
        Ok(())
    }
}

fn warn(deferred: bool) {
    if deferred {
        println!(
            "Without real-time priority: budgets were held at callback boundaries only; \
             `replenish doctor` says how to get it."
        );
    }
}

/// Says why windows were repeated, and which count although they should not; per point.
fn tell_repeated(points: impl Iterator<Item = (Repeated, u64)>) {
    let (mut all, mut disturbed) = (Repeated::default(), 0);
    for (repeated, still) in points {
        all.add(&repeated);
        disturbed += still;
    }
    if all.total() > 0 {
        println!("Repeated, because the machine stood still: {all}.");
    }
    if disturbed > 0 {
        println!(
            "{disturbed} windows count although the machine stood still: no repeats were left."
        );
    }
}

/// How far simulated and measured counts of one point are apart.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Apart {
    /// The counts of the topic that is worse, over all windows, divided by the windows.
    per_window: f64,
    /// One topic in one window, at worst.
    worst_window: u64,
}

impl Apart {
    /// `None` where nothing was simulated.
    fn of(summary: &Summary) -> Option<Self> {
        let of = |topic: &Topic| Some(topic.answered.abs_diff(topic.simulated?));
        let total = of(&summary.high)?.max(of(&summary.low)?);
        Some(Self {
            per_window: round(total as f64 / summary.windows.max(1) as f64),
            worst_window: summary.simulated_worst_difference?,
        })
    }
}

/// How well simulation and measurement agree, in one sentence, for all points of an experiment.
fn agreement(points: impl Iterator<Item = Option<Apart>>) -> String {
    let points: Vec<Apart> = points.flatten().collect();
    if points.is_empty() {
        return "Nothing was simulated.".into();
    }
    let worst = points.into_iter().fold(Apart::default(), |a, b| Apart {
        per_window: a.per_window.max(b.per_window),
        worst_window: a.worst_window.max(b.worst_window),
    });
    let verdict = if worst.per_window <= 1.0 {
        "agree within 1 answer"
    } else {
        "DIFFER by more than 1 answer"
    };
    format!(
        "Simulated and measured counts {verdict} per window: at worst {:.1} per window at one \
         point, {} in one window.",
        worst.per_window, worst.worst_window
    )
}

/// Writes the files that were asked for.
fn write(to: &Files, csv: &str, json: &serde_json::Value, svg: &str, page: Page) -> Outcome {
    files::write_json(to.json.json.as_deref(), json)?;
    if let Some(path) = &to.csv {
        files::write(path, csv)?;
    }
    if let Some(path) = &to.svg {
        files::write(path, svg)?;
    }
    if let Some(path) = &to.html {
        let footer = format!("replenish {}", env!("CARGO_PKG_VERSION"));
        files::write(path, &page.finish(&footer))?;
    }
    for path in [&to.json.json, &to.csv, &to.svg, &to.html]
        .into_iter()
        .flatten()
    {
        println!("wrote {}", path.display());
    }
    Ok(())
}

/// The points as CSV, the FIFO case last; cells without a value are empty.
fn csv(columns: &[&str], json: &serde_json::Value) -> String {
    let points = json["points"].as_array().into_iter().flatten();
    let cell = |point: &serde_json::Value, column: &str| match &point[column] {
        serde_json::Value::Null => String::new(),
        value => value.to_string(),
    };
    let head: Vec<String> = columns.iter().map(ToString::to_string).collect();
    let rows = points
        .chain(json.get("fifo").filter(|f| f.is_object()))
        .map(|p| columns.iter().map(|c| cell(p, c)).collect());
    files::csv(std::iter::once(head).chain(rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agreement_is_judged_by_point_and_tells_the_worst_window() {
        let summary = |answered, simulated, worst| Summary {
            high: Topic {
                answered,
                simulated,
                ..Topic::default()
            },
            low: Topic {
                simulated: Some(0),
                ..Topic::default()
            },
            windows: 10,
            simulated_worst_difference: worst,
            ..Summary::default()
        };
        let near = Apart::of(&summary(300, Some(310), Some(3)));
        let far = Apart::of(&summary(300, Some(289), Some(2)));
        let none = Apart::of(&summary(300, None, None));
        assert_eq!(none, None);
        let text = agreement([near, none].into_iter());
        assert!(
            text.contains("agree") && text.contains("1.0 per window"),
            "{text}"
        );
        assert!(text.contains("3 in one window"), "{text}");
        let text = agreement([near, far].into_iter());
        assert!(
            text.contains("DIFFER") && text.contains("1.1 per"),
            "{text}"
        );
    }

    #[test]
    fn csv_has_raw_numbers_and_the_fifo_case_last() {
        let json = serde_json::json!({
            "points": [{"budget_ms": 10, "sent": 400}, {"budget_ms": 20, "sent": 401}],
            "fifo": {"budget_ms": null, "sent": 402},
        });
        assert_eq!(
            csv(&["budget_ms", "sent"], &json),
            "budget_ms,sent\n10,400\n20,401\n,402\n"
        );
        let json = serde_json::json!({ "points": [], "fifo": null });
        assert_eq!(csv(&["a"], &json), "a\n");
    }
}
