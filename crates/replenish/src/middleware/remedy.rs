//! Calls that make a longer buffer, for
//! [`PublishError::TooLong`](super::PublishError::TooLong), and how long it may be.

/// The largest sample, in bytes: 256 MiB.
pub(crate) const LARGEST: usize = 256 << 20;

/// At an end of a topic, service or action.
pub(crate) const SIZE: &str = "Topic::max_size";
/// In an output barrier.
pub(crate) const BARRIER: &str = "WorkerBuilder::output_barrier";
