//! `replenish experiment nuttx-history`: why the paper's budgets held for one thread only.
//!
//! No real time here: the measurements that the paper's authors published are replayed by
//! [`crate::nuttx::history`], once with the two bugs that their kernel had and once without.

use super::history_figure;
use super::history_row::HistoryRow;
use super::output::{self, Files};
use crate::nuttx::history::{self, Bugs};
use replenish_cli::outcome::Outcome;
use replenish_cli::report::files;
use replenish_cli::report::html::Page;
use replenish_cli::report::table::Table;

/// A row counts as reproduced if no thread differs by more, in ms of 10 000.
const CLOSE: u64 = 10;

/// Options of `experiment nuttx-history`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    files: Files,
}

/// Runs it: about a second.
pub(crate) fn run(args: &Args) -> Outcome {
    args.files.check()?;
    eprintln!("replaying 44 measurements twice, every start that is possible …");
    let both = history::replay(Bugs::BOTH);
    let none = history::replay(Bugs::NONE);
    let rows: Vec<_> = both
        .iter()
        .zip(none)
        .map(|(both, none)| HistoryRow::new(both, none))
        .collect();
    report(&args.files, &rows)
}

fn report(to: &Files, rows: &[HistoryRow]) -> Outcome {
    let mut table = Table::new(&[
        "experiment",
        "budget ms",
        "measured, ms of CPU",
        "simulated, both bugs",
        "off by ms",
        "simulated, no bugs",
        "off by ms",
    ]);
    for row in rows {
        table.row(row.cells());
    }
    let close =
        |difference: fn(&HistoryRow) -> u64| rows.iter().filter(|r| difference(r) <= CLOSE).count();
    let with = close(|r| r.worst_difference_ms);
    let without = close(|r| r.without_bugs_worst_difference_ms);
    let all = rows.len();
    let verdict = format!(
        "With the two bugs that the paper's kernel had, {with} of {all} measurements come out \
         within {CLOSE} ms of 10 000; without them, {without}."
    );
    println!("{}", table.to_text());
    println!("{verdict}");
    println!("Threads: S1 / S2 (not in experiment 1) / FIFO. docs/nuttx-history.md explains it.");

    let json = serde_json::json!({
        "experiment": "nuttx-history",
        "rows": rows,
        "close_ms": CLOSE,
        "rows_close_with_bugs": with,
        "rows_close_without_bugs": without,
    });
    let svg = history_figure::draw(rows)?;
    let mut page = Page::new(
        "The paper's open question: why did budgets hold for one thread only?",
        "Measured in 2018-21 by the paper's authors on an Olimex STM32 board (apache/nuttx issue \
         2935); simulated by `replenish experiment nuttx-history`.",
    );
    page.answer(&verdict);
    page.text(
        "Busy threads share a CPU for 10 s: S1 and S2 under NuttX's SCHED_SPORADIC with budgets per \
         100 ms, and a FIFO thread between their high and low priorities. In experiment 1 the budget \
         of S1 varies and there is no S2. In 2, S1 varies and S2 has 30 ms; in 3 the other way \
         round; in 4 both have the same priorities.",
    );
    page.figure(
        &svg,
        "CPU time of each thread over the budget that was varied. Circles: measured. Lines: \
         simulated. Upper row: NuttX's algorithm with the two bugs of the paper's kernel. Lower row: \
         the same algorithm without them.",
    );
    page.text(
        "The bugs: the list of ready threads was not kept sorted when a waiting thread changed its \
         priority (fixed in NuttX 9.0), and a subtraction was reversed where unused budget is \
         credited (fixed in NuttX 10.1). Free in each row is when the threads were created: 0 to 6 \
         ticks before the measurement began, with and without the bugs alike.",
    );
    page.table(&table);
    output::write(
        to,
        "experiment-nuttx-history",
        &csv(rows),
        &json,
        &svg,
        page,
    )
}

/// One line per row; S2's cells are empty in experiment 1.
fn csv(rows: &[HistoryRow]) -> String {
    let head = ["experiment", "swept_budget_ms"].map(String::from);
    let groups = ["measured", "simulated", "without_bugs"];
    let columns = groups.map(|group| ["s1", "s2", "fifo"].map(|t| format!("{group}_{t}_ms")));
    let head = head.into_iter().chain(columns.into_iter().flatten());
    let lines = rows.iter().map(|row| {
        let mut line = vec![row.experiment.to_string(), row.swept_budget_ms.to_string()];
        for times in [&row.measured_ms, &row.simulated_ms, &row.without_bugs_ms] {
            let mut cells: Vec<String> = times.iter().map(ToString::to_string).collect();
            if cells.len() < 3 {
                cells.insert(1, String::new());
            }
            line.append(&mut cells);
        }
        line
    });
    files::csv(std::iter::once(head.collect()).chain(lines))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn csv_keeps_the_columns_of_a_missing_thread() {
        let row = HistoryRow {
            experiment: 1,
            swept_budget_ms: 30,
            measured_ms: vec![3014, 6896],
            simulated_ms: vec![3015, 6895],
            worst_difference_ms: 1,
            without_bugs_ms: vec![3016, 6894],
            without_bugs_worst_difference_ms: 2,
        };
        let text = csv(&[row]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[1], "1,30,3014,,6896,3015,,6895,3016,,6894");
        assert_eq!(lines[0].split(',').count(), lines[1].split(',').count());
    }
}
