//! The next message of a writer to a reader: repairs, or new samples; then a heartbeat.

use super::content::Content;
use super::history::Change;
use super::peer_reader::{Fragments, PeerReader};
use super::shared::refer;
use super::writer::Writer;
use crate::wire::{
    Data, DataFrag, EntityId, Gap, Guid, GuidPrefix, Heartbeat, INFINITE, MessageWriter, Nanos,
    Payload, SequenceNumber, SequenceSet, SharedPlace, WireError, disposal, put_chain_origins,
    put_related_request,
};
use core::net::SocketAddr;

/// The longest time between heartbeats while a reader lacks something.
const SLOWEST_HEARTBEAT: Nanos = 1_000_000_000;

impl Writer {
    /// Fills `m`, which has no submessages yet, for one reader or participant, and says where to
    /// send it. `None` when nothing is to be sent now.
    pub fn transmit(&mut self, now: Nanos, m: &mut MessageWriter<'_>) -> Option<SocketAddr> {
        let mut contents = [Content::Repairs, Content::New].into_iter();
        let sent = contents.find_map(|content| self.transmit_to(content, now, m));
        sent.map(|(to, _)| to)
    }

    /// As [`transmit`](Self::transmit), of one content, with the participant that the message is
    /// for.
    pub(crate) fn transmit_to(
        &mut self,
        content: Content,
        now: Nanos,
        m: &mut MessageWriter<'_>,
    ) -> Option<(SocketAddr, GuidPrefix)> {
        self.expire(now);
        if now >= self.heartbeat_at || self.sends_heartbeat_along(now) {
            self.announce(now);
        }
        if now >= self.burst_ends {
            self.begin_burst();
        }
        for _ in 0..self.readers.len() {
            let at = self.next_reader.checked_rem(self.readers.len())?;
            self.next_reader = at.saturating_add(1);
            let filled = fill(self, at, (content, now), m);
            if filled.is_some() {
                let amid_a_run = self.readers.get(at).is_some_and(PeerReader::is_amid_a_run);
                // A repair is not of the run: without end, it would keep repairs from the others.
                if content == Content::New && amid_a_run {
                    self.next_reader = at;
                }
                return filled;
            }
        }
        None
    }

    /// Every reader that lacks something hears what there is.
    fn announce(&mut self, now: Nanos) {
        let last = self.history.last();
        let mut lacking = false;
        for reader in self.readers.iter_mut().filter(|reader| reader.reliable) {
            let lacks = reader.acked <= last;
            reader.wants_heartbeat |= lacks;
            lacking |= lacks;
        }
        if lacking {
            self.announced_at = now;
            self.heartbeat_at = now.saturating_add(self.pace);
            self.pace = self.pace.saturating_mul(2).min(SLOWEST_HEARTBEAT);
        } else {
            self.heartbeat_at = INFINITE;
        }
    }
}

/// The result of one step of filling a message.
enum Step {
    /// Something was added to the message.
    Added,
    /// There is nothing to add.
    Nothing,
    /// The message is full.
    Full,
}

/// Fills `m` for the reader at `at`, if there is something for it.
pub(super) fn fill(
    w: &mut Writer,
    at: usize,
    (content, now): (Content, Nanos),
    m: &mut MessageWriter<'_>,
) -> Option<(SocketAddr, GuidPrefix)> {
    let ready = |reader: &&PeerReader| w.is_ready(reader, content);
    let reader = w.readers.get(at).filter(ready)?;
    let (to, prefix) = (reader.to, reader.guid.prefix);
    m.limit(w.datagram(to));
    m.info_destination(prefix).ok()?;
    let empty = m.len();
    let mut last = Step::Added;
    while let Step::Added = last {
        last = step(w, at, (content, now), m);
    }
    if let Step::Full = last
        && m.len() == empty
    {
        // Cut for readers on this host, it goes to another one in a datagram of its own.
        m.limit(usize::MAX);
        step(w, at, (content, now), m);
    }
    m.limit(usize::MAX);
    if m.len() > empty {
        return Some((to, prefix));
    }
    m.clear();
    None
}

