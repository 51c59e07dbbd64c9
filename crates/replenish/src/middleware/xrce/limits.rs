//! The bounds of what a session keeps: what a computer can spare, and what a microcontroller can.

use crate::middleware::MiddlewareError;
use crate::platform::{STD, StaticText, TEXTS};
use replenish_xrce::features::DELIVERY;

/// A limit with the standard library, or `bare` without it.
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
/// Reliable streams: requests have one of their own where there is room. A reader asks for more
/// samples on it, also while a writer of this session waits, perhaps for that reader.
pub(super) const RELIABLE_STREAMS: usize = limit(3, 1);
/// Samples that a keep-all reader has room for at least, if they are small: so that it goes on
/// where some of what it has asked for is lost on the way.
pub(super) const fn least_depth(max_size: usize) -> u16 {
    if STD && max_size <= 8 * 1024 { 8 } else { 1 }
}
/// Messages that wait for a missing one: agents keep sixteen; a microcontroller as many as it
/// keeps.
pub(super) const fn reorder(window: usize) -> usize {
    limit(16, window)
}
/// Messages of requests on their way after a new log-in, where samples are kept for it.
pub(super) const RESTORE: usize = if DELIVERY { limit(16, 1) } else { 0 };
/// Bytes of journal: what `REQUESTS` descriptions with names of usual length need.
pub(super) const JOURNAL: usize = limit(512 * 1024, 1024);
/// The most objects of one kind: ids have twelve bits.
pub(super) const MAX_NUMBER: usize = 0xffe;
/// Bytes of the largest sample whose length a submessage can say: every agent takes it.
pub(super) const SHORT: usize = 65_528;
/// Bytes of the largest sample, as `replenish agent` takes it.
pub(super) const LARGEST: usize = 16 << 20;
/// Bytes of a datagram besides the one sample in it.
pub(super) const OVERHEAD: usize = 12;
/// Clashes that wait to be told; more are left out.
pub(super) const CLASHES: usize = if TEXTS { 64 } else { 0 };

/// The number of the next object, from 1 on. (Where a session keeps few objects, it is full
/// before.)
pub(super) fn number(count: usize, limit: usize, what: StaticText) -> Result<u16, MiddlewareError> {
    let next = u16::try_from((count + 1) & 0xfff).unwrap_or_default();
    Some(next)
        .filter(|_| count < limit || REQUESTS < limit)
        .ok_or(MiddlewareError::Capacity { what, limit })
}
