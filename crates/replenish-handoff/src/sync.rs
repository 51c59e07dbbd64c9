//! The synchronisation of every protocol in this crate and in `replenish`, behind one name each.
//!
//! A model (`--cfg loom`) gets `loom`'s atomics here, and `replenish-os` gives it locks, cells and
//! time of the model: so the models run the code itself. Reference counts are not modelled: [`Arc`]
//! is the library's in a model, too.

#[cfg(not(all(feature = "std", not(loom))))]
pub use crate::once::Once;
#[cfg(all(not(loom), target_has_atomic = "64"))]
pub use core::sync::atomic::AtomicU64;
#[cfg(not(loom))]
pub use core::sync::atomic::{AtomicBool, AtomicUsize, Ordering, fence};
#[cfg(loom)]
pub use loom::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering, fence};
#[cfg(all(not(loom), not(target_has_atomic = "64")))]
pub use replenish_os::AtomicU64;
pub use replenish_os::{Arc, Notify, PiMutex as Mutex};
#[cfg(all(feature = "std", not(loom)))]
pub use std::sync::OnceLock as Once;

/// Numbers that no protocol depends on, such as statistics: a model does not explore them.
pub mod unmodelled {
    #[cfg(target_has_atomic = "64")]
    pub use core::sync::atomic::AtomicU64;
    #[cfg(not(target_has_atomic = "64"))]
    pub use replenish_os::AtomicU64;
}
