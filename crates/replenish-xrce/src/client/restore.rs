//! The requests of a session that is being restored: they go before the samples that were kept, and
//! begin the stream whose numbers the samples continue.

use crate::SeqNum;
use crate::stream::{OutputReliable, OutputStats, Reliability, StreamHeader, Tail};
use crate::time::{NEVER, Nanos};

#[derive(Debug)]
pub(super) struct Restore<S, const N: usize> {
    output: OutputReliable<S, N>,
    /// Requests go through here; no sample is sent.
    active: bool,
}

impl<S: AsRef<[u8]> + AsMut<[u8]>, const N: usize> Restore<S, N> {
    pub(super) fn new(buf: S, mtu: usize, header: StreamHeader, policy: Reliability) -> Self {
        Restore {
            output: OutputReliable::new(buf, mtu, header, Tail::Padded, policy),
            active: false,
        }
    }

    /// Whether `buf` has room for a message of `mtu` bytes: then samples are kept.
    pub(super) fn keeps(buf: &S, mtu: usize) -> bool {
        buf.as_ref().len() >= mtu
    }

    /// The largest request, submessage header included; 0 if there is no room for any.
    pub(super) fn limit(&self) -> usize {
        self.output.limit()
    }

    /// A new session begins, with samples that were kept or without.
    pub(super) fn begin(&mut self, header: StreamHeader, samples: bool) {
        self.output.reset(header);
        self.active = samples;
    }

    /// Everything was answered: the number of the first sample, if samples wait.
    pub(super) fn end(&mut self) -> Option<SeqNum> {
        let was = core::mem::take(&mut self.active);
        was.then(|| self.output.first_unacknowledged())
    }

    /// The stream that requests go on, if they go through here.
    pub(super) const fn active(&mut self) -> Option<&mut OutputReliable<S, N>> {
        if self.active {
            Some(&mut self.output)
        } else {
            None
        }
    }

    /// Whether all requests were acknowledged.
    pub(super) fn is_idle(&self) -> bool {
        !self.active || self.output.is_idle()
    }

    /// Whether requests go through here.
    pub(super) const fn is_active(&self) -> bool {
        self.active
    }

    /// Time at which there is something to send; [`NEVER`] for no time.
    pub(super) fn deadline(&self) -> Nanos {
        if self.active {
            self.output.deadline()
        } else {
            NEVER
        }
    }

    pub(super) const fn stats(&self) -> OutputStats {
        self.output.stats()
    }
}
