//! Changes the dispatcher's [routes](Route) while it runs.
//!
//! ```text
//!   any thread: reserve, then push ──► commands ──► dispatcher, before it waits: swaps the route,
//!                                                       │ deletes a reader without route
//!   any thread: free_retired ◄── retired ◄── old route ─┘    (memory is freed here)
//! ```

use super::routes::Route;
use crate::error::Error;
use crate::handoff::{CommandQueue, Reservation};
use crate::middleware::{Interest, MAX_READERS, Middleware, ReaderId};
use crate::sync::{Arc, Mutex};
use replenish_os::{Tid, current_tid};

/// Another route for a reader, or none.
pub(crate) struct RouteUpdate {
    slot: usize,
    reader: ReaderId,
    route: Option<Route>,
}

type Queue = CommandQueue<RouteUpdate, Option<Route>>;

/// Changes of routes that are under way.
pub(crate) struct RouteUpdates {
    queue: Queue,
    dispatcher: Mutex<Option<Tid>>,
}

/// A slot among the changes under way, for one of them; free again when dropped without one.
pub(crate) struct RouteReservation<'q>(Reservation<'q, RouteUpdate, Option<Route>>);

impl RouteReservation<'_> {
    /// Gives `reader` another route, or none.
    pub(crate) fn update(self, reader: ReaderId, route: Option<Route>) {
        let slot = self.0.slot();
        let update = RouteUpdate {
            slot,
            reader,
            route,
        };
        self.0.push(update).ok(); // never closed
    }
}

impl RouteUpdates {
    pub(crate) fn new() -> Arc<Self> {
        Arc::new(Self {
            queue: Queue::new(0..MAX_READERS, MAX_READERS),
            dispatcher: Mutex::new(None),
        })
    }

    /// Reserves a slot, before any step that a change of a route must follow. Fails if too many are
    /// in flight.
    pub(crate) fn reserve(&self) -> Result<RouteReservation<'_>, Error> {
        self.free_retired(); // it takes slots
        let full = |_| Error::Capacity {
            what: "handles that come and go at the same time".into(),
            limit: MAX_READERS,
        };
        self.queue.reserve().map(RouteReservation).map_err(full)
    }

    /// Dispatcher: the calling thread is the dispatcher.
    pub(crate) fn open(&self) {
        *self.dispatcher.lock() = Some(current_tid());
    }

    /// Whether the caller is the dispatcher, in a hook.
    pub(crate) fn is_mine(&self) -> bool {
        *self.dispatcher.lock() == Some(current_tid())
    }

    /// Frees what belonged to routes that are no more.
    pub(crate) fn free_retired(&self) {
        self.queue.free_retired();
    }

    /// Dispatcher: carries the updates out. A reader without route is deleted at once: a later
    /// chance may be far, and a reliable reader that keeps all would hold its writers up.
    pub(crate) fn carry_out(
        &self,
        middleware: &dyn Middleware,
        routes: &mut [Option<Route>],
        interest: &mut Interest,
        parked: &mut Interest,
    ) {
        while let Some(update) = self.queue.next() {
            let RouteUpdate {
                slot,
                reader,
                mut route,
            } = update;
            parked.remove(reader);
            let leaves = route.is_none();
            if leaves {
                interest.remove(reader);
            } else {
                interest.insert(reader);
            }
            if let Some(place) = routes.get_mut(usize::from(reader.0)) {
                core::mem::swap(place, &mut route);
            }
            if leaves {
                // A middleware that cannot do it keeps the reader; its samples are left out.
                middleware.delete_reader(reader).ok();
            }
            self.queue.retire(slot, route, |old| {
                if let Some(old) = old {
                    old.shared().departure.unroute();
                }
            });
        }
    }
}
