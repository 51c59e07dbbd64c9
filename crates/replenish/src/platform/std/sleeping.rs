//! The alarms of a future: the times at which it wants to be polled again, left by its sleeps.
//! `sleeping_disabled.rs` takes this file's place without feature `std`: nothing sleeps there.
//!
//! ```text
//!   handle ── polling(alarms, …) ──► future ──► Sleep ── current() ──► begin: a place, or `spill`
//!     ▲                                                                        │
//!     └── next: the worker's release ◄── Alarms ◄──────────────────────────────┘
//!         expire: wakes those that are due
//! ```

use crate::Nanos;
use crate::sync::Mutex;
use std::cell::RefCell;
use std::sync::Arc;
use std::task::Waker;

/// Sleeps of one future that have a place. Further ones share one, and are all polled when the
/// earliest of them is due.
const PLACES: usize = 8;

/// Places of those that sleep: when each is due, and its waker.
pub(crate) struct Places<const N: usize> {
    places: [Option<Place>; N],
    /// Number of places given so far. A place keeps the number of its sleep: after that sleep was
    /// woken the place may belong to another.
    given: u64,
}

struct Place {
    number: u64,
    due: Nanos,
    waker: Waker,
}

impl<const N: usize> Default for Places<N> {
    fn default() -> Self {
        Self {
            places: [const { None }; N],
            given: 0,
        }
    }
}

impl<const N: usize> Places<N> {
    /// The number of the sleep, to [end](Self::end) it; `None` if there is no place left.
    pub(crate) fn begin(&mut self, due: Nanos, waker: &Waker) -> Option<u64> {
        let free = self.places.iter_mut().find(|place| place.is_none())?;
        self.given += 1;
        let number = self.given;
        let waker = waker.clone();
        *free = Some(Place { number, due, waker });
        Some(number)
    }

    /// The waker of this sleep, which is given up. To be dropped without a lock: it may be foreign.
    pub(crate) fn end(&mut self, number: u64) -> Option<Waker> {
        self.take(|place| place.number == number)
    }

    /// Time at which the next sleep is over.
    fn next(&self) -> Option<Nanos> {
        self.places.iter().flatten().map(|place| place.due).min()
    }

    /// The waker of a sleep that is due, or with `all` of any. To be woken without a lock.
    pub(crate) fn take_due(&mut self, now: Nanos, all: bool) -> Option<Waker> {
        self.take(|place| all || place.due <= now)
    }

    fn take(&mut self, wanted: impl Fn(&Place) -> bool) -> Option<Waker> {
        let mut places = self.places.iter_mut();
        let taken = places.find_map(|place| place.take_if(|place| wanted(place)));
        taken.map(|place| place.waker)
    }
}

/// The sleeps of one handle's future. The handle and its future share it on one thread: the lock is
/// never contended.
#[derive(Default)]
pub(crate) struct Alarms(Mutex<Table>);

#[derive(Default)]
struct Table {
    places: Places<PLACES>,
    /// The earliest of those without a place.
    spill: Option<Nanos>,
}

thread_local! {
    static POLLED: RefCell<Option<Arc<Alarms>>> = const { RefCell::new(None) };
}

/// Gives the thread back the alarms that were current before.
struct Before(Option<Arc<Alarms>>);

impl Drop for Before {
    fn drop(&mut self) {
        // A thread that ends has no alarms left to give back.
        POLLED
            .try_with(|current| current.replace(self.0.take()))
            .ok();
    }
}

/// Polls a future, whose sleeps are in `alarms`.
pub(crate) fn polling<R>(alarms: &Arc<Alarms>, poll: impl FnOnce() -> R) -> R {
    let alarms = Some(Arc::clone(alarms));
    let _before = Before(POLLED.try_with(|c| c.replace(alarms)).unwrap_or_default());
    poll()
}

/// The alarms of the future that this thread polls; `None` outside of a worker's futures.
pub(crate) fn current() -> Option<Arc<Alarms>> {
    POLLED.try_with(|c| c.borrow().clone()).unwrap_or_default()
}

impl Alarms {
    /// Wakes `waker` at `due`. The number of the sleep, to [end](Self::end) it; `None` if there was
    /// no place left: then the whole future is polled at `due`.
    pub(crate) fn begin(&self, due: Nanos, waker: &Waker) -> Option<u64> {
        let mut table = self.0.lock();
        let number = table.places.begin(due, waker);
        if number.is_none() {
            table.spill = Some(table.spill.map_or(due, |spill| spill.min(due)));
        }
        number
    }

    /// Ends this sleep: it is over, or given up.
    pub(crate) fn end(&self, number: u64) {
        let mut table = self.0.lock();
        let ended = table.places.end(number);
        drop(table);
        drop(ended);
    }

    /// Time at which the next sleep is over.
    pub(crate) fn next(&self) -> Option<Nanos> {
        let table = self.0.lock();
        table.places.next().into_iter().chain(table.spill).min()
    }

    /// Wakes the sleeps that are due; whether the future must be polled for one without a place.
    pub(crate) fn expire(&self, now: Nanos) -> bool {
        loop {
            let due = self.0.lock().places.take_due(now, false);
            match due {
                Some(waker) => waker.wake(),
                None => break,
            }
        }
        self.0.lock().spill.take_if(|due| *due <= now).is_some()
    }
}
