//! Substitutes for the standard library in builds without feature `std`.
//!
//! - There is no unwinding: a panic ends in the program's panic handler, which halts the worker
//!   and reports.
//! - There is no wall clock; stamps come from the agent's clock.
//! - Deadlines and liveliness are not monitored.
//! - Events go where [`Executor::on_event`](crate::Executor::on_event) says, and nowhere without.

#[path = "chain_disabled.rs"]
pub(crate) mod chain;
pub mod io;
#[path = "local_disabled.rs"]
pub(crate) mod local;
#[path = "recorder_board.rs"]
pub(crate) mod recorder;
#[path = "sleeping_disabled.rs"]
pub(crate) mod sleeping;
#[path = "source_set_disabled.rs"]
pub(crate) mod source_set;

use crate::Nanos;
use crate::sync::{Ordering, unmodelled::AtomicU64};
use core::time::Duration;

/// A deadline that is not monitored.
pub(crate) struct Deadline;

impl Deadline {
    pub(crate) const fn new(_period: Nanos) -> Self {
        Self
    }

    #[allow(clippy::unused_self, reason = "as with feature `std`")]
    pub(crate) const fn renew(&mut self, _now: Nanos) -> bool {
        false
    }

    #[allow(clippy::unused_self, reason = "as with feature `std`")]
    pub(crate) const fn stop(&mut self) {}

    #[allow(clippy::unused_self, reason = "as with feature `std`")]
    pub(crate) const fn check(&mut self, _now: Nanos) {}

    #[allow(clippy::unused_self, reason = "as with feature `std`")]
    pub(crate) const fn next(&self) -> Nanos {
        Nanos::MAX
    }

    #[allow(clippy::unused_self, reason = "as with feature `std`")]
    pub(crate) const fn missed(&self) -> u64 {
        0
    }
}

/// A lease that never ends.
pub(crate) struct Lease;

impl Lease {
    pub(crate) const fn new(_time: Nanos) -> Self {
        Self
    }

    #[allow(clippy::unused_self, reason = "as with feature `std`")]
    pub(crate) const fn renew(&mut self, _now: Nanos) -> bool {
        false
    }

    #[allow(clippy::unused_self, reason = "as with feature `std`")]
    pub(crate) const fn check(&mut self, _now: Nanos) {}

    #[allow(clippy::unused_self, reason = "as with feature `std`")]
    pub(crate) const fn next(&self) -> Nanos {
        Nanos::MAX
    }

    #[allow(clippy::unused_self, reason = "as with feature `std`")]
    pub(crate) const fn is_alive(&self) -> bool {
        true
    }

    #[allow(clippy::unused_self, reason = "as with feature `std`")]
    pub(crate) const fn lost(&self) -> u64 {
        0
    }
}

/// There is no wall clock.
pub(crate) const fn wall_clock() -> Option<Duration> {
    None
}

/// Bits that differ from call to call and, as far as the clock does, from start to start. For ids
/// that no other machine has, set `XrceConfig::key`.
pub(crate) fn random(salt: u64) -> u64 {
    static CALLS: AtomicU64 = AtomicU64::new(0);
    let calls = CALLS.fetch_add(1, Ordering::Relaxed);
    let now = replenish_os::clock::monotonic();
    // The finishing steps of SplitMix64.
    let mut bits = now ^ salt.rotate_left(32) ^ calls.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    bits ^ (bits >> 31)
}

/// Runs `step`; a panic does not come back here.
pub(crate) fn guard<S: ?Sized, T>(
    subject: &mut S,
    step: impl FnOnce(&mut S) -> T,
    _panicked: impl FnOnce(&mut S, &str) -> T,
) -> T {
    step(subject)
}

/// There are no thread locals.
pub(crate) const fn prepare_end() {}

/// Ends the thread's account: nothing else of the thread is left.
pub(crate) fn end_with(account: replenish_os::Account) {
    drop(account);
}

/// Drops an event: there is no default place for events.
pub(crate) const fn tell(_event: &dyn core::fmt::Display) {}
