//! The figures of chains: plain numbers.

use crate::Nanos;
use crate::histogram::Histogram;
use alloc::string::String;
use alloc::vec::Vec;

/// Figures of one chain ([`Executor::chain`](crate::Executor::chain), `[[chain]]` of a deployment
/// file). Times in nanoseconds.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct ChainReport {
    /// Its name.
    pub name: String,
    /// Its stages, first to last: ids of handles, names of workers.
    pub stages: Vec<String>,
    /// The longest latency that is allowed.
    pub limit: Option<Nanos>,
    /// The latency that the analysis of the deployment file does not expect to be exceeded.
    pub bound: Option<Nanos>,
    /// Callbacks of the first stage.
    pub begun: u64,
    /// Callbacks of the last stage that an input of the first one has led to.
    pub ended: u64,
    /// Ended instances that took longer than the limit.
    pub exceeded: u64,
    /// Times from the origin of an instance to the end of its callback of the last stage.
    pub latency: Histogram,
    /// The instance that took longest.
    pub worst: Option<ChainInstance>,
}

/// One way through a chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct ChainInstance {
    /// Time at which it began (`CLOCK_MONOTONIC`): a timer's release, or the publication of a
    /// sample.
    pub origin: Nanos,
    /// Time from there to the end of the last stage's callback.
    pub latency: Nanos,
}
