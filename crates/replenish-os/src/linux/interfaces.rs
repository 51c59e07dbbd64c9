//! The host's addresses of IPv4.
#![expect(unsafe_code, reason = "getifaddrs(3) gives a linked list")]

use super::sys;
use std::io;
use std::net::Ipv4Addr;
use std::ptr;

/// The IPv4 addresses of the interfaces that are up, in the kernel's order; loopback ones too.
///
/// # Errors
/// The errors of `getifaddrs(3)`.
pub fn ipv4_addresses() -> io::Result<Vec<Ipv4Addr>> {
    let mut list = ptr::null_mut::<libc::ifaddrs>();
    // SAFETY: the function puts a list there, which is freed below.
    sys::check(unsafe { libc::getifaddrs(&raw mut list) })?;
    let mut addresses = Vec::new();
    let mut next = list;
    // SAFETY: null, or an element of the list, which lives until it is freed.
    while let Some(element) = unsafe { next.as_ref() } {
        next = element.ifa_next;
        let up = element.ifa_flags & libc::IFF_UP.cast_unsigned() != 0;
        // SAFETY: null, or a socket address of the list.
        let family = unsafe { element.ifa_addr.as_ref() }.map(|address| address.sa_family);
        if up && family.map(i32::from) == Some(libc::AF_INET) {
            // SAFETY: an address of this family has this layout.
            let address = unsafe {
                element
                    .ifa_addr
                    .cast::<libc::sockaddr_in>()
                    .read_unaligned()
            };
            addresses.push(Ipv4Addr::from(u32::from_be(address.sin_addr.s_addr)));
        }
    }
    // SAFETY: the list came from `getifaddrs`, and nothing refers to it any more.
    unsafe { libc::freeifaddrs(list) };
    Ok(addresses)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loopback_is_among_them() {
        assert!(ipv4_addresses().unwrap().contains(&Ipv4Addr::LOCALHOST));
    }
}
