//! Datagrams that come in: each submessage goes to its reader, its writer or discovery.

use super::event::{Bound, Event};
use super::remote::{RemoteEndpoint, RemoteParticipant};
use super::state::{Own, Participant};
use crate::endpoint::{ANSWER_WAIT, Reader, Writer};
use crate::wire::{
    Data, DataFrag, EndpointData, EntityId, Guid, GuidPrefix, Message, Nanos, ParticipantData,
    Payload, SequenceNumber, Submessage, Timestamp, WireError, disposed_entity, is_disposal,
};
use core::net::SocketAddr;

/// Announcements of a participant that an older one may come after, on its way through a network.
/// One that is older still is that of another participant, which has got the name of the first.
const OVERTAKEN: SequenceNumber = 8;

impl Participant {
    /// Takes a datagram in. What was understood has been acted on.
    ///
    /// # Errors
    /// Any [`WireError`]: the datagram is not RTPS, is damaged from some submessage on, or has an
    /// announcement in it that cannot be read.
    pub fn receive(&mut self, datagram: &[u8], now: Nanos) -> Result<(), WireError> {
        let message = Message::decode(datagram)?;
        let (mut for_us, mut result) = (true, Ok(()));
        let mut head = Head {
            from: message.prefix,
            source: None,
            sample: None,
        };
        for part in message.submessages() {
            let part = part?;
            match part {
                Submessage::InfoDestination(to) => {
                    for_us = to == self.prefix || to == GuidPrefix::default();
                }
                Submessage::InfoSource(prefix) => {
                    head = Head {
                        from: prefix,
                        source: None,
                        sample: None,
                    };
                }
                Submessage::InfoTimestamp(time) => head.source = time,
                _ if !for_us => {}
                part => result = result.and(self.act(&mut head, &part, now)),
            }
        }
        self.heard(message.prefix, now);
        result
    }

    fn act(&mut self, head: &mut Head, part: &Submessage<'_>, now: Nanos) -> Result<(), WireError> {
        let Head { from, source, .. } = *head;
        match part {
            Submessage::Data(data) if data.writer == EntityId::SPDP_WRITER => {
                return self.announced(from, data, now);
            }
            Submessage::Data(data) => {
                if let Some(reader) = self.builtin_reader(data.writer) {
                    reader.data(from, data, source);
                    return self.discover(data.writer, now);
                }
                head.sample = Some(data.writer);
                self.heard_writer(Guid::new(from, data.writer), now);
                self.deliver(from, data, source);
            }
            Submessage::DataFrag(data) => {
                if let Some(reader) = self.builtin_reader(data.writer) {
                    reader.data_frag(from, data, source);
                    return self.discover(data.writer, now);
                }
                head.sample = Some(data.writer);
                self.heard_writer(Guid::new(from, data.writer), now);
                self.deliver_fragment(from, data, source);
            }
            Submessage::Heartbeat(body) => {
                if let Some(reader) = self.builtin_reader(body.writer) {
                    reader.heartbeat(from, body);
                    return self.discover(body.writer, now);
                }
                if body.liveliness {
                    self.heard_writer(Guid::new(from, body.writer), now);
                }
                let along = head.sample == Some(body.writer);
                let Participant {
                    readers, writers, ..
                } = self;
                for Own { endpoint, .. } in readers {
                    if is_for(body.reader, endpoint.guid().entity) {
                        let to = endpoint.answers_to(Guid::new(from, body.writer));
                        let waits = along && to.is_some_and(|to| write_to(writers, from, to, now));
                        let wait = now.saturating_add(ANSWER_WAIT);
                        let at = if waits { wait } else { 0 };
                        endpoint.heartbeat_until(from, body, at);
                    }
                }
            }
            Submessage::Gap(body) => {
                if let Some(reader) = self.builtin_reader(body.writer) {
                    reader.gap(from, body);
                    return self.discover(body.writer, now);
                }
                for own in &mut self.readers {
                    if is_for(body.reader, own.endpoint.guid().entity) {
                        own.endpoint.gap(from, body);
                    }
                }
            }
            Submessage::AckNack(body) => {
                let writers = self.writers.iter_mut().map(|own| &mut own.endpoint);
                let discovery = [
                    &mut self.publications.0,
                    &mut self.subscriptions.0,
                    &mut self.liveliness.0,
                ];
                let mut anew = false;
                for writer in writers.chain(discovery) {
                    if writer.entity() == body.writer {
                        anew = writer.acknack(from, body, now);
                    }
                }
                if anew {
                    let ours = Guid::new(self.prefix, body.writer);
                    self.report(Event::Anew(ours, Guid::new(from, body.reader)));
                }
            }
            Submessage::NackFrag(body) => {
                let writers = self.writers.iter_mut().map(|own| &mut own.endpoint);
                let discovery = [&mut self.publications.0, &mut self.subscriptions.0];
                for writer in writers.chain(discovery) {
                    if writer.entity() == body.writer {
                        writer.nack_frag(from, body, now);
                    }
                }
            }
            Submessage::Reference(body) => self.refer(from, body, source, now),
            Submessage::Shared(body) => self.share(from, body),
            // A HEARTBEAT_FRAG says nothing that the HEARTBEAT after the sample does not.
            _ => {}
        }
        Ok(())
    }

