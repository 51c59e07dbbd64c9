//! [`Source`]: the samples of one reader, for the thread of its callback.

use crate::handoff::SampleInfo;
use crate::platform::SourceSet;

/// The samples of one reader, taken by the thread of its callback: on that thread's priority, and
/// on its budget. The dispatcher spends nothing on them.
///
/// Given by [`Middleware::source`](super::Middleware::source). Dropping it closes what it waits on.
pub trait Source: Send {
    /// The worker listens from now on: what was [added](SourceSet::add) to `set` under `key` ends
    /// its wait. Called once, on the worker's thread; allocates nothing.
    fn begin(&mut self, set: &SourceSet, key: u32);

    /// Hands a bounded batch of samples to `sink`, in order of arrival, without waiting; whether
    /// more may be there. `sink` only copies bytes, and never calls back into the middleware.
    fn pull(&mut self, sink: &mut dyn FnMut(&SampleInfo, &[u8])) -> bool;
}
