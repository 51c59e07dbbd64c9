//! Sending on a reliable stream: messages are kept until they are acknowledged.
//!
//! ```text
//!        first              first+sent       first+used
//!          │ acknowledge      │ send           │ push
//!   ───────┼──────┬──────┬────┼───────┬────────┼──────
//!    acked │ sent │ lost │ .. │ ready │ open   │ free
//!   ───────┴──────┴──────┴────┴───────┴────────┴──────
//! ```
//!
//! Only what an ACKNACK names as missing is sent again, before anything new, and not before an
//! acknowledgement of the last transmission can have come: the receiver answers every message that
//! follows a gap, and all those answers name the same gap; and where messages overtake each other,
//! not every gap is a loss. On a link with a steady delay that time has always passed when the
//! first ACKNACK arrives, so that repair is immediate there.

use super::ring::Ring;
use super::rtt::Rtt;
use super::{PushError, StreamHeader, Tail};
use crate::wire::{Encode, Heartbeat};
use crate::{Nanos, SeqNum};

/// Settings of a reliable output stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reliability {
    /// Nanoseconds without an acknowledgement until the first heartbeat; longer if the measured
    /// round trip is.
    pub heartbeat_first: Nanos,
    /// The time between heartbeats doubles up to this many nanoseconds.
    pub heartbeat_max: Nanos,
    /// Messages sent and not acknowledged at a time; what a receiver with 16 slots can keep is 16.
    pub in_flight: u16,
}

impl Reliability {
    /// What eProsima's client does: a heartbeat every 100 ms.
    pub const EPROSIMA: Reliability = Reliability {
        heartbeat_first: 100_000_000,
        heartbeat_max: 100_000_000,
        in_flight: 16,
    };
}

impl Default for Reliability {
    /// First heartbeat after 10 ms, then 20, 40, 80, 100 ms; 16 messages in flight.
    fn default() -> Self {
        Reliability {
            heartbeat_first: 10_000_000,
            ..Self::EPROSIMA
        }
    }
}

/// What happened on a reliable output stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct OutputStats {
    /// Messages sent for the first time.
    pub sent: u64,
    /// Messages sent again.
    pub resent: u64,
    /// Bytes of the messages sent again.
    pub resent_bytes: u64,
    /// Heartbeats sent.
    pub heartbeats: u64,
    /// Acknowledgements of messages that were never sent.
    pub bogus_acks: u64,
}

/// The sending end of a reliable stream: up to `N` messages are kept in `S`.
#[derive(Debug)]
pub struct OutputReliable<S, const N: usize> {
    ring: Ring<S, N>,
    config: Reliability,
    /// Messages from the first one on that were sent.
    sent: usize,
    heartbeat: Option<Nanos>,
    /// Time between heartbeats now.
    interval: Nanos,
    rtt: Rtt,
    stats: OutputStats,
}

impl<S: AsRef<[u8]> + AsMut<[u8]>, const N: usize> OutputReliable<S, N> {
    /// A stream at its beginning. `ring` is cut into slots of `mtu` bytes (at least 16, at most
    /// 65535), at most `N`; `mtu` is the longest message that is sent.
    pub fn new(ring: S, mtu: usize, header: StreamHeader, tail: Tail, config: Reliability) -> Self {
        OutputReliable {
            ring: Ring::new(ring, mtu, header, tail),
            config,
            sent: 0,
            heartbeat: None,
            interval: config.heartbeat_first,
            rtt: Rtt::default(),
            stats: OutputStats::default(),
        }
    }

    /// Back to the beginning, for a new session; what was not acknowledged is forgotten. The
    /// counters go on.
    pub fn reset(&mut self, header: StreamHeader) {
        self.ring.reset(header);
        self.sent = 0;
        self.heartbeat = None;
        self.interval = self.config.heartbeat_first;
        self.rtt = Rtt::default();
    }

    /// Which stream this is.
    pub const fn header(&self) -> StreamHeader {
        self.ring.header
    }

    /// The largest submessage, header included, that can be sent.
    pub const fn limit(&self) -> usize {
        self.ring.limit()
    }

    /// Messages that can be pushed until the stream is full.
    pub const fn free(&self) -> usize {
        self.ring.free()
    }

    /// The first message that is not acknowledged; the next one to be sent if all are.
    pub const fn first_unacknowledged(&self) -> SeqNum {
        self.ring.first
    }

    /// Whether everything was acknowledged.
    pub const fn is_idle(&self) -> bool {
        self.ring.used == 0
    }

    /// Messages that were pushed and not acknowledged.
    pub const fn unacknowledged(&self) -> usize {
        self.ring.used
    }

    /// What happened so far.
    pub const fn stats(&self) -> OutputStats {
        self.stats
    }

