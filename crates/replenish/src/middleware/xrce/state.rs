//! What the session lock protects: the session, its readers and writers, and the timer that the
//! dispatcher waits on.

use super::endpoints::{Reader, Topic, Writer};
use super::limits::{REQUESTS, STREAMS, WINDOW};
use super::removal::{Doomed, Numbers, Slots};
use super::waiting::Alarm;
use super::{Sent, Transport};
use crate::Nanos;
use crate::middleware::{
    Interest, PublishError, ReaderId, RequestIdentity, Room, SampleInfo, WriterId,
};
use crate::platform::{FULL, TEXTS, io};
use crate::qos::Criticality;
use crate::sync::{Arc, AtomicBool, AtomicUsize, Ordering};
use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;
use replenish_xrce::client::{Event, Session, SessionState, WriteError};
use replenish_xrce::features::{DELIVERY, QUERIES};
use replenish_xrce::wire::{DeliveryControl, Notice, ObjectId, Status, StreamId};

pub(super) type XrceSession = Session<Box<[u8]>, WINDOW, REQUESTS, STREAMS, STREAMS>;

/// Clashes that wait to be told; more are left out.
const CLASHES: usize = if TEXTS { 64 } else { 0 };

/// How often the session is looked after at most while the transport takes nothing.
const BLOCKED: Nanos = 5_000_000;

/// The sink of [`Middleware::take`](crate::middleware::Middleware::take).
pub(super) type Sink<'a> = dyn FnMut(ReaderId, &SampleInfo, &[u8]) -> Room + 'a;

/// What an adapter has counted at its socket.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SocketStats {
    /// Datagrams that the socket's buffer had no room for. What was reliable in them is sent again.
    pub full: u64,
    /// Datagrams that could not be sent because the agent was not reachable.
    pub unreachable: u64,
    /// Datagrams that the system refused otherwise.
    pub failed: u64,
    /// Datagrams received that were longer than the MTU, and dropped.
    pub oversized: u64,
}

impl SocketStats {
    /// Counts a datagram that was not simply sent.
    #[cold]
    #[inline(never)]
    fn count(&mut self, sent: &io::Result<Sent>) {
        let counter = match sent {
            Ok(Sent::Yes) => return,
            Ok(Sent::Full) => &mut self.full,
            Ok(Sent::Unreachable) => &mut self.unreachable,
            Err(_) => &mut self.failed,
        };
        *counter += 1;
    }
}

/// What can be asked without the lock. Written under it.
#[derive(Debug, Default)]
pub(super) struct Glance {
    /// The session is up.
    up: AtomicBool,
    /// Samples wait here.
    backlog: AtomicBool,
    /// The agent has told of endpoints that do not fit.
    clash: AtomicBool,
    /// How often either of `up` and `clash` has become another.
    news: AtomicUsize,
}

impl Glance {
    pub(super) fn is_up(&self) -> bool {
        self.up.load(Ordering::Acquire)
    }

    pub(super) fn has_backlog(&self) -> bool {
        self.backlog.load(Ordering::Acquire)
    }

    #[cfg(feature = "texts")]
    pub(super) fn has_clash(&self) -> bool {
        self.clash.load(Ordering::Acquire)
    }

    pub(super) fn news(&self) -> usize {
        self.news.load(Ordering::Acquire)
    }

    pub(super) fn show_clash(&self, any: bool) {
        self.show(&self.clash, any);
    }

    fn show(&self, what: &AtomicBool, value: bool) {
        if what.swap(value, Ordering::Release) != value {
            self.news.fetch_add(1, Ordering::Release);
        }
    }
}

#[cfg_attr(not(feature = "full"), expect(dead_code, reason = "for those that go"))]
pub(super) struct State {
    pub(super) session: Box<XrceSession>,
    pub(super) ends: Ends,
    /// The names of nodes, whose participants have the numbers from 1 on.
    pub(super) participants: Vec<String>,
    pub(super) topics: Vec<Topic>,
    pub(super) reader_numbers: Numbers,
    pub(super) writer_numbers: Numbers,
    pub(super) topic_numbers: Numbers,
    /// What the agent is to delete.
    pub(super) doomed: Doomed,
    /// The agent was lost, and what it may send after its return is to be determined anew.
    regrant: bool,
    /// What the timer is set to.
    armed: Nanos,
    /// The transport has no room at the moment.
    blocked: bool,
    pub(super) socket: SocketStats,
}

