//! One stream from a client to the agent.

use crate::config::Limits;
use crate::flow::{Charge, DeliveryTracker, Ledger, TRACKER_BYTES, TrackerHandle};
use replenish_xrce::Nanos;
use replenish_xrce::SeqNum;
use replenish_xrce::stream::{InputBestEffort, InputReliable};
use replenish_xrce::wire::{AckNack, Confirmation, Confirmed, StreamId, Submessage, Submessages};
use std::collections::VecDeque;
use std::sync::{Arc, Weak};

/// Messages that may wait for a missing one: as many as the bitmap of an ACKNACK can name.
const SLOTS: usize = 16;

/// Messages that may wait for their readers: twice as many as our clients keep. The oldest counts
/// as confirmed when a client sends more than it can repeat.
const UNCONFIRMED: usize = 128;

/// Bytes of a reliable stream besides its messages and the sample that is put together.
const OVERHEAD: usize =
    size_of::<Reliable>() + UNCONFIRMED * (size_of::<Unconfirmed>() + TRACKER_BYTES);

/// Confirmations are reported in batches of this size; a smaller remainder is reported when no
/// message is pending.
const CONFIRM_BATCH: i16 = 8;

type Reliable = InputReliable<Box<[u8]>, Box<[u8]>, SLOTS>;

/// A message, or a submessage joined from fragments, is malformed.
#[derive(Debug)]
pub(crate) struct Malformed;

/// A stream's receiving end.
#[derive(Debug)]
pub(crate) struct InputStream {
    stream: StreamId,
    receiver: Receiver,
    /// The last message that was not taken for want of room in a reader's queue.
    postponed: Option<SeqNum>,
    /// Messages that are not confirmed, the oldest first.
    unconfirmed: VecDeque<Unconfirmed>,
    /// The first message that is not reported as confirmed.
    reported: SeqNum,
    /// The client gets acknowledgements and confirmations; otherwise confirmations alone.
    reports_both: bool,
    _charge: Charge,
}

/// Messages from one on that wait for their readers.
#[derive(Debug)]
struct Unconfirmed {
    from: SeqNum,
    tracker: Weak<DeliveryTracker>,
    /// The time at which they count as confirmed.
    until: Nanos,
}

#[derive(Debug)]
enum Receiver {
    BestEffort(InputBestEffort),
    Reliable(Box<Reliable>),
}

impl InputStream {
    /// A stream at its beginning, for messages of up to `mtu` bytes. Longer ones are understood
    /// too, but on a reliable stream only when they come in order. `None` if the client may not
    /// have the memory.
    pub(crate) fn new(
        stream: StreamId,
        mtu: usize,
        reports_both: bool,
        limits: &Limits,
        ledger: &Ledger,
    ) -> Option<Self> {
        let bytes = if stream.is_reliable() {
            SLOTS * mtu + limits.longest_submessage() + OVERHEAD
        } else {
            0
        };
        let charge = ledger.charge(bytes)?;
        let receiver = if stream.is_reliable() {
            let slots = vec![0; SLOTS * mtu].into_boxed_slice();
            let fragments = vec![0; limits.longest_submessage()].into_boxed_slice();
            Receiver::Reliable(Box::new(InputReliable::new(stream, slots, mtu, fragments)))
        } else {
            Receiver::BestEffort(InputBestEffort::new())
        };
        Some(Self {
            stream,
            receiver,
            postponed: None,
            unconfirmed: VecDeque::new(),
            reported: SeqNum(0),
            reports_both,
            _charge: charge,
        })
    }

    pub(crate) fn stream(&self) -> StreamId {
        self.stream
    }

