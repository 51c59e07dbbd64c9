//! `READ_DATA`: how much of a reader's samples the client wants, how fast, and on which stream.

use crate::flow::RateLimiter;
use replenish_xrce::Nanos;
use replenish_xrce::wire::{BaseRequest, DeliveryControl, StreamId};

const MS: Nanos = 1_000_000;
const SECOND: Nanos = 1_000 * MS;

/// A client's `READ_DATA` that is being carried out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Delivery {
    /// Repeated in every DATA.
    pub(crate) base: BaseRequest,
    /// The stream on which the client wants the samples.
    pub(crate) stream: StreamId,
    /// Samples still to deliver; `None` for no end.
    left: Option<u16>,
    /// Time at which it ends.
    until: Option<Nanos>,
    rate_limiter: Option<RateLimiter>,
    /// Shortest time between two samples.
    gap: Nanos,
    /// Time at which the next sample may go because of `gap`.
    next_at: Nanos,
}

impl Delivery {
    /// The request as of `now`, or `None` if it asks for nothing (which cancels).
    pub(crate) fn new(
        base: BaseRequest,
        stream: StreamId,
        control: Option<DeliveryControl>,
        now: Nanos,
    ) -> Option<Self> {
        let control = control.unwrap_or(DeliveryControl {
            max_samples: 1,
            ..DeliveryControl::UNLIMITED
        });
        let left = match control.max_samples {
            0 => return None,
            DeliveryControl::UNLIMITED_SAMPLES => None,
            limit => Some(limit),
        };
        let elapsed = Nanos::from(control.max_elapsed_s) * SECOND;
        Some(Self {
            base,
            stream,
            left,
            until: (elapsed > 0).then(|| now.saturating_add(elapsed)),
            rate_limiter: RateLimiter::new(control.max_bytes_per_second.into()),
            gap: Nanos::from(control.min_pace_ms) * MS,
            next_at: 0,
        })
    }

    /// Whether nothing is to be delivered any more.
    pub(crate) fn is_over(&self, now: Nanos) -> bool {
        self.left == Some(0) || self.until.is_some_and(|until| until <= now)
    }

    /// Whether it is over because all samples that were asked for were delivered.
    pub(crate) fn is_used_up(&self) -> bool {
        self.left == Some(0)
    }

    /// Earliest time for a sample of `bytes` bytes.
    pub(crate) fn earliest(&self, bytes: usize) -> Nanos {
        let paced = self
            .rate_limiter
            .map_or(0, |limiter| limiter.earliest(bytes));
        paced.max(self.next_at)
    }

    /// A sample of `bytes` has gone.
    pub(crate) fn spend(&mut self, now: Nanos, bytes: usize) {
        self.left = self.left.map(|left| left.saturating_sub(1));
        self.next_at = now.saturating_add(self.gap);
        if let Some(limiter) = &mut self.rate_limiter {
            limiter.spend(now, bytes);
        }
    }
}
