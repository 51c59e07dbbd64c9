//! Liveliness of a reader's writers (DDS 1.4, 2.2.3.11).
//!
//! A writer whose liveliness is automatic is alive as long as anything is heard of its participant.
//! A manual one has to show it itself: by a sample, or a HEARTBEAT that says so.

use super::peer_writer::PeerWriter;
use super::reader::Reader;
use crate::wire::{Guid, GuidPrefix, INFINITE, Nanos};

impl Reader {
    /// Something has come from a participant.
    pub(crate) fn heard_participant(&mut self, prefix: GuidPrefix, now: Nanos) {
        self.renew(now, |writer| {
            writer.automatic && writer.guid.prefix == prefix
        });
    }

    /// A writer has shown that it is alive.
    pub(crate) fn heard_writer(&mut self, guid: Guid, now: Nanos) {
        self.renew(now, |writer| writer.guid == guid);
    }

    fn renew(&mut self, now: Nanos, which: impl Fn(&PeerWriter) -> bool) {
        for writer in self.writers.iter_mut().filter(|writer| which(writer)) {
            writer.lease.renew(now);
        }
    }

    /// Ends the leases that are over.
    pub(crate) fn check_leases(&mut self, now: Nanos) {
        for writer in &mut self.writers {
            writer.lease.check(now);
        }
    }

    /// Time at which the first lease ends.
    pub(crate) fn next_lease(&self) -> Nanos {
        let leases = self.writers.iter().map(|writer| writer.lease.next());
        leases.min().unwrap_or(INFINITE)
    }

    /// Matched writers that are alive.
    #[must_use]
    pub fn alive(&self) -> usize {
        let alive = self.writers.iter().filter(|writer| writer.lease.is_alive());
        alive.count()
    }
}
