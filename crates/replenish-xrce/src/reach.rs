//! Whether an agent can be reached, before there is a session with it.

use crate::client::{PING_LEN, ping, pong};
use crate::wire::RequestId;
use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

/// Asks over UDP whether there is an agent at `agent`.
///
/// It asks up to `attempts` times, each with this much `patience` for the answer, and gives the
/// round trip of the attempt that was answered, `None` if none was. The agent remembers nothing of
/// it. Waits: for set-up.
///
/// # Errors
/// The system's error of socket, bind, connect or send, if it is not about the way to the agent.
pub fn ping_agent(
    agent: SocketAddr,
    patience: Duration,
    attempts: u32,
) -> io::Result<Option<Duration>> {
    let any: SocketAddr = match agent {
        SocketAddr::V4(_) => (Ipv4Addr::UNSPECIFIED, 0).into(),
        SocketAddr::V6(_) => (Ipv6Addr::UNSPECIFIED, 0).into(),
    };
    let socket = UdpSocket::bind(any)?;
    socket.connect(agent)?;
    let mut request = RequestId::FIRST;
    for _ in 0..attempts {
        if let Some(time) = attempt(&socket, request, patience)? {
            return Ok(Some(time));
        }
        request = request.next(); // an answer that comes late is not taken for the next one
    }
    Ok(None)
}

fn attempt(
    socket: &UdpSocket,
    request: RequestId,
    patience: Duration,
) -> io::Result<Option<Duration>> {
    let (mut question, mut answer) = ([0; PING_LEN], [0; 512]);
    let question = ping(request, None, &mut question).unwrap_or_default(); // it has room
    let began = Instant::now();
    no_way(socket.send(question))?;
    loop {
        let left = patience.saturating_sub(began.elapsed());
        if left.is_zero() {
            return Ok(None);
        }
        socket.set_read_timeout(Some(left))?;
        let Some(len) = no_way(socket.recv(&mut answer))? else {
            continue; // the time is looked at again
        };
        if pong(request, answer.get(..len).unwrap_or_default()).is_some() {
            return Ok(Some(began.elapsed()));
        }
    }
}

/// `None` if nothing came, or if no agent is there.
fn no_way(result: io::Result<usize>) -> io::Result<Option<usize>> {
    match result.map_err(|error| (error.kind(), error)) {
        Ok(len) => Ok(Some(len)),
        Err((
            ErrorKind::WouldBlock
            | ErrorKind::TimedOut
            | ErrorKind::Interrupted
            | ErrorKind::ConnectionRefused
            | ErrorKind::HostUnreachable
            | ErrorKind::NetworkUnreachable
            | ErrorKind::NetworkDown,
            _,
        )) => Ok(None),
        Err((_, error)) => Err(error),
    }
}
