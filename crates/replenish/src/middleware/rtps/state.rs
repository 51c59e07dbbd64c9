//! [`State`]: the participant with its endpoints, under the adapter's lock.

use super::allowance::Allowance;
use super::carried::{self, Carried};
use super::ends::{LongSample, ReaderEnd, WriterEnd};
use super::graph::Graph;
use super::nudge::{BUFFER, Nudge};
use super::outgoing::Outgoing;
use super::qos::{LONG, policy_bit};
use super::shared::{Segments, Spare};
use super::stats::RtpsStats;
use crate::Nanos;
use crate::middleware::watch::Watches;
use crate::middleware::{
    IncompatibleQos, Interest, PublishError, ReaderId, Room, SampleInfo, WriterId,
};
use crate::platform::wall_clock;
use crate::sync::Arc;
use alloc::collections::VecDeque;
use alloc::vec::Vec;
use replenish_os::timer::TimerFd;
use replenish_os::{PiMutex, PiMutexGuard};
use replenish_rtps::endpoint::{Body, Header, Reader, WriteError};
use replenish_rtps::participant::{self as rtps, Bound, Event, Part, Participant};
use replenish_rtps::udp::{Interfaces, Sockets};
use replenish_rtps::wire::{INFINITE, Reliability, Timestamp};

/// Pairs of endpoints that do not fit and were not told of yet; more are left out.
const CLASHES: usize = 64;

/// The parts that the dispatcher sends, in this order.
pub(super) const PARTS: [Part; 3] = [Part::Samples, Part::Repairs, Part::Discovery];

/// A round of the dispatcher: who is interested, where samples go, how many went.
pub(super) struct Round<'i, 's> {
    pub(super) interest: &'i mut Interest,
    pub(super) sink: &'s mut dyn FnMut(ReaderId, &SampleInfo, &[u8]) -> Room,
    pub(super) taken: usize,
}

impl Round<'_, '_> {
    /// Hands a sample over.
    pub(super) fn give(&mut self, reader: ReaderId, info: &SampleInfo, payload: &[u8]) {
        self.taken += 1;
        if (self.sink)(reader, info, payload) == Room::Full {
            self.interest.remove(reader);
        }
    }
}

pub(super) struct State {
    pub(super) participant: Participant,
    pub(super) readers: Vec<ReaderEnd>,
    pub(super) writers: Vec<WriterEnd>,
    pub(super) graph: Graph,
    /// The chains of own samples.
    carried: Carried,
    outgoing: Outgoing,
    /// The addresses of this host.
    pub(super) interfaces: Interfaces,
    /// The time that the alarm is set to.
    armed: Nanos,
    pub(super) clashes: VecDeque<IncompatibleQos>,
    /// A participant was lost once.
    lost_any: bool,
    pub(super) stats: RtpsStats,
    /// Endpoints that a program watches.
    pub(super) watches: Watches,
    /// Memory of publishers on this host.
    pub(super) segments: Segments,
    /// The CPU time for discovery.
    discovery: Allowance,
    /// The CPU time for repairs.
    repairs: Allowance,
}

impl State {
    pub(super) fn new(
        participant: Participant,
        graph: Graph,
        (datagram, interfaces): (usize, Interfaces),
        segments: Segments,
    ) -> Self {
        Self {
            participant,
            readers: Vec::new(),
            writers: Vec::new(),
            graph,
            carried: Carried::new(),
            outgoing: Outgoing::new(datagram),
            interfaces,
            armed: Nanos::MAX,
            clashes: VecDeque::with_capacity(CLASHES),
            lost_any: false,
            stats: RtpsStats::default(),
            watches: Watches::default(),
            segments,
            discovery: Allowance::for_discovery(),
            repairs: Allowance::for_repairs(),
        }
    }

    /// Takes a datagram in.
    pub(super) fn receive(&mut self, datagram: &[u8], now: Nanos) {
        self.stats.received += 1;
        let understood = self.participant.receive(datagram, now).is_ok();
        self.stats.malformed += u64::from(!understood);
        let heard = self.graph.hear(&mut self.participant);
        self.stats.malformed += heard.malformed;
        self.stats.left_out += heard.left_out as u64;
    }

    /// Whether a reader of interest has samples that the dispatcher takes.
    pub(super) fn has_sample(&self, interest: &Interest) -> bool {
        let taken = |end: &ReaderEnd| end.owner.is_none() && self.ready(end) > 0;
        let ends = interest.iter();
        let ends = ends.filter_map(|reader| self.readers.get(usize::from(reader.0)));
        ends.into_iter().any(taken)
    }

