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
//! first ACKNACK arrives, so that repair is immediate there. A repair may be lost, too, and with it
//! what would make the receiver complain: so it is repeated a few times by itself, after the time
//! that an answer takes, which is measured only where nothing but the link can have delayed it.

use super::carry::Carried;
use super::push::{PushError, Tail};
use super::ring::{Ring, RingSlot};
use super::rtt::Rtt;
use super::spill::Spill;
use crate::SeqNum;
use crate::counter::{count, count_all};
use crate::features::{DELIVERY, RTT};
use crate::time::{NEVER, Nanos, ever, later};
use crate::wire::StreamHeader;
use crate::wire::{Encode, Heartbeat};

/// Settings of a reliable output stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reliability {
    /// Nanoseconds without an acknowledgement until the first heartbeat while no round trip has
    /// been measured. Then it comes as soon as an acknowledgement is overdue.
    pub heartbeat_first: Nanos,
    /// The shortest time until the first heartbeat, however short the round trip.
    pub heartbeat_min: Nanos,
    /// The time between heartbeats doubles up to this many nanoseconds.
    pub heartbeat_max: Nanos,
    /// Messages sent and not acknowledged at a time; what a receiver with 16 slots can keep is 16.
    pub in_flight: u16,
}

impl Reliability {
    /// The settings of eProsima's client: a heartbeat every 100 ms.
    pub const EPROSIMA: Reliability = Reliability {
        heartbeat_first: 100_000_000,
        heartbeat_min: 100_000_000,
        heartbeat_max: 100_000_000,
        in_flight: 16,
    };
}

impl Default for Reliability {
    /// First heartbeat after 10 ms, with a measured round trip as soon as that has passed, but not
    /// within 2 ms; the time doubles up to 100 ms; 16 messages in flight.
    fn default() -> Self {
        Reliability {
            heartbeat_first: 10_000_000,
            heartbeat_min: 2_000_000,
            ..Self::EPROSIMA
        }
    }
}

/// The counters of a reliable output stream.
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

impl OutputStats {
    /// Both together.
    #[must_use]
    pub const fn plus(self, other: Self) -> Self {
        OutputStats {
            sent: self.sent.saturating_add(other.sent),
            resent: self.resent.saturating_add(other.resent),
            resent_bytes: self.resent_bytes.saturating_add(other.resent_bytes),
            heartbeats: self.heartbeats.saturating_add(other.heartbeats),
            bogus_acks: self.bogus_acks.saturating_add(other.bogus_acks),
        }
    }
}

/// Repetitions of a message that was named missing once.
const RETRIES: u8 = 3;

/// Heartbeats at the same pace before it slows down.
const STEADY: u8 = 3;

/// The new information in an acknowledgement.
#[derive(Default)]
struct AckProgress {
    /// Time at which the newest message was sent whose arrival is progress.
    newest: Option<Nanos>,
    /// A message that was sent again has arrived: other progress may be old.
    again: bool,
}

impl AckProgress {
    fn received(&mut self, slot: &mut RingSlot) {
        slot.lost = NEVER;
        if !core::mem::replace(&mut slot.received, true) {
            self.again |= slot.resent;
            self.newest = self.newest.max(Some(slot.sent_at));
        }
    }
}

