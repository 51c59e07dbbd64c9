//! The host's addresses of IPv4 and IPv6, and word of their changes (`rtnetlink(7)`).

use rustix::io::Errno;
use rustix::net::netlink::SocketAddrNetlink;
use rustix::net::{AddressFamily, RecvFlags, SendFlags, SocketFlags, SocketType};
use rustix::net::{bind, recv, sendto, socket_with};
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};

/// Bytes of the longest answer of the kernel (`NLMSG_GOODSIZE`).
const ANSWER: usize = 8192;
/// Interfaces of a host that are looked at; further ones count as down.
const MOST_INTERFACES: usize = 256;
/// Bytes before a message's body: its length, type, flags, number and sender.
const HEAD: usize = 16;
/// Messages of changes that one [`AddressChanges::take`] takes at most.
const BATCH: usize = 64;

/// Shows each address of the interfaces that are up, with the index of its interface, in the
/// kernel's order: loopback's too, without those of link scope. No allocation.
///
/// # Errors
/// The errors of `socket(2)`, `sendto(2)` and `recv(2)` on a socket of `rtnetlink(7)`.
pub fn host_addresses(mut each: impl FnMut(IpAddr, u32)) -> io::Result<()> {
    let socket = open()?;
    let mut up = [0; MOST_INTERFACES];
    let mut places = up.iter_mut();
    ask(&socket, libc::RTM_GETLINK, |body| {
        let is_up = word(body, 8).is_some_and(|flags| flags & libc::IFF_UP.cast_unsigned() != 0);
        if let (true, Some(index)) = (is_up, word(body, 4))
            && let Some(place) = places.next()
        {
            *place = index;
        }
    })?;
    ask(&socket, libc::RTM_GETADDR, |body| {
        let index = word(body, 4).filter(|index| up.contains(index));
        if let (Some(index), Some(ip)) = (index, address(body)) {
            each(ip, index);
        }
    })
}

/// Tells of changes of the host's interfaces and addresses. Any thread may call any method.
#[derive(Debug)]
pub struct AddressChanges(OwnedFd);

impl AddressChanges {
    /// Of changes from now on; closed on `exec`.
    ///
    /// # Errors
    /// `EAFNOSUPPORT` where sockets of `rtnetlink(7)` are not allowed, `EMFILE`, `ENFILE`,
    /// `ENOMEM`.
    pub fn new() -> io::Result<Self> {
        let groups = libc::RTMGRP_LINK | libc::RTMGRP_IPV4_IFADDR | libc::RTMGRP_IPV6_IFADDR;
        let socket = open()?;
        bind(&socket, &SocketAddrNetlink::new(0, groups.cast_unsigned()))?;
        Ok(Self(socket))
    }

    /// Takes what has come, at most 64 messages; whether there was any. Does not wait.
    #[must_use]
    pub fn take(&self) -> bool {
        let mut room = [0; HEAD];
        let mut next = || recv(&self.0, &mut room, RecvFlags::DONTWAIT | RecvFlags::TRUNC);
        // Too many at once are an error and a change.
        (0..BATCH)
            .take_while(|_| next() != Err(Errno::AGAIN))
            .count()
            > 0
    }
}

