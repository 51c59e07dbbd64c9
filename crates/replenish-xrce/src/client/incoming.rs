//! The session's receiving half: datagrams and time in, events out.

use super::session::MAX_ASKED;
use super::{Event, Journal, Session, SessionState};
use crate::Nanos;
use crate::counter::{count, count_all};
use crate::features::{DELIVERY as DELIVERY_FEATURE, FRAGMENTS, QUERIES, SERVICES};
use crate::wire::{
    AckNack, BaseRequest, Body, DELIVERY, DELIVERY_CONFIRMED, Data, Heartbeat, Message, Notice,
    ObjectKind, RequestId, SampleIdentity, StatusAgent, StatusReply, StreamId, Submessage,
    SubmessageId,
};

impl<S, const N: usize, const E: usize, const B: usize, const R: usize> Session<S, N, E, B, R>
where
    S: AsRef<[u8]> + AsMut<[u8]>,
{
    /// A datagram has arrived. Returns whether the session may have something to do now that
    /// [`next_deadline`](Self::next_deadline) did not tell before: best-effort samples, the usual
    /// case, leave nothing to do.
    pub fn handle(
        &mut self,
        now: Nanos,
        datagram: &[u8],
        events: &mut dyn FnMut(Event<'_>),
    ) -> bool {
        let Some(message) = self.mine(datagram) else {
            count(&mut self.link.stats.rejected);
            return false;
        };
        if self.link.has_session() {
            self.link.hear(now);
        }
        match message.header.stream {
            StreamId::NONE => {
                let mut submessages = message.submessages();
                while let Some(submessage) = submessages.whole() {
                    self.outside(now, &submessage, events);
                }
            }
            _ if !self.link.has_session() => {}
            stream => {
                if !self.receive(stream, &message, events) {
                    count(&mut self.link.stats.rejected);
                }
            }
        }
        let calm = message.header.stream.best_effort_index().is_some()
            && self.link.state == SessionState::Up
            && self.journal.asked() == self.asked.0;
        if !calm {
            self.watch_answers(now);
            self.advance(events);
        }
        !calm
    }

    /// A message of a stream; false if there is no such stream.
    fn receive(
        &mut self,
        stream: StreamId,
        message: &Message<'_>,
        events: &mut dyn FnMut(Event<'_>),
    ) -> bool {
        let (journal, malformed) = (&mut self.journal, &mut self.link.stats.malformed);
        let seq = message.header.seq;
        if let Some(stream) = self.streams.best_effort_mut(stream) {
            if stream.input.accept(seq) {
                let mut submessages = message.submessages();
                while let Some(submessage) = submessages.whole() {
                    sample(journal, malformed, &submessage, events);
                }
            }
        } else if let Some(stream) = self.streams.reliable_mut(stream) {
            stream.input.receive(seq, message.body, |submessage| {
                sample(journal, malformed, submessage, events);
            });
        } else {
            return false;
        }
        true
    }

    /// Time has passed: notices the loss of the agent.
    pub fn tick(&mut self, now: Nanos, events: &mut dyn FnMut(Event<'_>)) {
        if self.link.is_lost(now, &self.config) {
            self.lose(now, events);
        } else if self.link.gave_up_closing(now) {
            self.link.enter(now, SessionState::Idle, &self.config);
            events(Event::Closed);
        }
        self.watch_answers(now);
        if self.answer_due() <= now && self.link.has_session() {
            self.journal.give_up();
            self.max_asked = usize::MAX;
            self.watch_answers(now);
        }
        self.advance(events);
    }

    /// The transport says that the agent is gone: nothing is gained by waiting for its silence.
    pub fn disconnected(&mut self, now: Nanos, events: &mut dyn FnMut(Event<'_>)) {
        if self.link.has_session() {
            self.lose(now, events);
        }
    }

    fn lose(&mut self, now: Nanos, events: &mut dyn FnMut(Event<'_>)) {
        let stats = &mut self.link.stats;
        count(&mut stats.losses);
        count_all(&mut stats.unacknowledged, self.streams.unacknowledged());
        self.link.enter(now, SessionState::Connecting, &self.config);
        events(Event::Down);
    }

    /// Parses a datagram and checks that it is of this session.
    fn mine<'a>(&self, datagram: &'a [u8]) -> Option<Message<'a>> {
        let message = Message::parse(datagram).ok()?;
        let header = &message.header;
        let key = header.key.is_none_or(|key| key == self.config.key);
        (self.link.state != SessionState::Idle && header.session == self.link.session && key)
            .then_some(message)
    }

    /// Handles a submessage outside of streams.
    #[inline(never)]
    fn outside(
        &mut self,
        now: Nanos,
        submessage: &Submessage<'_>,
        events: &mut dyn FnMut(Event<'_>),
    ) {
        let (body, little) = (submessage.payload, submessage.little_endian());
        match submessage.id {
            SubmessageId::StatusAgent if self.link.state == SessionState::Connecting => {
                self.login_answered(now, submessage, events);
            }
            SubmessageId::Status if self.link.state == SessionState::Closing => {
                let logout = |answer: StatusReply| answer.base.request == RequestId::LOGOUT;
                if StatusReply::of(body).is_some_and(logout) {
                    self.link.enter(now, SessionState::Idle, &self.config);
                    events(Event::Closed);
                }
            }
            _ if !self.link.has_session() => {}
            SubmessageId::AckNack => {
                if let Some(ack) = AckNack::of(body, little) {
                    self.acknowledged(now, submessage, &ack);
                }
            }
            SubmessageId::Heartbeat => {
                if let Some(heartbeat) = Heartbeat::of(body, little)
                    && let Some(stream) = self.streams.reliable_mut(heartbeat.stream)
                {
                    stream.input.heartbeat(heartbeat.last);
                }
            }
            SubmessageId::Info | SubmessageId::TimestampReply => {
                if QUERIES {
                    self.query_answered(submessage, events);
                }
            }
            _ => {
                let malformed = &mut self.link.stats.malformed;
                sample(&mut self.journal, malformed, submessage, events);
            }
        }
    }

    fn login_answered(
        &mut self,
        now: Nanos,
        submessage: &Submessage<'_>,
        events: &mut dyn FnMut(Event<'_>),
    ) {
        let (status, confirms) = if DELIVERY_FEATURE {
            let Ok(Body::StatusAgent(answer)) = submessage.body() else {
                return;
            };
            (Some(answer.status), confirms_delivery(&answer))
        } else {
            (StatusAgent::outcome(submessage.payload), false)
        };
        match status {
            Some(status) if status.is_ok() => self.logged_in(now, confirms),
            Some(status) => events(Event::Refused(status)),
            None => {}
        }
    }

    fn acknowledged(&mut self, now: Nanos, submessage: &Submessage<'_>, ack: &AckNack) {
        let confirmed = submessage.confirmed().filter(|_| DELIVERY_FEATURE);
        self.streams.acknowledge(now, ack, confirmed);
        if let Some(confirmed) = confirmed {
            self.companions = confirmed.companions;
        }
    }

    fn query_answered(&mut self, submessage: &Submessage<'_>, events: &mut dyn FnMut(Event<'_>)) {
        match submessage.body() {
            Ok(Body::Info(info)) if Some(info.base.request) == self.info_asked => {
                self.info_asked = None;
                events(Event::Info(info));
            }
            Ok(Body::TimestampReply(reply)) => events(Event::Time(reply)),
            _ => {}
        }
    }

    /// The agent has a new session for us: everything starts from the beginning.
    fn logged_in(&mut self, now: Nanos, confirms: bool) {
        self.link.enter(now, SessionState::Restoring, &self.config);
        self.link.hear(now);
        let session = self.link.session;
        let carried = self.streams.begin(&self.config, session, confirms);
        let stats = &mut self.link.stats;
        stats.carried = stats.carried.saturating_add(carried.samples);
        stats.lost = stats.lost.saturating_add(carried.lost);
        self.journal.requeue();
        self.max_asked = MAX_ASKED;
        self.notices = confirms;
        self.time_request = None;
        self.info_request = None;
        self.info_asked = None;
    }

    /// Sends queued requests as far as the stream takes them; notices that all were answered.
    fn advance(&mut self, events: &mut dyn FnMut(Event<'_>)) {
        if !self.link.has_session() {
            return;
        }
        self.send_queued();
        let confirmed = self.journal.is_answered() && self.streams.is_restored();
        if self.link.state == SessionState::Restoring && confirmed {
            self.streams.resume();
            self.link.state = SessionState::Up;
            count(&mut self.link.stats.sessions);
            events(Event::Up);
        }
    }
}

/// Handles a submessage of a stream: samples and answers.
fn sample<S: AsRef<[u8]> + AsMut<[u8]>, const E: usize>(
    journal: &mut Journal<S, E>,
    malformed: &mut u64,
    submessage: &Submessage<'_>,
    events: &mut dyn FnMut(Event<'_>),
) {
    if let Some(data) = submessage.data() {
        match service_data(&data) {
            Some(event) => events(event),
            None => count(malformed),
        }
    } else {
        answer(journal, submessage, events);
    }
}

/// Whether the agent sends confirmations.
fn confirms_delivery(answer: &StatusAgent<'_>) -> bool {
    let mut confirms = false;
    answer.properties.for_each(|name, value| {
        confirms |= (name, value) == (DELIVERY, DELIVERY_CONFIRMED);
    });
    confirms
}

/// Handles a submessage of a stream that is no sample.
#[inline(never)]
fn answer<S: AsRef<[u8]> + AsMut<[u8]>, const E: usize>(
    journal: &mut Journal<S, E>,
    submessage: &Submessage<'_>,
    events: &mut dyn FnMut(Event<'_>),
) {
    if FRAGMENTS && submessage.id == SubmessageId::Fragment {
        if let Some(data) = Data::of_beginning(submessage.payload) {
            events(Event::TooLong {
                reader: data.base.object,
                request: data.base.request,
            });
        }
        return;
    }
    if submessage.id != SubmessageId::Status {
        return;
    }
    let Some(answer) = StatusReply::of(submessage.payload) else {
        return;
    };
    let BaseRequest { request, object } = answer.base;
    if let Some(notice) = Notice::of(&answer).filter(|_| DELIVERY_FEATURE) {
        return events(Event::Notice { object, notice });
    }
    journal.answer(answer.base, answer.status);
    events(Event::Status {
        request,
        object,
        status: answer.status,
    });
}

/// A sample by its kind: plain, a request with its identity, or a reply with its request. `None` if
/// it is too short for its kind.
fn service_data<'a>(data: &Data<'a>) -> Option<Event<'a>> {
    let Data { base, payload } = *data;
    Some(match base.object.kind() {
        Ok(ObjectKind::Replier) if SERVICES => {
            let (identity, payload) = SampleIdentity::split(payload)?;
            Event::Request {
                replier: base.object,
                identity,
                payload,
            }
        }
        Ok(ObjectKind::Requester) if SERVICES => {
            let (answered, payload) = BaseRequest::split(payload)?;
            Event::Reply {
                requester: base.object,
                request: answered.request,
                payload,
            }
        }
        _ => Event::Data {
            reader: base.object,
            request: base.request,
            payload,
        },
    })
}
