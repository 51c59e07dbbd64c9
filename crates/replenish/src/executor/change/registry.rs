//! The handles of a running executor by id: known, leaving, or in the making.

use crate::executor::handles::state::HandleState;
use crate::name::{concat, with_number};
use crate::sync::{Arc, Mutex};
use alloc::string::String;
use alloc::vec::Vec;
use core::cell::RefCell;

/// Every handle of an executor with its worker's name, and the ids of handles in the making.
pub(crate) struct Registry(Mutex<Known>);

struct Known {
    handles: Vec<(Arc<str>, Arc<HandleState>)>,
    /// Handles that were removed while their callback ran, which has not ended in time.
    leaving: Vec<(Arc<str>, Arc<HandleState>)>,
    claimed: Vec<String>,
}

impl Known {
    fn is_taken(&self, id: &str) -> bool {
        self.handles.iter().any(|(_, h)| h.id == id) || self.claimed.iter().any(|c| c == id)
    }
}

impl Registry {
    /// A registry for up to `limit` handles of `workers` workers, with `handles` in it already.
    ///
    /// A handle that leaves keeps its place at its worker until the worker lets go of it. So no
    /// more than `limit` leave at a time, and one more of each worker, which frees the place a
    /// moment before it reports that it has let go.
    pub(crate) fn new(
        mut handles: Vec<(Arc<str>, Arc<HandleState>)>,
        limit: usize,
        workers: usize,
    ) -> Self {
        handles.reserve(limit.saturating_sub(handles.len()));
        Self(Mutex::new(Known {
            handles,
            leaving: Vec::with_capacity(limit.saturating_add(workers)),
            claimed: Vec::new(),
        }))
    }

    pub(crate) fn find(&self, id: &str) -> Option<(Arc<str>, Arc<HandleState>)> {
        let known = self.0.lock();
        known.handles.iter().find(|(_, h)| h.id == id).cloned()
    }

    pub(crate) fn all(&self) -> Vec<(Arc<str>, Arc<HandleState>)> {
        self.0.lock().handles.clone()
    }

    /// Fills `out` with every handle. Allocates if `out` lacks room, and then without the lock.
    #[allow(dead_code, reason = "diagnostics need feature `std`")]
    pub(crate) fn copy_into(&self, out: &mut Vec<(Arc<str>, Arc<HandleState>)>) {
        out.clear(); // a handle that has left may be dropped here: not with the lock
        loop {
            let known = self.0.lock();
            let count = known.handles.len();
            if count <= out.capacity() {
                out.extend(known.handles.iter().cloned());
                return;
            }
            drop(known);
            out.reserve(count);
        }
    }

    /// Enters one more handle, which `hand_over` gives to its worker meanwhile. No thread finds it
    /// here before it is on its way, and its first callback does.
    pub(super) fn enter<E>(
        &self,
        worker: &Arc<str>,
        shared: &Arc<HandleState>,
        hand_over: impl FnOnce() -> Result<(), E>,
    ) -> Result<(), E> {
        let mut known = self.0.lock();
        hand_over()?;
        known.handles.push((Arc::clone(worker), Arc::clone(shared)));
        Ok(())
    }

    pub(super) fn forget(&self, shared: &Arc<HandleState>) {
        let mut known = self.0.lock();
        known.handles.retain(|(_, h)| !Arc::ptr_eq(h, shared));
    }

    /// Notes that a forgotten handle has not left yet, so that it can be found once more.
    pub(super) fn leaves(&self, worker: &Arc<str>, shared: &Arc<HandleState>) {
        while self.swept().is_some() {}
        let mut known = self.0.lock();
        if known.leaving.len() < known.leaving.capacity() {
            let leaving = (Arc::clone(worker), Arc::clone(shared));
            known.leaving.push(leaving);
        }
    }

    /// Takes out a handle that has left meanwhile and that no thread waits for. The caller drops it
    /// without the lock.
    fn swept(&self) -> Option<(Arc<str>, Arc<HandleState>)> {
        let mut known = self.0.lock();
        let at = known
            .leaving
            .iter()
            .position(|(_, h)| h.departure.gone.take())?;
        Some(known.leaving.swap_remove(at))
    }

    /// Takes out one that leaves.
    pub(super) fn left(&self, id: &str) -> Option<(Arc<str>, Arc<HandleState>)> {
        let mut known = self.0.lock();
        let at = known.leaving.iter().position(|(_, h)| h.id == id)?;
        Some(known.leaving.swap_remove(at))
    }
}

/// Ids of handles that are being made, so that two threads do not give the same one; free again
/// when this is dropped.
pub(super) struct Claims<'r> {
    registry: &'r Registry,
    ids: RefCell<Vec<String>>,
}

impl<'r> Claims<'r> {
    /// A list without ids so far.
    pub(super) const fn of(registry: &'r Registry) -> Self {
        Self {
            registry,
            ids: RefCell::new(Vec::new()),
        }
    }

    /// This id, or the first free one of `id#2`, `id#3`, ...
    pub(super) fn unique(&self, id: String) -> String {
        let mut known = self.registry.0.lock();
        let numbered = (2..usize::MAX).map(|n| with_number(&concat(&[&id, "#"]), n));
        let mut all = core::iter::once(id.clone()).chain(numbered);
        let free = all.find(|id| !known.is_taken(id)).unwrap_or(id);
        known.claimed.push(free.clone());
        drop(known);
        self.ids.borrow_mut().push(free.clone());
        free
    }
}

impl Drop for Claims<'_> {
    fn drop(&mut self) {
        let ids = self.ids.take();
        let mut known = self.registry.0.lock();
        known.claimed.retain(|claimed| !ids.contains(claimed));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One place, which its worker has freed, but has not said so; the next one in it leaves as
    /// well.
    #[test]
    fn whoever_leaves_can_be_asked_for_once_more_also_when_all_leave() {
        let worker: Arc<str> = "w".into();
        let registry = Registry::new(Vec::new(), 1, 1);
        let leaving = ["first", "second"].map(|id| HandleState::new(id.into(), None));
        for shared in &leaving {
            registry.leaves(&worker, shared);
        }
        for shared in &leaving {
            let (_, found) = registry.left(&shared.id).expect("it has not left");
            assert!(Arc::ptr_eq(&found, shared));
            registry.leaves(&worker, &found); // waited for in vain once more
        }
        leaving
            .iter()
            .for_each(|shared| shared.departure.gone.set());
        registry.leaves(&worker, &HandleState::new("third".into(), None));
        assert!(registry.left("first").is_none(), "it has left");
    }
}
