//! [`Session`]: log-in, objects, samples, time.

use super::link::{Link, LinkStats, SessionState};
use super::streams::Streams;
use super::{Buffers, Config, Journal, ReliableBuffers, RequestError, RequestState, WriteError};
use crate::features::{DELIVERY, QUERIES, SERVICES};
use crate::stream::{BestEffortStats, InputStats, OutputStats, PushError};
use crate::time::{NEVER, Nanos, later};
use crate::wire::{
    BaseRequest, Create, CreationMode, DeliveryControl, Encode, Entity, ObjectId, ObjectKind,
    RawBody, ReadData, RequestId, SampleIdentity, SessionId, StreamId, SubmessageId, WireTime,
    Writer, padding,
};

/// Bytes of the longest message outside of streams: a log-in, with its properties if it has any.
const SCRATCH: usize = if DELIVERY { 192 } else { 36 };

/// Requests without an answer at a time, at most. Agents drop answers that they have no room for,
/// and each dropped one costs [`Config::answer_within`]: ours keeps 64 besides those under way.
pub(super) const MAX_ASKED: usize = 48;

/// A session with an agent; `S` is any kind of buffer, `N` the most messages kept per reliable
/// stream, `E` the most objects and reads; `B` best-effort and `R` reliable streams each way.
#[derive(Debug)]
pub struct Session<S, const N: usize, const E: usize, const B: usize = 1, const R: usize = 1> {
    pub(super) config: Config,
    pub(super) link: Link,
    pub(super) journal: Journal<S, E>,
    pub(super) requests: RequestId,
    pub(super) streams: Streams<S, N, B, R>,
    pub(super) time_request: Option<WireTime>,
    /// The question about the agent itself that is to be sent, and the one without an answer yet.
    pub(super) info_request: Option<u32>,
    pub(super) info_asked: Option<RequestId>,
    /// Requests to be answered when that was last looked at, and when their number changed.
    pub(super) asked: (usize, Nanos),
    /// Requests without an answer at a time, at most; no limit once the agent left one unanswered.
    pub(super) max_asked: usize,
    /// Clients that will return with this one, as the agent has said last.
    pub(super) companions: u8,
    /// The agent tells unasked what becomes of objects.
    pub(super) notices: bool,
    pub(super) scratch: [u8; SCRATCH],
}