    /// Takes a submessage: appends it to a message that was not sent yet, or begins one, or cuts it
    /// into fragments.
    ///
    /// # Errors
    /// [`PushError::WouldBlock`] if too few messages are acknowledged, [`PushError::TooLarge`] if
    /// it never fits, [`PushError::Wire`].
    pub fn push(&mut self, body: &impl Encode) -> Result<(), PushError> {
        self.ring.push(body)
    }

    /// The next message to send: lost ones first, then new ones while the window allows.
    pub fn next_datagram(&mut self, now: Nanos) -> Option<&[u8]> {
        let i = self.due(now)?;
        let new = i >= self.sent;
        let slot = self.ring.get_mut(i)?;
        slot.open = false;
        slot.lost = None;
        slot.resent = !new;
        slot.sent_at = now;
        if new {
            self.sent = self.sent.saturating_add(1);
            self.stats.sent = self.stats.sent.saturating_add(1);
        } else {
            self.stats.resent = self.stats.resent.saturating_add(1);
            let bytes = u64::try_from(slot.len).unwrap_or(u64::MAX);
            self.stats.resent_bytes = self.stats.resent_bytes.saturating_add(bytes);
        }
        if !new || self.heartbeat.is_none() {
            self.heartbeat = Some(now.saturating_add(self.interval));
        }
        self.ring.bytes(i)
    }

    /// Whether [`OutputReliable::next_datagram`] has something to send.
    pub fn has_message(&self, now: Nanos) -> bool {
        self.due(now).is_some()
    }

    /// The heartbeat to send, if its time has come.
    pub fn take_heartbeat(&mut self, now: Nanos) -> Option<Heartbeat> {
        if self.heartbeat? > now {
            return None;
        }
        let last = u16::try_from(self.sent.checked_sub(1)?).ok()?;
        self.interval = self
            .interval
            .saturating_mul(2)
            .min(self.config.heartbeat_max);
        self.heartbeat = Some(now.saturating_add(self.interval));
        self.stats.heartbeats = self.stats.heartbeats.saturating_add(1);
        let first = self.ring.first;
        Some(Heartbeat {
            first,
            last: first.plus(last),
            stream: self.header().stream,
        })
    }

    /// When there is something to send even if nothing else happens.
    pub fn next_deadline(&self) -> Option<Nanos> {
        let lost = (0..self.sent).filter_map(|i| self.ring.get(i)?.lost).min();
        lost.into_iter().chain(self.heartbeat).min()
    }

    /// An acknowledgement has arrived: see [`AckNack`](crate::wire::AckNack).
    pub fn acknowledge(&mut self, now: Nanos, first_unacked: SeqNum, missing: u16) {
        let Ok(acked) = usize::try_from(first_unacked.since(self.ring.first)) else {
            return; // an old one
        };
        if acked > self.sent {
            self.stats.bogus_acks = self.stats.bogus_acks.saturating_add(1);
            return;
        }
        for i in 0..acked {
            if let Some(slot) = self
                .ring
                .get(i)
                .filter(|slot| !slot.resent && !slot.received)
            {
                self.rtt.sample(now.saturating_sub(slot.sent_at));
            }
        }
        self.ring.release(acked);
        self.sent = self.sent.saturating_sub(acked);
        let patience = self
            .rtt
            .timeout()
            .unwrap_or(0)
            .min(self.config.heartbeat_max);
        if acked > 0 {
            self.interval = patience.max(self.config.heartbeat_first);
        }
        self.heartbeat = (self.sent > 0).then(|| now.saturating_add(self.interval));
        self.note_missing(now, missing, patience);
    }

    /// Marks what an acknowledgement names as missing, and what it thereby says has arrived.
    fn note_missing(&mut self, now: Nanos, missing: u16, patience: Nanos) {
        let known = 16_u32.saturating_sub(missing.leading_zeros());
        let known = usize::try_from(known).unwrap_or(16).min(self.sent);
        for i in 0..known {
            let Some(slot) = self.ring.get_mut(i) else {
                return;
            };
            if (missing >> i) & 1 == 0 {
                if !slot.resent && !slot.received {
                    self.rtt.sample(now.saturating_sub(slot.sent_at));
                }
                slot.received = true;
                slot.lost = None;
            } else if slot.lost.is_none() && !slot.received {
                slot.lost = Some(slot.sent_at.saturating_add(patience));
            }
        }
    }

    /// Which message is to be sent next, counted from the first.
    fn due(&self, now: Nanos) -> Option<usize> {
        let is_lost = |i: &usize| {
            self.ring
                .get(*i)
                .and_then(|slot| slot.lost)
                .is_some_and(|lost| lost <= now)
        };
        let window = usize::from(self.config.in_flight.max(1));
        let new = self.sent < self.ring.used && self.sent < window;
        (0..self.sent).find(is_lost).or(new.then_some(self.sent))
    }
}
