//! The cargo features of this build, as constants.

/// Samples may be longer than a message. Without it such samples are refused, and those that come
/// in fragments are dropped and counted.
pub const FRAGMENTS: bool = cfg!(feature = "fragments");
/// Reliable samples that were not acknowledged when the agent was lost are sent again, and what
/// the agent tells of their fate and of objects is understood. Without it they are given up and
/// counted.
pub const DELIVERY: bool = cfg!(feature = "delivery");
/// The round trip is measured, and repairs and heartbeats follow it. Without it they come at the
/// pace of [`Reliability::heartbeat_first`](crate::stream::Reliability::heartbeat_first).
pub const RTT: bool = cfg!(feature = "rtt");
/// Requesters and repliers. Without it they are not created.
pub const SERVICES: bool = cfg!(feature = "services");
/// The agent can be asked for its time and about itself.
pub const QUERIES: bool = cfg!(feature = "queries");
