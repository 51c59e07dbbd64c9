//! The next datagram of a participant: an announcement, an answer of a reader, or samples.
//!
//! Discovery and repairs are parts of their own: a caller may bound their time while samples go
//! out.

use super::event::Event;
use super::remote::RemoteParticipant;
use super::state::{Own, Participant, WriterId};
use crate::endpoint::{Content, Reader, Writer};
use crate::wire::{
    Data, EntityId, Guid, GuidPrefix, INFINITE, MessageWriter, Nanos, Payload, disposal,
};
use core::net::SocketAddr;

/// The time between quick announcements.
const QUICK_PERIOD: Nanos = 100_000_000;

/// A part of what a participant sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    /// Announcements of the participant and of its endpoints, and answers to those of others.
    Discovery,
    /// Samples for the first time, heartbeats and answers of own endpoints, and assertions of
    /// liveliness.
    Samples,
    /// Samples that readers ask for again.
    Repairs,
}

impl Participant {
    /// Builds the next datagram in `buf`, which has room for the longer of the two configured sizes
    /// of datagrams. Returns its length and its address; `None` if nothing is to be sent before
    /// [`Participant::next_at`].
    pub fn transmit(&mut self, buf: &mut [u8], now: Nanos) -> Option<(usize, SocketAddr)> {
        self.look_at_clock(now);
        let mut m = MessageWriter::new(buf, self.prefix).ok()?;
        let mut parts = [Part::Discovery, Part::Samples, Part::Repairs].into_iter();
        let to = parts.find_map(|part| self.transmit_one(part, now, &mut m));
        Some((m.len(), to?))
    }

    /// As [`transmit`](Self::transmit), of one part alone: a caller may bound the time for
    /// discovery and for repairs.
    pub fn transmit_part(
        &mut self,
        part: Part,
        buf: &mut [u8],
        now: Nanos,
    ) -> Option<(usize, SocketAddr)> {
        self.look_at_clock(now);
        let mut m = MessageWriter::new(buf, self.prefix).ok()?;
        let to = self.transmit_one(part, now, &mut m)?;
        Some((m.len(), to))
    }

    fn transmit_one(
        &mut self,
        part: Part,
        now: Nanos,
        m: &mut MessageWriter<'_>,
    ) -> Option<SocketAddr> {
        match part {
            Part::Discovery => self.transmit_discovery(now, m),
            Part::Samples => self.transmit_samples(now, m),
            Part::Repairs => self.transmit_content(Content::Repairs, now, m),
        }
    }

    /// Leases and promises whose time is over have ended.
    fn look_at_clock(&mut self, now: Nanos) {
        self.expire(now);
        self.check_promises(now);
    }

    /// Builds the next datagram of one writer's [`Part::Samples`] alone: what the thread that wrote
    /// a sample sends without others' work.
    pub fn transmit_writer(
        &mut self,
        id: WriterId,
        buf: &mut [u8],
        now: Nanos,
    ) -> Option<(usize, SocketAddr)> {
        let mut m = MessageWriter::new(buf, self.prefix).ok()?;
        let mut writers = self.writers.iter_mut();
        let own = writers.find(|own| own.endpoint.entity() == id.0)?;
        let writer = &mut own.endpoint;
        let to = transmit(writer, &mut self.readers, (Content::New, now), &mut m)?;
        Some((m.len(), to))
    }

    /// The time at which [`Participant::transmit`] is to be called at the latest; `now`: at once.
    #[must_use]
    pub fn next_at(&self, now: Nanos) -> Nanos {
        let mut first = INFINITE;
        for part in [Part::Discovery, Part::Samples, Part::Repairs] {
            first = first.min(self.part_next_at(part, now));
            if first <= now {
                break;
            }
        }
        first
    }

    /// The time at which [`Participant::transmit_part`] is to be called at the latest; `now`: at
    /// once.
    #[must_use]
    pub fn part_next_at(&self, part: Part, now: Nanos) -> Nanos {
        let next = match part {
            Part::Discovery => self.discovery_next_at(now),
            Part::Samples => self.samples_next_at(now),
            Part::Repairs => self.content_next_at(Content::Repairs, now),
        };
        next.max(now)
    }

