//! Datagrams with the number of those that the kernel has dropped at the same socket.
#![expect(unsafe_code, reason = "control messages of recvmsg(2)")]

use super::sys;
use std::io;
use std::mem::zeroed;
use std::os::fd::{AsFd, AsRawFd};

/// Makes the socket's datagrams say how many were dropped before them (`SO_RXQ_OVFL`).
///
/// # Errors
/// `ENOTSOCK`; see `setsockopt(2)`.
pub fn count_drops(socket: &impl AsFd) -> io::Result<()> {
    let on: libc::c_int = 1;
    let len = libc::socklen_t::try_from(size_of::<libc::c_int>()).unwrap_or(0);
    // SAFETY: the value lives across the call and has that length.
    let rc = unsafe {
        libc::setsockopt(
            socket.as_fd().as_raw_fd(),
            libc::SOL_SOCKET,
            libc::SO_RXQ_OVFL,
            (&raw const on).cast(),
            len,
        )
    };
    sys::check(rc).map(drop)
}

/// Takes the socket's next datagram without waiting: its length and the count of drops.
///
/// The count is that of the datagrams that the kernel had dropped at this socket in all when this
/// one came; `None` before the first drop. Bytes that do not fit into `into` are cut off.
///
/// # Errors
/// `EAGAIN` if there is none; see `recvmsg(2)`.
pub fn receive_counted(socket: &impl AsFd, into: &mut [u8]) -> io::Result<(usize, Option<u32>)> {
    let mut part = libc::iovec {
        iov_base: into.as_mut_ptr().cast(),
        iov_len: into.len(),
    };
    let mut control = [0_u64; 8]; // aligned as a control message is
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
    // SAFETY: the kernel has filled the header, whose control buffer still lives.
    let first = unsafe { libc::CMSG_FIRSTHDR(&raw const header) };
    // SAFETY: null, or a whole control message in that buffer.
    let drops = unsafe { first.as_ref() }.filter(|first| {
        (first.cmsg_level, first.cmsg_type) == (libc::SOL_SOCKET, libc::SO_RXQ_OVFL)
    });
    let drops = drops.map(|first| {
        // SAFETY: the control message is whole.
        let number = unsafe { libc::CMSG_DATA(first) };
        // SAFETY: this kind of control message has a number of four bytes.
        unsafe { number.cast::<u32>().read_unaligned() }
    });
    Ok((usize::try_from(len).unwrap_or(0).min(into.len()), drops))
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
        while let Ok((len, drops)) = receive_counted(&b, &mut buf) {
            assert_eq!(
                (len, drops),
                (512, None),
                "no datagram came after the first drop"
            );
            kept += 1;
        }
        assert!((1..200).contains(&kept), "{kept} of 200 kept");
        a.send(&[8; 16]).unwrap();
        assert_eq!(
            receive_counted(&b, &mut buf).unwrap(),
            (16, Some(200 - kept))
        );
        assert_eq!(buf[..16], [8; 16]);
    }
}
