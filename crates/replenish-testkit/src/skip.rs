//! A trial finds out on its way what the machine lacks, and ends: it counts as ignored.
//!
//! These work on the trial's own thread, in a target with `harness = false`; the standard harness
//! counts them as failures. What the trial owns is dropped.

use crate::rt;
use std::panic::resume_unwind;

/// Set to `1`, it makes trials that lack a foreign peer fail instead of being ignored.
pub const REQUIRE_PEERS: &str = "REPLENISH_REQUIRE_PEERS";

pub(crate) fn peers_required() -> bool {
    std::env::var_os(REQUIRE_PEERS).is_some_and(|value| value == "1")
}

/// The reason, with which [`skip`] unwinds.
pub(crate) struct Skipped(pub(crate) String);

/// Ends the trial that calls it as ignored; the list of results says `why`.
pub fn skip(why: &str) -> ! {
    resume_unwind(Box::new(Skipped(why.into())))
}

/// [`skip`], where real-time priority is missing; a failure if [`rt::REQUIRE`] is set.
///
/// # Panics
/// As said.
pub fn skip_rt(why: &str) -> ! {
    assert!(
        !rt::required(),
        "{why}, and {} forbids skipping",
        rt::REQUIRE
    );
    skip(why)
}

/// [`skip`], where a foreign program is missing; a failure if [`REQUIRE_PEERS`] is set.
///
/// # Panics
/// As said.
pub fn skip_peer(why: &str) -> ! {
    assert!(
        !peers_required(),
        "{why}, and {REQUIRE_PEERS} forbids skipping"
    );
    skip(why)
}
