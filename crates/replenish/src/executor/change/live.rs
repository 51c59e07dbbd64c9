//! Adding and removing handles while the executor runs, from any thread, callbacks included. What
//! can be added is in `live_handles`.

use crate::context::Context;
use crate::error::Error;
use crate::executor::describe::factory::HandleFactory;
use crate::executor::handles::callback::CallbackContext;
use crate::executor::handles::entry::HandleEntry;
use crate::executor::handles::group::{Group, Groups};
use crate::executor::handles::options::HandleOptions;
use crate::executor::handles::state::HandleState;
use crate::executor::run::mailbox::{Command, Mailbox};
use crate::executor::run::route_updates::RouteUpdates;
use crate::executor::run::routes::Route;
use crate::executor::wake::schedule::nanos;
use crate::executor::wake::stop::StopHandle;
use crate::handoff::Declined;
use crate::name::{concat, with_number};
use crate::platform::text;
use crate::stats::HandleStats;
use crate::sync::{Arc, AtomicU64, Mutex, Ordering};
use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;
use core::cell::RefCell;
use core::fmt;
use core::time::Duration;
use replenish_os::clock;

/// What happens to a callback that runs while its handle is removed. None starts after that.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Removal {
    /// It goes on; the removal does not wait for it.
    Detach,
    /// It goes on; the removal waits for its end, up to so long.
    Wait(Duration),
    /// It is told to end ([`CallbackContext::is_cancelled`](crate::CallbackContext::is_cancelled));
    /// the removal waits up to so long.
    Cancel(Duration),
}

/// Every handle of an executor with its worker's name, and the ids of those that are being made.
pub(crate) struct Registry(Mutex<Known>);

struct Known {
    handles: Vec<(Arc<str>, Arc<HandleState>)>,
    /// Those that were removed while a callback ran, which has not ended in time.
    leaving: Vec<(Arc<str>, Arc<HandleState>)>,
    claimed: Vec<String>,
}

impl Known {
    fn is_taken(&self, id: &str) -> bool {
        self.handles.iter().any(|(_, h)| h.id == id) || self.claimed.iter().any(|c| c == id)
    }
}

impl Registry {
    /// For up to `limit` handles of so many workers.
    ///
    /// One that leaves has its place at its worker until the worker lets go of it, so no more than
    /// `limit` leave at a time; and one more of each worker, which frees the place a moment before
    /// it says that it has let go.
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

    /// One more handle, which `hand_over` gives to its worker meanwhile: nobody can ask for it
    /// before it is on its way, and its first callback finds it here.
    fn enter<E>(
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

    fn forget(&self, shared: &Arc<HandleState>) {
        let mut known = self.0.lock();
        known.handles.retain(|(_, h)| !Arc::ptr_eq(h, shared));
    }

    /// One that was forgotten has not left yet: it can be asked for once more.
    fn leaves(&self, worker: &Arc<str>, shared: &Arc<HandleState>) {
        while self.swept().is_some() {}
        let mut known = self.0.lock();
        if known.leaving.len() < known.leaving.capacity() {
            let leaving = (Arc::clone(worker), Arc::clone(shared));
            known.leaving.push(leaving);
        }
    }

    /// One that has left meanwhile, and that nobody waits for: to be dropped without the lock.
    fn swept(&self) -> Option<(Arc<str>, Arc<HandleState>)> {
        let mut known = self.0.lock();
        let at = known.leaving.iter().position(|(_, h)| h.gone.take())?;
        Some(known.leaving.swap_remove(at))
    }

    /// Takes out one that leaves.
    fn left(&self, id: &str) -> Option<(Arc<str>, Arc<HandleState>)> {
        let mut known = self.0.lock();
        let at = known.leaving.iter().position(|(_, h)| h.id == id)?;
        Some(known.leaving.swap_remove(at))
    }
}

/// Ids of handles that are being made, so that two threads do not give the same one; free again
/// when this is dropped.
struct Claims<'r> {
    registry: &'r Registry,
    ids: RefCell<Vec<String>>,
}

