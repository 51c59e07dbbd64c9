//! `cargo xtask board experiment restart`: the agent is killed while the board answers. When the
//! board has noticed, another one is started on the same line and the same UDP address. Neither the
//! board nor ping gets a notice: both have to log in again and create their endpoints anew.
//!
//! ```text
//!   answers ── "end the agent" ── silence ── link lost ── new agent ── link back ── answers
//! ```
//!
//! From the kill until its link is back the board's clock does not wait for the host, so how long
//! the gap is in its time depends on how fast the host emulates; the measurement is longer by the
//! gap. The assertions do not depend on it: see [`judge`].

use super::case::{self, Worker};
use super::report;
use super::testbench::{Bench, Host, Run, UNANSWERED};
use crate::output::{Outcome, write};
use serde_json::{Value, json};
use std::path::Path;

/// Budget and period of the high worker in ms.
const BUDGET: (u64, u64) = (30, 100);

/// Runs it for `seconds` of the board's time; the agent ends after a fifth of it.
pub(crate) fn run(seconds: u64, path: Option<&Path>) -> Outcome {
    let bench = Bench::build("pong")?;
    let workers = case::pair(BUDGET.0, BUDGET.1);
    let length = seconds * 1_000;
    let mut words = vec![length.to_string()];
    words.extend(workers.iter().map(Worker::word));
    words.push(format!("restart={}", length / 5));
    // The board's time runs ahead while a loaded host starts the second agent: then that is lost
    // as well.
    let once = |run: &Run| report::number(&run.board, "link_lost") == 1.0;
    let run = bench.run_until(&words, Host::default(), once)?;
    let board = &run.board;
    println!("topic   answers   until the kill   after the return   refused   CPU within budget");
    for worker in report::workers(board) {
        let number = |key| report::number(worker, key);
        println!(
            "{:<7} {:>7} {:>16} {:>18} {:>9}   {:.2} ms",
            worker.get("name").and_then(Value::as_str).unwrap_or(""),
            number("answered"),
            number("answered_before_end"),
            number("answered") - number("answered_until_back"),
            number("failed"),
            number("cpu_high_ns") / 1e6,
        );
    }
    let top = |key| report::number(board, key);
    println!(
        "the link was lost {} and came back {} time(s); ticks not sent: {}, not answered: {}; ping received {} of {} answers",
        top("link_lost"),
        top("link_back"),
        top("ticks_unsent"),
        board.pointer(UNANSWERED).unwrap_or(&json!(0)),
        received(&run),
        answered(board),
    );
    println!(
        "from the kill to the first new answers: {} ms of the board's time",
        top("gap_ms")
    );
    let wrong = judge(&run);
    let result = json!({
        "experiment": "restart",
        "length_ms": length,
        "killed_at_ms": length / 5,
        "gap_ms": board.get("gap_ms"),
        "link_lost": board.get("link_lost"),
        "link_back": board.get("link_back"),
        "board": board,
        "ping": run.ping,
        "off": wrong,
    });
    write(path, &result)?;
    if wrong.is_empty() {
        println!("The session came back, and budgets held.");
        Ok(())
    } else {
        Err(wrong.join("\n"))
    }
}

/// Checks the counts of a run in which the host was fast enough to lose one agent only.
fn judge(run: &Run) -> Vec<String> {
    let mut wrong = Vec::new();
    let mut hold = |what: bool, why: String| {
        if !what {
            wrong.push(why);
        }
    };
    let top = |key| report::number(&run.board, key);
    for key in ["link_lost", "link_back"] {
        hold(top(key) == 1.0, format!("{key} is {}, must be 1", top(key)));
    }
    let refused = top("heap_refused");
    hold(
        refused == 0.0,
        format!("{refused} allocations were refused"),
    );
    let mut after = 0.0;
    for worker in report::workers(&run.board) {
        let number = |key| report::number(worker, key);
        let name = worker.get("name").and_then(Value::as_str).unwrap_or("");
        let back = number("answered") - number("answered_until_back");
        after += back;
        hold(
            number("answered_before_end") > 0.0,
            format!("{name} answered nothing before the agent ended"),
        );
        hold(
            back > 0.0,
            format!("{name} answered nothing after the link came back"),
        );
        let (budget, period) = (number("budget_ms"), number("period_ms"));
        if budget > 0.0 {
            let most = (top("elapsed_ns") / 1e6 / period).ceil() * budget;
            let got = number("cpu_high_ns") / 1e6;
            hold(
                got <= most,
                format!("{name} had {got} ms at its high priority, its budget is {most} ms"),
            );
        }
    }
    let (sent, got) = (answered(&run.board), received(run));
    // Some more come between the end of the measurement and the end of the run.
    hold(
        got >= after && got <= sent + 40.0,
        format!("ping received {got} answers of {sent}, {after} of them after the return"),
    );
    wrong
}

/// Answers that the board's middleware took.
fn answered(board: &Value) -> f64 {
    report::workers(board)
        .map(|w| report::number(w, "answered"))
        .sum()
}

/// Answers that ping received.
fn received(run: &Run) -> f64 {
    let both = run.ping.get("answered").and_then(Value::as_array);
    both.into_iter().flatten().filter_map(Value::as_f64).sum()
}
