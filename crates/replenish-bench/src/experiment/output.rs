//! The files of an experiment's results, and the remarks that go with them.

use crate::testbench::windows::Repeated;
use replenish_cli::options::JsonOption;
use replenish_cli::outcome::Outcome;
use replenish_cli::report::files;
use replenish_cli::report::html::Page;
use std::path::PathBuf;

/// The files that results are written to.
#[derive(Debug, clap::Args)]
pub(super) struct Files {
    #[command(flatten)]
    json: JsonOption,

    /// Also write the points as CSV.
    #[arg(long, value_name = "PATH")]
    csv: Option<PathBuf>,

    /// Also write the figure as SVG.
    #[arg(long, value_name = "PATH")]
    svg: Option<PathBuf>,

    /// Also write a page with figure, table and explanation.
    #[arg(long, value_name = "PATH")]
    html: Option<PathBuf>,

    /// Report what was measured on a board instead of measuring; `cargo xtask board` writes the
    /// file.
    #[arg(long, value_name = "PATH", hide = true)]
    pub(super) measured: Option<PathBuf>,
}

impl Files {
    /// The origin of the numbers of experiment `name`, in one sentence.
    pub(super) fn source(&self, name: &str) -> String {
        if self.measured.is_some() {
            format!("Measured on an emulated board by `cargo xtask board experiment {name}`.")
        } else {
            format!("Measured on this machine by `replenish experiment {name}`.")
        }
    }

    /// Fails early on a file that cannot be written.
    pub(super) fn check(&self) -> Outcome {
        for path in [&self.json.json, &self.csv, &self.svg, &self.html] {
            files::check_writable(path.as_deref())?;
        }
        Ok(())
    }
}

pub(super) fn warn(deferred: bool) {
    if deferred {
        println!(
            "Without real-time priority: budgets were held at callback boundaries only; \
             `replenish doctor` says how to get it."
        );
    }
}

/// Says why windows were repeated, and which count although they should not; per point.
pub(super) fn tell_repeated(points: impl Iterator<Item = (Repeated, u64)>) {
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

/// Writes the files that were asked for.
pub(super) fn write(
    to: &Files,
    document: &str,
    csv: &str,
    json: &serde_json::Value,
    svg: &str,
    page: Page,
) -> Outcome {
    files::write_json(to.json.json.as_deref(), document, json)?;
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
pub(super) fn csv(columns: &[&str], json: &serde_json::Value) -> String {
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