fn step(
    w: &mut Writer,
    at: usize,
    (content, now): (Content, Nanos),
    m: &mut MessageWriter<'_>,
) -> Step {
    let Some(reader) = w.readers.get(at) else {
        return Step::Nothing;
    };
    if content == Content::Repairs {
        if reader.repair.is_some() {
            return repair_fragment(w, at, now, m);
        }
        if reader.first_request().is_some() {
            return repair(w, at, m);
        }
    }
    if reader.next <= w.history.last() {
        return match content {
            Content::New => fresh(w, at, now, m),
            Content::Repairs => Step::Nothing,
        };
    }
    if reader.is_to_hear() {
        return heartbeat(w, at, m);
    }
    Step::Nothing
}

fn done(result: Result<(), WireError>) -> Step {
    if result.is_ok() {
        Step::Added
    } else {
        Step::Full
    }
}

/// Says which samples there are, to a new reader first up to the match.
fn heartbeat(w: &mut Writer, at: usize, m: &mut MessageWriter<'_>) -> Step {
    let Some(reader) = w.readers.get_mut(at) else {
        return Step::Nothing;
    };
    let body = Heartbeat {
        reader: reader.guid.entity,
        writer: w.guid.entity,
        first: w.history.first(),
        last: w.history.last(),
        count: w.heartbeats.wrapping_add(2),
        // Fast DDS hears an assertion in none but a final one, which asks for no answer.
        final_flag: reader.asserts,
        liveliness: reader.asserts,
    };
    let before = m.len();
    let last = reader.last_unpromised();
    let introduced = match last.filter(|last| *last < body.last) {
        Some(last) => m.heartbeat(&Heartbeat {
            first: body.first.min(last.saturating_add(1)),
            last,
            count: w.heartbeats.wrapping_add(1),
            final_flag: true,
            liveliness: false,
            ..body
        }),
        None => Ok(()),
    };
    let both = introduced.and_then(|()| m.heartbeat(&body));
    let step = done(both.inspect_err(|_| m.truncate(before)));
    if let Step::Added = step {
        reader.wants_heartbeat &= reader.asserts;
        reader.asserts = false;
        w.heartbeats = body.count;
    }
    step
}

/// Sends a requested sample again, or says that it will not come.
fn repair(w: &mut Writer, at: usize, m: &mut MessageWriter<'_>) -> Step {
    let Some(reader) = w.readers.get_mut(at) else {
        return Step::Nothing;
    };
    let Some(sn) = reader.first_request() else {
        return Step::Nothing;
    };
    let prefix = reader.guid.prefix;
    let kept = w.history.get(sn).filter(|_| sn >= reader.start);
    let kept = kept.filter(|(change, _)| change.is_for(prefix));
    let Some((change, payload)) = kept else {
        // Up to the next sample that is kept and for this reader.
        let mut end = sn
            .saturating_add(1)
            .max(reader.start)
            .max(w.history.first());
        end = end.min(w.history.last().saturating_add(1));
        while end <= w.history.last() && !w.history.has_for(end, prefix) {
            end = end.saturating_add(1);
        }
        let step = done(gap(m, reader.guid.entity, w.guid.entity, sn, end));
        if let Step::Added = step {
            reader.forget_requests_below(end);
        }
        return step;
    };
    if let Some(place) = change.shared.filter(|_| reader.fetches) {
        let ids = (w.guid.entity, reader.guid.entity);
        let step = done(reference(m, ids, change, payload, place));
        if let Step::Added = step {
            reader.take_request();
        }
        return step;
    }
    if payload.len() > change.fragment {
        reader.take_request();
        reader.repair = Some(Fragments {
            sn,
            base: 1,
            bits: None,
        });
        return Step::Added;
    }
    let step = done(data(m, w.guid, reader.guid.entity, change, payload));
    if let Step::Added = step {
        reader.take_request();
    }
    step
}

