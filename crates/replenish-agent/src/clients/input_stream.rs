//! One stream from a client to the agent.

use crate::config::Limits;
use crate::flow::{Charge, Ledger, Receipt, Token};
use replenish_xrce::Nanos;
use replenish_xrce::SeqNum;
use replenish_xrce::stream::{InputBestEffort, InputReliable};
use replenish_xrce::wire::{AckNack, Confirmation, Confirmed, StreamId, Submessage, Submessages};
use std::collections::VecDeque;
use std::sync::{Arc, Weak};

/// Messages that may wait for a missing one: what the bitmap of an ACKNACK can name.
const SLOTS: usize = 16;

/// Newly settled messages of which a client that is told both is told at once; fewer wait for more,
/// or until all are.
const SETTLED_AT_ONCE: i16 = 8;

type Reliable = InputReliable<Box<[u8]>, Box<[u8]>, SLOTS>;

/// A message, or what was put together of its fragments, made no sense from somewhere on.
#[derive(Debug)]
pub(crate) struct Malformed;

/// A stream's receiving end.
#[derive(Debug)]
pub(crate) struct Inlet {
    stream: StreamId,
    machine: Machine,
    /// The last message that was not taken because there is no room for what it brings.
    postponed: Option<SeqNum>,
    /// Messages that are not settled, the oldest first.
    unsettled: VecDeque<Unsettled>,
    /// The first message that the client does not know to be settled.
    told: SeqNum,
    /// The client is told what has come as well as what is settled; else only the latter.
    tells_both: bool,
    _charge: Charge,
}

/// Messages from one on that wait for a receipt.
#[derive(Debug)]
struct Unsettled {
    from: SeqNum,
    receipt: Weak<Token>,
    /// They count as settled from then on.
    until: Nanos,
}

#[derive(Debug)]
enum Machine {
    BestEffort(InputBestEffort),
    Reliable(Box<Reliable>),
}

impl Inlet {
    /// A stream at its beginning, for messages of up to `mtu` bytes. Longer ones are understood
    /// too, but on a reliable stream only when they come in order. `None` if the client may not
    /// have so much memory.
    pub(crate) fn new(
        stream: StreamId,
        mtu: usize,
        tells_both: bool,
        limits: &Limits,
        ledger: &Ledger,
    ) -> Option<Self> {
        let bytes = if stream.is_reliable() {
            SLOTS * mtu + limits.longest_submessage()
        } else {
            0
        };
        let charge = ledger.charge(bytes)?;
        let machine = if stream.is_reliable() {
            let slots = vec![0; SLOTS * mtu].into_boxed_slice();
            let fragments = vec![0; limits.longest_submessage()].into_boxed_slice();
            Machine::Reliable(Box::new(InputReliable::new(stream, slots, mtu, fragments)))
        } else {
            Machine::BestEffort(InputBestEffort::new())
        };
        Some(Self {
            stream,
            machine,
            postponed: None,
            unsettled: VecDeque::new(),
            told: SeqNum(0),
            tells_both,
            _charge: charge,
        })
    }

    pub(crate) fn stream(&self) -> StreamId {
        self.stream
    }