/// What messages from the agent are about.
#[derive(Default)]
pub(super) struct Ends {
    pub(super) glance: Arc<Glance>,
    pub(super) readers: Vec<Reader>,
    pub(super) writers: Vec<Writer>,
    pub(super) slots: Slots,
    /// The agent's refusal of the session, if that was its last word.
    pub(super) refused: Option<Status>,
    /// The latest answer to a question for the agent's time: how far it is ahead.
    pub(super) agent_time: Option<i64>,
    /// Some reader gets no more samples from the agent until it is granted some.
    spent: bool,
    /// Readers with a backlog.
    pending: Interest,
    /// Objects that do not talk with others, and why; not told yet.
    pub(super) clashes: Vec<(ObjectId, u8)>,
}

/// Where the samples of a round go.
pub(super) struct Round<'a, 'b> {
    /// Of whom; those that are full leave it.
    pub(super) interest: &'a mut Interest,
    pub(super) sink: &'a mut Sink<'b>,
    /// How many went there.
    pub(super) taken: usize,
}

impl Round<'_, '_> {
    /// Hands a sample over.
    fn give(&mut self, reader: ReaderId, info: &SampleInfo, sample: &[u8]) {
        self.taken += 1;
        if (self.sink)(reader, info, sample) == Room::Full {
            self.interest.remove(reader);
        }
    }
}

impl Ends {
    fn show_backlog(&self) {
        let any = !self.pending.is_empty();
        self.glance.backlog.store(any, Ordering::Release);
    }

    /// Something has come from the agent at `now`: samples go to where the round says, or wait.
    fn event(&mut self, now: Nanos, event: Event<'_>, round: &mut Round<'_, '_>) {
        let mut info = SampleInfo::at(now);
        let (object, payload) = match event {
            Event::Data {
                reader, payload, ..
            } => (reader, payload),
            Event::Request {
                replier,
                identity,
                payload,
            } if FULL => {
                info.request = RequestIdentity(identity.0);
                (replier, payload)
            }
            Event::Reply {
                requester,
                request,
                payload,
            } if FULL => {
                info.request = RequestIdentity::reply(request.0.into());
                (requester, payload)
            }
            Event::Notice { object, notice } if DELIVERY => return self.notice(object, notice),
            Event::Refused(status) => {
                self.refused = Some(status);
                return;
            }
            Event::Time(reply) if QUERIES => {
                self.agent_time = Some(reply.offset(super::setup::wall_clock()));
                return;
            }
            _ => return,
        };
        // One that was deleted has no slot any more.
        let id = ReaderId(self.slots.get(object.number()));
        let Some(reader) = self.readers.get_mut(usize::from(id.0)) else {
            return;
        };
        if let Some(flow) = &mut reader.flow {
            flow.granted = flow.granted.saturating_sub(1);
            self.spent |= flow.granted == 0;
        }
        // What is too long fits into no backlog: whom it is for refuses it, and says so.
        let at_once = reader.backlog.is_empty() || payload.len() > reader.max_size;
        if at_once && round.interest.contains(id) {
            return round.give(id, &info, payload);
        }
        if !reader.backlog.push(&info, payload) {
            reader.lost += 1;
        }
        if !reader.backlog.is_empty() {
            self.pending.insert(id);
            self.show_backlog();
        }
    }

    fn notice(&mut self, object: ObjectId, notice: Notice) {
        match notice {
            Notice::Served(served) if FULL => {
                let requester = self.writers.iter_mut().find(|w| w.object == object);
                requester.into_iter().for_each(|w| w.served = served);
            }
            Notice::IncompatibleQos(policies) if self.clashes.len() != CLASHES => {
                self.clashes.push((object, policies));
                self.glance.show_clash(true);
            }
            Notice::IncompatibleQos(_) | Notice::Served(_) => {}
        }
    }
}

