//! [`OneUser`]: what several handles of one worker call or poll.
//!
//! Its lock is held only while the value is taken out and put back. User code under a lock of ours
//! would be a critical section, in which a worker without budget is not stopped
//! (`docs/enforcement.md`).

use crate::sync::Mutex;

/// A value that one user at a time works with, without a lock meanwhile. Moving it should be cheap.
pub(crate) struct OneUser<T>(Mutex<Option<T>>);

impl<T> OneUser<T> {
    pub(crate) fn new(value: T) -> Self {
        Self(Mutex::new(Some(value)))
    }

    /// Works with the value, which is put back also if `work` panics. `None` while another user
    /// has it.
    pub(crate) fn with<R>(&self, work: impl FnOnce(&mut T) -> R) -> Option<R> {
        let value = self.0.lock().take()?;
        let mut taken = Taken {
            owner: self,
            value: Some(value),
        };
        taken.value.as_mut().map(work)
    }
}

/// Puts the value back.
struct Taken<'a, T> {
    owner: &'a OneUser<T>,
    value: Option<T>,
}

impl<T> Drop for Taken<'_, T> {
    fn drop(&mut self) {
        *self.owner.0.lock() = self.value.take();
    }
}

#[test]
fn a_second_user_has_nothing_until_the_first_is_done() {
    let number = OneUser::new(1);
    let inside = number.with(|n| {
        *n += 1;
        number.with(|_| ())
    });
    assert_eq!(inside, Some(None));
    assert_eq!(number.with(|n| *n), Some(2));
}

#[test]
fn a_value_is_put_back_after_a_panic() {
    let number = OneUser::new(1);
    let panics = || number.with(|_| std::panic::resume_unwind(Box::new("a panic of the user")));
    let caught = std::panic::catch_unwind(core::panic::AssertUnwindSafe(panics));
    assert!(caught.is_err());
    assert_eq!(number.with(|n| *n), Some(1));
}