/// The sending end of a reliable stream: up to `N` messages are kept in `S`.
#[derive(Debug)]
pub struct OutputReliable<S, const N: usize> {
    ring: Ring<S, N>,
    config: Reliability,
    /// Messages from the first one on that are acknowledged and kept all the same, because their
    /// sample is not acknowledged as a whole.
    acked: usize,
    /// Messages are kept until they are confirmed, not only acknowledged.
    confirms: bool,
    /// Messages from the first one on that are confirmed, if the receiver confirms.
    confirmed: usize,
    /// Messages from the first one on that were sent.
    sent: usize,
    /// Time at which the next heartbeat is due.
    heartbeat: Nanos,
    /// Time between heartbeats now.
    interval: Nanos,
    /// Heartbeats since something new was acknowledged.
    unanswered: u8,
    /// Time at which the last heartbeat was sent.
    asked_at: Nanos,
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
            acked: 0,
            confirms: false,
            confirmed: 0,
            sent: 0,
            heartbeat: NEVER,
            interval: config.heartbeat_first,
            unanswered: 0,
            asked_at: 0,
            rtt: Rtt::default(),
            stats: OutputStats::default(),
        }
    }

    /// The same with room in `spill` for one submessage that is larger than what is free of the
    /// ring: it goes out in fragments as the ring has room. Nothing else is taken meanwhile.
    #[must_use]
    pub fn with_spill(mut self, spill: S) -> Self {
        self.ring.spill_to(spill);
        self
    }

    /// The same, but keeping samples until all their fragments are acknowledged, so that
    /// [`OutputReliable::carry_over`] loses none.
    #[must_use]
    pub const fn keeping_whole_samples(mut self) -> Self {
        self.ring.keep_whole = true;
        self
    }

    /// Back to the beginning, for a new session with a receiver that has forgotten everything:
    /// samples that were not acknowledged are kept and will be sent again, requests are not.
    /// Without the feature `delivery` nothing is kept, and messages are counted as lost instead of
    /// samples.
    pub fn carry_over(&mut self, header: StreamHeader) -> Carried {
        if !DELIVERY {
            let lost = u64::try_from(self.ring.used).unwrap_or(u64::MAX);
            self.reset(header);
            return Carried { samples: 0, lost };
        }
        let carried = self.ring.carry_over(header);
        self.restart();
        carried
    }

    /// The number of the first message, if others have been sent on this stream by other means.
    /// Only before anything is sent.
    pub const fn start_at(&mut self, first: SeqNum) {
        if self.sent == 0 {
            self.ring.first = first;
        }
    }

    /// Back to the beginning, for a new session; what was not acknowledged is forgotten. The
    /// counters go on.
    pub fn reset(&mut self, header: StreamHeader) {
        self.ring.reset(header);
        self.restart();
    }

    fn restart(&mut self) {
        self.acked = 0;
        self.confirmed = 0;
        self.sent = 0;
        self.heartbeat = NEVER;
        self.interval = self.config.heartbeat_first;
        self.unanswered = 0;
        self.asked_at = 0;
        self.rtt = Rtt::default();
    }

    /// Keeps messages until they are confirmed (see [`Confirmation`](crate::wire::Confirmation)),
    /// if the receiver `confirms`; otherwise until they are acknowledged.
    pub const fn until_confirmed(&mut self, confirms: bool) {
        self.confirms = DELIVERY && confirms;
    }

    /// The session and the stream, as the header of each message has them.
    pub const fn header(&self) -> StreamHeader {
        self.ring.header
    }

    /// The largest submessage, header included, that can be sent.
    pub fn limit(&self) -> usize {
        self.ring.limit()
    }

    /// Messages that can be pushed until the stream is full.
    pub const fn free(&self) -> usize {
        self.ring.free()
    }

    /// The first message that is not acknowledged; the next one to be sent if all are.
    pub fn first_unacknowledged(&self) -> SeqNum {
        self.ring.first.ahead(self.acked())
    }

    /// The number of the message that ends with what was pushed last, or the one before the first.
    pub fn newest(&self) -> SeqNum {
        let ahead = self.ring.used.saturating_add(self.ring.in_spill());
        self.ring.first.ahead(ahead).previous()
    }

    /// Whether everything was acknowledged.
    pub fn is_idle(&self) -> bool {
        self.ring.used == 0 && !self.ring.spill().is_some_and(Spill::is_busy)
    }

    /// Messages that were pushed and not acknowledged or, if the receiver confirms, not confirmed.
    pub fn unacknowledged(&self) -> usize {
        let used = self.ring.used.saturating_sub(self.done());
        used.saturating_add(self.ring.in_spill())
    }

    /// The counters so far.
    pub const fn stats(&self) -> OutputStats {
        self.stats
    }

    /// Takes a submessage: appends it to a message that was not sent yet, or begins one, or cuts it
    /// into fragments.
    ///
    /// # Errors
    /// [`PushError::WouldBlock`] if too few messages are acknowledged, [`PushError::TooLarge`] if
    /// it never fits, [`PushError::Wire`].
    pub fn push<B: Encode + ?Sized>(&mut self, body: &B) -> Result<(), PushError> {
        self.ring.push(body)
    }

    /// The next message to send: lost ones first, then new ones while the window allows.
    pub fn next_datagram(&mut self, now: Nanos) -> Option<&[u8]> {
        let i = self.due(now)?;
        let new = i >= self.sent;
        let timeout = self.rtt.timeout().unwrap_or(self.config.heartbeat_first);
        let timeout = timeout.min(self.config.heartbeat_max);
        let slot = self.ring.get_mut(i)?;
        slot.open = false;
        slot.resent = !new;
        slot.sent_at = now;
        // A message lost once may be lost again, and so may the receiver's reason to report it.
        slot.lost = NEVER;
        if !new && slot.retries < RETRIES {
            slot.retries = slot.retries.saturating_add(1);
            slot.lost = (0..slot.retries).fold(now, |time, _| later(time, timeout));
        }
        let len = slot.len;
        if new {
            self.sent = self.sent.wrapping_add(1);
            count(&mut self.stats.sent);
        } else {
            count(&mut self.stats.resent);
            count_all(&mut self.stats.resent_bytes, len);
        }
        let overdue = later(now, self.interval);
        if !new || self.heartbeat > overdue {
            self.heartbeat = overdue;
        }
        self.ring.stamp(i, len)
    }

    /// Whether [`OutputReliable::next_datagram`] has something to send.
    pub fn has_message(&self, now: Nanos) -> bool {
        self.due(now).is_some()
    }

    /// The heartbeat to send, if its time has come.
    pub fn take_heartbeat(&mut self, now: Nanos) -> Option<Heartbeat> {
        if self.heartbeat > now {
            return None;
        }
        let unacknowledged = self.sent.saturating_sub(self.acked());
        let longest = self.config.heartbeat_max;
        let wait = if unacknowledged == 0 {
            longest
        } else {
            self.unanswered = self.unanswered.saturating_add(1);
            if self.unanswered >= STEADY {
                self.interval = later(self.interval, self.interval).min(longest);
            }
            self.interval
        };
        self.heartbeat = later(now, wait);
        self.asked_at = now;
        count(&mut self.stats.heartbeats);
        let first = self.first_unacknowledged();
        Some(Heartbeat {
            first,
            last: first.ahead(unacknowledged).previous(),
            stream: self.header().stream,
        })
    }

    /// Time at which there is something to send even if nothing else happens.
    pub fn next_deadline(&self) -> Option<Nanos> {
        ever(self.deadline())
    }

    /// The same, [`NEVER`] for none.
    pub(crate) fn deadline(&self) -> Nanos {
        let lost = |i| self.ring.get(i).map_or(NEVER, |slot| slot.lost);
        (self.acked()..self.sent)
            .map(lost)
            .fold(self.heartbeat, Nanos::min)
    }

    /// Messages from the first one on that are acknowledged and kept: none where there is nothing
    /// to keep them for.
    const fn acked(&self) -> usize {
        if DELIVERY { self.acked } else { 0 }
    }

    /// An acknowledgement has arrived: see [`AckNack`](crate::wire::AckNack).
    pub fn acknowledge(&mut self, now: Nanos, first_unacked: SeqNum, missing: u16) {
        let before = self.first_unacknowledged();
        let Ok(newly_acked) = usize::try_from(first_unacked.since(before)) else {
            return; // an old one
        };
        let acked = self.acked.wrapping_add(newly_acked);
        if acked > self.sent {
            count(&mut self.stats.bogus_acks);
            return;
        }
        let mut progress = AckProgress::default();
        for i in self.acked..acked {
            if let Some(slot) = self.ring.get_mut(i) {
                progress.received(slot);
            }
        }
        let last = self.note_received(acked, missing, &mut progress);
        if let Some(sent_at) = progress.newest.filter(|_| RTT && !progress.again) {
            let time = now.saturating_sub(sent_at);
            if sent_at >= self.asked_at {
                self.rtt.sample(time);
            } else {
                self.rtt.sample_at_most(time); // the answer may be to the heartbeat
            }
        }
        let timeout = self.rtt.timeout();
        let Reliability {
            heartbeat_min,
            heartbeat_max,
            ..
        } = self.config;
        if newly_acked > 0 {
            self.unanswered = 0;
            self.interval = timeout.map_or(self.config.heartbeat_first, |timeout| {
                timeout.min(heartbeat_max).max(heartbeat_min)
            });
        }
        let first = self.config.heartbeat_first;
        let unknown = later(first, first);
        let timeout = timeout.unwrap_or(unknown).min(heartbeat_max);
        self.note_missing(acked, last, missing, timeout);
        self.acked = acked;
        self.release();
        self.await_answer(now);
    }

    /// Everything before `first_unconfirmed` is confirmed: see
    /// [`Confirmation`](crate::wire::Confirmation).
    pub fn confirm(&mut self, now: Nanos, first_unconfirmed: SeqNum) {
        let Ok(confirmed) = usize::try_from(first_unconfirmed.since(self.ring.first)) else {
            return; // an old one
        };
        if confirmed > self.acked {
            count(&mut self.stats.bogus_acks);
            return;
        }
        self.confirmed = self.confirmed.max(confirmed);
        self.release();
        self.await_answer(now);
    }

    /// Messages from the first one on whose fate is known.
    const fn done(&self) -> usize {
        if DELIVERY && self.confirms {
            self.confirmed
        } else {
            self.acked
        }
    }

    /// Forgets what need not be kept any more.
    fn release(&mut self) {
        let released = self.ring.complete(self.done());
        self.ring.release(released);
        self.sent = self.sent.saturating_sub(released);
        self.acked = self.acked.saturating_sub(released);
        self.confirmed = self.confirmed.saturating_sub(released);
    }

    /// Something was heard: the time to the next heartbeat begins anew.
    fn await_answer(&mut self, now: Nanos) {
        let wait = if self.sent > self.acked {
            self.interval
        } else if self.sent > self.done() {
            self.config.heartbeat_max // a confirmation waits for the receiver's readers, too
        } else {
            NEVER
        };
        self.heartbeat = later(now, wait);
    }

    /// Marks what the bitmap of an acknowledgement from message `first` on says to have arrived;
    /// gives how many messages it says something about.
    fn note_received(&mut self, first: usize, missing: u16, progress: &mut AckProgress) -> usize {
        let known = 16_u32.saturating_sub(missing.leading_zeros());
        let known = usize::try_from(known).unwrap_or(16);
        let known = known.min(self.sent.saturating_sub(first));
        for i in 0..known {
            let slot = self.ring.get_mut(first.wrapping_add(i));
            if let Some(slot) = slot.filter(|_| (missing >> i) & 1 == 0) {
                progress.received(slot);
            }
        }
        known
    }

    /// Marks what the bitmap names as missing: each is lost once an answer to it would have come.
    fn note_missing(&mut self, first: usize, known: usize, missing: u16, timeout: Nanos) {
        for i in (0..known).filter(|i| (missing >> i) & 1 != 0) {
            if let Some(slot) = self.ring.get_mut(first.wrapping_add(i))
                && !slot.received
            {
                let at = later(slot.sent_at, timeout);
                if slot.resent || slot.lost == NEVER {
                    slot.lost = slot.lost.min(at);
                }
                slot.retries = 0;
            }
        }
    }

    /// The message to send next, counted from the first.
    fn due(&self, now: Nanos) -> Option<usize> {
        let is_lost = |i: &usize| self.ring.get(*i).is_some_and(|slot| slot.lost <= now);
        let window = usize::from(self.config.in_flight.max(1));
        let in_flight = self.sent.saturating_sub(self.acked());
        let new = self.sent < self.ring.used && in_flight < window;
        (self.acked()..self.sent)
            .find(is_lost)
            .or(new.then_some(self.sent))
    }
}
