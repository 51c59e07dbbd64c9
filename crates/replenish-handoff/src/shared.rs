//! A message in memory that its publisher and its readers share. `shared_disabled.rs` takes this
//! file's place without feature `std`.

use alloc::sync::Arc;
use core::any::{Any, TypeId};
use core::fmt;

/// A message of any type in memory that several threads read. Clones are the same message; a clone
/// and its drop are one atomic operation each, as long as a [`Pool`](crate::Pool) holds it too.
#[derive(Clone)]
pub struct Shared(Arc<dyn Any + Send + Sync>);

impl Shared {
    /// One more holder of this message.
    #[must_use]
    pub fn of<M: Send + Sync + 'static>(message: &Arc<M>) -> Self {
        Self(Arc::clone(message) as Arc<dyn Any + Send + Sync>)
    }

    /// The message, if it is of this type.
    #[must_use]
    pub fn get<M: 'static>(&self) -> Option<&M> {
        self.0.downcast_ref()
    }

    /// The message's type.
    #[must_use]
    pub fn message_type(&self) -> TypeId {
        (*self.0).type_id()
    }

    /// Whether this holder is the only one.
    #[must_use]
    pub fn is_alone(&mut self) -> bool {
        Arc::get_mut(&mut self.0).is_some()
    }
}

impl fmt::Debug for Shared {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Shared").finish_non_exhaustive()
    }
}
