//! Values that several parts of a program share: [`Arc`]. Where set-up happens once and nothing is
//! given back, it counts no references: a counter costs a loop of exclusive loads and stores at
//! every clone and every drop, and code that frees memory which is never freed.

/// `Arc`, where things that are no longer used are given back.
#[cfg(any(not(target_os = "none"), feature = "dynamic"))]
pub use alloc::sync::Arc;
#[cfg(not(any(not(target_os = "none"), feature = "dynamic")))]
pub use leaked::Arc;

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

    /// In the place of `Arc`, without feature `dynamic` on targets without an operating system:
    /// what is shared lives as long as the image, is never dropped, and its memory is never given
    /// back.
    pub struct Arc<T: ?Sized>(NonNull<T>);

    // SAFETY: it is a reference that several have, and may be the last to use the value: as `Arc`.
    unsafe impl<T: ?Sized + Send + Sync> Send for Arc<T> {}
    // SAFETY: as above.
    unsafe impl<T: ?Sized + Send + Sync> Sync for Arc<T> {}

    impl<T> Arc<T> {
        /// Shares a value from now on.
        #[must_use]
        pub fn new(value: T) -> Self {
            Self::from(Box::new(value))
        }
    }

    impl<T: ?Sized> Arc<T> {
        /// Whether both are the same.
        #[must_use]
        pub fn ptr_eq(this: &Self, other: &Self) -> bool {
            core::ptr::addr_eq(this.0.as_ptr(), other.0.as_ptr())
        }
    }

    impl<T: ?Sized> From<Box<T>> for Arc<T> {
        fn from(value: Box<T>) -> Self {
            Self(NonNull::from(Box::leak(value)))
        }
    }

    impl From<&str> for Arc<str> {
        fn from(text: &str) -> Self {
            Self::from(Box::from(text))
        }
    }

    impl<T: ?Sized> Clone for Arc<T> {
        fn clone(&self) -> Self {
            Self(self.0)
        }
    }

    impl<T: ?Sized> Deref for Arc<T> {
        type Target = T;

        fn deref(&self) -> &T {
            // SAFETY: it was leaked when it was shared, and nothing takes it back or changes it.
            unsafe { self.0.as_ref() }
        }
    }

    impl<T: ?Sized> AsRef<T> for Arc<T> {
        fn as_ref(&self) -> &T {
            self
        }
    }

    impl<T: Default> Default for Arc<T> {
        fn default() -> Self {
            Self::new(T::default())
        }
    }

    impl<T: ?Sized + fmt::Debug> fmt::Debug for Arc<T> {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            (**self).fmt(f)
        }
    }
}
