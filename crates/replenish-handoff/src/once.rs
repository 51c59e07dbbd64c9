//! A cell that is set once and read by any thread, where the standard library's cannot be used:
//! without that library, and in a model, which has to see the moment when the cell is set.

#[cfg(not(loom))]
pub use bare::Once;
#[cfg(loom)]
pub use modelled::Once;

#[cfg(not(loom))]
mod bare {
    use alloc::boxed::Box;
    use once_cell::race::OnceBox;

    /// The interface of `std::sync::OnceLock`, as far as it is used.
    pub struct Once<T>(OnceBox<T>);

    impl<T> Once<T> {
        /// A cell that is not set.
        #[must_use]
        pub const fn new() -> Self {
            Self(OnceBox::new())
        }

        /// The value, if it is set.
        pub fn get(&self) -> Option<&T> {
            self.0.get()
        }

        /// Sets the cell.
        ///
        /// # Errors
        /// If it is set: then it gives `value` back.
        pub fn set(&self, value: T) -> Result<(), T> {
            self.0.set(Box::new(value)).map_err(|value| *value)
        }
    }

    impl<T> Default for Once<T> {
        fn default() -> Self {
            Self::new()
        }
    }
}

#[cfg(loom)]
mod modelled {
    use crate::sync::{AtomicBool, Ordering};
    use std::sync::OnceLock;

    /// `OnceLock`, of which other threads see what the model lets them see.
    #[derive(Debug)]
    pub struct Once<T> {
        value: OnceLock<T>,
        is_set: AtomicBool,
    }

    impl<T> Once<T> {
        /// A cell that is not set.
        pub fn new() -> Self {
            Self {
                value: OnceLock::new(),
                is_set: AtomicBool::new(false),
            }
        }

        /// The value, if it is set.
        pub fn get(&self) -> Option<&T> {
            let is_set = self.is_set.load(Ordering::Acquire);
            self.value.get().filter(|_| is_set)
        }

        /// Sets the cell, or gives `value` back.
        pub fn set(&self, value: T) -> Result<(), T> {
            self.value.set(value)?;
            self.is_set.store(true, Ordering::Release);
            Ok(())
        }
    }

    impl<T> Default for Once<T> {
        fn default() -> Self {
            Self::new()
        }
    }
}
