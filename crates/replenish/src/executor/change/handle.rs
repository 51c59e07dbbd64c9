//! The handle to a running executor: removing handles, from any thread, callbacks included.

use super::live::Live;
use crate::error::Error;
use crate::executor::handles::callback::CallbackContext;
use crate::executor::handles::state::HandleState;
use crate::executor::wake::schedule::nanos;
use crate::executor::wake::stop::StopHandle;
use crate::stats::HandleStats;
use crate::sync::{Arc, Ordering};
use core::fmt;
use core::time::Duration;
use replenish_os::clock;

/// The rule for a callback that runs while its handle is removed. None starts after that.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Removal {
    /// The callback goes on; the removal does not wait for it.
    Detach,
    /// The callback goes on; the removal waits for its end, for at most this time.
    Wait(Duration),
    /// The callback is asked to end
    /// ([`CallbackContext::is_cancelled`](crate::CallbackContext::is_cancelled)); the removal waits
    /// for at most this time.
    Cancel(Duration),
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
    /// Removes a handle, by its [`HandleId`](crate::HandleId) or the text of it. When this returns
    /// no callback of it starts any more; what becomes of one that runs is up to `how`. Samples
    /// that wait are discarded. Returns the last counters.
    ///
    /// A callback that removes a handle of its own worker does not wait, nor does one that is in a
    /// [group](crate::Group), nor one whose worker a callback of the handle's worker waits for in
    /// the same way, nor an event hook on the dispatcher's thread: the handle goes when the
    /// callbacks have ended.
    ///
    /// The worker drops what the callback owns, under its budget, and the handle is charged for it.
    /// A panic in that is an [`Event::CallbackPanicked`](crate::Event::CallbackPanicked) of the
    /// handle and ends nothing.
    ///
    /// # Errors
    /// [`Error::UnknownHandle`]; [`Error::Stopped`]; [`Error::Capacity`] if too many changes are
    /// under way: then nothing has changed; [`Error::StillRunning`] if the callback has not ended
    /// in time: then the handle goes when it has, and can be removed once more, to wait on or to
    /// cancel the callback.
    pub fn remove(&self, id: impl AsRef<str>, how: Removal) -> Result<HandleStats, Error> {
        self.remove_by_text(id.as_ref(), how)
    }

    fn remove_by_text(&self, id: &str, how: Removal) -> Result<HandleStats, Error> {
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
        shared.discard(true, &**live.context.middleware());
        if let Some((reader, _)) = shared.input {
            update.update(reader, None);
        }
        live.context.middleware().wake();
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
        let gone = !waits || shared.departure.gone.wait_until(deadline);
        // The counters are the last ones when the dispatcher has let go of it, too.
        let routed = || shared.input.is_some() && !shared.departure.is_unrouted();
        while waits && routed() && !live.stop.is_stopping() && clock::monotonic() < deadline {
            clock::sleep_until(clock::monotonic().saturating_add(50_000));
        }
        if let Ok(me) = awaits {
            live.has_awaited(me);
        }
        post.mailbox.sweep();
        live.updates.free_retired();
        if gone {
            return Ok(shared.stats(&**live.context.middleware()));
        }
        live.registry.leaves(worker, shared);
        Err(Error::StillRunning(shared.id.as_str().into()))
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
