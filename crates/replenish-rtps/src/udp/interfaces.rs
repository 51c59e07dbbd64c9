//! [`Interfaces`]: the addresses of this host that a participant uses.

use crate::wire::Locators;
use core::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

/// Addresses of this host: at most four of IPv4 and four of IPv6, each with the index of its
/// interface. Further ones are left out.
///
/// Peers are told of these addresses, and what is sent to a multicast group goes out from each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Interfaces {
    v4: [Option<Ipv4Addr>; 4],
    v6: [Option<(Ipv6Addr, u32)>; 4],
}

impl Interfaces {
    /// The given addresses that are used: loopback only where there is no other of its version.
    #[must_use]
    pub fn of(v4: &[Ipv4Addr], v6: &[(Ipv6Addr, u32)]) -> Self {
        let mut used = Self::default();
        v4.iter().for_each(|ip| used.add((*ip).into(), 0));
        v6.iter()
            .for_each(|(ip, index)| used.add((*ip).into(), *index));
        used
    }

    /// Adds an address of the interface with this index, which is needed for IPv6, if it is used
    /// beside those that were added before, and instead of them if it is the first that is not of
    /// loopback.
    pub fn add(&mut self, ip: IpAddr, index: u32) {
        match ip {
            IpAddr::V4(ip) => put(&mut self.v4, ip, Ipv4Addr::is_loopback),
            IpAddr::V6(ip) => put(&mut self.v6, (ip, index), |(ip, _)| ip.is_loopback()),
        }
    }

    /// With at most so many of each version.
    #[must_use]
    pub fn first(mut self, most: usize) -> Self {
        self.v4
            .iter_mut()
            .skip(most)
            .for_each(|place| *place = None);
        self.v6
            .iter_mut()
            .skip(most)
            .for_each(|place| *place = None);
        self
    }

    /// The addresses of IPv4.
    pub fn v4(&self) -> impl Iterator<Item = Ipv4Addr> + '_ {
        self.v4.iter().filter_map(|ip| *ip)
    }

    /// The addresses of IPv6, each with the index of its interface.
    pub fn v6(&self) -> impl Iterator<Item = (Ipv6Addr, u32)> + '_ {
        self.v6.iter().filter_map(|ip| *ip)
    }

    /// Whether there is none but of loopback.
    #[must_use]
    pub fn is_local(&self) -> bool {
        let v4 = self.v4().all(|ip| ip.is_loopback());
        v4 && self.v6().all(|(ip, _)| ip.is_loopback())
    }

    /// Where a socket with this port is reached.
    #[must_use]
    pub fn at(&self, port: u16) -> Locators {
        let v4 = self.v4().map(IpAddr::V4);
        let all = v4.chain(self.v6().map(|(ip, _)| IpAddr::V6(ip)));
        all.map(|ip| SocketAddr::new(ip, port)).collect()
    }
}

fn put<A: Copy>(places: &mut [Option<A>; 4], new: A, is_local: impl Fn(&A) -> bool) {
    let local = places[0].as_ref().is_some_and(&is_local);
    if local && !is_local(&new) {
        places[0] = None;
    }
    if places[0].is_none() || !is_local(&new) {
        let free = places.iter_mut().find(|place| place.is_none());
        if let Some(place) = free {
            *place = Some(new);
        }
    }
}

#[test]
fn loopback_is_used_where_there_is_no_other() {
    let ip = |text: &str| -> IpAddr { text.parse().unwrap() };
    let used = |all: &[(&str, u32)]| {
        let mut used = Interfaces::default();
        all.iter()
            .for_each(|(text, index)| used.add(ip(text), *index));
        used
    };
    let told =
        |used: Interfaces| -> std::vec::Vec<_> { used.at(7).iter().map(|at| at.ip()).collect() };
    let lo = [("127.0.0.1", 1), ("127.0.0.2", 1)];
    assert_eq!(told(used(&lo)), [ip("127.0.0.1")]);
    assert!(used(&lo).is_local() && used(&[]).is_local());
    let both = used(&[
        ("127.0.0.1", 1),
        ("192.0.2.7", 2),
        ("::1", 1),
        ("192.0.2.8", 3),
    ]);
    assert_eq!(told(both), [ip("192.0.2.7"), ip("192.0.2.8"), ip("::1")]);
    assert_eq!(told(both.first(1)), [ip("192.0.2.7"), ip("::1")]);
    assert_eq!(
        told(used(&[("192.0.2.7", 2), ("127.0.0.1", 1)])),
        [ip("192.0.2.7")]
    );
    assert!(!both.is_local());
    let many = [
        ("192.0.2.1", 2),
        ("192.0.2.2", 2),
        ("192.0.2.3", 2),
        ("192.0.2.4", 2),
    ];
    let five = [&many[..], &[("192.0.2.5", 2)]].concat();
    assert_eq!(used(&five), used(&many));
}