fn gap(
    m: &mut MessageWriter<'_>,
    reader: EntityId,
    writer: EntityId,
    start: SequenceNumber,
    end: SequenceNumber,
) -> Result<(), WireError> {
    m.gap(&Gap {
        reader,
        writer,
        start,
        list: SequenceSet::empty(end),
    })
}

/// Sends the next sample for the first time. Readers behind the same address share it.
fn fresh(w: &mut Writer, at: usize, now: Nanos, m: &mut MessageWriter<'_>) -> Step {
    let Some(reader) = w.readers.get_mut(at) else {
        return Step::Nothing;
    };
    let sn = reader.next;
    let prefix = reader.guid.prefix;
    let kept = w.history.get(sn);
    let Some((change, payload)) = kept.filter(|(change, _)| change.is_for(prefix)) else {
        let mut end = sn.saturating_add(1).max(w.history.first());
        while end <= w.history.last() && !w.history.has_for(end, prefix) {
            end = end.saturating_add(1);
        }
        if reader.reliable && gap(m, reader.guid.entity, w.guid.entity, sn, end).is_err() {
            return Step::Full;
        }
        reader.next = end;
        reader.fragment = 1;
        return Step::Added;
    };
    let me = *reader;
    let alike = |other: &PeerReader| {
        other.to == me.to
            && other.guid.prefix == me.guid.prefix
            && (other.next, other.fragment) == (me.next, me.fragment)
            && other.fetches == me.fetches
    };
    let shared = w.readers.iter().filter(|other| alike(other)).count() > 1;
    let id = if shared {
        EntityId::UNKNOWN
    } else {
        me.guid.entity
    };
    let size = change.fragment;
    // A sample that has begun in fragments ends in fragments.
    let shared = change.shared.filter(|_| me.fetches && me.fragment == 1);
    let fragments = shared.is_none() && payload.len() > size;
    if fragments && (w.burst == 0 || m.len() > HEADERS) {
        return if w.burst == 0 {
            Step::Nothing
        } else {
            Step::Full
        };
    }
    let sent = if let Some(place) = shared {
        reference(m, (w.guid.entity, id), change, payload, place)
    } else if fragments {
        data_frag(m, w.guid, id, change, payload, me.fragment)
    } else {
        data(m, w.guid, id, change, payload)
    };
    if sent.is_err() {
        return Step::Full;
    }
    let last = u32::try_from(payload.len().div_ceil(size)).unwrap_or(u32::MAX);
    let done = !fragments || me.fragment >= last;
    for other in w.readers.iter_mut().filter(|other| alike(other)) {
        if done {
            other.next = sn.saturating_add(1);
            other.fragment = 1;
            // The last fragment may be the one that is lost: the reader hears of the sample.
            other.wants_heartbeat |= (fragments || shared.is_some()) && other.reliable;
        } else {
            other.fragment = other.fragment.saturating_add(1);
        }
    }
    if fragments {
        w.pause(size, now);
    }
    Step::Added
}

/// A message with one fragment has the header, `INFO_DST` and nothing before it.
const HEADERS: usize = 36;

