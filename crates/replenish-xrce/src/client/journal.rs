//! What a session has asked for and must ask for again after a new log-in: its objects, in the
//! order of their creation, and the reads that are on.
//!
//! ```text
//!   entry = length of the body LE (2), submessage, flags, state, status, body
//!   body  = request BE (2), object BE (2), ...               as it is sent
//! ```
//!
//! Entries stand one behind the other, in order; only state and request id change.

use crate::wire::{BaseRequest, ObjectId, Raw, RequestId, Status, SubmessageId};

/// How far a request in the journal has got.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RequestState {
    /// Not sent in this session yet.
    Queued,
    /// Sent, to be answered.
    Asked,
    /// Carried out; a read, which is not answered, once it was sent.
    Done,
    /// Refused by the agent with this status.
    Refused(Status),
    /// Sent, and not answered for as long as [`Config::answer_within`](super::Config::answer_within).
    /// A late answer counts all the same.
    Unanswered,
}

impl RequestState {
    const fn to_bytes(self) -> [u8; 2] {
        match self {
            RequestState::Queued => [0, 0],
            RequestState::Asked => [1, 0],
            RequestState::Done => [2, 0],
            RequestState::Refused(status) => [3, status.0],
            RequestState::Unanswered => [4, 0],
        }
    }

    const fn from_bytes([state, status]: [u8; 2]) -> Self {
        match state {
            0 => RequestState::Queued,
            1 => RequestState::Asked,
            2 => RequestState::Done,
            3 => RequestState::Refused(Status(status)),
            _ => RequestState::Unanswered,
        }
    }
}

/// An entry as it stands in the journal.
#[derive(Clone, Copy, Debug)]
struct Entry {
    at: usize,
    /// Of the body.
    len: usize,
    id: u8,
    flags: u8,
    state: RequestState,
    base: BaseRequest,
}

impl Entry {
    const fn body(&self) -> usize {
        self.at.wrapping_add(HEAD)
    }

    const fn end(&self) -> usize {
        self.body().wrapping_add(self.len)
    }
}

/// Bytes of an entry before its body.
const HEAD: usize = 6;

/// Up to `E` requests, their bytes in `S`.
#[derive(Debug)]
pub struct Journal<S, const E: usize> {
    bytes: S,
    used: usize,
    count: usize,
    /// How many are to be sent, and how many to be answered: most often none, and then nobody
    /// needs to look for them.
    queued: usize,
    asked: usize,
}

impl<S: AsRef<[u8]> + AsMut<[u8]>, const E: usize> Journal<S, E> {
    pub(super) const fn new(bytes: S) -> Self {
        Journal {
            bytes,
            used: 0,
            count: 0,
            queued: 0,
            asked: 0,
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
        let same = |entry: &Entry| entry.base.object == object && entry.id == id as u8;
        let old = self.find(same);
        let (at, end) = old.map_or((self.used, self.used), |old| (old.at, old.end()));
        let body = at.wrapping_add(HEAD);
        let next = body.wrapping_add(len);
        let used = self.used.saturating_sub(end).wrapping_add(next);
        let [low, high] = u16::try_from(len).ok()?.to_le_bytes();
        if used > self.bytes.as_ref().len() || (old.is_none() && self.count >= E) {
            return None;
        }
        match old {
            Some(old) => self.set(&old, RequestState::Done),
            None => self.count = self.count.wrapping_add(1),
        }
        self.queued = self.queued.wrapping_add(1);
        self.bytes.as_mut().copy_within(end..self.used, next);
        self.used = used;
        let entry = self.bytes.as_mut().get_mut(at..next)?;
        let (head, body) = entry.split_first_chunk_mut()?;
        let [state, status] = RequestState::Queued.to_bytes();
        *head = [low, high, id as u8, flags, state, status];
        Some(body)
    }

    /// Forgets everything about `object`.
    pub(super) fn forget(&mut self, object: ObjectId) {
        while let Some(entry) = self.find(|entry| entry.base.object == object) {
            self.set(&entry, RequestState::Done);
            self.count = self.count.saturating_sub(1);
            let end = entry.end().min(self.used);
            self.bytes.as_mut().copy_within(end..self.used, entry.at);
            self.used = self.used.saturating_sub(end.saturating_sub(entry.at));
        }
    }

    /// Everything is to be asked for again.
    pub(super) fn requeue(&mut self) {
        self.turn_all(|_| true, RequestState::Queued);
    }

    /// The first request that was not sent in this session, under the id `request`.
    pub(super) fn next_queued(&mut self, request: RequestId) -> Option<Raw<'_>> {
        let entry = self.first_queued()?;
        let body = self.bytes.as_mut().get_mut(entry.body()..entry.end())?;
        *body.first_chunk_mut()? = request.0.to_be_bytes();
        Some(Raw {
            id: SubmessageId::from_number(entry.id).ok()?,
            flags: entry.flags,
            head: &[],
            rest: body,
        })
    }

