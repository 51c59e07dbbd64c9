//! Samples on their way, and what paces and tracks them.

mod delivery_tracker;
mod identity;
mod rate_limiter;
mod sample;
mod weighted_round_robin;

pub(crate) use delivery_tracker::{Receipt, Settled, Token};
pub(crate) use identity::{Guid, Identity};
pub(crate) use rate_limiter::Pace;
pub(crate) use sample::{About, Charge, Ledger, Sample};
pub(crate) use weighted_round_robin::Turns;