impl Claims<'_> {
    /// This id, or the first free one of `id#2`, `id#3`, ...
    fn unique(&self, id: String) -> String {
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

/// One worker as it is seen from outside.
pub(crate) struct Post {
    pub(crate) name: Arc<str>,
    pub(crate) mailbox: Arc<Mailbox>,
    /// Numbers for the ids of timers and guard conditions.
    pub(crate) number: AtomicU64,
}

/// What every handle to a running executor shares.
pub(crate) struct Live {
    pub(crate) context: Context,
    pub(crate) stop: StopHandle,
    pub(crate) registry: Registry,
    pub(crate) updates: Arc<RouteUpdates>,
    pub(crate) posts: Vec<Post>,
    groups: Groups,
    /// By post: for which one its callback waits.
    awaited: Mutex<Vec<Option<usize>>>,
}

impl Post {
    pub(crate) fn new(name: &Arc<str>, mailbox: &Arc<Mailbox>, number: u64) -> Self {
        Self {
            name: Arc::clone(name),
            mailbox: Arc::clone(mailbox),
            number: AtomicU64::new(number),
        }
    }
}

impl Live {
    pub(crate) fn new(
        context: &Context,
        stop: &StopHandle,
        registry: Registry,
        updates: &Arc<RouteUpdates>,
        posts: Vec<Post>,
        known: &mut dyn Iterator<Item = &Group>,
    ) -> Arc<Self> {
        let groups = Groups::default();
        known.for_each(|group| groups.note(group));
        Arc::new(Self {
            context: context.clone(),
            stop: stop.clone(),
            registry,
            updates: Arc::clone(updates),
            awaited: Mutex::new(alloc::vec![None; posts.len()]),
            posts,
            groups,
        })
    }

    /// Whether the caller may wait for the worker at `target`: not in a callback of its own, not in
    /// one of a group, which that worker may wait for, and not if that worker waits for the
    /// caller's, directly or not. The place of the caller's worker, if it is one; it waits from now
    /// on.
    fn may_await(&self, target: usize) -> Result<Option<usize>, ()> {
        let is_mine = |post: &Post| post.mailbox.is_mine();
        if self.posts.get(target).is_some_and(is_mine) || self.groups.has_mine() {
            return Err(());
        }
        let Some(me) = self.posts.iter().position(is_mine) else {
            return Ok(None); // nobody waits for a thread that is no worker
        };
        let mut awaited = self.awaited.lock();
        let mut next = Some(target);
        while let Some(at) = next {
            if at == me {
                return Err(());
            }
            next = awaited.get(at).copied().flatten();
        }
        if let Some(place) = awaited.get_mut(me) {
            *place = Some(target);
        }
        Ok(Some(me))
    }

    /// The worker there waits for nobody any more.
    fn has_awaited(&self, me: Option<usize>) {
        let mut awaited = self.awaited.lock();
        if let Some(place) = me.and_then(|me| awaited.get_mut(me)) {
            *place = None;
        }
    }
}

/// Changes a running executor: adds and removes handles. Clones are for the same executor.
///
/// Adding allocates on the calling thread; the worker and the dispatcher only take over what is
/// there. Other handles are not disturbed.
#[derive(Clone)]
pub struct ExecutorHandle {
    pub(crate) live: Arc<Live>,
}

impl ExecutorHandle {
    /// A worker of this name, to add handles to.
    ///
    /// # Errors
    /// [`Error::UnknownWorker`].
    pub fn worker(&self, name: &str) -> Result<WorkerHandle<'_>, Error> {
        let mut posts = self.live.posts.iter();
        let post = posts.find(|p| &*p.name == name);
        let post = post.ok_or_else(|| Error::UnknownWorker(name.into()))?;
        Ok(WorkerHandle {
            live: &self.live,
            post,
            handling: HandleOptions::new(),
        })
    }

    /// Removes a handle. When this returns no callback of it starts any more; what becomes of one
    /// that runs is up to `how`. Samples that wait are discarded. Returns the last counters.
    ///
    /// A callback that removes a handle of its own worker does not wait, nor does one that is in a
    /// [group](crate::Group), nor one whose worker a callback of the handle's worker waits for in
    /// the same way: the handle goes when the callbacks have ended.
    ///
    /// # Errors
    /// [`Error::UnknownHandle`]; [`Error::Stopped`]; [`Error::Capacity`] if too many changes are
    /// under way: then nothing has changed; [`Error::StillRunning`] if the callback has not ended
    /// in time: then the handle goes when it has, and can be removed once more, to wait on or to
    /// cancel the callback.
    pub fn remove(&self, id: &str, how: Removal) -> Result<HandleStats, Error> {
        let live = &self.live;
        let unknown = || Error::UnknownHandle(id.into());
        let Some((worker, shared)) = live.registry.find(id) else {
            let (worker, shared) = live.registry.left(id).ok_or_else(unknown)?;
            return self.await_leaving(&worker, &shared, how);
        };
        let mut posts = live.posts.iter();
        let post = posts.find(|p| p.name == worker).ok_or_else(unknown)?;
        let update = live.updates.reserve()?;
        if shared.removed.swap(true, Ordering::AcqRel) {
            return Err(unknown()); // somebody else removes it
        }
        live.registry.forget(&shared);
        shared.discard(true, &live.stop);
        if let Some((reader, _)) = shared.input {
            update.update(reader, None);
        }
        live.stop.middleware.wake();
        if !post.mailbox.remove(&shared) {
            return Err(Error::Stopped);
        }
        self.await_leaving(&worker, &shared, how)
    }

    /// Waits for the worker to let go of a handle, as far as that is asked for and may be.
    fn await_leaving(
        &self,
        worker: &Arc<str>,
        shared: &Arc<HandleState>,
        how: Removal,
    ) -> Result<HandleStats, Error> {
        let live = &self.live;
        let unknown = || Error::UnknownHandle(shared.id.as_str().into());
        let mut posts = live.posts.iter().enumerate();
        let (target, post) = posts.find(|(_, p)| p.name == *worker).ok_or_else(unknown)?;
        if matches!(how, Removal::Cancel(_)) {
            shared.cancelled.store(true, Ordering::Release);
        }
        let patience = match how {
            Removal::Detach => Duration::ZERO,
            Removal::Wait(limit) | Removal::Cancel(limit) => limit,
        };
        let deadline = clock::monotonic().saturating_add(nanos(patience));
        let awaits = match how {
            Removal::Detach => Err(()),
            _ => live.may_await(target),
        };
        let waits = awaits.is_ok();
        let gone = !waits || shared.gone.wait_until(deadline);
        // The counters are the last ones when the dispatcher has let go of it, too.
        let routed = || shared.input.is_some() && !shared.unrouted.load(Ordering::Acquire);
        while waits && routed() && !live.stop.is_stopping() && clock::monotonic() < deadline {
            clock::sleep_until(clock::monotonic().saturating_add(50_000));
        }
        if let Ok(me) = awaits {
            live.has_awaited(me);
        }
        post.mailbox.sweep();
        live.updates.free_retired();
        let lost = shared.input.as_ref();
        let lost = lost.map_or(0, |(reader, _)| live.stop.middleware.lost(*reader));
        match gone {
            true => Ok(shared.counters.snapshot(shared.waiting(), lost)),
            false => {
                live.registry.leaves(worker, shared);
                Err(Error::StillRunning(shared.id.as_str().into()))
            }
        }
    }

    /// Stops the executor.
    #[must_use]
    pub fn stop_handle(&self) -> StopHandle {
        self.live.stop.clone()
    }
}

