//! The requests of a requester that wait for their replies.

use crate::flow::{Guid, Identity};
use replenish_xrce::wire::{BaseRequest, ObjectId, RequestId};
use std::collections::VecDeque;

/// A bounded table of requests, oldest first.
#[derive(Debug)]
pub(crate) struct Calls {
    guid: Guid,
    requester: ObjectId,
    limit: usize,
    last: u64,
    waiting: VecDeque<(u64, RequestId)>,
}

impl Calls {
    pub(crate) fn new(guid: Guid, requester: ObjectId, limit: usize) -> Self {
        Self {
            guid,
            requester,
            limit: limit.max(1),
            last: 0,
            waiting: VecDeque::new(),
        }
    }

    /// A new request; returns its identity, and whether an older one was forgotten for it.
    pub(crate) fn call(&mut self, request: RequestId) -> (Identity, bool) {
        let full = self.waiting.len() >= self.limit;
        if full {
            self.waiting.pop_front();
        }
        self.last += 1;
        self.waiting.push_back((self.last, request));
        let (guid, seq) = (self.guid, self.last);
        (Identity { guid, seq }, full)
    }

    /// A reply to `identity` has come; returns the client's request, if it waits for one. It does
    /// not after the first.
    pub(crate) fn answer(&mut self, identity: Identity) -> Option<BaseRequest> {
        if identity.guid != self.guid {
            return None;
        }
        let at = self.waiting.iter().position(|(s, _)| *s == identity.seq)?;
        let (_, request) = self.waiting.remove(at)?;
        let object = self.requester;
        Some(BaseRequest { request, object })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_request_is_answered_once_and_the_oldest_is_forgotten() {
        let guid = Guid([1; 16]);
        let requester = ObjectId::from_bytes([0, 0x17]);
        let mut calls = Calls::new(guid, requester, 2);
        let (first, _) = calls.call(RequestId(10));
        let (second, _) = calls.call(RequestId(11));
        assert_eq!(calls.answer(second).map(|base| base.request.0), Some(11));
        assert_eq!(calls.answer(second), None);
        calls.call(RequestId(12));
        let (_, forgot) = calls.call(RequestId(13));
        assert!(forgot);
        assert_eq!(calls.answer(first), None);
        let other = Identity {
            guid: Guid([2; 16]),
            seq: 3,
        };
        assert_eq!(calls.answer(other), None);
        assert_eq!(calls.waiting.len(), 2);
    }
}
