//! Privilege: an image may do everything.

/// Whether a thread can have a real-time priority at all: yes.
#[must_use]
pub const fn may_be_real_time() -> bool {
    true
}
