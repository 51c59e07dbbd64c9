//! [`Network`]: the addresses of this host, which come and go while a program runs.

use super::config::IpVersions;
use replenish_os::{AddressChanges, host_addresses};
use replenish_rtps::udp::Interfaces;
use std::io;
use std::net::{IpAddr, Ipv4Addr};

/// The addresses that are used, and word of their changes.
pub(super) struct Network {
    pub(super) changes: AddressChanges,
    ip: IpVersions,
}

impl Network {
    /// Follows addresses of these IP versions from now on.
    pub(super) fn new(ip: IpVersions) -> io::Result<Self> {
        let changes = AddressChanges::new()?;
        Ok(Self { changes, ip })
    }

    /// The addresses of the interfaces that are up, and of loopback where there is no other.
    pub(super) fn addresses(&self) -> io::Result<Interfaces> {
        let mut used = Interfaces::default();
        host_addresses(|ip, index| {
            if self.speaks(ip) {
                used.add(ip, index);
            }
        })?;
        if self.ip != IpVersions::V6 && used.v4().next().is_none() {
            used.add(Ipv4Addr::LOCALHOST.into(), 0);
        }
        // A peer reads four in all.
        let most = if self.ip == IpVersions::Both { 2 } else { 4 };
        Ok(used.first(most))
    }

    fn speaks(&self, ip: IpAddr) -> bool {
        match ip {
            IpAddr::V4(_) => self.ip != IpVersions::V6,
            IpAddr::V6(_) => self.ip != IpVersions::V4,
        }
    }
}
