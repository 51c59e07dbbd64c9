//! The clocks of a running agent.

use crate::agent_core::Now;
use replenish_os::clock;
use std::time::{SystemTime, UNIX_EPOCH};

/// Both clocks.
pub(super) fn now() -> Now {
    Now {
        monotonic: clock::monotonic(),
        unix: i64::try_from(unix()).unwrap_or(i64::MAX),
    }
}

fn unix() -> u128 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.unwrap_or_default().as_nanos()
}

/// A number that the agent before this one hardly had.
pub(super) fn instance() -> u16 {
    let mixed = (unix() >> 10) ^ u128::from(std::process::id());
    u16::try_from(mixed & 0xffff).unwrap_or(0)
}