fn repair_fragment(w: &mut Writer, at: usize, now: Nanos, m: &mut MessageWriter<'_>) -> Step {
    let Some(reader) = w.readers.get_mut(at) else {
        return Step::Nothing;
    };
    let Some(asked) = reader.repair else {
        return Step::Nothing;
    };
    let kept = w.history.get(asked.sn).filter(|_| asked.sn >= reader.start);
    let Some((change, payload)) = kept else {
        reader.repair = None;
        reader.wants_heartbeat = true;
        return Step::Added;
    };
    if w.burst == 0 {
        return Step::Nothing;
    }
    if m.len() > HEADERS {
        return Step::Full;
    }
    let size = change.fragment;
    let last = u32::try_from(payload.len().div_ceil(size)).unwrap_or(u32::MAX);
    let next = match &asked.bits {
        None => Some(asked.base),
        Some(bits) => bits.iter().next().map(|at| asked.base.saturating_add(at)),
    };
    let Some(number) = next.filter(|number| (1..=last).contains(number)) else {
        reader.repair = None;
        reader.wants_heartbeat = true;
        return Step::Added;
    };
    let id = reader.guid.entity;
    if data_frag(m, w.guid, id, change, payload, number).is_err() {
        return Step::Full;
    }
    let rest = match asked.bits {
        None => Some(Fragments {
            base: number.saturating_add(1),
            ..asked
        }),
        Some(mut bits) => {
            bits.clear(number.saturating_sub(asked.base));
            Some(Fragments {
                bits: Some(bits),
                ..asked
            })
        }
    };
    reader.repair = rest;
    w.pause(size, now);
    Step::Added
}

fn data(
    m: &mut MessageWriter<'_>,
    writer: Guid,
    reader: EntityId,
    change: &Change,
    payload: &[u8],
) -> Result<(), WireError> {
    let (mut qos, mut key) = ([0; RELATED], [0; 40]);
    let (inline_qos, payload) = match change.gone {
        Some(gone) => {
            let (qos, key) = disposal(gone, &mut qos, &mut key)?;
            (qos, Payload::Key(key))
        }
        None => (related(change, &mut qos)?, Payload::Data(payload)),
    };
    let body = Data {
        reader,
        writer: writer.entity,
        sn: change.sn,
        inline_qos: None,
        payload,
    };
    let before = m.len();
    if change.source.is_some() {
        m.info_timestamp(change.source)?;
    }
    m.data(&body, inline_qos)
        .inspect_err(|_| m.truncate(before))
}

fn data_frag(
    m: &mut MessageWriter<'_>,
    writer: Guid,
    reader: EntityId,
    change: &Change,
    payload: &[u8],
    number: u32,
) -> Result<(), WireError> {
    let size = change.fragment;
    let index = usize::try_from(number.saturating_sub(1)).unwrap_or(usize::MAX);
    let from = index.saturating_mul(size);
    let to = from.saturating_add(size).min(payload.len());
    let body = DataFrag {
        reader,
        writer: writer.entity,
        sn: change.sn,
        start: number,
        count: 1,
        fragment_size: u16::try_from(size).unwrap_or(u16::MAX),
        sample_size: u32::try_from(payload.len()).unwrap_or(u32::MAX),
        key: false,
        inline_qos: None,
        payload: payload.get(from..to).unwrap_or(&[]),
    };
    let before = m.len();
    if change.source.is_some() {
        m.info_timestamp(change.source)?;
    }
    let mut qos = [0; RELATED];
    m.data_frag(&body, related(change, &mut qos)?)
        .inspect_err(|_| m.truncate(before))
}

/// Says where the sample is in shared memory.
fn reference(
    m: &mut MessageWriter<'_>,
    ids: (EntityId, EntityId),
    change: &Change,
    payload: &[u8],
    place: SharedPlace,
) -> Result<(), WireError> {
    let before = m.len();
    if change.source.is_some() {
        m.info_timestamp(change.source)?;
    }
    let mut qos = [0; RELATED];
    let sample = (change.sn, payload.len(), change.fragment);
    refer(m, ids, sample, place, related(change, &mut qos)?).inspect_err(|_| m.truncate(before))
}

/// Bytes of inline quality of service that name a request, or chains.
const RELATED: usize = 64;

fn related<'q>(change: &Change, qos: &'q mut [u8; RELATED]) -> Result<&'q [u8], WireError> {
    match &change.related {
        Some(request) => put_related_request(request, qos),
        None => put_chain_origins(&change.origins, qos),
    }
}
