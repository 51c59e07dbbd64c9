//! The wall clock as messages carry it.

use replenish_msg::builtin_interfaces::Time;

/// This moment by the wall clock; zeros before 1970, after 2038 and without a wall clock.
pub(crate) fn wall_time() -> Time {
    let since = super::std::wall_clock().unwrap_or_default();
    let sec = i32::try_from(since.as_secs()).unwrap_or_default();
    let nanosec = since.subsec_nanos();
    Time { sec, nanosec }
}
