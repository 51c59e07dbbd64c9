//! A process under an orchestrator: it reports events on standard output and ends with its input.
//!
//! ```text
//!   orchestrator ── stdin: lines, later end of file = "stop" ──► process
//!   orchestrator ◄─ stdout: one JSON object per line ─────────── process
//! ```

use crate::signals::Stop;
use std::io::{BufRead, Write};

/// The report of a supervised process.
#[derive(Debug, serde::Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// Set-up is done.
    Ready(Ready),
}

/// Set-up is done.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub struct Ready {
    /// The address that the agent listens at (agent only).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub address: Option<String>,
    /// Mode in which budgets are held (pong only).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mode: Option<Mode>,
    /// Each thread's requested and granted scheduling.
    #[serde(default)]
    pub threads: Vec<ThreadRow>,
}

/// Mode in which budgets are held.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// An enforcer demotes a thread in the middle of a callback.
    Enforced,
    /// Without real-time priority: an exhausted callback is not started again until its budget
    /// is replenished, but one that runs is not interrupted.
    Deferred,
}

/// One thread: its name, what was requested, what the kernel granted, and where it runs.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct ThreadRow {
    /// Its name, with its process: `pong/high`.
    pub name: String,
    /// The policy asked for.
    pub requested: String,
    /// The policy the kernel reports.
    pub granted: String,
    /// The CPUs it may run on, as the kernel lists them: `1` or `0-3`.
    pub cpu: String,
}

/// Writes one event as a line. A reader that has gone is noticed as end of file on the input.
pub fn emit<E: serde::Serialize>(event: &E) {
    if let Ok(line) = serde_json::to_string(event) {
        let mut out = std::io::stdout().lock();
        writeln!(out, "{line}").and_then(|()| out.flush()).ok();
    }
}

/// Hands each line of standard input to `line`; end of file triggers `stop`.
pub fn listen(stop: Stop, mut line: impl FnMut(&str) + Send + 'static) {
    std::thread::spawn(move || {
        for text in std::io::stdin().lock().lines().map_while(Result::ok) {
            line(&text);
        }
        stop.trigger();
    });
}
