//! Where the dispatcher brings samples, and how that changes while it runs.
//!
//! ```text
//!   any thread: order ──► desk ──► dispatcher, before it waits: swap the route in or out
//!                                       │ old route
//!   any thread: sweep ◄── attic ◄───────┘      (readers are deleted and memory is freed here)
//! ```

use super::handle::Shared;
use crate::middleware::{Interest, MAX_READERS, Middleware, ReaderId};
use crate::sync::{Arc, AtomicBool, Mutex, Ordering};
use alloc::collections::VecDeque;
use alloc::vec::Vec;

/// Where a reader's samples go.
pub(crate) struct Route {
    pub(crate) shared: Arc<Shared>,
    /// Index into the dispatcher's bells.
    pub(crate) worker: usize,
}

/// Changes under way.
pub(crate) struct Desk {
    waiting: AtomicBool,
    orders: Mutex<Orders>,
}

struct Orders {
    inbound: VecDeque<(ReaderId, Option<Route>)>,
    attic: Vec<(ReaderId, Option<Route>)>,
}

impl Desk {
    pub(crate) fn new() -> Arc<Self> {
        Arc::new(Self {
            waiting: AtomicBool::new(false),
            orders: Mutex::new(Orders {
                inbound: VecDeque::with_capacity(MAX_READERS),
                attic: Vec::with_capacity(MAX_READERS),
            }),
        })
    }

    /// Gives `reader` another route, or none. `false` while too many changes are under way.
    pub(crate) fn order(&self, reader: ReaderId, route: Option<Route>) -> bool {
        let mut orders = self.orders.lock();
        if orders.inbound.len() + orders.attic.len() >= MAX_READERS {
            return false;
        }
        orders.inbound.push_back((reader, route));
        self.waiting.store(true, Ordering::Release);
        true
    }

    /// Deletes the readers that have lost their routes, and frees what was theirs.
    pub(crate) fn sweep(&self, middleware: &dyn Middleware) {
        loop {
            let Some((reader, old)) = self.orders.lock().attic.pop() else {
                return;
            };
            if old.is_some() {
                // A middleware that cannot do it keeps the reader; its samples are left out.
                middleware.delete_reader(reader).ok();
            }
        }
    }

    /// Dispatcher: carries the orders out.
    pub(crate) fn carry_out(
        &self,
        routes: &mut [Option<Route>],
        interest: &mut Interest,
        parked: &mut Interest,
    ) {
        if !self.waiting.load(Ordering::Acquire) {
            return;
        }
        self.waiting.store(false, Ordering::Relaxed);
        let mut orders = self.orders.lock();
        while let Some((reader, mut route)) = orders.inbound.pop_front() {
            parked.remove(reader);
            match route.is_some() {
                true => interest.insert(reader),
                false => interest.remove(reader),
            }
            if let Some(place) = routes.get_mut(usize::from(reader.0)) {
                core::mem::swap(place, &mut route);
            }
            orders.attic.push((reader, route));
        }
    }
}
