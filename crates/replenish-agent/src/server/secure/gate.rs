//! How many handshakes there may be at the same time and a second, of all and of one host.

use crate::flow::Strangers;
use crate::report::Reason;
use replenish_xrce::Nanos;
use std::net::{IpAddr, SocketAddr};

/// Handshakes at the same time.
pub(super) const MOST: usize = 64;

/// Of these, of one host.
pub(super) const OF_A_HOST: usize = 16;

/// Handshakes a second; a quarter of it of one host, a sixteenth of one address.
const PER_SECOND: u32 = 256;

/// The time that a handshake may take.
pub(super) const DEADLINE: Nanos = 5_000_000_000;

/// Lets handshakes begin, or not.
#[derive(Debug)]
pub(super) struct Gate(Option<Strangers<SocketAddr>>);

impl Gate {
    pub(super) fn new() -> Self {
        Self(Strangers::new(PER_SECOND))
    }

    /// Whether a handshake with `addr` may begin, while those with `others` go on; or why not.
    pub(super) fn admit(
        &mut self,
        now: Nanos,
        addr: SocketAddr,
        others: impl Iterator<Item = IpAddr>,
    ) -> Result<(), Reason> {
        let (mut all, mut own) = (0, 0);
        for other in others {
            all += 1;
            own += usize::from(other == addr.ip());
        }
        if all >= MOST {
            return Err(Reason::Handshakes { limit: MOST });
        }
        if own >= OF_A_HOST {
            return Err(Reason::Handshakes { limit: OF_A_HOST });
        }
        let host = Some(addr.ip());
        let admitted = self
            .0
            .as_mut()
            .is_none_or(|rate| rate.admit(now, addr, host));
        let limit = PER_SECOND as usize;
        admitted.then_some(()).ok_or(Reason::Handshakes { limit })
    }
}
