//! Connecting over TCP without waiting.
#![expect(unsafe_code, reason = "socket, connect")]

use super::sys;
use std::io;
use std::net::{SocketAddr, TcpStream};
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};

/// Begins to connect a non-blocking socket to `addr`.
///
/// Small messages are sent at once (`TCP_NODELAY`). Reading and writing fail with `WouldBlock`
/// until the socket is connected, and with the reason if it cannot be.
///
/// # Errors
/// What `socket(2)` and `connect(2)` say, except that it is not connected yet.
pub fn connect_tcp(addr: SocketAddr) -> io::Result<TcpStream> {
    let family = match addr {
        SocketAddr::V4(_) => libc::AF_INET,
        SocketAddr::V6(_) => libc::AF_INET6,
    };
    let kind = libc::SOCK_STREAM | libc::SOCK_NONBLOCK | libc::SOCK_CLOEXEC;
    // SAFETY: no memory is passed.
    let fd = sys::check(unsafe { libc::socket(family, kind, 0) })?;
    // SAFETY: the descriptor is new, open and owned by nobody else.
    let socket = unsafe { OwnedFd::from_raw_fd(fd) };
    let connected = match addr {
        SocketAddr::V4(addr) => {
            let address = libc::sockaddr_in {
                sin_family: libc::AF_INET as libc::sa_family_t,
                sin_port: addr.port().to_be(),
                sin_addr: libc::in_addr {
                    s_addr: u32::from_ne_bytes(addr.ip().octets()),
                },
                sin_zero: [0; 8],
            };
            connect(&socket, &address)
        }
        SocketAddr::V6(addr) => {
            let address = libc::sockaddr_in6 {
                sin6_family: libc::AF_INET6 as libc::sa_family_t,
                sin6_port: addr.port().to_be(),
                sin6_flowinfo: addr.flowinfo(),
                sin6_addr: libc::in6_addr {
                    s6_addr: addr.ip().octets(),
                },
                sin6_scope_id: addr.scope_id(),
            };
            connect(&socket, &address)
        }
    };
    match connected {
        Err(error) if error.raw_os_error() != Some(libc::EINPROGRESS) => return Err(error),
        _ => {}
    }
    let stream = TcpStream::from(socket);
    stream.set_nodelay(true)?;
    Ok(stream)
}

/// `T` is the address structure of the socket's family.
fn connect<T>(socket: &OwnedFd, address: &T) -> io::Result<()> {
    let len = libc::socklen_t::try_from(size_of::<T>()).map_err(io::Error::other)?;
    let address = std::ptr::from_ref(address).cast();
    // SAFETY: an address structure of that length that lives across the call.
    sys::check(unsafe { libc::connect(socket.as_raw_fd(), address, len) })?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::connect_tcp;
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
