//! Deadlines and liveliness of own endpoints kept and broken, and the counts of it.

use super::promises::Assertions;
use super::state::{Own, Participant, ReaderId, WriterId};
use super::status::EndpointStatus;
use crate::endpoint::Content;
use crate::wire::{CDR_LE, Guid, GuidPrefix, INFINITE, LivelinessKind, Nanos, Qos};

/// Kind of `ParticipantMessageData`: liveliness is automatic (RTPS 2.5, 9.6.3.1).
const AUTOMATIC: [u8; 4] = [0, 0, 0, 1];

impl Participant {
    /// A writer whose liveliness is manual shows that it is alive, without a sample. `false` if
    /// there is no such writer.
    pub fn assert_liveliness(&mut self, id: WriterId, now: Nanos) -> bool {
        let mut writers = self.writers.iter_mut();
        let own = writers.find(|own| own.endpoint.entity() == id.entity());
        own.is_some_and(|own| {
            own.promises.lease.renew(now);
            own.endpoint.assert();
            true
        })
    }

    /// The time at which [`transmit_writer`](Self::transmit_writer) is to be called.
    #[must_use]
    pub fn writer_next_at(&self, id: WriterId, now: Nanos) -> Nanos {
        let mut writers = self.writers.iter();
        let own = writers.find(|own| own.endpoint.entity() == id.entity());
        own.map_or(INFINITE, |own| {
            let next = own.endpoint.contents_next_at(&[Content::New], now);
            next.min(own.promises.next())
        })
    }

    /// An endpoint whose promises have to be watched has come.
    pub(super) fn promise(&mut self, qos: &Qos) {
        self.timed |= qos.deadline != INFINITE || qos.liveliness_lease != INFINITE;
    }

    /// Own writers have come or gone: how often do they have to be asserted?
    pub(super) fn plan_assertions(&mut self, now: Nanos) {
        let qos = self.writers.iter().map(|own| own.endpoint.qos());
        let automatic = qos.filter(|qos| qos.liveliness == LivelinessKind::Automatic);
        let shortest = automatic.map(|qos| qos.liveliness_lease).min();
        let shortest = shortest.filter(|lease| *lease != INFINITE && *lease > 0);
        self.assertions = shortest.map_or(Assertions::NONE, |lease| Assertions {
            period: (lease / 3).max(1_000_000),
            at: now,
        });
    }

    /// Something has come from a participant; samples may be ready.
    pub(super) fn heard(&mut self, from: GuidPrefix, now: Nanos) {
        self.renew_lease(from, now);
        if !self.timed {
            return;
        }
        for own in &mut self.readers {
            own.endpoint.heard_participant(from, now);
            let received = own.endpoint.stats().received;
            if own.promises.received != received {
                own.promises.received = received;
                own.promises.deadline.renew(now);
            }
        }
    }

    /// A participant is alive whatever it sends, also where its announcements are lost in a crowd
    /// of others'. An eighth of the lease later at the earliest: the alarm is seldom set anew.
    fn renew_lease(&mut self, from: GuidPrefix, now: Nanos) {
        let last = self.participants.get(self.heard_last);
        if last.is_none_or(|last| last.prefix != from) {
            let found = self.participants.iter().position(|p| p.prefix == from);
            let Some(found) = found else {
                return;
            };
            self.heard_last = found;
        }
        if let Some(known) = self.participants.get_mut(self.heard_last) {
            let renewed = now.saturating_add(known.lease);
            if renewed.saturating_sub(known.expires) > known.lease / 8 {
                known.expires = renewed;
            }
        }
    }

    /// A writer has shown that it is alive.
    pub(super) fn heard_writer(&mut self, guid: Guid, now: Nanos) {
        if self.timed {
            for own in &mut self.readers {
                own.endpoint.heard_writer(guid, now);
            }
        }
    }

    /// When a promise is broken next, or an assertion is due.
    pub(super) fn next_promise(&self) -> Nanos {
        if !self.timed {
            return INFINITE;
        }
        let writers = self.writers.iter().map(|own| own.promises.next());
        let readers = self.readers.iter();
        let readers = readers.map(|own| own.promises.next().min(own.endpoint.next_lease()));
        let first = writers.chain(readers).min().unwrap_or(INFINITE);
        first.min(self.assertions.at)
    }

    /// Counts the promises that are broken by now, and asserts what is alive.
    pub(super) fn check_promises(&mut self, now: Nanos) {
        if !self.timed {
            return;
        }
        for own in &mut self.writers {
            own.promises.check(now);
        }
        for own in &mut self.readers {
            if own.endpoint.matched() == 0 {
                own.promises.deadline.stop();
            }
            own.promises.check(now);
            own.endpoint.check_leases(now);
        }
        if self.assertions.at <= now && !self.leaving {
            self.assertions.at = now.saturating_add(self.assertions.period);
            let mut message = [0; 24];
            let parts = [&CDR_LE[..], &self.prefix.0, &AUTOMATIC];
            let bytes = parts.into_iter().flatten();
            for (to, from) in message.iter_mut().zip(bytes) {
                *to = *from;
            }
            // It keeps the last one alone: there is room.
            self.liveliness.0.write(&message, None, now).ok();
        }
    }
}

impl Participant {
    /// The counts of a writer.
    #[must_use]
    pub fn writer_status(&self, id: WriterId) -> Option<EndpointStatus> {
        let mut writers = self.writers.iter();
        let own = writers.find(|own| own.endpoint.entity() == id.entity())?;
        Some(EndpointStatus {
            matched: own.endpoint.matched(),
            deadline_missed: own.promises.deadline.missed(),
            liveliness_lost: own.promises.lease.lost(),
            ..own.status
        })
    }

    /// The counts of a reader.
    #[must_use]
    pub fn reader_status(&self, id: ReaderId) -> Option<EndpointStatus> {
        let of = |own: &&Own<crate::endpoint::Reader>| own.endpoint.guid().entity == id.entity();
        let own = self.readers.iter().find(of)?;
        Some(EndpointStatus {
            matched: own.endpoint.matched(),
            alive: own.endpoint.alive(),
            deadline_missed: own.promises.deadline.missed(),
            ..own.status
        })
    }
}
