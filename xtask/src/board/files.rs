//! The result files of the experiments with messages. The paper's two are reported by the program
//! `replenish` itself, so that names, keys, CSV, figure and page are those of Linux.

use super::case::{self, BURST_MS, Name};
use super::report;
use super::testbench::Bench;
use crate::output::{Outcome, writable, write};
use serde_json::{Value, json};
use std::path::PathBuf;

/// The files that were asked for.
#[derive(clap::Args, Default)]
pub(crate) struct Files {
    /// Also write the result as JSON.
    #[arg(long, value_name = "PATH")]
    pub(crate) json: Option<PathBuf>,
    /// Also write the points as CSV (budget-sweep, work-conserving).
    #[arg(long, value_name = "PATH")]
    pub(crate) csv: Option<PathBuf>,
    /// Also write the figure as SVG (budget-sweep, work-conserving).
    #[arg(long, value_name = "PATH")]
    pub(crate) svg: Option<PathBuf>,
    /// Also write a page with figure, table and explanation (budget-sweep, work-conserving).
    #[arg(long, value_name = "PATH")]
    pub(crate) html: Option<PathBuf>,
}

impl Files {
    /// The first option for a file that only a figure's points go to.
    pub(crate) fn drawn(&self) -> Option<&'static str> {
        let options = [
            ("--csv", &self.csv),
            ("--svg", &self.svg),
            ("--html", &self.html),
        ];
        let given = options.into_iter().find(|(_, path)| path.is_some());
        given.map(|(option, _)| option)
    }

    /// Fails if one of them cannot be written.
    pub(crate) fn writable(&self) -> Outcome {
        let paths = [&self.json, &self.csv, &self.svg, &self.html];
        paths
            .into_iter()
            .try_for_each(|path| writable(path.as_deref()))
    }

    /// Writes them.
    pub(crate) fn write(
        &self,
        name: Name,
        bench: &Bench,
        points: &[Value],
        length: u64,
    ) -> Outcome {
        if case::is_drawn(name) {
            return self.report(name, bench, points);
        }
        let board =
            "olimex-stm32-h405 in QEMU, FreeRTOS, executor, XRCE over USART2 at 921600 baud";
        let result = json!({
            "experiment": case::label(name),
            "board": board,
            "length_ms": length,
            "burst_ms": BURST_MS,
            "points": points,
        });
        write(self.json.as_deref(), &result)
    }

    /// Hands the numbers to `replenish experiment`.
    fn report(&self, name: Name, bench: &Bench, points: &[Value]) -> Outcome {
        let measured = std::env::temp_dir().join(format!("replenish-board-{}", std::process::id()));
        let points: Vec<Value> = points.iter().map(window).collect();
        write(Some(&measured), &json!({ "points": points }))?;
        let mut command = bench.replenish();
        command.args(["experiment", &case::label(name), "--measured"]);
        command.arg(&measured);
        let files = [
            ("--json", &self.json),
            ("--csv", &self.csv),
            ("--svg", &self.svg),
            ("--html", &self.html),
        ];
        for (option, path) in files {
            if let Some(path) = path {
                command.arg(option).arg(path);
            }
        }
        let status = command.status().map_err(|e| format!("replenish: {e}"))?;
        std::fs::remove_file(&measured).ok();
        if status.success() {
            Ok(())
        } else {
            Err(format!("the report was not written: {status}"))
        }
    }
}

/// A point as `replenish` takes it: one window, as pong and ping saw it. Answers that ping received
/// after the end of the window do not count.
fn window(point: &Value) -> Value {
    let worker = |i: usize| {
        let of = report::workers(point).nth(i);
        let number = |key: &str| of.and_then(|w| w.get(key)?.as_u64()).unwrap_or(0);
        json!({
            "cpu_high": number("cpu_high_ns"),
            "cpu_low": number("cpu_low_ns"),
            "answered": number("answered"),
            "exhaustions": number("exhaustions"),
        })
    };
    let (high, low) = (worker(0), worker(1));
    let length = point.get("length_ms").and_then(Value::as_u64).unwrap_or(0);
    let sent = length.div_ceil(report::INTERVAL_MS);
    // Without a budget: both are FIFO.
    let budget = point.get("budget_ms").filter(|b| b.as_u64() != Some(0));
    json!({
        "budget_ms": budget,
        "sleep_percent": point.get("sleep_percent"),
        "length_ms": length,
        "ping": {
            "index": 0, "sent_high": sent, "sent_low": sent, "late": 0,
            "received_high": high.get("answered"), "received_low": low.get("answered"),
        },
        "pong": {
            "index": 0, "late": 0, "high_slices": [], "low_slices": [],
            "support_cpu": report::support_ns(point),
            "high": high, "low": low,
        },
    })
}
