//! Datagrams with the number of those that the kernel has dropped at the same socket, and the time
//! at which it took them; several of one length in one call; those of groups that it joined.
#![expect(unsafe_code, reason = "control messages of recvmsg(2), setsockopt(2)")]

use super::sys;
use crate::Nanos;
use std::io;
use std::mem::zeroed;
use std::os::fd::{AsFd, AsRawFd};

/// Makes the socket's datagrams say how many were dropped before them (`SO_RXQ_OVFL`).
///
/// # Errors
/// `ENOTSOCK`; see `setsockopt(2)`.
pub fn count_drops(socket: &impl AsFd) -> io::Result<()> {
    set(socket, (libc::SOL_SOCKET, libc::SO_RXQ_OVFL), 1)
}

/// Makes the socket's datagrams say when the kernel took them (`SO_TIMESTAMPNS`).
///
/// # Errors
/// `ENOTSOCK`; see `setsockopt(2)`.
pub fn stamp_arrivals(socket: &impl AsFd) -> io::Result<()> {
    set(socket, (libc::SOL_SOCKET, libc::SO_TIMESTAMPNS), 1)
}

/// Makes the kernel cut what is sent at the socket into datagrams of `size` bytes, the last of
/// which may be shorter (`UDP_SEGMENT`); 0: each call sends one datagram.
///
/// # Errors
/// `ENOPROTOOPT` before Linux 4.18; see `setsockopt(2)`.
pub fn cut_datagrams(socket: &impl AsFd, size: u16) -> io::Result<()> {
    set(socket, (libc::SOL_UDP, libc::UDP_SEGMENT), size.into())
}

/// Makes the socket take multicast of the interfaces alone on which it joined the group itself;
/// before, also where another socket of this host did (`IP_MULTICAST_ALL`, `IPV6_MULTICAST_ALL`).
///
/// # Errors
/// `ENOPROTOOPT` for IPv6 before Linux 4.20; see `setsockopt(2)`.
pub fn hear_joined_alone(socket: &impl AsFd) -> io::Result<()> {
    let v4 = set(socket, (libc::IPPROTO_IP, libc::IP_MULTICAST_ALL), 0);
    let v6 = set(socket, (libc::IPPROTO_IPV6, libc::IPV6_MULTICAST_ALL), 0);
    v6.or(v4) // each is an error of the other kind of socket
}

fn set(
    socket: &impl AsFd,
    (level, option): (libc::c_int, libc::c_int),
    value: libc::c_int,
) -> io::Result<()> {
    let len = libc::socklen_t::try_from(size_of::<libc::c_int>()).unwrap_or(0);
    let fd = socket.as_fd().as_raw_fd();
    // SAFETY: the value lives across the call and has that length.
    let rc = unsafe { libc::setsockopt(fd, level, option, (&raw const value).cast(), len) };
    sys::check(rc).map(drop)
}

/// A datagram that was received.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Counted {
    /// Its length in bytes.
    pub len: usize,
    /// Datagrams that the kernel had dropped at this socket in all when this one came; `None`
    /// before the first drop, and if drops are not [counted](count_drops).
    pub drops: Option<u32>,
    /// When the kernel took it, in ns of the wall clock; `None` if arrivals are not
    /// [stamped](stamp_arrivals).
    pub at: Option<Nanos>,
}