    /// Whether any reader at all has samples.
    pub(super) fn has_any_sample(&self) -> bool {
        self.participant.next_ready().is_some()
    }

    fn ready(&self, end: &ReaderEnd) -> usize {
        let reader = end.id.and_then(|id| self.participant.reader(id));
        reader.map_or(0, Reader::ready)
    }

    /// Tells workers of samples that wait for them; whether any reader has samples left that the
    /// dispatcher takes.
    pub(super) fn nudge_owners(&self) -> bool {
        if !self.has_any_sample() {
            return false;
        }
        let mut any = false;
        for end in self.readers.iter().filter(|end| self.ready(end) > 0) {
            match &end.owner {
                Some(owner) => owner.set(),
                None => any = true,
            }
        }
        any
    }

    /// The names of a reader whose samples the dispatcher takes.
    pub(super) fn taken_here(&self, reader: ReaderId) -> Option<(ReaderId, rtps::ReaderId)> {
        let end = self.readers.get(usize::from(reader.0))?;
        end.id
            .filter(|_| end.owner.is_none())
            .map(|id| (reader, id))
    }

    /// The name of a reader that answers nobody: best effort, and without a time that is watched.
    pub(super) fn owes_nothing(&self, reader: ReaderId) -> Option<rtps::ReaderId> {
        let end = self.readers.get(usize::from(reader.0))?;
        let id = end.id.filter(|_| end.service.is_none())?;
        let qos = self.participant.reader(id)?.qos();
        let owes = qos.reliability != Reliability::BestEffort
            || qos.deadline != INFINITE
            || qos.liveliness_lease != INFINITE;
        (!owes).then_some(id)
    }

    /// From now on a worker takes the reader's samples.
    pub(super) fn give_away(&mut self, reader: ReaderId, owner: &Arc<Nudge>) {
        if let Some(end) = self.readers.get_mut(usize::from(reader.0)) {
            end.owner = Some(Arc::clone(owner));
            end.memory = end.memory.saturating_add(BUFFER);
        }
    }

    /// Counts datagrams that the kernel dropped at the reader's socket, if known.
    pub(super) fn count_drops(
        &mut self,
        (reader, id): (ReaderId, rtps::ReaderId),
        drops: Option<u32>,
    ) {
        let end = self.readers.get_mut(usize::from(reader.0));
        let end = end.filter(|end| end.id == Some(id));
        if let (Some(end), Some(drops)) = (end, drops) {
            end.dropped = drops.into();
        }
    }

