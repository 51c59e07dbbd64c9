//! Requests that a session must repeat after a new log-in: its objects, in the
//! order of their creation, and the reads that are on.
//!
//! ```text
//!   entry = length of the body LE (2), submessage, flags, state, status, body
//!   body  = request BE (2), object BE (2), ...               as it is sent
//! ```
//!
//! Entries stand one behind the other, in order; only state and request id change.

use crate::wire::{BaseRequest, ObjectId, RawBody, RequestId, Status, SubmessageId};

/// State of a request in the journal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RequestState {
    /// The request was not sent in this session yet.
    Queued,
    /// Sent, to be answered.
    Asked,
    /// Carried out; a read, which is not answered, once it was sent.
    Done,
    /// Refused by the agent with this status.
    Refused(Status),
    /// Sent, and not answered for as long as
    /// [`Config::answer_within`](super::Config::answer_within). A late answer counts all the same.
    Unanswered,
}

/// The codes of a [`RequestState`] in an entry; a refusal's status stands behind it.
mod code {
    pub(super) const QUEUED: u8 = 0;
    pub(super) const ASKED: u8 = 1;
    pub(super) const DONE: u8 = 2;
    pub(super) const REFUSED: u8 = 3;
    pub(super) const UNANSWERED: u8 = 4;
}

/// Bytes of an entry before its body.
const HEAD: usize = 6;

/// The beginning of an entry, up to the ids that begin its body.
#[derive(Clone, Copy)]
struct Head<'a>(&'a [u8; HEAD + 4]);

impl Head<'_> {
    /// Begin of the next entry, if this one begins at `at`.
    const fn end(self, at: usize) -> usize {
        let [low, high, ..] = *self.0;
        let len = u16::from_le_bytes([low, high]) as usize;
        at.wrapping_add(HEAD).wrapping_add(len)
    }

    const fn id(self) -> u8 {
        let [_, _, id, ..] = *self.0;
        id
    }

    const fn state(self) -> u8 {
        let [_, _, _, _, state, ..] = *self.0;
        state
    }

    const fn base(self) -> BaseRequest {
        let [.., a, b, c, d] = *self.0;
        BaseRequest::from_bytes([a, b, c, d])
    }

    fn is(self, object: ObjectId, id: SubmessageId) -> bool {
        self.base().object == object && self.id() == id as u8
    }
}

/// A journal of up to `E` requests, their bytes in `S`.
#[derive(Debug)]
pub struct Journal<S, const E: usize> {
    bytes: S,
    used: usize,
    count: usize,
    /// The number of requests to be sent, and to be answered: most often none, and then no search
    /// is needed.
    open: [usize; 2],
}

impl<S: AsRef<[u8]> + AsMut<[u8]>, const E: usize> Journal<S, E> {
    pub(super) const fn new(bytes: S) -> Self {
        Journal {
            bytes,
            used: 0,
            count: 0,
            open: [0; 2],
        }
    }

    /// Adds a request about `object`, or puts it in the place of the same kind of request about the
    /// same object; gives the room for its body of `len` bytes, which is to be filled with the
    /// request id 0 first. `None` if no entry or no room is left.
    pub(super) fn place(
        &mut self,
        object: ObjectId,
        id: SubmessageId,
        flags: u8,
        len: usize,
    ) -> Option<&mut [u8]> {
        let old = self.find(|head| head.is(object, id));
        let (at, end, state) = match old {
            Some((at, head)) => (at, head.end(at), head.state()),
            None => (self.used, self.used, code::DONE),
        };
        let body = at.wrapping_add(HEAD);
        let next = body.wrapping_add(len);
        let used = self.used.saturating_sub(end).wrapping_add(next);
        let [low, high] = u16::try_from(len).ok()?.to_le_bytes();
        let count = self.count.wrapping_add(usize::from(at == end));
        if used > self.bytes.as_ref().len() || count > E {
            return None;
        }
        self.count = count;
        self.turn(state, code::QUEUED);
        self.bytes.as_mut().copy_within(end..self.used, next);
        self.used = used;
        let entry = self.bytes.as_mut().get_mut(at..next)?;
        let (head, body) = entry.split_first_chunk_mut()?;
        *head = [low, high, id as u8, flags, code::QUEUED, 0];
        Some(body)
    }

