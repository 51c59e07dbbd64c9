//! Addresses (RTPS 2.5, 9.3.2.4), and short lists of them.

use super::{Reader, WireError, Writer};
use core::cmp::Reverse;
use core::fmt;
use core::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

/// Address at which an endpoint can be reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Locator {
    /// 1 is UDP over IPv4, 2 over IPv6; others are a vendor's (Fast DDS: 16 is shared memory).
    pub kind: i32,
    /// The UDP port.
    pub port: u32,
    /// IPv6, or 12 zeros and IPv4.
    pub address: [u8; 16],
}

impl Locator {
    /// The UDP address, if it is one and has a port.
    #[must_use]
    pub fn socket_addr(&self) -> Option<SocketAddr> {
        let port = u16::try_from(self.port).ok().filter(|port| *port != 0)?;
        let ip = match self.kind {
            1 => {
                let [.., a, b, c, d] = self.address;
                IpAddr::V4(Ipv4Addr::new(a, b, c, d))
            }
            2 => IpAddr::V6(Ipv6Addr::from(self.address)),
            _ => return None,
        };
        Some(SocketAddr::new(ip, port))
    }

    pub(super) fn decode(r: &mut Reader<'_>) -> Result<Self, WireError> {
        Ok(Locator {
            kind: r.i32()?,
            port: r.u32()?,
            address: r.array()?,
        })
    }

    pub(super) fn encode(&self, w: &mut Writer<'_>) {
        w.i32(self.kind);
        w.u32(self.port);
        w.put(&self.address);
    }
}

impl From<SocketAddr> for Locator {
    fn from(addr: SocketAddr) -> Self {
        let (kind, address) = match addr.ip() {
            IpAddr::V4(ip) => {
                let [a, b, c, d] = ip.octets();
                (1, [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, a, b, c, d])
            }
            IpAddr::V6(ip) => (2, ip.octets()),
        };
        Locator {
            kind,
            port: u32::from(addr.port()),
            address,
        }
    }
}

/// The addresses that can be sent to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Reach {
    /// Addresses of this host alone.
    pub local: bool,
    /// Addresses of IPv4.
    pub v4: bool,
    /// Addresses of IPv6.
    pub v6: bool,
}

impl Reach {
    /// A participant that is reached by one version of IP sends by it.
    pub(crate) fn of(own: &Locators) -> Self {
        let mut v4 = own.iter().filter(SocketAddr::is_ipv4);
        let mut v6 = own.iter().filter(SocketAddr::is_ipv6);
        Reach {
            local: own.iter().all(|addr| addr.ip().is_loopback()),
            v4: v4.next().is_some() || own.is_empty(),
            v6: v6.next().is_some() || own.is_empty(),
        }
    }

    fn has(self, addr: SocketAddr) -> bool {
        match addr {
            SocketAddr::V4(_) => self.v4,
            // One of link scope is none without its interface.
            SocketAddr::V6(addr) => self.v6 && !addr.ip().is_unicast_link_local(),
        }
    }
}

/// At most four UDP addresses. Locators of other kinds, and those beyond four, are left out.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub struct Locators {
    list: [Option<SocketAddr>; Self::MOST],
}

impl Locators {
    /// The most addresses.
    pub const MOST: usize = 4;

    /// No address.
    pub const NONE: Locators = Locators {
        list: [None; Self::MOST],
    };

    /// Adds an address; `false` if the list is full.
    pub fn add(&mut self, addr: SocketAddr) -> bool {
        if self.iter().any(|known| known == addr) {
            return true;
        }
        let Some(place) = self.list.iter_mut().find(|place| place.is_none()) else {
            return false;
        };
        *place = Some(addr);
        true
    }

    /// The addresses, in the order they came.
    pub fn iter(&self) -> impl Iterator<Item = SocketAddr> + '_ {
        self.list.iter().filter_map(|addr| *addr)
    }

    /// Whether there is no address.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.list.iter().all(Option::is_none)
    }

    /// The address to send to: a loopback one if `reach` is local, one that is not loopback
    /// otherwise, and without that any within reach. Of several one of IPv4, as ROS 2 speaks it;
    /// then the one that has most leading bits in common with an address in `own`, the sender's:
    /// the other end of a network that both are in. Then the first one.
    ///
    /// Two hosts may have an address in common, that of a bridge to their containers: it is used
    /// only where all addresses are the sender's, on its own host.
    #[must_use]
    #[inline(never)] // five callers, and flash is short on a board
    pub fn best(&self, reach: Reach, own: &Locators) -> Option<SocketAddr> {
        let known = || self.iter().filter(|addr| reach.has(*addr));
        let is_own = |addr: SocketAddr| own.iter().any(|own| own.ip() == addr.ip());
        let is_elsewhere = known().any(|addr| !addr.ip().is_loopback() && !is_own(addr));
        known().min_by_key(|addr| {
            let strange = addr.ip().is_loopback() != reach.local;
            let bridge = is_elsewhere && is_own(*addr);
            let common = own.iter().map(|own| common_bits(own.ip(), addr.ip())).max();
            (strange, bridge, addr.is_ipv6(), Reverse(common))
        })
    }
}

/// Leading bits that two addresses of one version have in common.
fn common_bits(one: IpAddr, other: IpAddr) -> u32 {
    let octets = |ip| match ip {
        IpAddr::V4(ip) => ip.to_ipv6_mapped().octets(),
        IpAddr::V6(ip) => ip.octets(),
    };
    let mut common = 0_u32;
    for (one, other) in octets(one).into_iter().zip(octets(other)) {
        common = common.saturating_add((one ^ other).leading_zeros());
        if one != other {
            break;
        }
    }
    common
}

impl FromIterator<SocketAddr> for Locators {
    fn from_iter<I: IntoIterator<Item = SocketAddr>>(addresses: I) -> Self {
        let mut list = Locators::NONE;
        for addr in addresses {
            if !list.add(addr) {
                break;
            }
        }
        list
    }
}

impl fmt::Debug for Locators {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_list().entries(self.iter()).finish()
    }
}
