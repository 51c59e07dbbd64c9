//! What several parts of a program share: [`Shared`]. Where set-up happens once and nothing is given
//! back, it counts no references: a counter costs a loop of exclusive loads and stores at every
//! clone and every drop, and code that frees what is never freed.

/// `Arc`, where things that are no longer used are given back.
#[cfg(any(not(target_os = "none"), feature = "dynamic"))]
pub use alloc::sync::Arc as Shared;
#[cfg(not(any(not(target_os = "none"), feature = "dynamic")))]
pub use leaked::Shared;

#[cfg(not(any(not(target_os = "none"), feature = "dynamic")))]
mod leaked {
    #![expect(
        unsafe_code,
        reason = "a reference would bind what is shared to 'static, which `Arc` does not"
    )]

    use alloc::boxed::Box;
    use core::fmt;
    use core::ops::Deref;
    use core::ptr::NonNull;

    /// In the place of `Arc`, without feature `dynamic` on targets without an operating system: what
    /// is shared lives as long as the image, is never dropped, and its memory is never given back.
    pub struct Shared<T: ?Sized>(NonNull<T>);

    // SAFETY: it is a reference that several have, and may be the last to use the value: as `Arc`.
    unsafe impl<T: ?Sized + Send + Sync> Send for Shared<T> {}
    // SAFETY: as above.
    unsafe impl<T: ?Sized + Send + Sync> Sync for Shared<T> {}

    impl<T> Shared<T> {
        /// Shares a value from now on.
        #[must_use]
        pub fn new(value: T) -> Self {
            Self::from(Box::new(value))
        }
    }

    impl<T: ?Sized> Shared<T> {
        /// Whether both are the same.
        #[must_use]
        pub fn ptr_eq(this: &Self, other: &Self) -> bool {
            core::ptr::addr_eq(this.0.as_ptr(), other.0.as_ptr())
        }
    }

    impl<T: ?Sized> From<Box<T>> for Shared<T> {
        fn from(value: Box<T>) -> Self {
            Self(NonNull::from(Box::leak(value)))
        }
    }

    impl From<&str> for Shared<str> {
        fn from(text: &str) -> Self {
            Self::from(Box::from(text))
        }
    }

    impl<T: ?Sized> Clone for Shared<T> {
        fn clone(&self) -> Self {
            Self(self.0)
        }
    }

    impl<T: ?Sized> Deref for Shared<T> {
        type Target = T;

        fn deref(&self) -> &T {
            // SAFETY: it was leaked when it was shared, and nobody takes it back or changes it.
            unsafe { self.0.as_ref() }
        }
    }

    impl<T: ?Sized> AsRef<T> for Shared<T> {
        fn as_ref(&self) -> &T {
            self
        }
    }

    impl<T: Default> Default for Shared<T> {
        fn default() -> Self {
            Self::new(T::default())
        }
    }

    impl<T: ?Sized + fmt::Debug> fmt::Debug for Shared<T> {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            (**self).fmt(f)
        }
    }
}