impl CallbackContext<'_> {
    /// The running executor, to add and remove handles. A change of the callback's own worker
    /// happens when the callback has ended. `Some` in every executor that runs, with threads or
    /// without.
    #[must_use]
    pub fn handle(&self) -> Option<ExecutorHandle> {
        let live = self.env.live?.downcast_ref::<Arc<Live>>()?;
        let live = Arc::clone(live);
        Some(ExecutorHandle { live })
    }
}

impl fmt::Debug for ExecutorHandle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ExecutorHandle").finish_non_exhaustive()
    }
}

/// A worker of a running executor. Each method adds one handle and returns its id; the handle
/// runs as soon as the worker has ended the callback it is in.
///
/// # Errors
/// All of them: [`Error::Capacity`] with the limit when the worker is full (see
/// [`WorkerBuilder::capacity`](crate::WorkerBuilder::capacity)), [`Error::Stopped`], and what the
/// method of the same name says in [`WorkerBuilder`](crate::WorkerBuilder).
pub struct WorkerHandle<'e> {
    live: &'e Arc<Live>,
    post: &'e Post,
    handling: HandleOptions,
}

impl fmt::Debug for WorkerHandle<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("WorkerHandle")
            .field("name", &self.post.name)
            .finish_non_exhaustive()
    }
}

