//! Connecting over TCP without waiting, and acknowledging at once.

use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketFlags, SocketType, connect, socket_with, sockopt};
use std::io;
use std::net::{SocketAddr, TcpStream};

/// Begins to connect a non-blocking socket to `addr`.
///
/// Small messages are sent at once (`TCP_NODELAY`). Reading and writing fail with `WouldBlock`
/// until the socket is connected, and with the reason if it cannot be.
///
/// # Errors
/// The errors of `socket(2)` and `connect(2)`, except `EINPROGRESS`: it is not connected yet.
pub fn connect_tcp(addr: SocketAddr) -> io::Result<TcpStream> {
    let family = match addr {
        SocketAddr::V4(_) => AddressFamily::INET,
        SocketAddr::V6(_) => AddressFamily::INET6,
    };
    let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
    let socket = socket_with(family, SocketType::STREAM, flags, None)?;
    match connect(&socket, &addr) {
        Ok(()) | Err(Errno::INPROGRESS) => {}
        Err(error) => return Err(error.into()),
    }
    let stream = TcpStream::from(socket);
    stream.set_nodelay(true)?;
    Ok(stream)
}

/// Acknowledges what has arrived on `stream` at once (`TCP_QUICKACK`).
///
/// The kernel holds an acknowledgement back for 40 ms and more, and a peer with Nagle's algorithm
/// sends nothing small until it has it: its messages come in bursts. The kernel goes back to its
/// own ways after a while: call this after each read. One system call, and a packet if one is due.
///
/// # Errors
/// The errors of `setsockopt(2)`.
pub fn acknowledge_at_once(stream: &TcpStream) -> io::Result<()> {
    Ok(sockopt::set_tcp_quickack(stream, true)?)
}

#[cfg(test)]
mod tests {
    use super::{acknowledge_at_once, connect_tcp};
    use std::io::{ErrorKind, Read, Write};
    use std::net::TcpListener;
    use std::time::{Duration, Instant};

    #[test]
    fn it_connects_or_tells_why_not_and_never_waits() {
        for address in ["127.0.0.1:0", "[::1]:0"] {
            let Ok(listener) = TcpListener::bind(address) else {
                continue; // a machine without IPv6
            };
            let mut here = connect_tcp(listener.local_addr().unwrap()).unwrap();
            let (mut there, _) = listener.accept().unwrap();
            let nothing = here.read(&mut [0; 8]).unwrap_err();
            assert_eq!(nothing.kind(), ErrorKind::WouldBlock);
            here.write_all(b"hello").unwrap();
            let mut heard = [0; 5];
            there.read_exact(&mut heard).unwrap();
            assert_eq!(&heard, b"hello");
            acknowledge_at_once(&there).unwrap();
        }
        let nobody = TcpListener::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap();
        let refused = connect_tcp(nobody).and_then(|mut socket| {
            let end = Instant::now() + Duration::from_secs(5);
            loop {
                match socket.write(b"x") {
                    Err(e) if e.kind() == ErrorKind::WouldBlock && Instant::now() < end => {}
                    other => return other,
                }
            }
        });
        assert!(refused.is_err(), "{refused:?}");
    }
}
