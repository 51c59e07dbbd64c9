//! The wall clock, as XRCE writes it; of a board, which has none, the monotonic clock.

use crate::platform;
use core::time::Duration;
use replenish_os::clock;
use replenish_xrce::wire::WireTime;

pub(super) fn wall_clock() -> WireTime {
    let since = platform::wall_clock();
    let since = since.unwrap_or_else(|| Duration::from_nanos(clock::monotonic()));
    WireTime {
        seconds: i32::try_from(since.as_secs()).unwrap_or(i32::MAX),
        nanoseconds: since.subsec_nanos(),
    }
}