impl AsFd for AddressChanges {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

fn open() -> io::Result<OwnedFd> {
    let (family, kind) = (AddressFamily::NETLINK, SocketType::RAW);
    // Protocol 0 is that of routes and addresses (`NETLINK_ROUTE`).
    Ok(socket_with(family, kind, SocketFlags::CLOEXEC, None)?)
}

/// Asks for everything of one kind, and shows the body of each message of the answer.
fn ask(socket: &OwnedFd, kind: u16, mut each: impl FnMut(&[u8])) -> io::Result<()> {
    const LEN: u32 = 20;
    let flags = u16::try_from(libc::NLM_F_REQUEST | libc::NLM_F_DUMP).unwrap_or(0);
    let mut request = [0; LEN as usize];
    request[..4].copy_from_slice(&LEN.to_ne_bytes());
    request[4..6].copy_from_slice(&kind.to_ne_bytes());
    request[6..8].copy_from_slice(&flags.to_ne_bytes());
    sendto(
        socket,
        &request,
        SendFlags::empty(),
        &SocketAddrNetlink::new(0, 0),
    )?;
    let mut room = [0; ANSWER];
    loop {
        // The kernel has answered when the call before returns: nothing is waited for.
        let (_, len) = recv(socket, &mut room, RecvFlags::DONTWAIT | RecvFlags::TRUNC)?;
        let mut rest = room.get(..len).ok_or(Errno::MSGSIZE)?;
        while let Some((kind, body, next)) = message(rest) {
            match kind {
                libc::NLMSG_DONE => return Ok(()),
                libc::NLMSG_ERROR => {
                    let errno = word(body, 0).unwrap_or(0).cast_signed();
                    return Err(io::Error::from_raw_os_error(errno.saturating_neg()));
                }
                _ => each(body),
            }
            rest = next;
        }
    }
}

/// The type and the body of the first message, and the messages behind it.
fn message(all: &[u8]) -> Option<(libc::c_int, &[u8], &[u8])> {
    let len = usize::try_from(word(all, 0)?).ok()?;
    let body = all.get(HEAD..len)?;
    let next = all.get(len.next_multiple_of(4)..).unwrap_or_default();
    Some((half(all, 4)?.into(), body, next))
}

/// The address in the body of a `RTM_NEWADDR`: the interface's own, where it has a peer's as well.
fn address(body: &[u8]) -> Option<IpAddr> {
    let (mut found, mut rest) = (None, body.get(8..)?);
    while let Some(len) = half(rest, 0).map(usize::from) {
        let kind = half(rest, 2)?;
        let value = rest.get(4..len)?;
        if kind == libc::IFA_LOCAL || (kind == libc::IFA_ADDRESS && found.is_none()) {
            found = Some(value);
        }
        rest = rest.get(len.next_multiple_of(4)..).unwrap_or_default();
    }
    let value = found?;
    if let Ok(v4) = <[u8; 4]>::try_from(value) {
        return Some(Ipv4Addr::from(v4).into());
    }
    let v6 = Ipv6Addr::from(<[u8; 16]>::try_from(value).ok()?);
    (!v6.is_unicast_link_local()).then_some(v6.into())
}

fn word(bytes: &[u8], at: usize) -> Option<u32> {
    let bytes = bytes.get(at..)?.first_chunk()?;
    Some(u32::from_ne_bytes(*bytes))
}

fn half(bytes: &[u8], at: usize) -> Option<u16> {
    let bytes = bytes.get(at..)?.first_chunk()?;
    Some(u16::from_ne_bytes(*bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loopback_is_among_them() {
        let mut all = Vec::new();
        host_addresses(|ip, index| all.push((ip, index))).unwrap();
        let found = all.iter().find(|(ip, _)| *ip == Ipv4Addr::LOCALHOST);
        assert!(found.is_some_and(|(_, index)| *index > 0), "{all:?}");
    }

    #[test]
    fn what_is_cut_off_or_too_long_is_no_message() {
        let whole = [20, 0, 0, 0, 3, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 7, 0, 0, 0];
        let (kind, body, rest) = message(&whole).unwrap();
        assert_eq!((kind, body, rest), (3, &[7, 0, 0, 0][..], &[][..]));
        for len in 0..whole.len() {
            assert_eq!(message(&whole[..len]), None, "{len}");
        }
        let no_length = [0; 32];
        assert_eq!(message(&no_length), None);
        // An attribute without a length, and one that is longer than its message.
        for attribute in [[0, 0, 1, 0], [9, 0, 1, 0]] {
            let body = [[2, 8, 0, 0], [1, 0, 0, 0], attribute].concat();
            assert_eq!(address(&body), None);
        }
    }
}