    /// Takes in message `seq`; calls `deliver` with each submessage that is due now. Where that
    /// returns false on a reliable stream, the stream stops before the submessage, and the client
    /// sends from there on again. Of fragments that are too long together it gets the beginning, as
    /// a `FRAGMENT`.
    ///
    /// # Errors
    /// Something was malformed; it was dropped.
    pub(crate) fn receive(
        &mut self,
        seq: SeqNum,
        body: &[u8],
        mut deliver: impl FnMut(&Submessage<'_>) -> bool,
    ) -> Result<(), Malformed> {
        match &mut self.receiver {
            Receiver::BestEffort(receiver) => {
                if receiver.accept(seq) {
                    let mut submessages = Submessages::new(body);
                    return submessages
                        .try_for_each(|s| s.map(|s| _ = deliver(&s)))
                        .map_err(|_| Malformed);
                }
            }
            Receiver::Reliable(receiver) => {
                let before = receiver.stats().malformed;
                receiver.receive_while(seq, body, deliver);
                if receiver.stats().malformed != before {
                    return Err(Malformed);
                }
            }
        }
        Ok(())
    }

    /// A HEARTBEAT of this stream.
    pub(crate) fn heartbeat(&mut self, last: SeqNum) {
        if let Receiver::Reliable(receiver) = &mut self.receiver {
            receiver.heartbeat(last);
        }
    }

    /// Postpones message `seq` if it can be: a message that was taken before is acknowledged again,
    /// and a best-effort stream repeats nothing.
    pub(crate) fn postpone(&mut self, seq: SeqNum) -> bool {
        let Receiver::Reliable(receiver) = &self.receiver else {
            return false;
        };
        if receiver.next_expected().is_after(seq) {
            return false;
        }
        if self.postponed.is_none_or(|last| seq.is_after(last)) {
            self.postponed = Some(seq);
        }
        true
    }

    /// There is room again: delivers what has waited here, as [`receive`](Self::receive) does.
    pub(crate) fn retry(&mut self, deliver: impl FnMut(&Submessage<'_>) -> bool) {
        if let Receiver::Reliable(receiver) = &mut self.receiver {
            receiver.retry(deliver);
        }
    }

    /// There is room again: asks for the postponed messages.
    pub(crate) fn resume(&mut self) {
        if let Some(last) = self.postponed.take() {
            self.heartbeat(last);
        }
    }

    /// The first message that has not been taken in, on a reliable stream.
    pub(crate) fn next(&self) -> SeqNum {
        match &self.receiver {
            Receiver::BestEffort(_) => SeqNum(0),
            Receiver::Reliable(receiver) => receiver.next_expected(),
        }
    }

    /// Withholds the confirmation of the messages from `from` on until the last handle of `tracker`
    /// is dropped, or until `until`.
    /// Returns the number of older ones that count as confirmed for it.
    pub(crate) fn withhold(&mut self, from: SeqNum, tracker: &TrackerHandle, until: Nanos) -> u64 {
        let mut late = 0;
        while self.unconfirmed.len() >= UNCONFIRMED {
            let oldest = self.unconfirmed.pop_front();
            late += u64::from(oldest.is_some_and(|o| o.tracker.strong_count() > 0));
        }
        self.unconfirmed.push_back(Unconfirmed {
            from,
            tracker: Arc::downgrade(tracker),
            until,
        });
        late
    }

    /// Removes confirmed messages; returns the number that were not confirmed in time.
    pub(crate) fn confirm(&mut self, now: Nanos) -> u64 {
        let mut late = 0;
        while let Some(oldest) = self.unconfirmed.front() {
            let held = oldest.tracker.strong_count() > 0;
            if held && now < oldest.until {
                break;
            }
            late += u64::from(held);
            self.unconfirmed.pop_front();
        }
        late
    }

    /// The latest time at which the oldest of them counts as confirmed.
    pub(crate) fn deadline(&self) -> Option<Nanos> {
        self.unconfirmed.front().map(|oldest| oldest.until)
    }

    /// The first message that is not confirmed.
    fn first_unconfirmed(&self) -> SeqNum {
        let oldest = self.unconfirmed.front();
        oldest.map_or_else(|| self.next(), |oldest| oldest.from)
    }

    /// Whether an ACKNACK is due. For a client that gets confirmations alone, a message that has
    /// arrived but is not confirmed is no reason for one.
    pub(crate) fn ack_due(&self) -> bool {
        let Receiver::Reliable(receiver) = &self.receiver else {
            return false;
        };
        let confirmed = self.first_unconfirmed();
        let progress = confirmed.since(self.reported);
        if self.reports_both {
            let enough = confirmed == self.next() || progress >= CONFIRM_BATCH;
            receiver.ack_due() || (progress > 0 && enough)
        } else {
            receiver.is_urgent() || progress > 0
        }
    }

    /// The ACKNACK to send, if one is due. It names nothing as missing while messages are
    /// postponed: they would only come again.
    pub(crate) fn take_ack(&mut self, companions: u8) -> Option<Confirmation> {
        if !self.ack_due() {
            return None;
        }
        let confirmed = self.first_unconfirmed();
        let Receiver::Reliable(receiver) = &mut self.receiver else {
            return None;
        };
        let mut ack = receiver.take_ack().unwrap_or_else(|| receiver.ack());
        self.reported = confirmed;
        if self.postponed.is_some() {
            ack.missing = 0;
        }
        if self.reports_both {
            let confirmed = Some(Confirmed {
                first_unconfirmed: confirmed,
                companions,
            });
            return Some(Confirmation { ack, confirmed });
        }
        let ahead = u32::try_from(ack.first_unacked.since(confirmed)).unwrap_or(0);
        let ack = AckNack {
            first_unacked: confirmed,
            missing: ack.missing.checked_shl(ahead).unwrap_or(0),
            ..ack
        };
        Some(Confirmation {
            ack,
            confirmed: None,
        })
    }
}