impl WorkerHandle<'_> {
    /// How the handle that is added next is treated. Where several are added together (actions,
    /// parameters, managed nodes), priority, group and error hook are those of all of them.
    #[must_use]
    pub fn options(self, handling: HandleOptions) -> Self {
        Self { handling, ..self }
    }

    /// The same worker once more, for handles that belong together and are treated alike.
    pub(crate) fn again(&self) -> Self {
        Self {
            live: self.live,
            post: self.post,
            handling: self.handling.shared(),
        }
    }

    /// What is known about one of its handles.
    pub(crate) fn handle(&self, id: &str) -> Option<Arc<HandleState>> {
        let (_, handle) = self.live.registry.find(id)?;
        Some(handle)
    }

    /// The executor.
    pub(crate) fn executor_handle(&self) -> ExecutorHandle {
        let live = Arc::clone(self.live);
        ExecutorHandle { live }
    }

    pub(crate) fn add(
        self,
        make: impl FnOnce(&HandleFactory<'_>) -> Result<HandleEntry, Error>,
    ) -> Result<String, Error> {
        let Self {
            live,
            post,
            handling,
        } = self;
        post.mailbox.free_retired();
        let update = live.updates.reserve()?;
        let reserved = post.mailbox.reserve().map_err(|e| declined(e, post))?;
        let number = post.number.fetch_add(1, Ordering::Relaxed);
        let claims = Claims {
            registry: &live.registry,
            ids: RefCell::new(Vec::new()),
        };
        let mut entry = make(&HandleFactory {
            context: &live.context,
            worker: &post.name,
            unique: &|id| claims.unique(id),
            number: usize::try_from(number).unwrap_or(usize::MAX),
        })?;
        entry.treat(handling);
        entry.slot = reserved.slot();
        let shared = Arc::clone(&entry.shared);
        let group = entry.handling.group.as_ref();
        group.into_iter().for_each(|g| live.groups.note(g));
        let route = Route {
            shared: Arc::clone(&shared),
            wake: post.mailbox.wake_handle(entry.slot),
            spare_slot: None,
        };
        let sent = live.registry.enter(&post.name, &shared, || {
            post.mailbox.add(reserved, entry)?;
            if let Some((reader, _)) = shared.input {
                update.update(reader, Some(route));
            }
            Ok(())
        });
        sent.map_err(|_: Box<Command>| Error::Stopped)?;
        if shared.input.is_some() {
            live.stop.middleware.wake();
        }
        Ok(shared.id.clone())
    }
}

fn declined(why: Declined, post: &Post) -> Error {
    match why {
        Declined::Closed => Error::Stopped,
        Declined::Full { limit } => Error::Capacity {
            what: text!("handles of worker {:?}", post.name),
            limit,
        },
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
        leaving.iter().for_each(|shared| shared.gone.set());
        registry.leaves(&worker, &HandleState::new("third".into(), None));
        assert!(registry.left("first").is_none(), "it has left");
    }
}
