//! Samples on their way, and what paces and tracks them.

mod delivery_tracker;
mod identity;
mod rate_limiter;
mod sample;
mod weighted_round_robin;

pub(crate) use delivery_tracker::{ConfirmedStreams, DeliveryTracker, TrackerHandle};
pub(crate) use identity::{Guid, Identity};
pub(crate) use rate_limiter::RateLimiter;
pub(crate) use sample::{Charge, Ledger, Sample, SampleInfo};
pub(crate) use weighted_round_robin::WeightedRoundRobin;