impl<S, const N: usize, const E: usize, const B: usize, const R: usize> Session<S, N, E, B, R>
where
    S: AsRef<[u8]> + AsMut<[u8]>,
{
    /// A session that is not wanted yet.
    pub fn new(config: Config, buffers: Buffers<S, B, R>) -> Self {
        let (best_effort, reliable) = (buffers.best_effort, buffers.reliable);
        let streams = Streams::of(&config, buffers.restore, best_effort, reliable);
        Self::with(config, buffers.journal, streams)
    }

    /// The same with storage that is made for each stream by its index and goes to its place at
    /// once: a little smaller and faster than [`Session::new`], which moves the arrays.
    pub fn from_fn(
        config: Config,
        journal: S,
        restore: S,
        best_effort: impl FnMut(usize) -> S,
        reliable: impl FnMut(usize) -> ReliableBuffers<S>,
    ) -> Self {
        let streams = Streams::new(&config, restore, best_effort, reliable);
        Self::with(config, journal, streams)
    }

    fn with(config: Config, journal: S, streams: Streams<S, N, B, R>) -> Self {
        Session {
            link: Link::new(&config),
            config,
            journal: Journal::new(journal),
            requests: RequestId::NONE,
            streams,
            time_request: None,
            info_request: None,
            info_asked: None,
            asked: (0, 0),
            max_asked: MAX_ASKED,
            companions: 0,
            notices: false,
            scratch: [0; SCRATCH],
        }
    }

    /// Begins to log in.
    pub fn connect(&mut self, now: Nanos) {
        if self.link.state == SessionState::Idle {
            self.link.enter(now, SessionState::Connecting, &self.config);
            self.link.hear(now);
        }
    }

    /// Begins to log out; unacknowledged samples are given up.
    pub fn close(&mut self, now: Nanos) {
        let lost = self.streams.give_up();
        self.link.stats.lost = self.link.stats.lost.saturating_add(lost);
        let state = if self.link.has_session() {
            SessionState::Closing
        } else {
            SessionState::Idle
        };
        self.link.enter(now, state, &self.config);
    }

    /// State of the session with its agent.
    pub const fn state(&self) -> SessionState {
        self.link.state
    }

    /// The session's id, or that of the latest log-in.
    pub const fn id(&self) -> SessionId {
        self.link.session
    }

    /// Time at which the agent was last heard of in a session, or when [`Session::connect`] was
    /// called.
    pub const fn heard(&self) -> Nanos {
        self.link.heard()
    }

    /// The counters of the link.
    pub const fn link_stats(&self) -> LinkStats {
        self.link.stats
    }

    /// The counters of all reliable output streams together.
    pub fn output_stats(&self) -> OutputStats {
        self.streams.output_stats()
    }

    /// The counters of all reliable and all best-effort input streams.
    pub fn input_stats(&self) -> (InputStats, BestEffortStats) {
        self.streams.input_stats()
    }

    /// The counters of one reliable stream, both ways.
    pub fn stream_stats(&self, stream: StreamId) -> Option<(OutputStats, InputStats)> {
        self.streams.stream_stats(stream)
    }

    /// Whether every reliable message that was written has been acknowledged.
    pub fn is_delivered(&self) -> bool {
        self.streams.is_delivered()
    }

    /// Reliable messages that were written and not acknowledged.
    pub fn unacknowledged(&self) -> usize {
        self.streams.unacknowledged()
    }

    /// The largest sample that [`Session::write`] takes on `stream`, if there is that stream.
    pub fn limit(&self, stream: StreamId) -> Option<usize> {
        self.streams.limit(stream)
    }

    /// Creates an object, now or once the session is up, and anew after every later log-in. The
    /// answer is an [`Event::Status`](super::Event::Status) and in [`Session::creation`].
    ///
    /// # Errors
    /// [`RequestError`]; nothing was done then.
    pub fn create(
        &mut self,
        object: ObjectId,
        mode: CreationMode,
        entity: &Entity<'_>,
    ) -> Result<(), RequestError> {
        if object.kind() != Ok(entity.kind()) {
            return Err(RequestError::WrongObject(object));
        }
        let is_service = matches!(entity, Entity::Requester { .. } | Entity::Replier { .. });
        if !SERVICES && is_service {
            return Err(RequestError::Unsupported);
        }
        let base = BaseRequest {
            request: RequestId::NONE,
            object,
        };
        let create = Create {
            base,
            mode,
            entity: *entity,
        };
        self.create_as(object, &create)
    }

    /// As [`create`](Self::create), with a body that is a CREATE of `object` in bytes of your own
    /// making, whose request id is [`RequestId::NONE`].
    ///
    /// # Errors
    /// [`RequestError`]; nothing was done then.
    pub fn create_as(&mut self, object: ObjectId, body: &impl Encode) -> Result<(), RequestError> {
        let measured = body.measure();
        let len = measured.map_err(|error| RequestError::Stream(PushError::Wire(error)))?;
        let flags = body.flags();
        let room = self.record(object, SubmessageId::Create, flags, len)?;
        body.write(&mut Writer::new(room));
        self.recorded();
        Ok(())
    }

    /// Asks for the samples of `reader`, on the agent's `stream`, now or once the session is up,
    /// and anew after every later log-in.
    ///
    /// # Errors
    /// [`RequestError`]; nothing was done then.
    pub fn read(
        &mut self,
        reader: ObjectId,
        stream: StreamId,
        control: DeliveryControl,
    ) -> Result<(), RequestError> {
        let kind = reader.kind();
        if !matches!(
            kind,
            Ok(ObjectKind::DataReader | ObjectKind::Requester | ObjectKind::Replier)
        ) {
            return Err(RequestError::WrongObject(reader));
        }
        let base = BaseRequest {
            request: RequestId::NONE,
            object: reader,
        };
        let body = ReadData::unfiltered(base, stream, control);
        let body = body.as_flattened();
        let room = self.record(reader, SubmessageId::ReadData, 0, body.len())?;
        room.copy_from_slice(body);
        self.recorded();
        Ok(())
    }

    /// Deletes an object, and forgets it even if there is no session.
    ///
    /// # Errors
    /// [`RequestError::Stream`] if the DELETE cannot be queued now.
    pub fn delete(&mut self, object: ObjectId) -> Result<(), RequestError> {
        if self.link.has_session() {
            let request = self.requests.next();
            let base = BaseRequest { request, object }.to_bytes();
            self.streams
                .request(&RawBody::delete(&base))
                .map_err(RequestError::Stream)?;
            self.requests = request;
        }
        self.journal.forget(object);
        Ok(())
    }

    /// As [`delete`](Self::delete), behind what was written to `stream`: a last reply still goes
    /// out. Where samples on that stream wait for the next agent it waits for them, too.
    ///
    /// # Errors
    /// [`RequestError::Stream`] if the DELETE cannot be queued now; try again.
    pub fn delete_behind(
        &mut self,
        object: ObjectId,
        stream: StreamId,
    ) -> Result<(), RequestError> {
        let later = RequestError::Stream(PushError::WouldBlock);
        if self.link.state != SessionState::Up {
            // Forgotten now, the object would not exist when its samples arrive.
            return if self.streams.carries(stream) {
                Err(later)
            } else {
                self.delete(object)
            };
        }
        let request = self.requests.next();
        let base = BaseRequest { request, object }.to_bytes();
        self.streams
            .write(stream, &RawBody::delete(&base), 0)
            .map_err(|_| later)?;
        self.requests = request;
        self.journal.forget(object);
        Ok(())
    }

    /// State of the creation of `object`; `None` if it was not asked for.
    pub fn creation(&self, object: ObjectId) -> Option<RequestState> {
        self.journal.creation(object)
    }

    /// Writes a sample: CDR without encapsulation header. It goes out with the next
    /// [`Session::poll_transmit`], together with what else is written before that.
    ///
    /// # Errors
    /// [`WriteError`]; nothing was done then.
    pub fn write(
        &mut self,
        writer: ObjectId,
        stream: StreamId,
        payload: &[u8],
    ) -> Result<(), WriteError> {
        self.push(writer, stream, None, payload)?;
        Ok(())
    }

    /// Sends a request: CDR without encapsulation header. Its reply is an
    /// [`Event::Reply`](super::Event::Reply) with the number given here.
    ///
    /// # Errors
    /// [`WriteError`]; nothing was done then.
    pub fn request(
        &mut self,
        requester: ObjectId,
        stream: StreamId,
        payload: &[u8],
    ) -> Result<RequestId, WriteError> {
        self.push(requester, stream, None, payload)
    }

    /// Answers the request of that identity.
    ///
    /// # Errors
    /// [`WriteError`]; nothing was done then.
    pub fn reply(
        &mut self,
        replier: ObjectId,
        stream: StreamId,
        identity: SampleIdentity,
        payload: &[u8],
    ) -> Result<(), WriteError> {
        self.push(replier, stream, Some(&identity), payload)?;
        Ok(())
    }

    fn push(
        &mut self,
        object: ObjectId,
        stream: StreamId,
        identity: Option<&SampleIdentity>,
        payload: &[u8],
    ) -> Result<RequestId, WriteError> {
        if self.link.state != SessionState::Up {
            return Err(WriteError::Down);
        }
        let request = self.requests.next();
        let base = BaseRequest { request, object }.to_bytes();
        let mut reply = [0; 28];
        let mut body = RawBody {
            id: SubmessageId::WriteData,
            flags: 0,
            head: &base,
            rest: payload,
        };
        if let Some(SampleIdentity(identity)) = identity {
            let bytes = base.iter().chain(identity);
            reply
                .iter_mut()
                .zip(bytes)
                .for_each(|(to, from)| *to = *from);
            body.head = &reply;
        }
        self.streams.write(stream, &body, payload.len())?;
        self.requests = request;
        Ok(request)
    }

    /// Asks the agent about itself: `mask` is made of [`INFO_ACTIVITY`](crate::wire::INFO_ACTIVITY)
    /// and [`INFO_CONFIGURATION`](crate::wire::INFO_CONFIGURATION). The answer is an
    /// [`Event::Info`](super::Event::Info). Neither is repeated if it is lost.
    ///
    /// # Errors
    /// [`RequestError::Down`]; without the feature `queries` [`RequestError::Unsupported`].
    pub fn request_info(&mut self, mask: u32) -> Result<(), RequestError> {
        if !QUERIES {
            return Err(RequestError::Unsupported);
        }
        if !self.link.has_session() {
            return Err(RequestError::Down);
        }
        self.info_request = Some(mask);
        Ok(())
    }

    /// Whether the agent tells unasked what becomes of objects:
    /// [`Event::Notice`](super::Event::Notice).
    #[must_use]
    pub fn has_notices(&self) -> bool {
        DELIVERY && self.notices && self.link.has_session()
    }

    /// Asks for the agent's time; `wall` is the client's time now. The answer is an
    /// [`Event::Time`](super::Event::Time). Neither is repeated if it is lost.
    ///
    /// # Errors
    /// [`RequestError::Down`]; without the feature `queries` [`RequestError::Unsupported`].
    pub fn request_time(&mut self, wall: WireTime) -> Result<(), RequestError> {
        if !QUERIES {
            return Err(RequestError::Unsupported);
        }
        if !self.link.has_session() {
            return Err(RequestError::Down);
        }
        self.time_request = Some(wall);
        Ok(())
    }

    /// Notes whether the agent answers requests.
    pub(super) fn watch_answers(&mut self, now: Nanos) {
        let asked = self.journal.asked();
        if asked != self.asked.0 {
            self.asked = (asked, now);
        }
    }

    /// Time at which unanswered requests are given up.
    pub(super) fn answer_due(&self) -> Nanos {
        match self.asked {
            (0, _) => NEVER,
            (_, since) => later(since, self.config.answer_within),
        }
    }

    pub(super) fn send_queued(&mut self) {
        while self.journal.asked() < self.max_asked {
            let request = self.requests.next();
            let Some(recorded) = self.journal.next_queued(request) else {
                return;
            };
            if self.streams.request(&recorded).is_err() {
                return; // again when messages have been acknowledged
            }
            self.requests = request;
            self.journal.mark_sent();
        }
    }

    /// Room in the journal for a request with a body of `len` bytes.
    fn record(
        &mut self,
        object: ObjectId,
        id: SubmessageId,
        flags: u8,
        len: usize,
    ) -> Result<&mut [u8], RequestError> {
        let size = len.wrapping_add(padding(len, 4)).wrapping_add(4);
        let limit = self.streams.request_limit();
        if size > limit {
            return Err(RequestError::Stream(PushError::TooLarge { size, limit }));
        }
        self.journal
            .place(object, id, flags, len)
            .ok_or(RequestError::JournalFull)
    }

    /// The room was filled.
    fn recorded(&mut self) {
        if self.link.has_session() {
            self.send_queued();
        }
    }
}
