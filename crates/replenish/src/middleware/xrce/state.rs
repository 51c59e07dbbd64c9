//! What the session lock protects: the session, its readers and writers, and the timer that the
//! dispatcher waits on.

use super::backlog::Backlog;
use super::endpoints::{Reader, Topic, Writer};
use crate::Nanos;
use crate::middleware::{Interest, PublishError, ReaderId, Room, SampleInfo, WriterId};
use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;
use replenish_os::timer::TimerFd;
use replenish_xrce::client::{Event, Session, State as Link, WriteError};
use replenish_xrce::udp::{Sent, UdpTransport};
use replenish_xrce::wire::{ObjectId, Status, StreamId};
use std::io;

/// Reliable datagrams kept per direction at most.
pub(super) const WINDOW: usize = 64;
/// Objects and reads of a session at most: a writer takes two and a reader three, plus one for
/// each node and one for each topic of a node.
pub(super) const REQUESTS: usize = 1024;

/// Streams of each kind and direction.
pub(super) const STREAMS: usize = 2;

pub(super) type XrceSession = Session<Box<[u8]>, WINDOW, REQUESTS, STREAMS, STREAMS>;

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

pub(super) struct State {
    pub(super) session: XrceSession,
    pub(super) readers: Vec<Reader>,
    pub(super) writers: Vec<Writer>,
    /// Node names and their participants.
    pub(super) participants: Vec<(String, ObjectId)>,
    pub(super) topics: Vec<Topic>,
    /// The agent's refusal of the session, if that was its last word.
    pub(super) refused: Option<Status>,
    /// Readers with a backlog.
    pending: Interest,
    /// What the timer is set to.
    armed: Nanos,
    pub(super) socket: SocketStats,
}

impl State {
    pub(super) fn new(session: XrceSession) -> Self {
        Self {
            session,
            readers: Vec::new(),
            writers: Vec::new(),
            participants: Vec::new(),
            topics: Vec::new(),
            refused: None,
            pending: Interest::empty(),
            armed: Nanos::MAX,
            socket: SocketStats::default(),
        }
    }

    pub(super) fn is_up(&self) -> bool {
        self.session.state() == Link::Up
    }

    /// Whether a sample of a reader in `interest` waits here.
    pub(super) fn has_sample(&self, interest: &Interest) -> bool {
        self.pending.iter().any(|reader| interest.contains(reader))
    }

    /// Whether any sample waits here.
    pub(super) fn has_backlog(&self) -> bool {
        !self.pending.is_empty()
    }

    /// Hands up to `limit` samples that waited to `sink`; takes readers that are full then out of
    /// `interest`.
    pub(super) fn take_backlog(
        &mut self,
        interest: &mut Interest,
        limit: usize,
        sink: &mut Sink<'_>,
    ) -> usize {
        let mut taken = 0;
        let waiting = self.pending;
        for id in waiting.iter() {
            let Some(reader) = self.readers.get_mut(usize::from(id.0)) else {
                continue;
            };
            while interest.contains(id) && taken < limit {
                let Some((arrival, sample)) = reader.backlog.front() else {
                    break;
                };
                taken += 1;
                if sink(id, &SampleInfo { arrival }, sample) == Room::Full {
                    interest.remove(id);
                }
                reader.backlog.pop();
            }
            if reader.backlog.is_empty() {
                self.pending.remove(id);
            }
        }
        taken
    }

    /// Handles a datagram: samples of readers in `interest` go to `sink`, others wait. Returns how
    /// many went to `sink`.
    pub(super) fn receive(
        &mut self,
        now: Nanos,
        datagram: &[u8],
        interest: &mut Interest,
        sink: &mut Sink<'_>,
    ) -> usize {
        let mut taken = 0;
        let Self {
            session,
            readers,
            pending,
            refused,
            ..
        } = self;
        session.handle(now, datagram, &mut |event| match event {
            Event::Data {
                reader, payload, ..
            } => {
                let index = reader.number().wrapping_sub(1);
                let Some(reader) = readers.get_mut(usize::from(index)) else {
                    return;
                };
                let id = ReaderId(index);
                if payload.len() > reader.max_size {
                    reader.lost += 1;
                } else if interest.contains(id) && reader.backlog.is_empty() {
                    taken += 1;
                    if sink(id, &SampleInfo { arrival: now }, payload) == Room::Full {
                        interest.remove(id);
                    }
                } else {
                    reader.lost += u64::from(!reader.backlog.push(now, payload));
                    pending.insert(id);
                }
            }
            Event::Refused(status) => *refused = Some(status),
            _ => {}
        });
        taken
    }

    /// Lets the session notice that time has passed.
    pub(super) fn tick(&mut self, now: Nanos) {
        self.session.tick(now, &mut |_| ());
    }

    /// Writes a sample and sends what is due.
    pub(super) fn publish(
        &mut self,
        now: Nanos,
        writer: WriterId,
        payload: &[u8],
        transport: &UdpTransport,
        timer: &TimerFd,
    ) -> Result<(), PublishError> {
        let writer = self
            .writers
            .get(usize::from(writer.0))
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
        let sent = self.flush(now, transport, timer);
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
        transport: &UdpTransport,
        timer: &TimerFd,
    ) -> io::Result<Sent> {
        let mut result = Ok(Sent::Yes);
        while let Some(datagram) = self.session.poll_transmit(now) {
            match transport.send(datagram) {
                Ok(Sent::Yes) => {}
                Ok(Sent::Full) => {
                    self.socket.full += 1;
                    result = Ok(Sent::Full);
                }
                Ok(Sent::Unreachable) => {
                    self.socket.unreachable += 1;
                    result = Ok(Sent::Unreachable);
                }
                Err(error) => {
                    self.socket.failed += 1;
                    result = Err(error);
                }
            }
        }
        self.arm(now, timer);
        result
    }

    /// Sets the timer if it is not set to fire early enough. A timer that fires too early costs one
    /// look at the session; moving it for every message would cost more.
    fn arm(&mut self, now: Nanos, timer: &TimerFd) {
        let next = self.session.next_deadline().unwrap_or(Nanos::MAX);
        let fired = self.armed <= now;
        if next >= self.armed && !fired {
            return;
        }
        // Arming also forgets that it has fired, so that it need not be read.
        let set = if next == Nanos::MAX {
            timer.disarm()
        } else {
            timer.arm(next)
        };
        self.armed = if set.is_ok() { next } else { Nanos::MAX };
    }
}

/// A backlog for a reader with this depth, size and history.
pub(super) fn backlog(depth: u16, max_size: usize, keep_last: bool) -> Backlog {
    Backlog::new(depth, max_size, keep_last)
}

/// The stream for a reliability.
pub(super) const fn stream(reliable: bool) -> StreamId {
    if reliable {
        StreamId::RELIABLE
    } else {
        StreamId::BEST_EFFORT
    }
}
