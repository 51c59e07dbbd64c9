//! [`Nudge`]: tells a worker that receives by itself of samples that came another way.

use crate::sync::{AtomicBool, Ordering};
use replenish_os::WakeFd;
use std::io;

/// Bytes of the buffer for a datagram.
pub(super) const BUFFER: usize = 65_536;

/// Tells the worker of samples that have come another way than through the reader's socket.
pub(super) struct Nudge {
    pub(super) fd: WakeFd,
    is_set: AtomicBool,
}

impl Nudge {
    pub(super) fn new() -> io::Result<Self> {
        Ok(Self {
            fd: WakeFd::new()?,
            is_set: AtomicBool::new(false),
        })
    }

    pub(super) fn set(&self) {
        if !self.is_set.swap(true, Ordering::AcqRel) {
            self.fd.wake();
        }
    }

    /// Before the samples are looked for: a nudge that comes later stays.
    pub(super) fn clear(&self) {
        if self.is_set.load(Ordering::Acquire) {
            self.fd.clear();
            self.is_set.store(false, Ordering::Release);
        }
    }
}
