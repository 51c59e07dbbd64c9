//! `replenish experiment …`: the paper's two experiments, its open question, what budgets protect
//! from, and the files that these write.

pub(super) mod budget_sweep;
mod history_figure;
pub(super) mod isolation;
pub(super) mod nuttx_history;
mod sleep_report;
mod sweep_report;
pub(super) mod work_conserving;

use crate::options::JsonOption;
use crate::outcome::Outcome;
use crate::report::files;
use crate::report::html::Page;
use std::path::PathBuf;

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
}

impl Files {
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

/// How well simulation and measurement agree, in one sentence: the largest differences of one topic
/// in one window, and numbers of windows, of all points.
fn agreement(points: impl Iterator<Item = (Option<u64>, u64)>) -> String {
    let (mut windows, mut worst) = (0, 0);
    for (difference, of) in points {
        windows += of;
        worst = worst.max(difference.unwrap_or(0));
    }
    let verdict = if worst <= 1 {
        "agree within"
    } else {
        "DIFFER by up to"
    };
    let bursts = if worst <= 1 {
        "1 answer".to_string()
    } else {
        format!("{worst} answers")
    };
    format!(
        "Simulated and measured counts {verdict} {bursts} per window and topic ({windows} windows)."
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
