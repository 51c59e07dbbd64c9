//! [`PeerReader`]: what a writer knows of one reader.

use crate::wire::{Bits, Guid, SequenceNumber, SequenceSet};
use core::net::SocketAddr;

/// Fragments that one reader gets before the next one has its turn.
const RUN: u32 = 16;

/// Fragments of one sample that are to be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Fragments {
    pub(crate) sn: SequenceNumber,
    /// The number of bit 0, from 1.
    pub(crate) base: u32,
    /// Named ones; `None`: all from the base on.
    pub(crate) bits: Option<Bits>,
}

/// One matched reader.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PeerReader {
    pub(crate) guid: Guid,
    pub(crate) to: SocketAddr,
    pub(crate) reliable: bool,
    /// Samples before it are not for this reader.
    pub(crate) start: SequenceNumber,
    /// It takes samples from before the match, too.
    pub(crate) late: bool,
    /// The first sample that it must get since it has known this writer.
    pub(crate) promised: SequenceNumber,
    /// The next sample that it has not been sent.
    pub(crate) next: SequenceNumber,
    /// The next fragment of that sample, from 1.
    pub(crate) fragment: u32,
    /// All below have arrived.
    pub(crate) acked: SequenceNumber,
    /// Samples to be sent again.
    pub(crate) requested: SequenceSet,
    /// Fragments to be sent again.
    pub(crate) repair: Option<Fragments>,
    pub(crate) ack_count: Option<u32>,
    pub(crate) nack_frag_count: Option<u32>,
    pub(crate) wants_heartbeat: bool,
    /// The reader is to hear that the writer is alive, in a heartbeat of its own.
    pub(crate) asserts: bool,
    /// The reader fetches samples from shared memory.
    pub(crate) fetches: bool,
}

impl PeerReader {
    /// The last sample before those that the reader must get, as long as it has acknowledged none
    /// of these.
    ///
    /// A reader of Cyclone DDS that takes no earlier samples waits for those after the last one of
    /// the first heartbeat that it hears: the first heartbeat of the match may have been lost.
    pub(crate) fn last_unpromised(&self) -> Option<SequenceNumber> {
        let unknown = self.reliable && !self.late && self.acked <= self.promised;
        unknown.then(|| self.promised.saturating_sub(1))
    }

    /// Takes the first requested sample.
    pub(crate) fn take_request(&mut self) -> Option<SequenceNumber> {
        let sn = self.requested.iter().next()?;
        self.forget_requests_below(sn.saturating_add(1));
        Some(sn)
    }

    /// Whether the next fragment goes to this reader again, before another one has its turn: a
    /// kernel takes fragments to one address together.
    pub(crate) const fn is_amid_a_run(&self) -> bool {
        self.fragment % RUN != 1
    }

    /// Whether something is to be sent again.
    pub(crate) fn lacks(&self) -> bool {
        self.repair.is_some() || self.first_request().is_some()
    }

    /// Whether a heartbeat is to be sent. One before a repair would have it asked for twice.
    pub(crate) fn is_to_hear(&self) -> bool {
        self.asserts || (self.wants_heartbeat && !self.lacks())
    }

    /// The first requested sample.
    pub(crate) fn first_request(&self) -> Option<SequenceNumber> {
        self.requested.iter().next()
    }

    pub(crate) fn forget_requests_below(&mut self, sn: SequenceNumber) {
        let mut left = SequenceSet::empty(sn);
        for asked in self.requested.iter().filter(|asked| *asked >= sn) {
            left.insert(asked);
        }
        self.requested = left;
    }
}
