//! Receiving from a socket, without what the C library does around it so that its threads can be
//! cancelled: a thread that a message wakes finds none of that in its caches.

use rustix::net::{RecvFlags, recv};
use std::io;
use std::os::fd::AsFd;

/// Takes the next datagram that a connected socket has; its length. Bytes that do not fit into
/// `into` are cut off. Waits if the socket is one that waits; signals end that.
///
/// # Errors
/// `EAGAIN` if there is none and the socket does not wait, `EINTR`, and what `recv(2)` says of
/// datagrams sent earlier, such as `ECONNREFUSED`.
#[inline]
pub fn receive(socket: &impl AsFd, into: &mut [u8]) -> io::Result<usize> {
    let (taken, _) = recv(socket, into, RecvFlags::empty())?;
    Ok(taken)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::UdpSocket;

    #[test]
    fn a_datagram_is_taken_whole_or_cut_off() {
        let (a, b) = (
            UdpSocket::bind("127.0.0.1:0").unwrap(),
            UdpSocket::bind("127.0.0.1:0").unwrap(),
        );
        a.connect(b.local_addr().unwrap()).unwrap();
        b.set_nonblocking(true).unwrap();
        let mut buf = [0; 4];
        let none = receive(&b, &mut buf).unwrap_err();
        assert_eq!(none.kind(), io::ErrorKind::WouldBlock);
        a.send(b"abc").unwrap();
        a.send(b"").unwrap();
        a.send(b"longer").unwrap();
        assert_eq!(receive(&b, &mut buf).unwrap(), 3);
        assert_eq!(&buf[..3], b"abc");
        assert_eq!(receive(&b, &mut buf).unwrap(), 0);
        assert_eq!(receive(&b, &mut buf).unwrap(), 4);
        assert_eq!(&buf, b"long");
        drop(b);
        a.send(b"x").unwrap();
        let refused = receive(&a, &mut buf).unwrap_err();
        assert_eq!(refused.raw_os_error(), Some(libc::ECONNREFUSED));
    }
}
