//! Readers of this process that take a message as it is in memory.
//! `local_disabled.rs` takes this file's place without feature `std`.

use crate::handoff::{DeliveryOutcome, Doorbell, SampleInfo, Shared};
use crate::sync::Arc;
use core::any::TypeId;
use core::fmt;
use std::sync::Weak;

pub(crate) use crate::sync::Once as Late;

/// A handle that takes messages as they are in memory, from any thread.
pub(crate) trait Deliver<W: ?Sized>: Send + Sync {
    /// Stores a message, without a copy; its fate, and the bell to ring.
    fn deliver(
        &self,
        message: &Shared,
        info: &SampleInfo,
    ) -> (DeliveryOutcome, Option<Arc<Doorbell<W>>>);
}

/// A subscription of this process that takes messages of one Rust type as they are in memory. The
/// executor hands it to [`Middleware::share_with`](crate::middleware::Middleware::share_with).
pub struct LocalReader<W: ?Sized> {
    takes: TypeId,
    /// Gone when its executor is: the middleware must not keep it, which it keeps itself.
    to: Weak<dyn Deliver<W>>,
}

impl<W: ?Sized + 'static> LocalReader<W> {
    /// A handle that takes messages of type `M`.
    pub(crate) fn of<M: 'static>(to: &Arc<impl Deliver<W> + 'static>) -> Option<Self> {
        let weak = Arc::downgrade(to);
        Some(Self {
            takes: TypeId::of::<M>(),
            to: weak,
        })
    }

    /// Whether it takes this message.
    pub(crate) fn takes(&self, message: &Shared) -> bool {
        self.takes == message.message_type() && self.to.strong_count() > 0
    }

    /// Stores a message that it takes; `None` if its executor has gone.
    pub(crate) fn deliver(
        &self,
        message: &Shared,
        info: &SampleInfo,
    ) -> Option<(DeliveryOutcome, Option<Arc<Doorbell<W>>>)> {
        Some(self.to.upgrade()?.deliver(message, info))
    }
}

impl<W: ?Sized> fmt::Debug for LocalReader<W> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LocalReader").finish_non_exhaustive()
    }
}