impl State {
    pub(super) fn new(session: Box<XrceSession>) -> Self {
        Self {
            session,
            ends: Ends {
                clashes: Vec::with_capacity(CLASHES),
                ..Ends::default()
            },
            participants: Vec::new(),
            topics: Vec::new(),
            reader_numbers: Numbers::default(),
            writer_numbers: Numbers::default(),
            topic_numbers: Numbers::default(),
            doomed: Doomed::new(),
            regrant: false,
            armed: Nanos::MAX,
            blocked: false,
            socket: SocketStats::default(),
        }
    }

    pub(super) const fn is_up(&self) -> bool {
        matches!(self.session.state(), SessionState::Up)
    }

    /// Nothing waits for this reader any more.
    #[cfg(feature = "full")]
    pub(super) fn forget(&mut self, id: ReaderId) {
        self.ends.pending.remove(id);
        self.ends.show_backlog();
    }

    /// After everything that may have changed the session's state.
    #[cfg_attr(not(feature = "std"), inline(never))]
    fn show_link(&self) {
        let glance = &self.ends.glance;
        glance.show(&glance.up, self.is_up());
    }

    /// Whether a sample of a reader in `interest` waits here.
    pub(super) fn has_sample(&self, interest: &Interest) -> bool {
        self.ends.pending.meets(interest)
    }

    /// Whether any sample waits here.
    pub(super) fn has_backlog(&self) -> bool {
        !self.ends.pending.is_empty()
    }

    /// Hands samples that waited to where the round says, up to `limit` in all.
    pub(super) fn take_backlog(&mut self, round: &mut Round<'_, '_>, limit: usize) {
        let ends = &mut self.ends;
        let waiting = ends.pending;
        for id in waiting.iter() {
            let Some(reader) = ends.readers.get_mut(usize::from(id.0)) else {
                continue;
            };
            while round.interest.contains(id)
                && round.taken < limit
                && let Some((info, sample)) = reader.backlog.front()
            {
                round.give(id, &info, sample);
                reader.backlog.pop();
            }
            if reader.backlog.is_empty() {
                ends.pending.remove(id);
            }
        }
        ends.show_backlog();
    }

    /// Handles a datagram: samples of readers in the round's interest go to its sink, others wait.
    /// Whether the session is to be looked after now: mostly not.
    pub(super) fn receive(
        &mut self,
        now: Nanos,
        datagram: &[u8],
        round: &mut Round<'_, '_>,
    ) -> bool {
        let Self { session, ends, .. } = self;
        let busy = session.handle(now, datagram, &mut |event| ends.event(now, event, round));
        if busy {
            self.show_link();
        }
        let late = self.armed <= now || self.blocked;
        let due = late || self.regrant || self.ends.spent;
        busy || due || !self.doomed.is_empty()
    }

    /// Lets the session notice that time has passed.
    pub(super) fn tick(&mut self, now: Nanos) {
        let regrant = &mut self.regrant;
        self.session
            .tick(now, &mut |event| *regrant |= matches!(event, Event::Down));
        self.show_link();
    }

    /// The transport says that the agent is gone.
    pub(super) fn disconnected(&mut self, now: Nanos) {
        let regrant = &mut self.regrant;
        self.session
            .disconnected(now, &mut |event| *regrant |= matches!(event, Event::Down));
        self.show_link();
    }

    /// Asks the agent for as many samples as there is room for, for keep-all readers that have got
    /// all they had asked for: so none comes that must be dropped, and the others wait at the agent.
    pub(super) fn grant(&mut self) {
        let lost = core::mem::take(&mut self.regrant);
        if !core::mem::take(&mut self.ends.spent) && !lost {
            return;
        }
        if lost {
            self.ends.writers.iter_mut().for_each(|w| w.served = false);
        }
        for reader in &mut self.ends.readers {
            let flow = reader.flow.as_mut();
            let Some(flow) = flow.filter(|flow| lost || flow.granted == 0) else {
                continue;
            };
            let room = flow.depth.saturating_sub(reader.backlog.len());
            if lost || room >= flow.depth.div_ceil(2) {
                let room = u16::try_from(room).unwrap_or(u16::MAX - 1);
                let control = DeliveryControl {
                    max_samples: room,
                    ..flow.control
                };
                let asked = self.session.read(reader.object, flow.stream, control);
                flow.granted = if asked.is_ok() { room } else { 0 };
            }
            // If there is no room or no way to ask now, the reader stays spent: it is asked for later.
            self.ends.spent |= flow.granted == 0;
        }
    }