    /// Hands over the samples of one reader, long ones without the lock.
    pub(super) fn hand_over_all_of<'m>(
        lock: &'m PiMutex<Self>,
        mut state: PiMutexGuard<'m, Self>,
        name: (ReaderId, rtps::ReaderId),
        round: &mut Round<'_, '_>,
        times: (Nanos, Nanos),
    ) -> PiMutexGuard<'m, Self> {
        while let Some(long) = state.hand_over(name, round, times) {
            drop(state);
            round.give(name.0, &long.info, long.payload());
            state = lock.lock();
            state.return_long(long);
        }
        state
    }

    /// Hands over the samples of one reader, as long as there is interest in it. A long one is
    /// returned instead, to be handed over without the lock and then
    /// [given back](Self::return_long).
    fn hand_over(
        &mut self,
        (reader, id): (ReaderId, rtps::ReaderId),
        round: &mut Round<'_, '_>,
        times: (Nanos, Nanos),
    ) -> Option<LongSample> {
        let end = self.readers.get_mut(usize::from(reader.0))?;
        if end.id != Some(id) {
            return None; // deleted, and its place is given out again
        }
        let own = self.participant.prefix();
        while round.interest.contains(reader) {
            let next = self.participant.reader(id).and_then(Reader::next_len)?;
            if next >= LONG
                && let Some(mut buffer) = end.spare.take()
            {
                let Some(sample) = self.participant.take_into(id, &mut buffer) else {
                    continue; // a buffer of another length is of no use
                };
                let read = end.read(&sample, (own, &self.carried), times);
                let Some((info, len)) = read.map(|(info, payload)| (info, payload.len())) else {
                    end.spare = Some(buffer);
                    continue;
                };
                return Some(LongSample {
                    reader,
                    id,
                    info,
                    buffer,
                    len,
                });
            }
            let sample = self.participant.take(id)?;
            if let Some((info, payload)) = end.read(&sample, (own, &self.carried), times) {
                round.give(reader, &info, payload);
            }
        }
        None
    }

    /// Returns the buffer of a long sample, if the reader is still the same.
    pub(super) fn return_long(&mut self, long: LongSample) {
        let end = self.readers.get_mut(usize::from(long.reader.0));
        if let Some(end) = end.filter(|end| end.id == Some(long.id)) {
            end.spare = Some(long.buffer);
        }
    }

    /// The writer, if it takes samples of `size` bytes.
    pub(super) fn writer(
        &mut self,
        writer: WriterId,
        size: usize,
    ) -> Result<(rtps::WriterId, &mut WriterEnd), PublishError> {
        let end = self.writers.get_mut(usize::from(writer.0));
        let end = end.ok_or(PublishError::UnknownWriter)?;
        let id = end.id.ok_or(PublishError::UnknownWriter)?;
        let limit = end.limit;
        if size > limit {
            return Err(PublishError::TooLarge { size, limit });
        }
        Ok((id, end))
    }

    /// Returns the buffer for samples, if the writer is still the same.
    pub(super) fn give_back(&mut self, writer: WriterId, id: rtps::WriterId, spare: Option<Spare>) {
        let end = self.writers.get_mut(usize::from(writer.0));
        if let Some(end) = end.filter(|end| end.id == Some(id)) {
            end.spare = spare;
        }
    }

    /// Keeps a sample, to be sent by its writer.
    pub(super) fn write(
        &mut self,
        writer: rtps::WriterId,
        body: Body<'_>,
        header: Header,
        now: Nanos,
    ) -> Result<u64, PublishError> {
        let header = Header {
            source: wall_clock()
                .and_then(|time| u64::try_from(time.as_nanos()).ok())
                .map(Timestamp),
            origins: carried::sent(),
            ..header
        };
        let written = self.participant.write_with(writer, body, &header, now);
        let number = written.map_err(|error| match error {
            WriteError::Full => PublishError::Full,
            WriteError::TooLong { len, most } => PublishError::TooLarge {
                size: len,
                limit: most,
            },
            _ => PublishError::UnknownWriter,
        })?;
        let number = number.unsigned_abs();
        self.carried.remember(writer.entity(), number);
        Ok(number)
    }

    /// Sends the next datagram of a writer, or some fragments, nothing of other writers; `false`,
    /// and the alarm is set, if there is no further one for now.
    pub(super) fn send_of(
        &mut self,
        writer: rtps::WriterId,
        now: Nanos,
        (alarm, sockets): (&TimerFd, &Sockets),
    ) -> bool {
        let to_kernel = ((sockets, &self.interfaces), &mut self.stats);
        let participant = &mut self.participant;
        let sent = self.outgoing.send(to_kernel, |room| {
            participant.transmit_writer(writer, room, now)
        });
        let next = self.participant.writer_next_at(writer, now);
        if sent && next <= now {
            return true;
        }
        if next < self.armed {
            self.arm(next.max(now + 1), alarm);
        }
        false
    }

    /// Sends the next datagram of one part that is due, or some fragments; `false` if none is.
    pub(super) fn send_next(&mut self, part: Part, now: Nanos, sockets: &Sockets) -> bool {
        let to_kernel = ((sockets, &self.interfaces), &mut self.stats);
        let participant = &mut self.participant;
        self.outgoing
            .send(to_kernel, |room| participant.transmit_part(part, room, now))
    }

    /// The dispatcher has spent CPU time on a part.
    pub(super) fn spend(&mut self, part: Part, time: Nanos, now: Nanos) {
        match part {
            Part::Discovery => self.discovery.spend(time, now),
            Part::Repairs => self.repairs.spend(time, now),
            Part::Samples => {}
        }
    }

    /// When there is CPU time for a part again, if none is left now.
    pub(super) fn resumes_at(&self, part: Part, now: Nanos) -> Option<Nanos> {
        match part {
            Part::Discovery => self.discovery.resumes_at(now),
            Part::Repairs => self.repairs.resumes_at(now),
            Part::Samples => None,
        }
    }

    /// When a part is to be sent next, not before there is CPU time for it.
    pub(super) fn next_of(&self, part: Part, now: Nanos) -> Nanos {
        let next = self.participant.part_next_at(part, now);
        next.max(self.resumes_at(part, now).unwrap_or(0))
    }

    /// Whether something is to be sent.
    pub(super) fn is_due(&self, now: Nanos) -> bool {
        let mut parts = PARTS.into_iter();
        parts.any(|part| self.next_of(part, now) <= now)
    }

    /// Sends everything that is due, and sets the alarm to the next time: at set-up and at the end.
    pub(super) fn housekeep(&mut self, now: Nanos, alarm: &TimerFd, sockets: &Sockets) {
        for part in PARTS {
            while self.send_next(part, now, sockets) {}
        }
        self.arm_next(now, alarm);
    }

    /// Sets the alarm to the next time at which something is to be sent.
    pub(super) fn arm_next(&mut self, now: Nanos, alarm: &TimerFd) {
        let parts = PARTS.map(|part| self.next_of(part, now));
        // One that is due and cannot be sent is tried again, but not at once.
        let next = match parts.into_iter().min().unwrap_or(Nanos::MAX) {
            due if due <= now => now.saturating_add(1_000_000),
            next => next,
        };
        if next != self.armed {
            self.arm(next, alarm);
        }
    }

    fn arm(&mut self, at: Nanos, alarm: &TimerFd) {
        let set = if at == Nanos::MAX {
            alarm.disarm()
        } else {
            alarm.arm(at)
        };
        // One that cannot be set is tried again in the next round.
        self.armed = if set.is_ok() { at } else { Nanos::MAX };
    }

    /// The alarm has rung.
    pub(super) fn rung(&mut self, now: Nanos, alarm: &TimerFd) {
        if self.armed <= now {
            self.armed = Nanos::MAX;
            alarm.disarm().ok();
        }
    }

    /// Takes the participant's events; whether the executor has something to be told.
    pub(super) fn notice(&mut self, now: Nanos) -> bool {
        let mut any = false;
        let mut repeat = false;
        while let Some(event) = self.participant.event() {
            match event {
                Event::Incompatible(ours, _, policy) => {
                    let bit = policy_bit(policy);
                    let reader = (0..)
                        .zip(&self.readers)
                        .find(|(_, end)| end.id.is_some_and(|id| id.entity() == ours.entity));
                    let writer = self
                        .writers
                        .iter()
                        .find(|end| end.id.is_some_and(|id| id.entity() == ours.entity));
                    let topic = reader
                        .map(|(_, end)| &end.topic)
                        .or(writer.map(|end| &end.topic));
                    let Some(topic) = topic.filter(|_| bit != 0 && self.clashes.len() < CLASHES)
                    else {
                        continue;
                    };
                    let reader = reader.map(|(at, _)| ReaderId(at));
                    let clash = IncompatibleQos::known_by_policy(topic, reader, bit);
                    self.clashes.push_back(clash);
                    any = true;
                }
                Event::Matched(..) | Event::Unmatched(..) => self.segments.has_changed = true,
                Event::Full(bound) => {
                    self.stats.left_out += 1;
                    if bound == Bound::Events {
                        // Matches and lost participants may be among the events left out.
                        self.segments.has_changed = true;
                        self.lost_any = true;
                        self.graph.lost_some(&self.participant);
                    }
                }
                Event::ParticipantLost(gone) => {
                    self.lost_any = true;
                    self.graph.lost(&self.participant, gone);
                }
                Event::ParticipantFound(_) => repeat |= self.lost_any,
                Event::Anew(ours, _) => repeat |= self.graph.is_written_by(ours.entity),
                _ => {}
            }
        }
        if repeat {
            self.graph.repeat(&mut self.participant, now);
        }
        any
    }

    /// Samples of a reader that were lost on the way to its inbox.
    pub(super) fn lost(&self, reader: ReaderId) -> u64 {
        let Some(end) = self.readers.get(usize::from(reader.0)) else {
            return 0;
        };
        let reader = end.id.and_then(|id| self.participant.reader(id));
        let stats = reader.map(Reader::stats).unwrap_or_default();
        // A datagram of a reliable writer that the kernel drops comes again.
        let dropped =
            reader.is_some_and(|reader| reader.qos().reliability == Reliability::BestEffort);
        let dropped = if dropped { end.dropped } else { 0 };
        let other = stats.overwritten + stats.too_long + end.unreadable + end.expired + dropped;
        stats.lost.saturating_add(other) // a peer may name any number of samples lost
    }
}
