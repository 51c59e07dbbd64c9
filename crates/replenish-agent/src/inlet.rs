//! One stream from a client to the agent.

use crate::limits::Limits;
use crate::sample::{Charge, Ledger};
use replenish_xrce::SeqNum;
use replenish_xrce::stream::{InputBestEffort, InputReliable};
use replenish_xrce::wire::{AckNack, StreamId, Submessage, Submessages};

/// Messages that may wait for a missing one: what the bitmap of an ACKNACK can name.
const SLOTS: usize = 16;

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
    _charge: Charge,
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

    /// Whether an ACKNACK is due.
    pub(crate) fn ack_due(&self) -> bool {
        match &self.machine {
            Machine::BestEffort(_) => false,
            Machine::Reliable(machine) => machine.ack_due(),
        }
    }

    /// The ACKNACK to send, if one is due. It names nothing as missing while messages are
    /// postponed: they would only come again.
    pub(crate) fn take_ack(&mut self) -> Option<AckNack> {
        let ack = match &mut self.machine {
            Machine::BestEffort(_) => None,
            Machine::Reliable(machine) => machine.take_ack(),
        };
        ack.map(|ack| match self.postponed {
            Some(_) => AckNack { missing: 0, ..ack },
            None => ack,
        })
    }
}
