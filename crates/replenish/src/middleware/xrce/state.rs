//! The state under the session lock: the session, its readers and writers, and the timer that the
//! dispatcher waits on.

use super::limits::{CLASHES, STREAMS};
use super::objects::{Endpoints, Round, State};
use super::time::wall_clock;
use super::transport::{Sent, Transport};
use super::waiting::Alarm;
use crate::Nanos;
use crate::middleware::{Interest, PublishError, ReaderId, RequestIdentity, SampleInfo, WriterId};
use crate::platform::{FULL, io};
use crate::qos::Criticality;
use replenish_xrce::client::{Event, SessionState, WriteError};
use replenish_xrce::features::{DELIVERY, QUERIES};
use replenish_xrce::wire::{DeliveryControl, Notice, ObjectId, RequestId, StreamId};
use sporadic::{later, latest};

/// The shortest time between two looks after the session while the transport takes nothing.
const BLOCKED: Nanos = 5_000_000;

impl Endpoints {
    pub(super) fn show_backlog(&self) {
        self.flags.show_backlog(!self.pending.is_empty());
    }

    /// Something has come from the agent at `now`: samples go to where the round says, or wait.
    fn event(&mut self, now: Nanos, event: Event<'_>, round: &mut Round<'_, '_>) {
        let mut info = SampleInfo::at(now);
        let mut read = RequestId::NONE;
        let (object, payload) = match event {
            Event::Data {
                reader,
                request,
                payload,
            } => {
                read = request;
                (reader, payload)
            }
            Event::TooLong { reader, request } if FULL => {
                let id = self.slots.get(reader.number());
                if let Some(reader) = self.readers.get_mut(usize::from(id)) {
                    reader.lost += 1;
                    self.spent |= reader.spend(request);
                }
                return;
            }
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
                self.agent_time = Some(reply.offset(wall_clock()).saturating_neg());
                return;
            }
            _ => return,
        };
        // One that was deleted has no slot any more.
        let id = ReaderId(self.slots.get(object.number()));
        let Some(reader) = self.readers.get_mut(usize::from(id.0)) else {
            return;
        };
        self.spent |= reader.spend(read);
        // A sample that is too long fits into no backlog: its reader refuses and reports it.
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
                self.flags.show_clash(true);
            }
            Notice::IncompatibleQos(_) | Notice::Served(_) => {}
        }
    }
}

impl State {
    pub(super) const fn is_up(&self) -> bool {
        matches!(self.session.state(), SessionState::Up)
    }

    /// After everything that may have changed the session's state.
    #[cfg_attr(not(feature = "std"), inline(never))]
    fn show_link(&self) {
        self.endpoints.flags.show_link(self.is_up());
    }

    /// Whether a sample of a reader in `interest` waits here.
    pub(super) fn has_sample(&self, interest: &Interest) -> bool {
        self.endpoints.pending.meets(interest)
    }

    /// Whether any sample waits here.
    pub(super) fn has_backlog(&self) -> bool {
        !self.endpoints.pending.is_empty()
    }

    /// Hands samples that waited to where the round says, up to `limit` in all.
    pub(super) fn take_backlog(&mut self, round: &mut Round<'_, '_>, limit: usize) {
        let endpoints = &mut self.endpoints;
        let waiting = endpoints.pending;
        for id in waiting.iter() {
            let Some(reader) = endpoints.readers.get_mut(usize::from(id.0)) else {
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
                endpoints.pending.remove(id);
            }
        }
        endpoints.show_backlog();
    }

    /// Handles a datagram: samples of readers in the round's interest go to its sink, others wait.
    /// Whether the session is to be looked after now: mostly not.
    pub(super) fn receive(
        &mut self,
        now: Nanos,
        datagram: &[u8],
        round: &mut Round<'_, '_>,
    ) -> bool {
        let Self {
            session, endpoints, ..
        } = self;
        let busy = session.handle(now, datagram, &mut |event| {
            endpoints.event(now, event, round);
        });
        if busy {
            self.show_link();
        }
        let late = self.armed <= now || self.blocked;
        let due = late || self.regrant || self.endpoints.spent;
        busy || due || !self.pending_deletes.is_empty()
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
    /// all they had asked for: so none comes that must be dropped, and the others wait at the
    /// agent.
    pub(super) fn grant(&mut self) {
        let lost = core::mem::take(&mut self.regrant);
        if !core::mem::take(&mut self.endpoints.spent) && !lost {
            return;
        }
        if lost {
            self.endpoints
                .writers
                .iter_mut()
                .for_each(|w| w.served = false);
        }
        for reader in &mut self.endpoints.readers {
            let flow = reader.flow.as_mut();
            let Some(flow) = flow.filter(|flow| lost || flow.is_spent()) else {
                continue;
            };
            if FULL && lost {
                flow.lost();
            }
            let mut room = flow.depth.saturating_sub(reader.backlog.len());
            if FULL {
                room = room.saturating_sub(flow.expected());
            }
            if lost || room >= flow.depth.div_ceil(2) {
                let room = u16::try_from(room).unwrap_or(u16::MAX - 1);
                let control = DeliveryControl {
                    max_samples: room,
                    ..flow.control
                };
                if self
                    .session
                    .read(reader.object, flow.stream, control)
                    .is_ok()
                {
                    flow.asked(room);
                } else if !FULL {
                    flow.lost();
                }
            }
            // If there is no room or no way to ask now, the reader stays spent: it is asked for
            // later.
            self.endpoints.spent |= flow.is_spent();
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
            .endpoints
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
            next = latest(next, later(now, BLOCKED)); // the descriptor will tell
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
