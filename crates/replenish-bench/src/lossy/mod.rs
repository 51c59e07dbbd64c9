//! The reliable streams over a link that loses, duplicates, delays and reorders, in virtual time:
//! for tests, and for measuring what repair costs.
//!
//! ```text
//!   samples ─► OutputReliable ─► Link ─► InputReliable ─► checked: each once, in order, unharmed
//!                    ▲                        │
//!                    └──────── Link ◄─────────┘  acknowledgements are lost as well
//! ```
//!
//! The fate of the k-th datagram of a direction depends on the seed and k alone. So the same seed
//! gives the same run, and two ways of repair are compared over the same losses.

mod link;
mod transfer;

pub use link::{Direction, Fate, Link};
pub use transfer::{Load, Outcome, Repair, transfer};

use replenish_xrce::Nanos;

/// One measured point: a load over a link with one rate of loss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Datagrams lost on their way, in percent, in either direction.
    pub loss_percent: u8,
    /// Samples written.
    pub sent: u64,
    /// Samples that arrived unharmed and in their turn.
    pub delivered: u64,
    /// Samples that arrived again.
    pub duplicated: u64,
    /// Samples that did not arrive.
    pub lost: u64,
    /// Samples for each second of virtual time.
    pub messages_per_second: f64,
    /// Bytes of datagrams that were sent again.
    pub retransmitted_bytes: u64,
    /// Bytes that a sender would have sent again which is the same in all but that it answers a gap
    /// with everything that is not acknowledged (see [`Repair::GoBackN`]), over a link that treats
    /// its k-th datagram as it has treated ours.
    pub go_back_n_bytes: u64,
}

/// Default number of samples of [`point`] and the largest of them.
pub const SAMPLES: u32 = 100_000;

/// Sends `samples` samples of 16 to 300 bytes, every five-hundredth of 50 kB, over a link that
/// loses `loss_percent` (0 to 90) of the datagrams, duplicates 1 % and delays them for 1 to 5 ms.
#[must_use]
pub fn point(loss_percent: u8, samples: u32, seed: u64) -> Point {
    const MILLI: Nanos = 1_000_000;
    let link = Link {
        loss_percent: loss_percent.min(90),
        duplicate_percent: 1,
        delay_min: MILLI,
        delay_max: MILLI.saturating_mul(5),
    };
    let load = Load {
        samples,
        shortest: 16,
        usual: 300,
        large: 50_000,
        large_every: 500,
    };
    let ours = transfer(seed, link, load, Repair::Selective);
    let theirs = transfer(seed, link, load, Repair::GoBackN);
    Point {
        loss_percent: link.loss_percent,
        sent: ours.sent,
        delivered: ours.delivered,
        duplicated: ours.duplicated,
        lost: ours.lost,
        messages_per_second: ours.messages_per_second(),
        retransmitted_bytes: ours.stats.resent_bytes,
        go_back_n_bytes: theirs.stats.resent_bytes,
    }
}
