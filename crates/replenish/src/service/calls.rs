//! Replies that futures wait for: as many places as the client may have requests under way, made
//! when a worker gets the client.
//!
//! ```text
//!   free ── request sent ──► waits ── reply, or none in time ──► ended ── taken ──► free
//!                              └───────────── given up ────────────┴──────────────► free
//! ```

use super::error::{CallError, NoReply};
use crate::sync::Mutex;
use alloc::vec::Vec;
use core::task::{Poll, Waker};
use replenish_msg::Service;

/// The calls of one client.
pub(crate) struct Calls<S: Service> {
    table: Mutex<Table<S>>,
}

struct Table<S: Service> {
    places: Vec<Place<S>>,
    /// No reply will come any more.
    closed: bool,
}

struct Place<S: Service> {
    state: State,
    response: S::Response,
}

enum State {
    Free,
    Waits(u64, Option<Waker>),
    Ended(Result<(), NoReply>),
}

impl<S: Service> Calls<S> {
    pub(crate) fn new(most: usize) -> Self {
        let place = || Place {
            state: State::Free,
            response: S::Response::default(),
        };
        Self {
            table: Mutex::new(Table {
                places: core::iter::repeat_with(place).take(most).collect(),
                closed: false,
            }),
        }
    }

    /// A place for the request that `send` sends and gives the number of.
    pub(crate) fn begin(
        &self,
        send: impl FnOnce() -> Result<u64, CallError>,
    ) -> Result<usize, CallError> {
        // Held while it is sent: the reply must not come before its place is known.
        let mut table = self.table.lock();
        let limit = table.places.len();
        let mut places = table.places.iter_mut().enumerate();
        let free = places.find(|(_, place)| matches!(place.state, State::Free));
        let (at, place) = free.ok_or(CallError::TooMany { limit })?;
        place.state = State::Waits(send()?, None);
        Ok(at)
    }

    /// A request has its reply, or will have none.
    pub(crate) fn settle(&self, number: u64, reply: Result<&mut S::Response, NoReply>) {
        let mut table = self.table.lock();
        let waits =
            |place: &&mut Place<S>| matches!(place.state, State::Waits(n, _) if n == number);
        let Some(place) = table.places.iter_mut().find(waits) else {
            return; // nobody waits any more
        };
        let outcome = reply.map(|reply| core::mem::swap(reply, &mut place.response));
        let before = core::mem::replace(&mut place.state, State::Ended(outcome));
        drop(table);
        if let State::Waits(_, Some(waker)) = before {
            waker.wake();
        }
    }

    /// Wakes all waiting futures: no reply will come any more.
    pub(crate) fn close(&self) {
        loop {
            let mut table = self.table.lock();
            table.closed = true;
            let waker = table.places.iter_mut().find_map(|p| match &mut p.state {
                State::Waits(_, waker) => waker.take(),
                _ => None,
            });
            drop(table);
            match waker {
                Some(waker) => waker.wake(),
                None => return,
            }
        }
    }

    /// Takes the reply of the place, which is free then; or notes whom to wake.
    pub(crate) fn poll(&self, at: usize, waker: &Waker) -> Poll<Result<S::Response, CallError>> {
        let mut table = self.table.lock();
        let closed = table.closed;
        let Some(place) = table.places.get_mut(at) else {
            return Poll::Ready(Err(CallError::Gone));
        };
        match &mut place.state {
            State::Waits(_, known) if !closed => {
                if !known.as_ref().is_some_and(|known| known.will_wake(waker)) {
                    *known = Some(waker.clone());
                }
                Poll::Pending
            }
            State::Ended(outcome) => {
                let outcome = outcome.map_err(CallError::NoReply);
                place.state = State::Free;
                Poll::Ready(outcome.map(|()| core::mem::take(&mut place.response)))
            }
            _ => {
                place.state = State::Free;
                Poll::Ready(Err(CallError::Gone))
            }
        }
    }

    /// The place is free again: its call was dropped, and its reply is not wanted. `abandon` frees
    /// the place of its request at the client, if it has one still.
    pub(crate) fn give_up(&self, at: usize, abandon: impl FnOnce(u64)) {
        let mut table = self.table.lock();
        let Some(place) = table.places.get_mut(at) else {
            return;
        };
        let before = core::mem::replace(&mut place.state, State::Free);
        if let State::Waits(number, _) = &before {
            abandon(*number); // under the lock: whoever gets this place has room there, too
        }
        drop(table); // before the waker, which may own other calls
    }
}
