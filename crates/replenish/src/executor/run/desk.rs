//! How the dispatcher's [routes](Route) change while it runs.
//!
//! ```text
//!   any thread: order ──► desk ──► dispatcher, before it waits: swap the route in or out,
//!                                       │ delete the reader that has none any more
//!                                       │ old route
//!   any thread: sweep ◄── attic ◄───────┘      (memory is freed here)
//! ```

use super::routes::Route;
use crate::error::Error;
use crate::middleware::{Interest, MAX_READERS, Middleware, ReaderId};
use crate::sync::{Arc, AtomicBool, Mutex, Ordering};
use alloc::collections::VecDeque;
use alloc::vec::Vec;

/// Changes under way.
pub(crate) struct Desk {
    waiting: AtomicBool,
    orders: Mutex<Orders>,
}

struct Orders {
    inbound: VecDeque<(ReaderId, Option<Route>)>,
    attic: Vec<Option<Route>>,
    /// Places kept for orders that will follow.
    kept: usize,
}

/// A place among the changes under way, for one order; free again when dropped without one.
pub(crate) struct Kept<'d> {
    desk: &'d Desk,
}

impl Drop for Kept<'_> {
    fn drop(&mut self) {
        self.desk.orders.lock().kept -= 1;
    }
}

impl Kept<'_> {
    /// Gives `reader` another route, or none.
    pub(crate) fn order(self, reader: ReaderId, route: Option<Route>) {
        let mut orders = self.desk.orders.lock();
        orders.kept -= 1;
        orders.inbound.push_back((reader, route));
        self.desk.waiting.store(true, Ordering::Release);
        drop(orders);
        core::mem::forget(self); // the place was used
    }
}

impl Desk {
    pub(crate) fn new() -> Arc<Self> {
        Arc::new(Self {
            waiting: AtomicBool::new(false),
            orders: Mutex::new(Orders {
                inbound: VecDeque::with_capacity(MAX_READERS),
                attic: Vec::with_capacity(MAX_READERS),
                kept: 0,
            }),
        })
    }

    /// A place for one order; none while too many changes are under way. To be had before anything
    /// is done that an order has to follow.
    pub(crate) fn keep(&self) -> Result<Kept<'_>, Error> {
        self.sweep(); // what others have left there takes room
        let mut orders = self.orders.lock();
        if orders.inbound.len() + orders.attic.len() + orders.kept >= MAX_READERS {
            return Err(Error::Capacity {
                what: "handles that come and go at the same time".into(),
                limit: MAX_READERS,
            });
        }
        orders.kept += 1;
        Ok(Kept { desk: self })
    }

    /// Frees what belonged to routes that are no more.
    pub(crate) fn sweep(&self) {
        loop {
            let old = self.orders.lock().attic.pop();
            if old.is_none() {
                return;
            }
        }
    }

    /// Dispatcher: carries the orders out. A reader without route is deleted at once: nobody else
    /// may come by for long, and a reliable reader that keeps all would hold its writers up.
    pub(crate) fn carry_out(
        &self,
        middleware: &dyn Middleware,
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
            let leaves = route.is_none();
            if let Some(place) = routes.get_mut(usize::from(reader.0)) {
                core::mem::swap(place, &mut route);
            }
            if leaves {
                // A middleware that cannot do it keeps the reader; its samples are left out.
                middleware.delete_reader(reader).ok();
            }
            if let Some(old) = &route {
                old.shared.unrouted.store(true, Ordering::Release);
            }
            orders.attic.push(route);
        }
    }
}
