//! In the place of `shared` without feature `std`: no message is shared, every one is copied.

use core::any::TypeId;

/// There is none.
#[derive(Debug, Clone)]
pub enum Shared {}

impl Shared {
    /// The message, if it is of this type.
    #[must_use]
    pub const fn get<M: 'static>(&self) -> Option<&M> {
        match *self {}
    }

    /// The message's type.
    #[must_use]
    pub const fn message_type(&self) -> TypeId {
        match *self {}
    }
}
