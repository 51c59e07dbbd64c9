//! Participants whose addresses change: our own, and those of others.
//!
//! ```text
//!   an interface comes or goes ──► move_to: the participant's announcement, quickly at first,
//!                                           or goodbye, to those who have to meet it anew
//!                              ──► announce_moved, for each endpoint: its announcement, anew
//!   others, again ──► meet_again ──► relocate ◄── an endpoint of others, again
//! ```

use super::announcements::{LONGEST, OWN_BYTES, QUICK};
use super::endpoints::Whom;
use super::event::Event;
use super::remote::{RemoteEndpoint, addresses};
use super::state::{BUILTIN, Participant};
use crate::endpoint::Writer;
use crate::wire::{
    EndpointData, EntityId, Guid, GuidPrefix, INFINITE, Locators, Nanos, ParticipantData, Reach,
    SequenceNumber, VENDOR, Writer as Cdr, builtin,
};
use core::net::SocketAddr;

/// Each with one of the quick announcements.
const GOODBYES: u8 = 2;
/// Nanoseconds until the first of them: one change of an address may be several to the kernel, with
/// moments without any way in between.
const SETTLE: Nanos = 20_000_000;

/// Nanoseconds after which a participant that was met anew has acknowledged something, or is said
/// goodbye to again.
const DOUBT: Nanos = 2_000_000_000;

impl Participant {
    /// Takes the memory for [`move_to`](Self::move_to), which takes none.
    pub fn expect_moves(&mut self) {
        let more = LONGEST.saturating_sub(self.announcement.len());
        self.announcement.reserve_exact(more);
        self.abroad.reserve_exact(Locators::MOST);
        self.note_abroad();
    }

    /// From now on the participant and its endpoints are reached at the IP addresses of `at`, with
    /// the ports that they have. Peers are told of the participant, and by
    /// [`announce_moved`](Self::announce_moved) of its endpoints. Without an address nothing
    /// changes.
    pub fn move_to(&mut self, at: &Locators, now: Nanos) {
        if at.is_empty() || self.leaving {
            return;
        }
        self.discovery = moved(&self.discovery, at);
        self.user = moved(&self.user, at);
        self.reach = Reach::of(&self.discovery);
        self.host.addresses = self.user;
        self.write_announcement();
        // Its number goes on: peers ignore an older one.
        self.quick_until = self.announced.saturating_add(QUICK);
        self.announce_at = now.saturating_add(SETTLE);
        if self.note_abroad() {
            for known in &mut self.participants {
                known.goodbyes = if follows(known.vendor) { 0 } else { GOODBYES };
            }
        }
        for own in &mut self.writers {
            own.endpoint.set_host(self.host);
            own.moved = true;
        }
        for own in &mut self.readers {
            own.moved = true;
        }
    }

    /// After [`move_to`](Self::move_to): announces the next endpoint anew; `false` after the
    /// last one.
    pub fn announce_moved(&mut self, now: Nanos) -> bool {
        let (user, writers) = (self.user, &mut self.publications.0);
        let (guid, told) = if let Some(own) = self.writers.iter_mut().find(|own| own.moved) {
            own.moved = false;
            let told = announce_again(writers, &mut own.announced, &user, now);
            (own.endpoint.guid(), told)
        } else if let Some(own) = self.readers.iter_mut().find(|own| own.moved) {
            own.moved = false;
            let readers = &mut self.subscriptions.0;
            let told = announce_again(readers, &mut own.announced, &user, now);
            (own.endpoint.guid(), told)
        } else {
            return false;
        };
        // Own endpoints may hear each other.
        let known = self.known.iter().position(|known| *known == guid);
        let to = told.and_then(|told| told.best(self.reach, &self.discovery));
        if let (Some(at), Some(to)) = (known, to) {
            self.relocate(at, to, now);
        }
        true
    }

    /// Keeps the addresses beyond this host, if there are some; whether one of those before is
    /// gone: a peer may use it. Without any address they may all come back.
    fn note_abroad(&mut self) -> bool {
        if self.reach.local {
            return false;
        }
        let stays = |old: &SocketAddr| self.discovery.iter().any(|now| now == *old);
        let gone = !self.abroad.iter().all(stays);
        self.abroad.clear();
        self.abroad.extend(self.discovery.iter());
        gone
    }

    /// Writes the participant's announcement anew, with the addresses of now.
    fn write_announcement(&mut self) {
        let mut room = [0; LONGEST];
        let mut w = Cdr::new(&mut room);
        if let Ok(data) = ParticipantData::decode(&self.announcement) {
            let data = ParticipantData {
                metatraffic_unicast: self.discovery,
                default_unicast: self.user,
                ..data
            };
            data.encode(&mut w);
        }
        if let Ok(bytes) = w.finish() {
            self.announcement.clear();
            self.announcement.extend_from_slice(bytes);
        }
    }

