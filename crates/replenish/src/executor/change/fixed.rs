//! In the place of [`live`](super), `mailbox` and `route_updates` in builds without feature `full`:
//! the handles that were described are there until the end.

use crate::context::Context;
use crate::executor::StopHandle;
use crate::executor::handles::group::Group;
use crate::executor::handles::state::HandleState;
use crate::executor::run::routes::Route;
use crate::executor::wake::doorbell::{Doorbell, WakeHandle};
use crate::middleware::{Interest, Middleware};
use crate::sync::Arc;
use alloc::vec::Vec;

/// Every handle with its worker's name.
pub(crate) struct Registry(Vec<(Arc<str>, Arc<HandleState>)>);

impl Registry {
    pub(crate) const fn new(
        handles: Vec<(Arc<str>, Arc<HandleState>)>,
        _: usize,
        _: usize,
    ) -> Self {
        Self(handles)
    }

    pub(crate) fn find(&self, id: &str) -> Option<(Arc<str>, Arc<HandleState>)> {
        self.0.iter().find(|(_, h)| h.id == id).cloned()
    }

    pub(crate) fn all(&self) -> Vec<(Arc<str>, Arc<HandleState>)> {
        self.0.clone()
    }
}

/// What outlives the set-up: the handles.
pub(crate) struct Live {
    pub(crate) registry: Registry,
}

/// A worker needs no way to it.
pub(crate) struct Post;

impl Post {
    pub(crate) const fn new(_: &Arc<str>, _: &Arc<Mailbox>, _: u64) -> Self {
        Self
    }
}

impl Live {
    pub(crate) fn new(
        _: &Context,
        _: &StopHandle,
        registry: Registry,
        _: &Arc<RouteUpdates>,
        _: Vec<Post>,
        _: &mut dyn Iterator<Item = &Group>,
    ) -> Arc<Self> {
        Arc::new(Self { registry })
    }
}

/// There is none.
#[derive(Clone, Copy)]
pub(crate) enum Command {}

/// Nothing comes for a worker.
#[derive(Clone)]
pub(crate) struct Mailbox {
    bell: Arc<Doorbell>,
}

impl Mailbox {
    pub(crate) fn new(_: usize, _: usize, bell: Arc<Doorbell>) -> Arc<Self> {
        Arc::new(Self { bell })
    }

    /// Wakes the worker for the handle in `slot`.
    pub(crate) fn wake_handle(&self, slot: usize) -> WakeHandle {
        WakeHandle::new(&self.bell, slot)
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(crate) const fn open(&self) {}

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(crate) const fn next(&self) -> Option<Command> {
        None
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(crate) const fn close(&self) {}
}

/// Routes do not change.
pub(crate) struct RouteUpdates;

impl RouteUpdates {
    pub(crate) fn new() -> Arc<Self> {
        Arc::new(Self)
    }

    #[expect(clippy::unused_self, reason = "the signature of what it stands in for")]
    pub(crate) const fn carry_out(
        &self,
        _: &dyn Middleware,
        _: &mut [Option<Route>],
        _: &mut Interest,
        _: &mut Interest,
    ) {
    }
}
