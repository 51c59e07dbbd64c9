//! The session's receiving half: datagrams and time in, events out.

use super::{Event, Journal, Session, State};
use crate::Nanos;
use crate::wire::{BaseRequest, Body, Data, Message, RequestId, StreamId, Submessage};

impl<S: AsRef<[u8]> + AsMut<[u8]>, const N: usize, const E: usize> Session<S, N, E> {
    /// A datagram has arrived.
    pub fn handle(&mut self, now: Nanos, datagram: &[u8], events: &mut impl FnMut(Event<'_>)) {
        let Some(message) = self.mine(datagram) else {
            self.link.stats.rejected = self.link.stats.rejected.saturating_add(1);
            return;
        };
        if self.link.has_session() {
            self.link.hear(now, &self.config);
        }
        match message.header.stream {
            StreamId::NONE => {
                for submessage in message.submessages().map_while(Result::ok) {
                    self.outside(now, &submessage, events);
                }
            }
            _ if !self.link.has_session() => {}
            StreamId::BEST_EFFORT => {
                if self.inputs.best_effort.accept(message.header.seq) {
                    for submessage in message.submessages().map_while(Result::ok) {
                        sample(&mut self.journal, &submessage, events);
                    }
                }
            }
            StreamId::RELIABLE => {
                let journal = &mut self.journal;
                self.inputs
                    .reliable
                    .receive(message.header.seq, message.body, |submessage| {
                        sample(journal, submessage, events);
                    });
            }
            _ => self.link.stats.rejected = self.link.stats.rejected.saturating_add(1),
        }
        self.advance(events);
    }

    /// Time has passed: notices the loss of the agent.
    pub fn tick(&mut self, now: Nanos, events: &mut impl FnMut(Event<'_>)) {
        if self.link.is_lost(now, &self.config) {
            self.link.stats.losses = self.link.stats.losses.saturating_add(1);
            let kept = self.outputs.reliable.unacknowledged();
            let kept = u64::try_from(kept).unwrap_or(u64::MAX);
            self.link.stats.unacknowledged = self.link.stats.unacknowledged.saturating_add(kept);
            self.link.enter(now, State::Connecting, &self.config);
            events(Event::Down);
        } else if self.link.gave_up_closing(now) {
            self.link.enter(now, State::Idle, &self.config);
            events(Event::Closed);
        }
        self.advance(events);
    }

    /// Parses a datagram and checks that it is of this session.
    fn mine<'a>(&self, datagram: &'a [u8]) -> Option<Message<'a>> {
        let message = Message::parse(datagram).ok()?;
        let header = &message.header;
        let key = header.key.is_none_or(|key| key == self.config.key);
        (self.link.state != State::Idle && header.session == self.link.session && key)
            .then_some(message)
    }

    /// Handles a submessage outside of streams.
    fn outside(
        &mut self,
        now: Nanos,
        submessage: &Submessage<'_>,
        events: &mut impl FnMut(Event<'_>),
    ) {
        match submessage.body() {
            Ok(Body::StatusAgent(answer)) if self.link.state == State::Connecting => {
                if answer.status.is_ok() {
                    self.logged_in(now);
                } else {
                    events(Event::Refused(answer.status));
                }
            }
            Ok(Body::Status(answer))
                if self.link.state == State::Closing
                    && answer.base.request == RequestId::LOGOUT =>
            {
                self.link.enter(now, State::Idle, &self.config);
                events(Event::Closed);
            }
            _ if !self.link.has_session() => {}
            Ok(Body::AckNack(ack)) => {
                self.outputs
                    .acknowledge(now, ack.stream, ack.first_unacked, ack.missing);
            }
            Ok(Body::Heartbeat(heartbeat)) if heartbeat.stream == StreamId::RELIABLE => {
                self.inputs.reliable.heartbeat(heartbeat.last);
            }
            Ok(Body::TimestampReply(reply)) => events(Event::Time(reply)),
            _ => sample(&mut self.journal, submessage, events),
        }
    }

    /// The agent has a new session for us: everything starts from the beginning.
    fn logged_in(&mut self, now: Nanos) {
        self.link.enter(now, State::Restoring, &self.config);
        self.link.hear(now, &self.config);
        self.outputs.reset(&self.config, self.link.session);
        self.inputs.best_effort.reset();
        self.inputs.reliable.reset();
        self.journal.requeue();
        self.time_request = None;
    }

    /// Sends queued requests as far as the stream takes them; notices that all were answered.
    fn advance(&mut self, events: &mut impl FnMut(Event<'_>)) {
        if !self.link.has_session() {
            return;
        }
        self.send_queued();
        if self.link.state == State::Restoring && self.journal.is_settled() {
            self.link.state = State::Up;
            self.link.stats.sessions = self.link.stats.sessions.saturating_add(1);
            events(Event::Up);
        }
    }
}

/// Handles a submessage of a stream: samples and answers.
fn sample<S: AsRef<[u8]> + AsMut<[u8]>, const E: usize>(
    journal: &mut Journal<S, E>,
    submessage: &Submessage<'_>,
    events: &mut impl FnMut(Event<'_>),
) {
    match submessage.body() {
        Ok(Body::Data(Data { base, payload })) => {
            events(Event::Data {
                reader: base.object,
                request: base.request,
                payload,
            });
        }
        Ok(Body::Status(answer)) => {
            journal.answer(answer.base, answer.status);
            let BaseRequest { request, object } = answer.base;
            events(Event::Status {
                request,
                object,
                status: answer.status,
            });
        }
        _ => {}
    }
}
