//! Messages that are made at set-up, lent one at a time, and come back from where they were read.
//!
//! ```text
//!             take()                 publish()                        last reader drops it
//!   free ──────────────► lent ──────────────────► shared by readers ───────────────────────► free
//!    ▲                     │
//!    └─────────────────────┘ give_back(): not published
//! ```
//!
//! The pool keeps a reference of its own to each message that readers share. So a reader's drop is
//! one atomic decrement, never frees memory and takes no lock; a message is free again as soon as
//! the pool's reference is the only one. The order of the count makes every read of a reader happen
//! before the next write of a publisher.

use crate::sync::Mutex;
use alloc::vec::Vec;

/// A reference that is counted.
pub trait Counted: Clone {
    /// Whether no other reference exists; everything that others did with theirs happened before.
    fn is_alone(&mut self) -> bool;
}

impl<T: ?Sized> Counted for alloc::sync::Arc<T> {
    fn is_alone(&mut self) -> bool {
        Self::get_mut(self).is_some()
    }
}

/// Messages to lend. Allocates in [`Pool::new`] only; nothing in it waits for a reader.
#[derive(Debug)]
pub struct Pool<A> {
    places: Mutex<Places<A>>,
    size: usize,
}

#[derive(Debug)]
struct Places<A> {
    /// `None`: lent and not published yet.
    messages: Vec<Option<A>>,
    /// The place after that of the message lent last: the oldest is most likely free.
    next: usize,
}

impl<A: Counted> Pool<A> {
    /// A pool of these messages, each of which nobody else holds.
    pub fn new(messages: impl IntoIterator<Item = A>) -> Self {
        let messages: Vec<_> = messages.into_iter().map(Some).collect();
        Self {
            size: messages.len(),
            places: Mutex::new(Places { messages, next: 0 }),
        }
    }

    /// A message that nobody else holds, and its place; `None` while every one is lent or read.
    pub fn take(&self) -> Option<(usize, A)> {
        let places = &mut *self.places.lock();
        for looked_at in 0..self.size {
            let at = (places.next + looked_at) % self.size;
            if let Some(place) = places.messages.get_mut(at)
                && place.as_mut().is_some_and(Counted::is_alone)
                && let Some(message) = place.take()
            {
                places.next = at + 1;
                return Some((at, message));
            }
        }
        None
    }

    /// Puts a message back to its place, published or not.
    pub fn give_back(&self, at: usize, message: A) {
        if let Some(place) = self.places.lock().messages.get_mut(at) {
            *place = Some(message);
        }
    }

    /// The number of its messages, lent ones included.
    pub const fn size(&self) -> usize {
        self.size
    }

    /// The number of messages that could be lent at this moment.
    pub fn free(&self) -> usize {
        let places = &mut *self.places.lock();
        let messages = places.messages.iter_mut().flatten();
        messages.filter_map(|m| m.is_alone().then_some(())).count()
    }

    /// Takes out the messages that others hold still.
    pub fn held(&mut self) -> Vec<A> {
        let messages = &mut self.places.get_mut().messages;
        let held = messages.iter_mut().filter_map(Option::take);
        held.filter_map(|mut m| (!m.is_alone()).then_some(m))
            .collect()
    }
}