    fn builtin_reader(&mut self, writer: EntityId) -> Option<&mut Reader> {
        match writer {
            EntityId::SEDP_PUBLICATIONS_WRITER => Some(&mut self.publications.1),
            EntityId::SEDP_SUBSCRIPTIONS_WRITER => Some(&mut self.subscriptions.1),
            EntityId::LIVELINESS_WRITER => Some(&mut self.liveliness.1),
            _ => None,
        }
    }

    fn deliver(&mut self, from: GuidPrefix, data: &Data<'_>, source: Option<Timestamp>) {
        for own in &mut self.readers {
            if is_for(data.reader, own.endpoint.guid().entity) {
                own.endpoint.data(from, data, source);
            }
        }
    }

    fn deliver_fragment(&mut self, from: GuidPrefix, data: &DataFrag<'_>, at: Option<Timestamp>) {
        for own in &mut self.readers {
            if is_for(data.reader, own.endpoint.guid().entity) {
                own.endpoint.data_frag(from, data, at);
            }
        }
    }

    /// An SPDP sample.
    fn announced(
        &mut self,
        from: GuidPrefix,
        data: &Data<'_>,
        now: Nanos,
    ) -> Result<(), WireError> {
        // Our own multicast comes back to us.
        if from == self.prefix {
            return Ok(());
        }
        if is_disposal(data.inline_qos) {
            let key = match data.payload {
                Payload::Key(key) | Payload::Data(key) => key,
                Payload::None => &[],
            };
            // A participant says goodbye for itself alone.
            if disposed_entity(key, data.inline_qos)?.prefix == from {
                self.leave_behind(from, now);
            }
            return Ok(());
        }
        let number = data.sn;
        let Payload::Data(payload) = data.payload else {
            return Ok(());
        };
        let data = ParticipantData::decode(payload)?;
        let elsewhere = data.domain.is_some_and(|domain| domain != self.domain);
        if data.prefix != from || elsewhere || self.leaving {
            return Ok(());
        }
        let known = |known: &RemoteParticipant| known.prefix == from;
        if let Some(at) = self.participants.iter().position(known)
            && let Some(known) = self.participants.get_mut(at)
        {
            if number >= known.announced.saturating_sub(OVERTAKEN) {
                known.announced = known.announced.max(number);
                self.meet_again(at, &data, now);
                return Ok(());
            }
            self.leave_behind(from, now);
        }
        if self.participants.len() >= self.most_participants {
            self.report(Event::Full(Bound::Participants));
            return Ok(());
        }
        let own = (self.reach, &self.discovery);
        let Some(found) = RemoteParticipant::new(&data, number, own, now) else {
            return Ok(());
        };
        self.participants.push(found);
        self.announce_at = self.announce_at.min(now);
        self.report(Event::ParticipantFound(from));
        self.meet_builtin(from, data.builtin, found.discovery, now);
        Ok(())
    }

    /// A participant is gone for good: one that comes under its name is another.
    fn leave_behind(&mut self, prefix: GuidPrefix, now: Nanos) {
        self.lose(prefix, now);
        for own in &mut self.readers {
            own.endpoint.forget_past(|guid| guid.prefix == prefix);
        }
    }

    /// Acts on the announcements of endpoints that have arrived in order.
    fn discover(&mut self, writer: EntityId, now: Nanos) -> Result<(), WireError> {
        let mut result = Ok(());
        while let Some(sample) = self.builtin_reader(writer).and_then(Reader::take) {
            let from = sample.writer.prefix;
            if writer == EntityId::LIVELINESS_WRITER {
                continue; // that something came is what it says
            }
            if let Some(gone) = sample.gone {
                if gone.prefix == from {
                    self.unlearn(gone, now);
                    for own in &mut self.readers {
                        own.endpoint.forget_past(|guid| guid == gone);
                    }
                }
                continue;
            }
            let (addresses, remote) = match EndpointData::decode(sample.payload) {
                Ok(data) if data.guid.prefix == from => (data.unicast, RemoteEndpoint::new(&data)),
                Ok(_) => continue,
                Err(error) => {
                    result = Err(error);
                    continue;
                }
            };
            let known = self.participants.iter().find(|known| known.prefix == from);
            let (Some(known), Some(mut remote)) = (known, remote) else {
                continue;
            };
            let announces_writers = writer == EntityId::SEDP_PUBLICATIONS_WRITER;
            if remote.guid.entity.is_writer() == announces_writers {
                let to = addresses.best(self.reach, &self.discovery);
                remote.to = to.unwrap_or(known.user);
                self.learn(remote, now);
            }
        }
        result
    }
}

/// The part of a message that holds for its later submessages.
struct Head {
    from: GuidPrefix,
    source: Option<Timestamp>,
    /// The writer of the last sample in it.
    sample: Option<EntityId>,
}

/// Whether a sample to the participant `prefix` at `to` may soon be sent: one was.
fn write_to(writers: &[Own<Writer>], prefix: GuidPrefix, to: SocketAddr, now: Nanos) -> bool {
    let since = now.saturating_sub(ANSWER_WAIT);
    let mut writers = writers.iter();
    writers.any(|own| own.endpoint.wrote_to(prefix, to, since))
}

fn is_for(named: EntityId, own: EntityId) -> bool {
    named == EntityId::UNKNOWN || named == own
}