    fn discovery_next_at(&self, now: Nanos) -> Nanos {
        if self.announce_left > 0 || self.participants.iter().any(|known| known.answer) {
            return now;
        }
        let sides = [&self.publications, &self.subscriptions];
        let sides = sides.map(|(writer, reader)| writer.next_at(now).min(reader.answers_at()));
        let leases = self.participants.iter().map(|known| known.expires);
        let first = leases.chain(sides).min().unwrap_or(INFINITE);
        first.min(self.announce_at)
    }

    fn samples_next_at(&self, now: Nanos) -> Nanos {
        let (assertions, answers) = &self.liveliness;
        let readers = self.readers.iter().map(|own| &own.endpoint);
        let answers = readers.chain([answers]).map(Reader::answers_at).min();
        let answers = answers.unwrap_or(INFINITE);
        if answers <= now {
            return now;
        }
        let writers = self.content_next_at(Content::New, now);
        let first = writers.min(assertions.next_at(now)).min(answers);
        first.min(self.next_promise())
    }

    fn content_next_at(&self, content: Content, now: Nanos) -> Nanos {
        let writers = self.writers.iter().map(|own| &own.endpoint);
        let first = writers.map(|writer| writer.contents_next_at(&[content], now));
        first.min().unwrap_or(INFINITE)
    }

    /// Participants that were not heard for their lease are gone.
    fn expire(&mut self, now: Nanos) {
        let over = |known: &&super::RemoteParticipant| known.expires <= now;
        while let Some(prefix) = self
            .participants
            .iter()
            .find(over)
            .map(|known| known.prefix)
        {
            self.report(Event::Silent(prefix));
            self.lose(prefix, now);
        }
    }

    fn transmit_announcement(
        &mut self,
        now: Nanos,
        m: &mut MessageWriter<'_>,
    ) -> Option<SocketAddr> {
        // A new participant is answered before anything else.
        if let Some(known) = self.participants.iter_mut().find(|known| known.answer) {
            known.answer = false;
            let to = known.discovery;
            self.put_announcement(m)?;
            return Some(to);
        }
        if now >= self.announce_at {
            self.announced = self.announced.saturating_add(1);
            let quick = self.announced < self.quick_until;
            self.announce_at = match self.leaving {
                true => INFINITE,
                false if quick => now.saturating_add(QUICK_PERIOD),
                false => now.saturating_add(self.announce_period),
            };
            let groups = self.announce_to.len();
            self.announce_left = groups.saturating_add(self.participants.len());
        }
        while self.announce_left > 0 {
            self.announce_left = self.announce_left.saturating_sub(1);
            // Without sockets of its own, a participant does not move.
            if cfg!(feature = "std")
                && let Some(to) = self.say_goodbye(self.announce_left, now, m)
            {
                return Some(to);
            }
            let known = self
                .participants
                .get(self.announce_left)
                .map(|known| known.discovery);
            let group = self.announce_left.checked_sub(self.participants.len());
            let group = || group.and_then(|at| self.announce_to.get(at).copied());
            if let Some(to) = known.or_else(group) {
                self.put_announcement(m)?;
                return Some(to);
            }
        }
        None
    }

    /// Says goodbye to a participant that is to meet this one anew. After the last time nothing is
    /// left of it but its address, where it gets announcements.
    fn say_goodbye(
        &mut self,
        at: usize,
        now: Nanos,
        m: &mut MessageWriter<'_>,
    ) -> Option<SocketAddr> {
        let known = self.participants.get_mut(at)?;
        if self.reach.local && !known.discovery.ip().is_loopback() {
            return None; // there is no way to it now
        }
        known.goodbyes = known.goodbyes.checked_sub(1)?;
        let known = *known;
        self.announced = self.announced.saturating_add(1);
        self.quick_until = self.quick_until.saturating_add(1); // it is none of the announcements
        self.put(true, m)?;
        if known.goodbyes == 0 {
            self.lose(known.prefix, now);
            self.participants.push(RemoteParticipant {
                anew: true,
                ..known
            });
        }
        Some(known.discovery)
    }

