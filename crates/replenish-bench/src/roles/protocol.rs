//! Messages among the processes of one run: one JSON object per line.
//!
//! ```text
//!   orchestrator ── stdin: one Grid, later end of file = "stop" ──► agent, ping, pong
//!   orchestrator ◄─ stdout: Event, Event, … ─────────────────────── agent, ping, pong
//! ```
//!
//! End of file doubles as the dead man's handle: if the orchestrator dies, its children stop.

use crate::load::Nanos;
use crate::load::simulated::{Arrivals, Costs};
pub(crate) use replenish_cli::supervised::{Mode, Ready, ThreadRow};

/// A report of a part to the orchestrator.
#[derive(Debug, Clone, serde::Serialize, serde::Deserialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub(crate) enum Event {
    /// Set-up is done; the part waits for the grid.
    Ready(Ready),
    /// Pong's account of one window.
    PongWindow(PongWindow),
    /// Ping's account of one window.
    PingWindow(PingWindow),
    /// The way to the agent has gone, or has come back.
    Link {
        /// Whether the agent answers.
        up: bool,
        /// One sentence for people.
        detail: String,
    },
    /// Pong's statistics over its whole life, printed when it ends.
    PongEnd(PongEnd),
    /// Something worth a line: a fallback in force, a lost message.
    Note {
        /// One sentence for people.
        text: String,
    },
}

/// CPU time and answers of one worker in one window.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) struct WorkerWindow {
    /// CPU time at its own (high) priority.
    pub cpu_high: Nanos,
    /// CPU time at its background priority.
    pub cpu_low: Nanos,
    /// Answers published.
    pub answered: u64,
    /// Times its budget ran out.
    pub exhaustions: u64,
}

/// Pong's account of one window.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub(crate) struct PongWindow {
    /// The number of the window.
    pub index: u64,
    /// The high worker.
    pub high: WorkerWindow,
    /// The low worker.
    pub low: WorkerWindow,
    /// CPU time of dispatcher and enforcer, which share the workers' CPU.
    pub support_cpu: Nanos,
    /// The enforcers' part of it.
    #[serde(default)]
    pub enforcer_cpu: Nanos,
    /// Idle time of the measured CPU, in steps of 10 ms; 0 if the kernel does not say.
    #[serde(default)]
    pub idle: Nanos,
    /// The largest delay of the thread that takes the snapshots.
    pub late: Nanos,
    /// Time of the measured CPU that the hypervisor took.
    ///
    /// In steps of 10 ms; 0 if the kernel does not say.
    #[serde(default)]
    pub stolen: Nanos,
    /// Slices in which the high worker had the CPU: pairs of start and end, relative to the window.
    pub high_slices: Vec<(Nanos, Nanos)>,
    /// Slices in which the low worker had the CPU.
    pub low_slices: Vec<(Nanos, Nanos)>,
}

/// Ping's account of one window.
#[derive(Debug, Clone, Copy, Default, serde::Serialize, serde::Deserialize)]
pub(crate) struct PingWindow {
    /// The number of the window.
    pub index: u64,
    /// Messages sent on the high topic.
    pub sent_high: u64,
    /// Messages sent on the low topic.
    pub sent_low: u64,
    /// Answers received on the high topic.
    pub received_high: u64,
    /// Answers received on the low topic.
    pub received_low: u64,
    /// The largest delay of a message against its grid time.
    pub late: Nanos,
}

/// Pong's statistics over its whole life.
#[derive(Debug, Clone, Default, serde::Serialize, serde::Deserialize)]
pub(crate) struct PongEnd {
    /// CPU time beyond the budget at the high priority, per exhaustion.
    pub overrun_us: Overrun,
    /// Costs of messages and answers besides the work of the callbacks.
    #[serde(default)]
    pub costs: Costs,
    /// Times at which the messages of topic high were taken.
    #[serde(default)]
    pub arrivals_high: Arrivals,
    /// Times at which the messages of topic low were taken.
    #[serde(default)]
    pub arrivals_low: Arrivals,
    /// Samples that slots dropped because newer ones came.
    pub dropped: u64,
    /// Names of workers that did not end on a stop.
    pub stuck: Vec<String>,
}

/// Overruns of a budget, by the thread's CPU clock, in microseconds.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Overrun {
    /// Half of the exhaustions overran by no more than this.
    pub median: f64,
    /// 99 % of the exhaustions overran by no more than this.
    pub p99: f64,
    /// Exhaustions measured.
    pub count: u64,
    /// Demotions that were late because the machine itself stood still; not part of the above.
    pub stall_count: u64,
    /// Overruns of the late demotions; of many, the worst.
    pub stalls: Vec<f64>,
}
