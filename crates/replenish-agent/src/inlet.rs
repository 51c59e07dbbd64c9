//! One stream from a client to the agent.

use crate::config::Limits;
use replenish_xrce::SeqNum;
use replenish_xrce::stream::{InputBestEffort, InputReliable};
use replenish_xrce::wire::{AckNack, StreamId, Submessage, Submessages, WireError};

/// Messages that may wait for a missing one: what the bitmap of an ACKNACK can name.
const SLOTS: usize = 16;

type Reliable = InputReliable<Box<[u8]>, Box<[u8]>, SLOTS>;

/// A stream's receiving end.
#[derive(Debug)]
pub(crate) struct Inlet {
    stream: StreamId,
    machine: Machine,
}

#[derive(Debug)]
enum Machine {
    BestEffort(InputBestEffort),
    Reliable(Box<Reliable>),
}

impl Inlet {
    /// A stream at its beginning, for messages of up to `mtu` bytes. Longer ones are understood
    /// too, but on a reliable stream only when they come in order.
    pub(crate) fn new(stream: StreamId, mtu: usize, limits: &Limits) -> Self {
        let machine = if stream.is_reliable() {
            let slots = vec![0; SLOTS * mtu].into_boxed_slice();
            let fragments = vec![0; limits.longest_submessage()].into_boxed_slice();
            Machine::Reliable(Box::new(InputReliable::new(stream, slots, mtu, fragments)))
        } else {
            Machine::BestEffort(InputBestEffort::new())
        };
        Self { stream, machine }
    }

    pub(crate) fn stream(&self) -> StreamId {
        self.stream
    }

    /// Takes in message `seq`; calls `deliver` with each submessage that is due now.
    pub(crate) fn receive(
        &mut self,
        seq: SeqNum,
        body: &[u8],
        mut deliver: impl FnMut(&Submessage<'_>),
    ) -> Result<(), WireError> {
        match &mut self.machine {
            Machine::BestEffort(machine) => {
                if machine.accept(seq) {
                    Submessages::new(body).try_for_each(|s| s.map(|s| deliver(&s)))?;
                }
            }
            Machine::Reliable(machine) => machine.receive(seq, body, deliver),
        }
        Ok(())
    }

    /// A HEARTBEAT of this stream.
    pub(crate) fn heartbeat(&mut self, last: SeqNum) {
        if let Machine::Reliable(machine) = &mut self.machine {
            machine.heartbeat(last);
        }
    }

    /// The ACKNACK to send, if one is due.
    pub(crate) fn take_ack(&mut self) -> Option<AckNack> {
        match &mut self.machine {
            Machine::BestEffort(_) => None,
            Machine::Reliable(machine) => machine.take_ack(),
        }
    }
}
