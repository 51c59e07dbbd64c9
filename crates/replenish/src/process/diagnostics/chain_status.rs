//! A status of each chain, for `/diagnostics`.

use super::texts::{MESSAGE, Ms, OK, WARN, put, roomy, value};
use crate::platform::chain::ChainState;
use replenish_interfaces::diagnostic_msgs::msg::DiagnosticStatus;
use std::sync::Arc;

const KEYS: [&str; 5] = [
    "limit (ms)",
    "bound (ms)",
    "instances",
    "beyond the limit",
    "worst latency (ms)",
];

/// A chain and its count at the last look.
pub(super) struct WatchedChain {
    chain: Arc<ChainState>,
    exceeded: u64,
}

impl WatchedChain {
    pub(super) fn new(chain: &Arc<ChainState>) -> Self {
        Self {
            chain: Arc::clone(chain),
            exceeded: 0,
        }
    }

    /// A status with room for every later value.
    pub(super) fn status(&self, program: &str, hardware: &str) -> DiagnosticStatus {
        let name = format_args!("{program}: chain {}", self.chain.name());
        roomy(name, hardware, &KEYS)
    }

    /// The state now. Does not allocate.
    pub(super) fn say(&mut self, status: &mut DiagnosticStatus) {
        let seen = self.chain.figures();
        let new = seen.exceeded.saturating_sub(self.exceeded);
        self.exceeded = seen.exceeded;
        if new > 0 {
            status.level = WARN;
            let message = format_args!("{new} instances beyond the limit");
            put(&mut status.message, MESSAGE, message);
        } else {
            status.level = OK;
            put(&mut status.message, MESSAGE, format_args!("ok"));
        }
        let Some([limit, bound, ended, exceeded, worst]) = status.values.get_mut(..) else {
            return;
        };
        let times = [
            (limit, seen.limit),
            (bound, seen.bound),
            (worst, seen.worst),
        ];
        for (pair, time) in times {
            match time {
                Some(time) => value(pair, format_args!("{}", Ms(time))),
                None => value(pair, format_args!("-")),
            }
        }
        value(ended, format_args!("{}", seen.ended));
        value(exceeded, format_args!("{}", seen.exceeded));
    }
}
