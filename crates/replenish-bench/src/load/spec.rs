//! The load of one run: budget, priorities, and behaviour of the callbacks.

use super::{MS, Nanos};

/// Scheduling of the high-priority worker.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case", tag = "policy")]
pub(crate) enum High {
    /// A sporadic server: `budget` every `period` at the high priority, the rest at `background`.
    Sporadic {
        /// CPU time at the high priority per period.
        budget: Nanos,
        /// The replenishment period.
        period: Nanos,
        /// The priority once the budget is used up.
        background: u8,
    },
    /// Plain FIFO: no budget, the paper's second case.
    Fifo,
}

/// The load: two topics, one message each per interval, two callbacks that consume CPU time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Spec {
    /// The high-priority worker's policy.
    pub high: High,
    /// CPU time that an answer takes, everything included.
    pub burst: Nanos,
    /// The part of a low callback that it sleeps instead, in percent (Experiment 2).
    pub low_sleep_percent: u8,
    /// Time between two messages of one topic.
    pub interval: Nanos,
    /// The period that windows are aligned with; the budget's own where there is one.
    pub period: Nanos,
}

/// Time between two messages of one topic in the paper.
pub(crate) const INTERVAL: Nanos = 10 * MS;
/// Priority of the worker that has the budget.
pub(crate) const HIGH_PRIORITY: u8 = 60;
/// Priority of the low worker.
pub(crate) const LOW_PRIORITY: u8 = 50;
/// Background priority in the demo and in Experiment 1.
pub(crate) const BACKGROUND: u8 = 6;
/// Background priority in Experiment 2.
pub(crate) const BACKGROUND_EXPERIMENT_2: u8 = 10;
/// Most replenishments that may be pending.
pub(crate) const MAX_REPL: u16 = 100;
/// The dispatcher: the highest that is sensible on Linux below the enforcer (the paper's 110).
pub(crate) const DISPATCHER_PRIORITY: u8 = 98;
/// The enforcer: above everything that it has to interrupt.
pub(crate) const ENFORCER_PRIORITY: u8 = 99;
/// The thread in pong that takes the snapshots; it runs on ping's CPU.
pub(crate) const MONITOR_PRIORITY: u8 = 97;
/// The thread in ping that sends.
pub(crate) const SENDER_PRIORITY: u8 = 80;
/// Everything else of ping and the agent, so that a busy machine does not hold up messages.
pub(crate) const SUPPORT_PRIORITY: u8 = 70;

impl Spec {
    /// The paper's load with a budget of `budget` every `period`.
    pub(crate) fn paper(budget: Nanos, period: Nanos) -> Self {
        Self {
            high: High::Sporadic {
                budget,
                period,
                background: BACKGROUND,
            },
            burst: 10 * MS,
            low_sleep_percent: 0,
            interval: INTERVAL,
            period,
        }
    }

    /// The paper's second case: both workers FIFO.
    pub(crate) fn fifo(period: Nanos) -> Self {
        Self {
            high: High::Fifo,
            ..Self::paper(period, period)
        }
    }

    /// Experiment 2: 30 ms every 100 ms, and a low callback that sleeps `percent` of its time.
    pub(crate) fn work_conserving(percent: u8) -> Self {
        let (budget, period) = (30 * MS, 100 * MS);
        Self {
            high: High::Sporadic {
                budget,
                period,
                background: BACKGROUND_EXPERIMENT_2,
            },
            low_sleep_percent: percent.min(100),
            ..Self::paper(budget, period)
        }
    }

    /// CPU time that a callback has to burn so that an answer takes `cpu` all in all.
    ///
    /// 1 % of the burst is left for receiving, decoding and sending.
    pub(crate) fn net(&self, cpu: Nanos) -> Nanos {
        cpu.saturating_sub(self.burst / 100)
    }

    /// CPU time that a low answer takes.
    pub(crate) fn low_burn(&self) -> Nanos {
        self.burst - self.low_sleep()
    }

    /// Time that a low callback sleeps.
    pub(crate) fn low_sleep(&self) -> Nanos {
        self.burst * Nanos::from(self.low_sleep_percent.min(100)) / 100
    }
}