    fn put_announcement(&self, m: &mut MessageWriter<'_>) -> Option<()> {
        self.put(self.leaving, m)
    }

    /// Puts the participant's announcement, or its goodbye.
    fn put(&self, leaving: bool, m: &mut MessageWriter<'_>) -> Option<()> {
        let (mut qos, mut key) = ([0; 40], [0; 40]);
        let guid = Guid::new(self.prefix, EntityId::PARTICIPANT);
        let (payload, inline_qos) = if leaving {
            let (qos, key) = disposal(guid, &mut qos, &mut key).ok()?;
            (Payload::Key(key), qos)
        } else {
            (Payload::Data(&self.announcement), [].as_slice())
        };
        let data = Data {
            reader: EntityId::UNKNOWN,
            writer: EntityId::SPDP_WRITER,
            sn: i64::from(self.announced.max(1)),
            inline_qos: None,
            payload,
        };
        m.info_destination(GuidPrefix::default()).ok()?;
        m.data(&data, inline_qos).ok()
    }

    /// Announcements of the participant, ACKNACKs of those of others' endpoints, and those of own
    /// endpoints.
    fn transmit_discovery(&mut self, now: Nanos, m: &mut MessageWriter<'_>) -> Option<SocketAddr> {
        if let Some(to) = self.transmit_announcement(now, m) {
            return Some(to);
        }
        let (publications, subscriptions) = (&mut self.publications, &mut self.subscriptions);
        let readers = [&mut publications.1, &mut subscriptions.1];
        if let Some(to) = answer(readers, now, m) {
            return Some(to);
        }
        let first = publications.0.transmit(now, m);
        first.or_else(|| subscriptions.0.transmit(now, m))
    }

    /// ACKNACKs of own readers, assertions of liveliness, then samples and heartbeats of the own
    /// writers.
    fn transmit_samples(&mut self, now: Nanos, m: &mut MessageWriter<'_>) -> Option<SocketAddr> {
        let (assertions, answers) = &mut self.liveliness;
        let own = self.readers.iter_mut().map(|own| &mut own.endpoint);
        if let Some(to) = answer([answers].into_iter().chain(own), now, m) {
            return Some(to);
        }
        if let Some(to) = assertions.transmit(now, m) {
            return Some(to);
        }
        self.transmit_content(Content::New, now, m)
    }

    /// One content of the own writers in turn.
    fn transmit_content(
        &mut self,
        content: Content,
        now: Nanos,
        m: &mut MessageWriter<'_>,
    ) -> Option<SocketAddr> {
        for _ in 0..self.writers.len() {
            let at = self.next_writer.checked_rem(self.writers.len())?;
            self.next_writer = at.saturating_add(1);
            let own = self.writers.get_mut(at)?;
            let to = transmit(&mut own.endpoint, &mut self.readers, (content, now), m);
            if to.is_some() {
                return to;
            }
        }
        None
    }
}

/// The first ACKNACK that is due.
fn answer<'r>(
    readers: impl IntoIterator<Item = &'r mut Reader>,
    now: Nanos,
    m: &mut MessageWriter<'_>,
) -> Option<SocketAddr> {
    let mut readers = readers.into_iter();
    let reader = readers.find(|reader| reader.answers_at() <= now)?;
    reader.transmit(now, m)
}

/// Fills `m` with samples of an own writer, and with what waits of own readers' answers to the same
/// participant.
fn transmit(
    writer: &mut Writer,
    readers: &mut [Own<Reader>],
    (content, now): (Content, Nanos),
    m: &mut MessageWriter<'_>,
) -> Option<SocketAddr> {
    let (to, prefix) = writer.transmit_to(content, now, m)?;
    m.limit(writer.datagram(to));
    for own in readers {
        own.endpoint.transmit_along(prefix, (to, now), m);
    }
    m.limit(usize::MAX);
    Some(to)
}