    /// The request that [`Journal::next_queued`] gave was sent.
    pub(super) fn mark_sent(&mut self) {
        if let Some(entry) = self.first_queued() {
            let answered = entry.id == SubmessageId::Create as u8;
            let state = if answered {
                RequestState::Asked
            } else {
                RequestState::Done
            };
            self.set(&entry, state);
        }
    }

    /// The agent answered `base`.
    pub(super) fn answer(&mut self, base: BaseRequest, status: Status) {
        let state = if status.is_ok() {
            RequestState::Done
        } else {
            RequestState::Refused(status)
        };
        let asked = |entry: &Entry| entry.base == base && entry.state != RequestState::Queued;
        if let Some(entry) = self.find(asked) {
            self.set(&entry, state);
        }
    }

    /// Whether every request was sent and answered.
    #[must_use]
    pub const fn is_settled(&self) -> bool {
        self.queued == 0 && self.asked == 0
    }

    /// Requests that were sent and are to be answered.
    pub(super) const fn asked(&self) -> usize {
        self.asked
    }

    /// Gives up waiting for answers to what was sent.
    pub(super) fn give_up(&mut self) {
        self.turn_all(
            |state| state == RequestState::Asked,
            RequestState::Unanswered,
        );
    }

    /// How far the creation of `object` has got; `None` if it is not in the journal.
    #[must_use]
    pub fn creation(&self, object: ObjectId) -> Option<RequestState> {
        let create = SubmessageId::Create as u8;
        let entry = self.find(|entry| entry.base.object == object && entry.id == create);
        entry.map(|entry| entry.state)
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

    fn first_queued(&self) -> Option<Entry> {
        if self.queued == 0 {
            return None;
        }
        self.find(|entry| entry.state == RequestState::Queued)
    }

    /// The entry at `at`, if one begins there.
    #[cfg_attr(not(feature = "std"), inline(never))]
    fn entry(&self, at: usize) -> Option<Entry> {
        let bytes = self.bytes.as_ref().get(at..self.used)?;
        let &[low, high, id, flags, state, status, a, b, c, d] = bytes.first_chunk()?;
        Some(Entry {
            at,
            len: u16::from_le_bytes([low, high]).into(),
            id,
            flags,
            state: RequestState::from_bytes([state, status]),
            base: BaseRequest::from_bytes([a, b, c, d]),
        })
    }

    fn find(&self, wanted: impl Fn(&Entry) -> bool) -> Option<Entry> {
        let mut at = 0;
        loop {
            let entry = self.entry(at)?;
            if wanted(&entry) {
                return Some(entry);
            }
            at = entry.end();
        }
    }

    fn turn_all(&mut self, which: impl Fn(RequestState) -> bool, to: RequestState) {
        let mut at = 0;
        while let Some(entry) = self.entry(at) {
            if which(entry.state) {
                self.set(&entry, to);
            }
            at = entry.end();
        }
    }

    /// The entry changes its state.
    fn set(&mut self, entry: &Entry, state: RequestState) {
        for (state, change) in [(entry.state, usize::MAX), (state, 1)] {
            let count = match state {
                RequestState::Queued => &mut self.queued,
                RequestState::Asked => &mut self.asked,
                _ => continue,
            };
            *count = count.wrapping_add(change);
        }
        let at = entry.at.wrapping_add(4);
        let room = self.bytes.as_mut().get_mut(at..);
        if let Some(room) = room.and_then(<[u8]>::first_chunk_mut) {
            *room = state.to_bytes();
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
            assert!(!journal.is_settled());
            journal.requeue();
        }
    }

    #[test]
    fn answers_settle_it() {
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
        assert!(!journal.is_settled(), "an answer to another request");
        journal.answer(
            BaseRequest {
                request: RequestId(10),
                object,
            },
            Status::DENIED,
        );
        assert!(journal.is_settled());
        assert_eq!(
            journal.creation(object),
            Some(RequestState::Refused(Status::DENIED))
        );
        journal.requeue();
        assert!(journal.next_queued(RequestId(11)).is_some());
        journal.mark_sent();
        assert_eq!(journal.asked(), 1);
        journal.give_up();
        assert_eq!((journal.asked(), journal.is_settled()), (0, true));
        journal.requeue();
        journal.forget(object);
        assert!(journal.is_settled() && journal.is_empty());
        let (long, create) =
            participant(2, "a name that is longer than what is left in the buffer");
        assert!(!record(&mut journal, long, &create));
        assert!(journal.is_empty() && journal.next_queued(RequestId(12)).is_none());
    }
}