    /// Writes a sample and sends what is due.
    pub(super) fn publish(
        &mut self,
        now: Nanos,
        writer: WriterId,
        payload: &[u8],
        transport: &dyn Transport,
        alarm: &Alarm,
    ) -> Result<(), PublishError> {
        let writer = self
            .ends
            .writers
            .get(usize::from(writer.0))
            .filter(|writer| !writer.closed)
            .ok_or(PublishError::UnknownWriter)?;
        let (object, stream, limit) = (writer.object, writer.stream, writer.max_size);
        if payload.len() > limit {
            return Err(PublishError::TooLarge {
                size: payload.len(),
                limit,
            });
        }
        self.session
            .write(object, stream, payload)
            .map_err(|error| match error {
                WriteError::WouldBlock => PublishError::Full,
                WriteError::TooLarge { size, limit } => PublishError::TooLarge { size, limit },
                WriteError::UnknownStream(_) => PublishError::UnknownWriter,
                _ => PublishError::LinkDown,
            })?;
        let sent = self.flush(now, transport, alarm);
        // A reliable sample stays in the session and goes out again; a best-effort one is gone.
        match sent {
            Err(error) if !stream.is_reliable() => {
                Err(PublishError::Io(error.raw_os_error().unwrap_or(0)))
            }
            Ok(Sent::Full) if !stream.is_reliable() => Err(PublishError::Full),
            _ => Ok(()),
        }
    }

    /// Sends everything the session has to send; returns what became of the last datagram that was
    /// not simply sent. Sets the timer to the session's next deadline.
    pub(super) fn flush(
        &mut self,
        now: Nanos,
        transport: &dyn Transport,
        alarm: &Alarm,
    ) -> io::Result<Sent> {
        let mut result = Ok(Sent::Yes);
        while transport.ready_at() <= now
            && let Some(datagram) = self.session.poll_transmit(now)
        {
            let sent = transport.send(now, datagram);
            if !matches!(sent, Ok(Sent::Yes)) {
                self.socket.count(&sent);
                result = sent;
            }
        }
        self.arm(now, transport.ready_at(), alarm);
        result
    }

    /// Sets the timer if it is not set to fire early enough. A timer that fires too early costs one
    /// look at the session; moving it for every message would cost more.
    fn arm(&mut self, now: Nanos, ready: Nanos, alarm: &Alarm) {
        let mut next = self.session.next_deadline().unwrap_or(Nanos::MAX);
        self.blocked = ready == Nanos::MAX;
        if ready == Nanos::MAX {
            next = next.max(now.saturating_add(BLOCKED)); // the descriptor will tell
        } else if ready > now {
            next = ready;
        }
        let fired = self.armed <= now;
        if next >= self.armed && !fired {
            return;
        }
        // Arming also forgets that it has fired, so that it need not be read.
        let set = alarm.set(next);
        self.armed = if set.is_ok() { next } else { Nanos::MAX };
    }
}

/// The real-time stream; the only one where there is room for one alone.
const REAL_TIME: u8 = if STREAMS > 1 { 1 } else { 0 };

/// The stream for a reliability and a criticality: real-time topics have one of their own, which is
/// served first.
pub(super) const fn stream(reliable: bool, criticality: Criticality) -> StreamId {
    let index = match criticality {
        Criticality::Normal => 0,
        Criticality::RealTime => REAL_TIME,
    };
    if reliable {
        StreamId::reliable(index)
    } else {
        StreamId::best_effort(index)
    }
}
