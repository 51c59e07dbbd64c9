//! Limits of handshakes at the same time and per second, in all and per host.

use crate::flow::Strangers;
use crate::report::Reason;
use replenish_xrce::Nanos;
use std::net::{IpAddr, SocketAddr};

/// Handshakes at the same time.
pub(super) const MOST: usize = 64;

/// The most handshakes at the same time of one host.
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

#[cfg(test)]
mod tests {
    use super::*;

    fn addr(host: u16, port: u16) -> SocketAddr {
        ([127, 1, (host >> 8) as u8, host as u8], port).into()
    }

    #[test]
    fn handshakes_are_bounded_at_a_time_and_of_a_host() {
        let mut gate = Gate::new();
        let others = |hosts: u16, of_each: usize| {
            let hosts = (1..=hosts).map(|host| addr(host, 1).ip());
            hosts.flat_map(move |host| std::iter::repeat_n(host, of_each))
        };
        let new = addr(1, 9);
        let limit = OF_A_HOST;
        let refused = gate.admit(0, new, others(1, OF_A_HOST));
        assert_eq!(refused, Err(Reason::Handshakes { limit }));
        assert_eq!(gate.admit(0, new, others(1, OF_A_HOST - 1)), Ok(()));
        let limit = MOST;
        let refused = gate.admit(0, addr(99, 9), others(4, OF_A_HOST));
        assert_eq!(refused, Err(Reason::Handshakes { limit }));
    }

    #[test]
    fn handshakes_are_bounded_in_a_second() {
        let mut gate = Gate::new();
        let mut admitted = |hosts: std::ops::Range<u16>, ports: u16| {
            let all = hosts.flat_map(|host| (0..ports).map(move |port| addr(host, port)));
            let admitted = all.filter(|new| gate.admit(0, *new, std::iter::empty()).is_ok());
            admitted.count()
        };
        assert_eq!(admitted(1..2, 200), 64, "of one host");
        assert_eq!(admitted(2..500, 1), 256 - 64, "of all");
    }
}
