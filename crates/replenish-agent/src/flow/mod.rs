//! Samples on their way, and the machines that pace and track them.
//!
//! ```text
//!   sample                a payload with its metadata, charged to a ledger of bytes
//!   identity              the identity of a request, for its reply
//!   delivery_tracker      the confirmation of a message that has reached all its readers
//!   rate_limiter          a token bucket
//!   shrink                queues and tables that give memory back
//!   strangers             token buckets for all without a session, and for each address of theirs
//!   weighted_round_robin  the order of the readers on a stream
//! ```

mod delivery_tracker;
mod identity;
mod rate_limiter;
mod sample;
pub(crate) mod shrink;
mod strangers;
mod weighted_round_robin;

pub(crate) use delivery_tracker::{
    ConfirmedStreams, DeliveryTracker, TRACKER_BYTES, TrackerHandle,
};
pub(crate) use identity::{Guid, Identity};
pub(crate) use rate_limiter::RateLimiter;
pub(crate) use sample::{Charge, Ledger, Sample, SampleInfo};
pub(crate) use strangers::Strangers;
pub(crate) use weighted_round_robin::WeightedRoundRobin;
