//! Calls that make a longer buffer, for [`PublishError::TooLong`](super::PublishError::TooLong).

/// In a publisher.
pub(crate) const PUBLISHER: &str = "Node::publisher_sized";
/// In a service's client or server.
pub(crate) const SERVICE: &str = "Topic::max_size";
/// In an action's client or server.
pub(crate) const ACTION: &str = "ActionOptions::max_size";
/// In an output barrier.
pub(crate) const BARRIER: &str = "WorkerBuilder::output_barrier";
