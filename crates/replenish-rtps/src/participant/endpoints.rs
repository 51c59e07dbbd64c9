//! Matching of own endpoints with those of others.

use super::event::{Bound, Event, Policy};
use super::matching::incompatible;
use super::remote::{RemoteEndpoint, Text};
use super::state::{Own, Participant, ReaderId, WriterId};
use crate::endpoint::Writer;
use crate::wire::{EntityId, Guid, GuidPrefix, Nanos, Qos};

/// Whether they belong together: `None` if their topics differ, else the first obstacle.
fn fit<E>(own: &Own<E>, remote: &RemoteEndpoint, offered: &Qos, asked: &Qos) -> Option<Fit> {
    if own.topic != remote.topic {
        return None;
    }
    Some(if own.type_name != remote.type_name {
        Err(Policy::Type)
    } else if !remote.default_partition {
        Err(Policy::Partition)
    } else {
        incompatible(offered, asked).map_or(Ok(()), Err)
    })
}

type Fit = Result<(), Policy>;

/// The own endpoints that a remote one meets.
#[derive(Clone, Copy)]
pub(super) enum Whom {
    /// Each of its topic.
    All,
    /// One of them.
    One(EntityId),
    /// Endpoints that fit and had no place for it.
    Waiting,
    /// Endpoints that are matched with it, after a change of its address alone.
    Matched,
}

impl Participant {
    /// Whether a participant is matched by both, and has acknowledged the announcements of both.
    ///
    /// A participant that was found may not have found ours yet: it would ignore a request, or its
    /// reply would reach nobody.
    #[must_use]
    pub fn has_counterpart(&self, writer: WriterId, reader: ReaderId) -> bool {
        let mut writers = self.writers.iter();
        let mut readers = self.readers.iter();
        let (Some(writer), Some(reader)) = (
            writers.find(|own| own.endpoint.entity() == writer.entity()),
            readers.find(|own| own.endpoint.guid().entity == reader.entity()),
        ) else {
            return false;
        };
        let mut matched = writer.endpoint.readers();
        matched.any(|Guid { prefix, .. }| {
            let knows = |sedp: &Writer, number| {
                prefix == self.prefix || sedp.is_acknowledged_by(prefix, number)
            };
            reader
                .endpoint
                .writers()
                .any(|theirs| theirs.prefix == prefix)
                && knows(&self.publications.0, writer.announced)
                && knows(&self.subscriptions.0, reader.announced)
        })
    }

    /// A new writer of ours meets every reader that is known.
    pub(super) fn match_writer(&mut self, entity: EntityId, now: Nanos) {
        for at in 0..self.remotes.len() {
            self.pair(Whom::One(entity), at, now);
        }
    }

    /// A new reader of ours meets every writer that is known.
    pub(super) fn match_reader(&mut self, entity: EntityId, now: Nanos) {
        for at in 0..self.remotes.len() {
            self.pair(Whom::One(entity), at, now);
        }
    }

    /// A remote endpoint meets own ones.
    pub(super) fn pair(&mut self, whom: Whom, at: usize, now: Nanos) {
        let Some(remote) = self.remotes.get(at).copied() else {
            return;
        };
        let theirs = remote.guid;
        self.promise(&remote.qos);
        // One that waits has been reported before.
        let passed = |guid: Guid, known, fit: Fit| match whom {
            Whom::All => false,
            Whom::One(entity) => entity != guid.entity,
            Whom::Waiting => known || fit.is_err(),
            Whom::Matched => !known,
        };
        if theirs.entity.is_reader() {
            for at in 0..self.writers.len() {
                let Some(own) = self.writers.get_mut(at) else {
                    continue;
                };
                let ours = own.endpoint.guid();
                let Some(fit) = fit(own, &remote, own.endpoint.qos(), &remote.qos) else {
                    continue;
                };
                let known = own.endpoint.readers().any(|guid| guid == theirs);
                if passed(ours, known, fit) {
                    continue;
                }
                let taken =
                    fit.is_ok() && own.endpoint.add_reader(theirs, &remote.qos, remote.to, now);
                if known && fit.is_err() {
                    own.endpoint.remove_reader(theirs);
                }
                own.status.met(known, fit, taken);
                self.report_pair(ours, theirs, known, fit, taken);
            }
        } else {
            for at in 0..self.readers.len() {
                let Some(own) = self.readers.get_mut(at) else {
                    continue;
                };
                let ours = own.endpoint.guid();
                let Some(fit) = fit(own, &remote, &remote.qos, own.endpoint.qos()) else {
                    continue;
                };
                let known = own.endpoint.writers().any(|guid| guid == theirs);
                if passed(ours, known, fit) {
                    continue;
                }
                let taken = fit.is_ok() && own.endpoint.add_writer(theirs, &remote.qos, remote.to);
                if taken {
                    own.endpoint.offer(theirs, remote.segment);
                }
                if taken && !known {
                    own.endpoint.heard_writer(theirs, now);
                }
                if known && fit.is_err() {
                    own.endpoint.remove_writer(theirs);
                }
                own.status.met(known, fit, taken);
                self.report_pair(ours, theirs, known, fit, taken);
            }
        }
    }

