//! What a session has asked for and must ask for again after a new log-in: its objects, in the
//! order of their creation, and the reads that are on.
//!
//! Each request is kept as its encoded body, in which only the request id changes.

use crate::wire::{
    BaseRequest, Encode, ObjectId, RequestId, Status, SubmessageId, WireError, Writer,
};

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

#[derive(Clone, Copy, Debug)]
struct Entry {
    id: SubmessageId,
    flags: u8,
    object: ObjectId,
    request: RequestId,
    start: usize,
    end: usize,
    state: RequestState,
}

/// Up to `E` requests, their bytes in `S`.
#[derive(Debug)]
pub struct Journal<S, const E: usize> {
    bytes: S,
    entries: [Option<Entry>; E],
    count: usize,
    /// How many are to be sent, and how many to be answered: most often none, and then nobody
    /// needs to look for them.
    open: Open,
}

#[derive(Clone, Copy, Debug, Default)]
struct Open {
    queued: usize,
    asked: usize,
}

impl Open {
    fn of(&mut self, state: RequestState) -> Option<&mut usize> {
        match state {
            RequestState::Queued => Some(&mut self.queued),
            RequestState::Asked => Some(&mut self.asked),
            _ => None,
        }
    }

    /// A request changes its state, comes or goes.
    fn change(&mut self, from: Option<RequestState>, to: Option<RequestState>) {
        if let Some(count) = from.and_then(|from| self.of(from)) {
            *count = count.saturating_sub(1);
        }
        if let Some(count) = to.and_then(|to| self.of(to)) {
            *count = count.saturating_add(1);
        }
    }
}

/// A request of the journal with the request id of this session.
pub(super) struct Recorded<'a> {
    id: SubmessageId,
    flags: u8,
    base: BaseRequest,
    /// The body after its base.
    rest: &'a [u8],
}

const BASE: usize = 4;

impl Encode for Recorded<'_> {
    fn id(&self) -> SubmessageId {
        self.id
    }

    fn flags(&self) -> u8 {
        self.flags
    }

    fn encode(&self, w: &mut Writer<'_>) -> Result<(), WireError> {
        w.put(&self.base.request.0.to_be_bytes())?;
        w.put(&self.base.object.to_bytes())?;
        w.put(self.rest)
    }
}

impl<S: AsRef<[u8]> + AsMut<[u8]>, const E: usize> Journal<S, E> {
    pub(super) const fn new(bytes: S) -> Self {
        Journal {
            bytes,
            entries: [None; E],
            count: 0,
            open: Open {
                queued: 0,
                asked: 0,
            },
        }
    }

    /// Adds a request about `object`, or puts it in the place of the same kind of request about the
    /// same object.
    pub(super) fn record(
        &mut self,
        object: ObjectId,
        body: &dyn Encode,
    ) -> Result<(), RecordError> {
        let end = self.entries().map(|entry| entry.end).max().unwrap_or(0);
        let mut w = Writer::new(self.bytes.as_mut().get_mut(end..).unwrap_or(&mut []));
        body.encode(&mut w).map_err(RecordError::Wire)?;
        let (len, id) = (w.len(), body.id());
        let same = |entry: &Entry| entry.object == object && entry.id == id;
        let position = self.entries().position(same);
        if position.is_none() && self.count >= E {
            return Err(RecordError::Full);
        }
        let entry = Entry {
            id,
            flags: body.flags(),
            object,
            request: RequestId::NONE,
            start: end,
            end: end.saturating_add(len),
            state: RequestState::Queued,
        };
        let old = position.and_then(|position| self.entries.get_mut(position)?.replace(entry));
        self.open
            .change(old.map(|old| old.state), Some(entry.state));
        match old {
            Some(old) => self.close_gap(old.start, old.end),
            None => {
                if let Some(slot) = self.entries.get_mut(self.count) {
                    *slot = Some(entry);
                    self.count = self.count.saturating_add(1);
                }
            }
        }
        Ok(())
    }

    /// Forgets everything about `object`.
    pub(super) fn forget(&mut self, object: ObjectId) {
        let mut i = 0;
        while let Some(Some(entry)) = self.entries.get(i).copied() {
            if entry.object != object {
                i = i.saturating_add(1);
                continue;
            }
            if let Some(tail) = self.entries.get_mut(i..self.count) {
                tail.rotate_left(1);
                tail.last_mut().into_iter().for_each(|last| *last = None);
            }
            self.count = self.count.saturating_sub(1);
            self.open.change(Some(entry.state), None);
            self.close_gap(entry.start, entry.end);
        }
    }

    /// Everything is to be asked for again.
    pub(super) fn requeue(&mut self) {
        for entry in self.entries.iter_mut().flatten() {
            entry.state = RequestState::Queued;
            entry.request = RequestId::NONE;
        }
        self.open = Open {
            queued: self.count,
            asked: 0,
        };
    }

