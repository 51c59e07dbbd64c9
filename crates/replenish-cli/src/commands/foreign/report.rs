//! The figures of threads and budgets: a table, and JSON.

use crate::outcome::Failure;
use crate::report::files;
use crate::report::table::{Table, percent, signed_percent};
use crate::time::Nanos;
use std::path::Path;

/// A thread, or all threads of one name that have ended.
#[derive(Debug, Clone, serde::Serialize)]
pub(super) struct ThreadRow {
    pub(super) name: String,
    pub(super) pid: i32,
    /// Of several, the last one's.
    pub(super) tid: i32,
    /// The number of threads in this row.
    pub(super) count: u64,
    pub(super) policy: String,
    /// The budget, which all threads of one pattern share.
    pub(super) budget_ns: Nanos,
    pub(super) period_ns: Nanos,
    /// CPU time at the budget's priority.
    pub(super) high_ns: Nanos,
    /// CPU time in the background.
    pub(super) background_ns: Nanos,
    /// Times that the budget has run out.
    pub(super) exhaustions: u64,
}

/// A budget.
#[derive(Debug, Clone, serde::Serialize)]
pub(super) struct Share {
    /// The pattern.
    pub(super) name: String,
    /// CPU time at the priority since its first thread, in percent of the time.
    pub(super) percent: f64,
    /// `percent` less the budget's share of its period; negative for threads that need less.
    pub(super) error_percent: f64,
    pub(super) budget_percent: f64,
    pub(super) background_percent: f64,
    pub(super) elapsed_ns: Nanos,
    pub(super) exhaustions: u64,
    /// Whether the kernel's switch records show when its threads wait.
    pub(super) sees_blocking: bool,
}

/// The result of `run` and `adopt`.
#[derive(Debug, Clone, serde::Serialize)]
pub(crate) struct Report {
    /// The time for which budgets were held, in nanoseconds.
    pub(super) elapsed_ns: Nanos,
    /// The CPU of all threads with a budget.
    pub(super) cpu: usize,
    /// CPU time of the enforcer in nanoseconds.
    pub(super) enforcer_ns: Nanos,
    /// The enforcer's wake-ups.
    pub(super) enforcer_wakes: u64,
    /// Threads, those that run and those that have ended; the latter together by name.
    pub(super) threads: Vec<ThreadRow>,
    /// Budgets.
    pub(super) shares: Vec<Share>,
    /// Threads that had changed their policy or CPU.
    pub(super) displaced: u64,
    /// Guardians that were killed and replaced.
    pub(super) guardians_replaced: u64,
    /// Sentences about what did not hold.
    pub(super) notes: Vec<String>,
}

impl Report {
    /// Prints it to standard error, where a program's own output is not disturbed, and writes the
    /// JSON.
    pub(crate) fn finish(&self, json: Option<&Path>) -> Result<(), Failure> {
        let ms = |ns: Nanos| format!("{:.3}", ns as f64 / 1e6);
        let mut table = Table::new(&[
            "thread",
            "tid",
            "policy",
            "budget",
            "at priority ms",
            "background ms",
            "exhausted",
        ]);
        for row in &self.threads {
            let name = match row.count {
                1 => row.name.clone(),
                count => format!("{} ({count}, ended)", row.name),
            };
            table.row([
                name,
                row.tid.to_string(),
                row.policy.clone(),
                format!("{}/{} ms", ms(row.budget_ns), ms(row.period_ns)),
                ms(row.high_ns),
                ms(row.background_ns),
                row.exhaustions.to_string(),
            ]);
        }
        remark!("{}", table.to_text());
        let mut table = Table::new(&["budget of", "allowed", "at priority", "error", "background"]);
        for share in &self.shares {
            table.row([
                share.name.clone(),
                percent(share.budget_percent),
                percent(share.percent),
                signed_percent(share.error_percent),
                percent(share.background_percent),
            ]);
        }
        remark!("{}", table.to_text());
        for note in &self.notes {
            remark!("note: {note}");
        }
        files::write_json(json, "budgets", self)
    }
}
