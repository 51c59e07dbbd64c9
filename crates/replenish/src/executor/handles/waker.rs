//! Wakes the handle of a future.

use crate::executor::wake::doorbell::WakeHandle;
use crate::handoff::Flag;
use crate::sync::{Once, Ordering, fence};
use alloc::sync::Arc;
use alloc::task::Wake;
use replenish_os::clock;

/// The waker of one handle. Waking is two atomic operations and a system call at most.
pub(super) struct HandleWaker {
    woken: Flag,
    wake: Once<WakeHandle>,
}

impl HandleWaker {
    pub(super) fn new() -> Arc<Self> {
        Arc::new(Self {
            woken: Flag::new(),
            wake: Once::new(),
        })
    }

    /// The worker begins.
    pub(super) fn begin(&self, wake: &WakeHandle) {
        self.wake.set(wake.clone()).ok();
        fence(Ordering::SeqCst);
    }

    pub(super) fn is_woken(&self) -> bool {
        self.woken.is_raised()
    }

    /// Whether it was woken since this was asked last.
    pub(super) fn take(&self) -> bool {
        self.woken.take() > 0
    }
}

impl Wake for HandleWaker {
    fn wake(self: Arc<Self>) {
        self.wake_by_ref();
    }

    fn wake_by_ref(self: &Arc<Self>) {
        self.woken.raise(|| {
            fence(Ordering::SeqCst); // either the wake handle is seen here, or the flag after `begin`
            if let Some(wake) = self.wake.get() {
                wake.ring(clock::monotonic());
            }
        });
    }
}