    /// A participant that is known has announced itself again.
    pub(super) fn meet_again(&mut self, at: usize, data: &ParticipantData<'_>, now: Nanos) {
        let Some(known) = self.participants.get_mut(at) else {
            return;
        };
        known.lease = data.lease;
        known.expires = now.saturating_add(data.lease);
        if known.refused && self.foreign < self.most_foreign {
            // Discovery's writers repeat all that they have.
            known.refused = false;
            self.publications.1.begin_anew(known.prefix);
            self.subscriptions.1.begin_anew(known.prefix);
        }
        // One that was not listening yet when it was answered announces itself again.
        let unheard = self.publications.0.is_unheard_by(known.prefix);
        known.answer |= unheard;
        if unheard && known.doubted_at <= now {
            // It has heard no goodbye, and sends to an address of before.
            (known.goodbyes, known.doubted_at) = (GOODBYES, INFINITE);
            self.quick_until = self.announced.saturating_add(QUICK);
            self.announce_at = now;
            return;
        }
        let Some((discovery, user)) = addresses(data, (self.reach, &self.discovery)) else {
            return;
        };
        let (before, prefix) = (known.user, known.prefix);
        let anew = core::mem::take(&mut known.anew);
        if anew {
            known.doubted_at = now.saturating_add(DOUBT);
        } else if !unheard {
            known.doubted_at = INFINITE;
        }
        if !anew && (known.discovery, before) == (discovery, user) {
            return;
        }
        (known.discovery, known.user) = (discovery, user);
        known.answer = true;
        if anew {
            self.report(Event::ParticipantFound(prefix));
        }
        self.meet_builtin(prefix, data.builtin, discovery, now);
        for at in 0..self.remotes.len() {
            let remote = self.remotes.get(at);
            // Others have addresses of their own, and announce new ones themselves.
            let there = |remote: &&RemoteEndpoint| remote.to == before;
            if remote
                .filter(there)
                .is_some_and(|remote| remote.guid.prefix == prefix)
            {
                self.relocate(at, user, now);
            }
        }
    }

    /// Matches the endpoints of discovery with those that a participant says it has; those that are
    /// matched get the new address.
    pub(super) fn meet_builtin(
        &mut self,
        prefix: GuidPrefix,
        has: u32,
        to: SocketAddr,
        now: Nanos,
    ) {
        for (bit, entity, side) in [
            (
                builtin::PUBLICATIONS_READER,
                EntityId::SEDP_PUBLICATIONS_READER,
                0,
            ),
            (
                builtin::SUBSCRIPTIONS_READER,
                EntityId::SEDP_SUBSCRIPTIONS_READER,
                1,
            ),
            (
                builtin::PUBLICATIONS_WRITER,
                EntityId::SEDP_PUBLICATIONS_WRITER,
                0,
            ),
            (
                builtin::SUBSCRIPTIONS_WRITER,
                EntityId::SEDP_SUBSCRIPTIONS_WRITER,
                1,
            ),
            (builtin::LIVELINESS_READER, EntityId::LIVELINESS_READER, 2),
            (builtin::LIVELINESS_WRITER, EntityId::LIVELINESS_WRITER, 2),
        ] {
            if has & bit == 0 {
                continue;
            }
            let guid = Guid::new(prefix, entity);
            let (writer, reader) = match side {
                0 => &mut self.publications,
                1 => &mut self.subscriptions,
                _ => &mut self.liveliness,
            };
            if entity.is_reader() {
                writer.add_reader(guid, &BUILTIN, to, now);
            } else {
                reader.add_writer(guid, &BUILTIN, to);
            }
        }
    }

    /// A known endpoint is reached at another address.
    fn relocate(&mut self, at: usize, to: SocketAddr, now: Nanos) {
        if let Some(remote) = self.remotes.get_mut(at) {
            remote.to = to;
            self.pair(Whom::Matched, at, now);
        }
    }
}

/// Whether an implementation takes other addresses from a participant that it knows. Fast DDS (2.9,
/// 2.14, 3.2) and Cyclone (0.10, 11) go on to send what belongs to discovery to the old ones: they
/// have to hear that the participant is gone, and meet it anew.
fn follows(vendor: [u8; 2]) -> bool {
    vendor == VENDOR
}

/// The IP addresses of `to` with the port of `from`.
fn moved(from: &Locators, to: &Locators) -> Locators {
    let port = from.iter().next().map_or(0, |addr| addr.port());
    let there = to.iter().map(|addr| SocketAddr::new(addr.ip(), port));
    there.collect()
}

/// Announces an own endpoint with the IP addresses of `user`: at the port that it named, or else at
/// that of `user`. Returns where it is reached then.
fn announce_again(
    sedp: &mut Writer,
    announced: &mut SequenceNumber,
    user: &Locators,
    now: Nanos,
) -> Option<Locators> {
    let mut data = EndpointData::decode(sedp.kept(*announced)?).ok()?;
    data.unicast = if data.unicast.is_empty() {
        *user
    } else {
        moved(&data.unicast, user)
    };
    let unicast = data.unicast;
    let mut room = [0; OWN_BYTES];
    let mut w = Cdr::new(&mut room);
    data.encode(&mut w);
    let bytes = w.finish().ok()?;
    sedp.forget(*announced);
    *announced = sedp.announce_instance(bytes, now);
    Some(unicast)
}
