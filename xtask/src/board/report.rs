//! The JSON that a board prints at its end, taken apart.

use super::testbench::{Run, UNANSWERED};
use serde_json::Value;

/// Between two messages of a topic, in ms.
pub(crate) const INTERVAL_MS: u64 = 10;

/// Losses that a run must not have.
pub(crate) fn losses(run: &Run) -> Vec<String> {
    let mut wrong = Vec::new();
    let of = |path: &str| run.board.pointer(path).and_then(Value::as_f64);
    for path in [
        "/uart/overruns",
        "/uart/dropped",
        UNANSWERED,
        "/ticks_unsent",
        "/frames/damaged",
        "/heap_refused",
    ] {
        if of(path) != Some(0.0) {
            wrong.push(format!("{path}: {:?}, must be 0", of(path)));
        }
    }
    let sent: f64 = workers(&run.board).map(|w| number(w, "answered")).sum();
    let received = run.ping.get("answered").and_then(Value::as_array);
    let received: f64 = received
        .into_iter()
        .flatten()
        .filter_map(Value::as_f64)
        .sum();
    // Some more come between the end of the measurement and the end of the run.
    if received < sent || received > sent + 40.0 {
        wrong.push(format!(
            "ping received {received} answers, the board had sent {sent}"
        ));
    }
    wrong
}

/// The workers in the board's JSON.
pub(crate) fn workers(board: &Value) -> impl Iterator<Item = &Value> {
    board
        .get("workers")
        .and_then(Value::as_array)
        .into_iter()
        .flatten()
}

/// CPU time of everything but the workers, in ms.
pub(crate) fn support_ms(board: &Value) -> f64 {
    support_ns(board) as f64 / 1e6
}

/// The same in ns.
pub(crate) fn support_ns(board: &Value) -> u64 {
    let names: Vec<_> = workers(board).filter_map(|w| w.get("name")).collect();
    let tasks = board.get("tasks").and_then(Value::as_array);
    let others = tasks.into_iter().flatten();
    let others = others.filter(|t| t.get("name").is_some_and(|n| !names.contains(&n)));
    others.filter_map(|t| t.get("cpu_ns")?.as_u64()).sum()
}

/// A number in it; 0 where there is none.
pub(crate) fn number(of: &Value, key: &str) -> f64 {
    of.get(key).and_then(Value::as_f64).unwrap_or(0.0)
}
