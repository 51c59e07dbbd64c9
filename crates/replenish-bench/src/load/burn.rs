//! A loop that consumes CPU time: the work of a callback.

use super::Nanos;
use replenish_os::clock;

/// Consumes `cpu` nanoseconds of the calling thread's CPU time, or stops at `deadline`.
///
/// Returns whether all of it was consumed before the deadline. Time during which the thread is
/// preempted or demoted does not count: a burst is the same work at any priority.
///
/// Calls `ran` with the time again and again while it runs.
pub(crate) fn burn(cpu: Nanos, deadline: Nanos, mut ran: impl FnMut(Nanos)) -> bool {
    let until = clock::thread_cpu().saturating_add(cpu);
    loop {
        let now = clock::monotonic();
        if now >= deadline {
            return false;
        }
        ran(now);
        if clock::thread_cpu() >= until {
            return true;
        }
    }
}