    /// Takes in message `seq`; calls `deliver` with each submessage that is due now.
    ///
    /// # Errors
    /// Something was malformed, or too long when its fragments were put together; it was dropped.
    pub(crate) fn receive(
        &mut self,
        seq: SeqNum,
        body: &[u8],
        mut deliver: impl FnMut(&Submessage<'_>),
    ) -> Result<(), Malformed> {
        match &mut self.machine {
            Machine::BestEffort(machine) => {
                if machine.accept(seq) {
                    let mut submessages = Submessages::new(body);
                    return submessages
                        .try_for_each(|s| s.map(|s| deliver(&s)))
                        .map_err(|_| Malformed);
                }
            }
            Machine::Reliable(machine) => {
                let damage = |machine: &Reliable| {
                    let stats = machine.stats();
                    stats.malformed.saturating_add(stats.too_long)
                };
                let before = damage(machine);
                machine.receive(seq, body, deliver);
                if damage(machine) != before {
                    return Err(Malformed);
                }
            }
        }
        Ok(())
    }

    /// A HEARTBEAT of this stream.
    pub(crate) fn heartbeat(&mut self, last: SeqNum) {
        if let Machine::Reliable(machine) = &mut self.machine {
            machine.heartbeat(last);
        }
    }

    /// Message `seq` has come, but is not taken now; whether that can be. What was taken before is
    /// acknowledged again, and on a best-effort stream there is nothing to come back to.
    pub(crate) fn postpone(&mut self, seq: SeqNum) -> bool {
        let Machine::Reliable(machine) = &self.machine else {
            return false;
        };
        if machine.next_expected().is_after(seq) {
            return false;
        }
        if self.postponed.is_none_or(|last| seq.is_after(last)) {
            self.postponed = Some(seq);
        }
        true
    }

    /// There is room again: asks for what was postponed.
    pub(crate) fn resume(&mut self) {
        if let Some(last) = self.postponed.take() {
            self.heartbeat(last);
        }
    }

    /// The first message that has not been taken in, on a reliable stream.
    pub(crate) fn next(&self) -> SeqNum {
        match &self.machine {
            Machine::BestEffort(_) => SeqNum(0),
            Machine::Reliable(machine) => machine.next_expected(),
        }
    }

    /// The messages from `from` on that have just come are not settled before nobody holds
    /// `receipt` any more, or `until` has come.
    pub(crate) fn withhold(&mut self, from: SeqNum, receipt: &Receipt, until: Nanos) {
        self.unsettled.push_back(Unsettled {
            from,
            receipt: Arc::downgrade(receipt),
            until,
        });
    }

    /// Notes what is settled by now; returns how many were not in time.
    pub(crate) fn settle(&mut self, now: Nanos) -> u64 {
        let mut late = 0;
        while let Some(oldest) = self.unsettled.front() {
            let held = oldest.receipt.strong_count() > 0;
            if held && now < oldest.until {
                break;
            }
            late += u64::from(held);
            self.unsettled.pop_front();
        }
        late
    }

    /// When something counts as settled at the latest.
    pub(crate) fn deadline(&self) -> Option<Nanos> {
        self.unsettled.front().map(|oldest| oldest.until)
    }

    /// The first message that is not settled.
    fn first_unsettled(&self) -> SeqNum {
        let oldest = self.unsettled.front();
        oldest.map_or_else(|| self.next(), |oldest| oldest.from)
    }

    /// Whether an ACKNACK is due. What has come and is not settled is no reason for one to a client
    /// that is told nothing else.
    pub(crate) fn ack_due(&self) -> bool {
        let Machine::Reliable(machine) = &self.machine else {
            return false;
        };
        let settled = self.first_unsettled();
        let progress = settled.since(self.told);
        if self.tells_both {
            let enough = settled == self.next() || progress >= SETTLED_AT_ONCE;
            machine.ack_due() || (progress > 0 && enough)
        } else {
            machine.is_urgent() || progress > 0
        }
    }

    /// The ACKNACK to send, if one is due. It names nothing as missing while messages are
    /// postponed: they would only come again.
    pub(crate) fn take_ack(&mut self, companions: u8) -> Option<Confirmation> {
        if !self.ack_due() {
            return None;
        }
        let settled = self.first_unsettled();
        let Machine::Reliable(machine) = &mut self.machine else {
            return None;
        };
        let mut ack = machine.take_ack().unwrap_or_else(|| machine.ack());
        self.told = settled;
        if self.postponed.is_some() {
            ack.missing = 0;
        }
        if self.tells_both {
            let confirmed = Some(Confirmed {
                first_unconfirmed: settled,
                companions,
            });
            return Some(Confirmation { ack, confirmed });
        }
        let ahead = u32::try_from(ack.first_unacked.since(settled)).unwrap_or(0);
        let ack = AckNack {
            first_unacked: settled,
            missing: ack.missing.checked_shl(ahead).unwrap_or(0),
            ..ack
        };
        Some(Confirmation {
            ack,
            confirmed: None,
        })
    }
}
