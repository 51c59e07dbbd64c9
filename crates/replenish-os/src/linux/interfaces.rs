//! The host's addresses of IPv4 and IPv6.
#![expect(unsafe_code, reason = "getifaddrs(3) gives a linked list")]

use super::sys;
use std::io;
use std::net::{Ipv4Addr, Ipv6Addr};
use std::ptr;

/// The IPv4 addresses of the interfaces that are up, in the kernel's order; loopback ones too.
///
/// # Errors
/// The errors of `getifaddrs(3)`.
pub fn ipv4_addresses() -> io::Result<Vec<Ipv4Addr>> {
    let mut addresses = Vec::new();
    each_address(|element, family| {
        if family == libc::AF_INET {
            // SAFETY: an address of this family has this layout.
            let address = unsafe {
                element
                    .ifa_addr
                    .cast::<libc::sockaddr_in>()
                    .read_unaligned()
            };
            addresses.push(Ipv4Addr::from(u32::from_be(address.sin_addr.s_addr)));
        }
    })?;
    Ok(addresses)
}

/// The IPv6 addresses of the interfaces that are up, each with the index of its interface, in the
/// kernel's order; loopback ones too, without those of link scope.
///
/// # Errors
/// The errors of `getifaddrs(3)`.
pub fn ipv6_addresses() -> io::Result<Vec<(Ipv6Addr, u32)>> {
    let mut addresses = Vec::new();
    each_address(|element, family| {
        if family == libc::AF_INET6 {
            // SAFETY: an address of this family has this layout.
            let address = unsafe {
                element
                    .ifa_addr
                    .cast::<libc::sockaddr_in6>()
                    .read_unaligned()
            };
            // SAFETY: the name is a string of the list.
            let index = unsafe { libc::if_nametoindex(element.ifa_name) };
            let ip = Ipv6Addr::from(address.sin6_addr.s6_addr);
            if !ip.is_unicast_link_local() {
                addresses.push((ip, index));
            }
        }
    })?;
    Ok(addresses)
}

/// Shows each address of an interface that is up, with its family.
fn each_address(mut each: impl FnMut(&libc::ifaddrs, i32)) -> io::Result<()> {
    let mut list = ptr::null_mut::<libc::ifaddrs>();
    // SAFETY: the function puts a list there, which is freed below.
    sys::check(unsafe { libc::getifaddrs(&raw mut list) })?;
    let mut next = list;
    // SAFETY: null, or an element of the list, which lives until it is freed.
    while let Some(element) = unsafe { next.as_ref() } {
        next = element.ifa_next;
        let up = element.ifa_flags & libc::IFF_UP.cast_unsigned() != 0;
        // SAFETY: null, or a socket address of the list.
        let family = unsafe { element.ifa_addr.as_ref() }.map(|address| address.sa_family);
        if let Some(family) = family.filter(|_| up) {
            each(element, i32::from(family));
        }
    }
    // SAFETY: the list came from `getifaddrs`, and nothing refers to it any more.
    unsafe { libc::freeifaddrs(list) };
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loopback_is_among_them() {
        assert!(ipv4_addresses().unwrap().contains(&Ipv4Addr::LOCALHOST));
    }
}
