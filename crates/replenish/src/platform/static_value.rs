//! Values that live as long as the image where nothing is given back.
//! `static_value_disabled.rs` takes this file's place in other builds.

use core::mem::ManuallyDrop;

/// A value that is never dropped: its destructor is not linked.
pub(crate) type Static<T> = ManuallyDrop<T>;

pub(crate) const fn make_static<T>(value: T) -> Static<T> {
    ManuallyDrop::new(value)
}