    /// The first request that was not sent in this session, under the id `request`.
    pub(super) fn next_queued(&self, request: RequestId) -> Option<Recorded<'_>> {
        if self.open.queued == 0 {
            return None;
        }
        let entry = self
            .entries()
            .find(|entry| entry.state == RequestState::Queued)?;
        let start = entry.start.saturating_add(BASE);
        Some(Recorded {
            id: entry.id,
            flags: entry.flags,
            base: BaseRequest {
                request,
                object: entry.object,
            },
            rest: self.bytes.as_ref().get(start..entry.end).unwrap_or(&[]),
        })
    }

    /// The request that [`Journal::next_queued`] gave was sent.
    pub(super) fn mark_sent(&mut self, request: RequestId) {
        let queued = |entry: &&mut Entry| entry.state == RequestState::Queued;
        if let Some(entry) = self.entries.iter_mut().flatten().find(queued) {
            entry.request = request;
            entry.state = match entry.id {
                SubmessageId::Create => RequestState::Asked,
                _ => RequestState::Done,
            };
            let sent = entry.state;
            self.open.change(Some(RequestState::Queued), Some(sent));
        }
    }

    /// The agent answered `base`.
    pub(super) fn answer(&mut self, base: BaseRequest, status: Status) {
        let asked =
            |entry: &&mut Entry| entry.object == base.object && entry.request == base.request;
        if let Some(entry) = self.entries.iter_mut().flatten().find(asked) {
            let before = entry.state;
            entry.state = if status.is_ok() {
                RequestState::Done
            } else {
                RequestState::Refused(status)
            };
            let answered = entry.state;
            self.open.change(Some(before), Some(answered));
        }
    }

    /// Whether every request was sent and answered.
    #[must_use]
    pub fn is_settled(&self) -> bool {
        self.open.queued == 0 && self.open.asked == 0
    }

    /// Requests that were sent and are to be answered.
    pub(super) fn asked(&self) -> usize {
        self.open.asked
    }

    /// Gives up waiting for answers to what was sent.
    pub(super) fn give_up(&mut self) {
        for entry in self.entries.iter_mut().flatten() {
            if entry.state == RequestState::Asked {
                entry.state = RequestState::Unanswered;
            }
        }
        self.open.asked = 0;
    }

    /// How far the creation of `object` has got; `None` if it is not in the journal.
    #[must_use]
    pub fn creation(&self, object: ObjectId) -> Option<RequestState> {
        self.entries()
            .find(|entry| entry.object == object && entry.id == SubmessageId::Create)
            .map(|entry| entry.state)
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

    fn entries(&self) -> impl Iterator<Item = &Entry> {
        self.entries.iter().flatten()
    }

    /// Moves the bytes after `end` to `start`.
    fn close_gap(&mut self, start: usize, end: usize) {
        let bytes = self.bytes.as_mut();
        if start <= end && end <= bytes.len() {
            bytes.copy_within(end.., start);
        }
        let gap = end.saturating_sub(start);
        for entry in self
            .entries
            .iter_mut()
            .flatten()
            .filter(|entry| entry.start >= end)
        {
            entry.start = entry.start.saturating_sub(gap);
            entry.end = entry.end.saturating_sub(gap);
        }
    }
}

/// Why a request was not recorded.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum RecordError {
    /// No entry is left.
    Full,
    /// No room for its bytes, or it cannot be encoded.
    Wire(WireError),
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::{
        Create, CreationMode, Entity, ObjectKind, ReadData, Representation, StreamId, measure,
    };

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
            journal.record(object, &create).unwrap();
        }
        let (two, _) = participant(2, "");
        journal.forget(two);
        let (object, replacement) = participant(1, "one again");
        journal.record(object, &replacement).unwrap();
        let read = ReadData {
            base: BaseRequest {
                request: RequestId::NONE,
                object,
            },
            stream: StreamId::RELIABLE,
            filter: None,
            control: None,
        };
        journal.record(object, &read).unwrap();
        let (four, create) = participant(4, "no entry left");
        assert_eq!(journal.record(four, &create), Err(RecordError::Full));

        for round in 0..2 {
            let mut seen = std::vec::Vec::new();
            let mut request = RequestId(100);
            while let Some(recorded) = journal.next_queued(request) {
                let mut buf = [0; 64];
                let mut w = Writer::new(&mut buf);
                recorded.encode(&mut w).unwrap();
                let len = w.len();
                seen.push((recorded.id(), buf[1], [buf[2], buf[3]], len));
                journal.mark_sent(request);
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
        journal.record(object, &create).unwrap();
        assert_eq!(journal.creation(object), Some(RequestState::Queued));
        journal.mark_sent(RequestId(10));
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
        journal.mark_sent(RequestId(11));
        assert_eq!(journal.asked(), 1);
        journal.give_up();
        assert_eq!((journal.asked(), journal.is_settled()), (0, true));
        journal.requeue();
        journal.forget(object);
        assert!(journal.is_settled() && journal.is_empty());
        let (long, create) =
            participant(2, "a name that is longer than what is left in the buffer");
        assert!(matches!(
            journal.record(long, &create),
            Err(RecordError::Wire(_))
        ));
    }
}
