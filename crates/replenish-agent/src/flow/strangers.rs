//! Rates of datagrams from outside of sessions: for all together, and at most a part of that for
//! one host and for one address, so that none of them can use up the others' share.

use super::rate_limiter::RateLimiter;
use replenish_xrce::Nanos;
use std::collections::HashMap;
use std::hash::Hash;
use std::net::IpAddr;

/// The part of the rate that one host may use, and that one of its addresses may.
const HOST_PART: u32 = 4;
const ADDRESS_PART: u32 = 16;

/// The most hosts, and the most addresses, with a rate of their own; further ones share one rate.
const MOST: usize = 1024;

/// The rates of all senders without a session.
#[derive(Debug)]
pub(crate) struct Strangers<P> {
    all: RateLimiter,
    hosts: Shares<Option<IpAddr>>,
    addresses: Shares<P>,
}

impl<P: Copy + Eq + Hash> Strangers<P> {
    /// `rate` datagrams per second, or `None` for 0, which means no limit.
    pub(crate) fn new(rate: u32) -> Option<Self> {
        Some(Self {
            all: RateLimiter::new(rate)?,
            hosts: Shares::new(rate.div_ceil(HOST_PART))?,
            addresses: Shares::new(rate.div_ceil(ADDRESS_PART))?,
        })
    }

    /// Whether a datagram from `peer` at `host` is taken.
    pub(crate) fn admit(&mut self, now: Nanos, peer: P, host: Option<IpAddr>) -> bool {
        self.addresses.admit(now, peer) && self.hosts.admit(now, host) && self.all.admit(now, 1)
    }
}

/// A rate for each of many.
#[derive(Debug)]
struct Shares<K> {
    fresh: RateLimiter,
    each: HashMap<K, RateLimiter>,
    others: RateLimiter,
}

impl<K: Eq + Hash> Shares<K> {
    fn new(rate: u32) -> Option<Self> {
        let fresh = RateLimiter::new(rate)?;
        Some(Self {
            fresh,
            each: HashMap::new(),
            others: fresh,
        })
    }

    fn admit(&mut self, now: Nanos, who: K) -> bool {
        if let Some(limiter) = self.each.get_mut(&who) {
            return limiter.admit(now, 1);
        }
        if self.each.len() >= MOST {
            self.each.retain(|_, limiter| !limiter.is_full(now));
        }
        if self.each.len() >= MOST {
            return self.others.admit(now, 1);
        }
        let mut limiter = self.fresh;
        let admitted = limiter.admit(now, 1);
        self.each.insert(who, limiter);
        admitted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Nanos = 1_000_000;

    fn host(last: u8) -> Option<IpAddr> {
        Some([10, 0, 0, last].into())
    }

    #[test]
    fn none_uses_up_the_share_of_another() {
        let mut strangers = Strangers::new(1000).unwrap();
        let mut taken = [0; 4];
        for ms in 0..10_000 {
            let now = ms * MS;
            for _ in 0..20 {
                // A flood from one address, and one from all the ports of another host.
                taken[0] += u32::from(strangers.admit(now, (1, 0), host(1)));
                taken[1] += u32::from(strangers.admit(now, (2, ms), host(2)));
            }
            if ms % 100 == 0 {
                taken[2] += u32::from(strangers.admit(now, (3, 0), host(3)));
                taken[3] += u32::from(strangers.admit(now, (1, 1), host(1)));
            }
        }
        let [one, many, other, same_host] = taken;
        assert!((600..=700).contains(&one), "{one}");
        assert!((2400..=2800).contains(&many), "{many}");
        assert_eq!((other, same_host), (100, 100));
    }

    #[test]
    fn what_is_told_apart_is_bounded() {
        let mut strangers = Strangers::new(1000).unwrap();
        for port in 0..100_000_u32 {
            strangers.admit(u64::from(port) * MS, port, host(port as u8));
            assert!(strangers.addresses.each.len() <= MOST);
        }
    }
}
