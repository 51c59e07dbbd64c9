//! How much a session keeps: what a computer can spare, and what a microcontroller can.

use crate::platform::STD;
use replenish_xrce::features::DELIVERY;

/// What a limit is with the standard library, and what without.
const fn limit(std: usize, bare: usize) -> usize {
    if STD { std } else { bare }
}

/// Reliable datagrams kept per direction at most.
pub(super) const WINDOW: usize = limit(64, 4);
/// Objects and reads of a session at most: a writer takes two and a reader three, plus one for
/// each node and one for each topic of a node (of an endpoint, where topics are not known by name).
pub(super) const REQUESTS: usize = limit(4096, 32);
/// Streams of each kind and direction: one for each [`Criticality`](crate::Criticality), or one for
/// both.
pub(super) const STREAMS: usize = limit(2, 1);
/// Messages that wait for a missing one: agents keep sixteen; a microcontroller as many as it keeps.
pub(super) const fn reorder(window: usize) -> usize {
    limit(16, window)
}
/// Messages of requests on their way after a new log-in, where samples are kept for it.
pub(super) const RESTORE: usize = if DELIVERY { limit(16, 1) } else { 0 };
/// Bytes of journal: what `REQUESTS` descriptions with names of usual length need.
pub(super) const JOURNAL: usize = limit(512 * 1024, 1024);