    /// Forgets everything about `object`.
    pub(super) fn forget(&mut self, object: ObjectId) {
        while let Some((at, head)) = self.find(|head| head.base().object == object) {
            let (end, state) = (head.end(at).min(self.used), head.state());
            self.turn(state, code::DONE);
            self.count = self.count.saturating_sub(1);
            self.bytes.as_mut().copy_within(end..self.used, at);
            self.used = self.used.saturating_sub(end.saturating_sub(at));
        }
    }

    /// Queues all requests again.
    pub(super) fn requeue(&mut self) {
        self.turn_all(None, code::QUEUED);
    }

    /// The first request that was not sent in this session, under the id `request`.
    pub(super) fn next_queued(&mut self, request: RequestId) -> Option<RawBody<'_>> {
        let (at, head) = self.first_queued()?;
        let end = head.end(at);
        let entry = self.bytes.as_mut().get_mut(at..end)?;
        let ([_, _, id, flags, ..], body) = entry.split_first_chunk_mut::<HEAD>()?;
        *body.first_chunk_mut()? = request.0.to_be_bytes();
        Some(RawBody {
            id: SubmessageId::from_number(*id).ok()?,
            flags: *flags,
            head: &[],
            rest: body,
        })
    }

    /// The request that [`Journal::next_queued`] gave was sent.
    pub(super) fn mark_sent(&mut self) {
        if let Some((at, head)) = self.first_queued() {
            let answered = head.id() == SubmessageId::Create as u8;
            let state = if answered { code::ASKED } else { code::DONE };
            self.set(at, state, Status::OK);
        }
    }

    /// The agent answered `base`.
    pub(super) fn answer(&mut self, base: BaseRequest, status: Status) {
        let state = if status.is_ok() {
            code::DONE
        } else {
            code::REFUSED
        };
        let asked = |head: Head<'_>| head.base() == base && head.state() != code::QUEUED;
        if let Some((at, _)) = self.find(asked) {
            self.set(at, state, status);
        }
    }

    /// Whether every request was sent and answered.
    #[must_use]
    pub fn is_answered(&self) -> bool {
        self.open == [0; 2]
    }

    /// Requests that were sent and are to be answered.
    pub(super) const fn asked(&self) -> usize {
        let [_, asked] = self.open;
        asked
    }

    /// Gives up waiting for answers.
    pub(super) fn give_up(&mut self) {
        self.turn_all(Some(code::ASKED), code::UNANSWERED);
    }

    /// State of the creation of `object`; `None` if it is not in the journal.
    #[must_use]
    pub fn creation(&self, object: ObjectId) -> Option<RequestState> {
        let (_, head) = self.find(|head| head.is(object, SubmessageId::Create))?;
        let [.., state, status, _, _, _, _] = *head.0;
        Some(match state {
            code::QUEUED => RequestState::Queued,
            code::ASKED => RequestState::Asked,
            code::DONE => RequestState::Done,
            code::REFUSED => RequestState::Refused(Status(status)),
            _ => RequestState::Unanswered,
        })
    }

    /// Requests in the journal.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.count
    }

    /// Whether there is none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    fn first_queued(&self) -> Option<(usize, Head<'_>)> {
        let [queued, _] = self.open;
        if queued == 0 {
            return None;
        }
        self.find(|head| head.state() == code::QUEUED)
    }

    /// The entry at `at`, if one begins there.
    fn head(&self, at: usize) -> Option<Head<'_>> {
        let bytes = self.bytes.as_ref().get(at..self.used)?;
        bytes.first_chunk().map(Head)
    }

    /// The first entry that is wanted, and where it is.
    fn find(&self, wanted: impl Fn(Head<'_>) -> bool) -> Option<(usize, Head<'_>)> {
        let mut at = 0;
        loop {
            let head = self.head(at)?;
            if wanted(head) {
                return Some((at, head));
            }
            at = head.end(at);
        }
    }

    /// All entries, or those in state `from`, change to `to`.
    fn turn_all(&mut self, from: Option<u8>, to: u8) {
        let mut at = 0;
        while let Some(head) = self.head(at) {
            let (end, state) = (head.end(at), head.state());
            if from.is_none_or(|from| from == state) {
                self.set(at, to, Status::OK);
            }
            at = end;
        }
    }

    /// The entry at `at` changes its state.
    fn set(&mut self, at: usize, state: u8, status: Status) {
        let room = self.bytes.as_mut().get_mut(at.wrapping_add(4)..);
        if let Some(room) = room.and_then(<[u8]>::first_chunk_mut) {
            let [old, _] = core::mem::replace(room, [state, status.0]);
            self.turn(old, state);
        }
    }

    /// Counts one entry more in state `to`, and one less in state `from`.
    fn turn(&mut self, from: u8, to: u8) {
        if let Some(count) = self.open.get_mut(usize::from(from)) {
            *count = count.wrapping_sub(1);
        }
        if let Some(count) = self.open.get_mut(usize::from(to)) {
            *count = count.wrapping_add(1);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::{
        Create, CreationMode, Encode, Entity, ObjectKind, ReadData, Representation, StreamId,
        Writer, measure,
    };

    fn record<const E: usize>(
        journal: &mut Journal<impl AsRef<[u8]> + AsMut<[u8]>, E>,
        object: ObjectId,
        body: &dyn Encode,
    ) -> bool {
        let len = measure(body).unwrap();
        let room = journal.place(object, body.id(), body.flags(), len);
        room.map(|room| body.encode(&mut Writer::new(room)).unwrap())
            .is_some()
    }

    fn participant(number: u16, name: &str) -> (ObjectId, Create<'_>) {
        let object = ObjectId::new(number, ObjectKind::Participant);
        let base = BaseRequest {
            request: RequestId::NONE,
            object,
        };
        let entity = Entity::Participant {
            repr: Representation::Xml(name),
            domain: 0,
        };
        (
            object,
            Create {
                base,
                mode: CreationMode::REPLACE,
                entity,
            },
        )
    }

    #[test]
    fn requests_come_back_in_order_with_new_ids_and_removal_closes_the_gap() {
        let mut journal: Journal<_, 3> = Journal::new([0; 256]);
        for (number, name) in [(1, "one"), (2, "a longer two"), (3, "three")] {
            let (object, create) = participant(number, name);
            assert!(record(&mut journal, object, &create));
        }
        let (two, _) = participant(2, "");
        journal.forget(two);
        let (object, replacement) = participant(1, "one again");
        assert!(record(&mut journal, object, &replacement));
        let read = ReadData {
            base: BaseRequest {
                request: RequestId::NONE,
                object,
            },
            stream: StreamId::RELIABLE,
            filter: None,
            control: None,
        };
        assert!(record(&mut journal, object, &read));
        let (four, create) = participant(4, "no entry left");
        assert!(!record(&mut journal, four, &create));

        for round in 0..2 {
            let mut seen = std::vec::Vec::new();
            let mut request = RequestId(100);
            while let Some(recorded) = journal.next_queued(request) {
                let body = recorded.rest;
                seen.push((recorded.id, body[1], [body[2], body[3]], body.len()));
                journal.mark_sent();
                request = request.next();
            }
            let (_, three) = participant(3, "three");
            let create = SubmessageId::Create;
            let one = (create, 100, [0x00, 0x11], measure(&replacement).unwrap());
            let two = (create, 101, [0x00, 0x31], measure(&three).unwrap());
            let read = (
                SubmessageId::ReadData,
                102,
                [0x00, 0x11],
                measure(&read).unwrap(),
            );
            let expected = [one, two, read];
            assert_eq!(seen, expected, "round {round}");
            assert!(!journal.is_answered());
            journal.requeue();
        }
    }

    #[test]
    fn answers_complete_it() {
        let mut journal: Journal<_, 3> = Journal::new([0; 64]);
        let (object, create) = participant(1, "x");
        assert!(record(&mut journal, object, &create));
        assert_eq!(journal.creation(object), Some(RequestState::Queued));
        assert!(journal.next_queued(RequestId(10)).is_some());
        journal.mark_sent();
        assert_eq!(journal.creation(object), Some(RequestState::Asked));
        journal.answer(
            BaseRequest {
                request: RequestId(9),
                object,
            },
            Status::OK,
        );
        assert!(!journal.is_answered(), "an answer to another request");
        journal.answer(
            BaseRequest {
                request: RequestId(10),
                object,
            },
            Status::DENIED,
        );
        assert!(journal.is_answered());
        assert_eq!(
            journal.creation(object),
            Some(RequestState::Refused(Status::DENIED))
        );
        journal.requeue();
        assert!(journal.next_queued(RequestId(11)).is_some());
        journal.mark_sent();
        assert_eq!(journal.asked(), 1);
        journal.give_up();
        assert_eq!((journal.asked(), journal.is_answered()), (0, true));
        journal.requeue();
        journal.forget(object);
        assert!(journal.is_answered() && journal.is_empty());
        let (long, create) =
            participant(2, "a name that is longer than what is left in the buffer");
        assert!(!record(&mut journal, long, &create));
        assert!(journal.is_empty() && journal.next_queued(RequestId(12)).is_none());
    }
}
