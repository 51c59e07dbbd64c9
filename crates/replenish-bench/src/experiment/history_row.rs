//! One row of the history: measured, simulated with the bugs, simulated without.

use crate::nuttx::history::Row;

/// One row of the result. The first four names are a contract. Threads in the order S1, S2 (not in
/// experiment 1), FIFO; CPU times in ms of 10 s.
#[derive(Debug, Clone, serde::Serialize)]
pub(super) struct HistoryRow {
    /// 1 to 4.
    pub(super) experiment: u32,
    pub(super) swept_budget_ms: u32,
    pub(super) measured_ms: Vec<u64>,
    /// With both bugs.
    pub(super) simulated_ms: Vec<u64>,
    pub(super) worst_difference_ms: u64,
    /// Without the bugs, with the start that fits best.
    pub(super) without_bugs_ms: Vec<u64>,
    pub(super) without_bugs_worst_difference_ms: u64,
}

impl HistoryRow {
    pub(super) fn new(both: &Row, none: Row) -> Self {
        Self {
            experiment: both.experiment,
            swept_budget_ms: both.swept_budget_ms,
            measured_ms: both.measured_ms.clone(),
            simulated_ms: both.simulated_ms.clone(),
            worst_difference_ms: both.worst_difference(),
            without_bugs_worst_difference_ms: none.worst_difference(),
            without_bugs_ms: none.simulated_ms,
        }
    }

    pub(super) fn cells(&self) -> [String; 7] {
        [
            self.experiment.to_string(),
            self.swept_budget_ms.to_string(),
            join(&self.measured_ms),
            join(&self.simulated_ms),
            self.worst_difference_ms.to_string(),
            join(&self.without_bugs_ms),
            self.without_bugs_worst_difference_ms.to_string(),
        ]
    }
}

fn join(times: &[u64]) -> String {
    let cells: Vec<String> = times.iter().map(ToString::to_string).collect();
    cells.join(" / ")
}
