//! The wall clock, as XRCE writes it.

use crate::platform;
use replenish_xrce::wire::WireTime;

pub(super) fn wall_clock() -> WireTime {
    let since = platform::wall_clock().unwrap_or_default();
    WireTime {
        seconds: i32::try_from(since.as_secs()).unwrap_or(i32::MAX),
        nanoseconds: since.subsec_nanos(),
    }
}
