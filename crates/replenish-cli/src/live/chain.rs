//! A chain of a recording, as the documents of `top` and `trace` show it.

use crate::time::Nanos;
use replenish_recorder::{ChainView, bucket_end};

/// One chain, since the start of its program. The names are a contract: those that `report` has,
/// too, have the same meaning.
#[derive(Debug, serde::Serialize)]
pub(crate) struct ChainJson {
    pub(crate) name: String,
    pub(crate) limit_ns: Option<Nanos>,
    /// The analysed bound.
    pub(crate) bound_ns: Option<Nanos>,
    pub(crate) begun: u64,
    pub(crate) ended: u64,
    /// Ended instances that took longer than the limit.
    pub(crate) exceeded: u64,
    pub(crate) latency_ns: Latency,
    /// The instance that took longest.
    pub(crate) worst: Option<Worst>,
    /// Ended instances by latency.
    histogram: Vec<Bucket>,
}

/// From the origin to the end of the last stage; 0 before the first.
#[derive(Debug, serde::Serialize)]
pub(crate) struct Latency {
    count: u64,
    p50: Nanos,
    p90: Nanos,
    pub(crate) p99: Nanos,
}

/// A bucket that is not empty.
#[derive(Debug, serde::Serialize)]
struct Bucket {
    /// The largest latency that belongs to it; `null` without an end.
    up_to_ns: Option<Nanos>,
    count: u64,
}

#[derive(Debug, serde::Serialize)]
pub(crate) struct Worst {
    /// `CLOCK_MONOTONIC`.
    origin_ns: Nanos,
    pub(crate) latency_ns: Nanos,
}

impl ChainJson {
    pub(crate) fn of(chain: &ChainView) -> Self {
        let buckets = chain.histogram.iter().enumerate();
        let buckets = buckets.filter(|(_, count)| **count > 0);
        let histogram = buckets.map(|(n, count)| Bucket {
            up_to_ns: Some(bucket_end(n)).filter(|end| *end < Nanos::MAX),
            count: *count,
        });
        let counts = chain.histogram.iter();
        Self {
            name: chain.name.clone(),
            limit_ns: chain.limit,
            bound_ns: chain.bound,
            begun: chain.begun,
            ended: chain.ended,
            exceeded: chain.exceeded,
            latency_ns: Latency {
                count: counts.fold(0, |sum, n| sum.saturating_add(*n)),
                p50: chain.percentile(50),
                p90: chain.percentile(90),
                p99: chain.percentile(99),
            },
            worst: chain.worst.map(|(origin_ns, latency_ns)| Worst {
                origin_ns,
                latency_ns,
            }),
            histogram: histogram.collect(),
        }
    }
}