    fn report_pair(&mut self, ours: Guid, theirs: Guid, known: bool, fit: Fit, taken: bool) {
        match fit {
            Err(policy) => {
                if known {
                    self.report(Event::Unmatched(ours, theirs));
                }
                self.report(Event::Incompatible(ours, theirs, policy));
            }
            Ok(()) if known => {}
            Ok(()) if taken => self.report(Event::Matched(ours, theirs)),
            Ok(()) => {
                self.is_crowded = true;
                self.report(Event::Full(Bound::Matches));
            }
        }
    }

    /// A remote endpoint is announced, for the first time or again.
    pub(super) fn learn(&mut self, remote: RemoteEndpoint, now: Nanos) {
        let known = self.known.iter().position(|known| *known == remote.guid);
        let foreign = remote.guid.prefix != self.prefix;
        let at = match known {
            Some(at) => at,
            None if !self.whole_graph && !self.has_topic(&remote.topic) => return,
            None if foreign && self.foreign >= self.most_foreign => {
                self.report(Event::Full(Bound::Endpoints));
                let of = remote.guid.prefix;
                let from = self.participants.iter_mut().find(|one| one.prefix == of);
                if let Some(from) = from {
                    from.refused = true;
                }
                return;
            }
            None => {
                self.remotes.push(remote);
                self.known.push(remote.guid);
                self.foreign = self.foreign.saturating_add(usize::from(foreign));
                self.remotes.len().saturating_sub(1)
            }
        };
        let mut whom = Whom::All;
        if let Some(place) = self.remotes.get_mut(at) {
            if known.is_some() && place.fits_as(&remote) {
                whom = Whom::Matched;
            }
            *place = remote;
        }
        self.pair(whom, at, now);
    }

    /// Whether an own endpoint has this topic.
    fn has_topic(&self, topic: &Text) -> bool {
        let writers = self.writers.iter().map(|own| &own.topic);
        let mut own = writers.chain(self.readers.iter().map(|own| &own.topic));
        own.any(|own| own == topic)
    }

    /// A remote endpoint is gone.
    pub(super) fn unlearn(&mut self, theirs: Guid, now: Nanos) {
        self.forget(|guid| guid == theirs);
        self.give_places(now);
    }

    /// Endpoints that fit and had no place get one that is free now.
    fn give_places(&mut self, now: Nanos) {
        if !self.is_crowded {
            return;
        }
        self.is_crowded = false;
        for at in 0..self.remotes.len() {
            self.pair(Whom::Waiting, at, now);
        }
    }

    /// Forgets the endpoints that `gone` chooses. One pass over all that is known, however many go.
    fn forget(&mut self, gone: impl Fn(Guid) -> bool) {
        let mut at = 0;
        while let Some(guid) = self.known.get(at).copied() {
            if !gone(guid) {
                at = at.saturating_add(1);
                continue;
            }
            self.known.swap_remove(at);
            self.remotes.swap_remove(at);
            let foreign = usize::from(guid.prefix != self.prefix);
            self.foreign = self.foreign.saturating_sub(foreign);
        }
        for at in 0..self.writers.len() {
            while let Some((ours, theirs)) = self.writers.get_mut(at).and_then(|own| {
                let theirs = own.endpoint.readers().find(|guid| gone(*guid))?;
                own.endpoint.remove_reader(theirs);
                Some((own.endpoint.guid(), theirs))
            }) {
                self.report(Event::Unmatched(ours, theirs));
            }
        }
        for at in 0..self.readers.len() {
            while let Some((ours, theirs)) = self.readers.get_mut(at).and_then(|own| {
                let theirs = own.endpoint.writers().find(|guid| gone(*guid))?;
                own.endpoint.remove_writer(theirs);
                Some((own.endpoint.guid(), theirs))
            }) {
                self.report(Event::Unmatched(ours, theirs));
            }
        }
    }

    /// A participant is gone, with everything it had.
    pub(super) fn lose(&mut self, prefix: GuidPrefix, now: Nanos) {
        let before = self.participants.len();
        self.participants.retain(|known| known.prefix != prefix);
        if before == self.participants.len() {
            return;
        }
        for (writer, reader) in [
            &mut self.publications,
            &mut self.subscriptions,
            &mut self.liveliness,
        ] {
            writer.remove_participant(prefix);
            reader.remove_participant(prefix);
        }
        self.forget(|guid| guid.prefix == prefix);
        self.report(Event::ParticipantLost(prefix));
        self.give_places(now);
    }
}