/// Takes the socket's next datagram without waiting. Bytes that do not fit into `into` are cut off.
///
/// # Errors
/// `EAGAIN` if there is none; see `recvmsg(2)`.
pub fn receive_counted(socket: &impl AsFd, into: &mut [u8]) -> io::Result<Counted> {
    let mut part = libc::iovec {
        iov_base: into.as_mut_ptr().cast(),
        iov_len: into.len(),
    };
    let mut control = [0_u64; 12]; // aligned as a control message is
    // SAFETY: a message header of zeros is an empty one.
    let mut header: libc::msghdr = unsafe { zeroed() };
    header.msg_iov = &raw mut part;
    header.msg_iovlen = 1;
    header.msg_control = control.as_mut_ptr().cast();
    // Each C library has another integer type here.
    header.msg_controllen = size_of_val(&control) as _;
    let flags = libc::MSG_DONTWAIT;
    let fd = socket.as_fd().as_raw_fd();
    // SAFETY: the header names one buffer and one control buffer, which live across the call.
    let len = sys::retry(|| sys::check(unsafe { libc::recvmsg(fd, &raw mut header, flags) }))?;
    let mut counted = Counted {
        len: usize::try_from(len).unwrap_or(0).min(into.len()),
        drops: None,
        at: None,
    };
    // SAFETY: the kernel has filled the header, whose control buffer still lives.
    let mut next = unsafe { libc::CMSG_FIRSTHDR(&raw const header) };
    // SAFETY: null, or a whole control message in that buffer.
    while let Some(message) = unsafe { next.as_ref() } {
        // SAFETY: the control message is whole.
        let content = unsafe { libc::CMSG_DATA(message) };
        match (message.cmsg_level, message.cmsg_type) {
            (libc::SOL_SOCKET, libc::SO_RXQ_OVFL) => {
                // SAFETY: this kind of control message has a number of four bytes.
                counted.drops = Some(unsafe { content.cast::<u32>().read_unaligned() });
            }
            (libc::SOL_SOCKET, libc::SCM_TIMESTAMPNS) => {
                // SAFETY: this kind of control message has a `timespec`.
                let at = unsafe { content.cast::<libc::timespec>().read_unaligned() };
                counted.at = sys::nanos(&at);
            }
            _ => {}
        }
        // SAFETY: the message is one of the header's.
        next = unsafe { libc::CMSG_NXTHDR(&raw const header, message) };
    }
    Ok(counted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::UdpSocket;

    #[test]
    fn a_full_socket_counts_what_it_drops() {
        let (a, b) = (
            UdpSocket::bind("127.0.0.1:0").unwrap(),
            UdpSocket::bind("127.0.0.1:0").unwrap(),
        );
        count_drops(&b).unwrap();
        rustix::net::sockopt::set_socket_recv_buffer_size(&b, 4096).unwrap();
        a.connect(b.local_addr().unwrap()).unwrap();
        let mut buf = [0; 1024];
        let none = receive_counted(&b, &mut buf).unwrap_err();
        assert_eq!(none.kind(), io::ErrorKind::WouldBlock);
        for _ in 0..200 {
            a.send(&[7; 512]).unwrap();
        }
        let mut kept = 0;
        let counted = |len, drops| Counted {
            len,
            drops,
            at: None,
        };
        while let Ok(datagram) = receive_counted(&b, &mut buf) {
            assert_eq!(
                datagram,
                counted(512, None),
                "no datagram came after the first drop"
            );
            kept += 1;
        }
        assert!((1..200).contains(&kept), "{kept} of 200 kept");
        a.send(&[8; 16]).unwrap();
        assert_eq!(
            receive_counted(&b, &mut buf).unwrap(),
            counted(16, Some(200 - kept))
        );
        assert_eq!(buf[..16], [8; 16]);
    }

    /// Datagrams to a group that another socket has joined, without this call and with it.
    #[test]
    fn a_socket_hears_no_group_of_another_socket() {
        let group = std::net::Ipv4Addr::new(239, 255, 0, 77);
        let local = std::net::Ipv4Addr::LOCALHOST;
        for (alone, joined, heard) in [
            (false, false, true),
            (true, false, false),
            (true, true, true),
        ] {
            let socket = UdpSocket::bind((group, 0)).unwrap();
            let other = UdpSocket::bind((local, 0)).unwrap();
            other.join_multicast_v4(&group, &local).unwrap();
            if alone {
                hear_joined_alone(&socket).unwrap();
            }
            if joined {
                socket.join_multicast_v4(&group, &local).unwrap();
            }
            let to = socket.local_addr().unwrap();
            other.send_to(&[7], to).unwrap();
            socket.set_nonblocking(true).unwrap();
            assert_eq!(socket.recv(&mut [0]).is_ok(), heard, "{alone} {joined}");
        }
    }

    #[test]
    fn the_kernel_cuts_datagrams_of_one_length() {
        let [a, b] = [(); 2].map(|()| UdpSocket::bind("127.0.0.1:0").unwrap());
        a.connect(b.local_addr().unwrap()).unwrap();
        let bytes: Vec<u8> = (0..250).collect();
        cut_datagrams(&a, 100).unwrap();
        a.send(&bytes).unwrap();
        cut_datagrams(&a, 0).unwrap();
        a.send(&bytes).unwrap();
        let mut buf = [0; 300];
        for expected in bytes.chunks(100).chain([&bytes[..]]) {
            let len = b.recv(&mut buf).unwrap();
            assert_eq!(&buf[..len], expected);
        }
    }

    /// The stamp is that of the arrival, however long the datagram waits, and the drops stay.
    #[test]
    fn a_datagram_bears_the_time_of_its_arrival() {
        let wall = || {
            let now = std::time::SystemTime::now();
            let since = now.duration_since(std::time::UNIX_EPOCH).unwrap();
            Nanos::try_from(since.as_nanos()).unwrap()
        };
        let (a, b) = (
            UdpSocket::bind("127.0.0.1:0").unwrap(),
            UdpSocket::bind("127.0.0.1:0").unwrap(),
        );
        stamp_arrivals(&b).unwrap();
        count_drops(&b).unwrap();
        rustix::net::sockopt::set_socket_recv_buffer_size(&b, 4096).unwrap();
        a.connect(b.local_addr().unwrap()).unwrap();
        let mut buf = [0; 1024];
        // The kernel stamps what came before it knows of the wish when it is read.
        std::thread::sleep(std::time::Duration::from_millis(50));
        for _ in 0..100 {
            a.send(&[7; 512]).unwrap();
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
        let later = wall();
        let first = receive_counted(&b, &mut buf).unwrap();
        assert!(first.at.unwrap() + 40_000_000 < later, "{first:?} {later}");
        while receive_counted(&b, &mut buf).is_ok() {}
        a.send(&[8; 16]).unwrap();
        let last = receive_counted(&b, &mut buf).unwrap();
        assert!(last.at > first.at && last.drops > Some(0), "{last:?}");
    }
}
