//! The port: HTTP/1.1, one request a connection, one connection at a time, all of it bounded.

use super::families::{self, Span};
use super::follow::Follower;
use super::text::MEDIA_TYPE;
use crate::outcome::{Failure, Outcome};
use crate::signals::Stop;
use std::io::{ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::time::{Duration, Instant};

/// Bytes of a request with its headers.
const MAX_REQUEST: usize = 8192;
/// Time of a connection, from the first byte read to the last one written.
const CONNECTION: Duration = Duration::from_secs(2);
/// Between two looks at the recordings: a ring of 8192 events lasts longer.
const LOOK: Duration = Duration::from_millis(250);
/// Between two looks at the port.
const POLL: Duration = Duration::from_millis(20);

/// Serves until SIGINT or SIGTERM.
pub(super) fn serve(address: SocketAddr, follower: &mut Follower) -> Outcome {
    let failed = |e: std::io::Error| Failure::refused(e).context(format!("--listen {address}"));
    let stop = Stop::on_signals()?;
    let listener = TcpListener::bind(address).map_err(failed)?;
    listener.set_nonblocking(true).map_err(failed)?;
    let local = listener.local_addr().map_err(failed)?;
    println!("http://{local}/metrics");
    let mut looked: Option<Instant> = None;
    while !stop.is_triggered() {
        match listener.accept() {
            Ok((stream, _)) => {
                let why = answer(stream, &mut || {
                    let found = follower.look();
                    families::all(&found, follower, Span::Followed)
                });
                if let Err(why) = why {
                    detail!("a connection ended early: {why}");
                }
            }
            Err(e) if e.kind() == ErrorKind::WouldBlock => {
                stop.wait(POLL);
            }
            Err(e) => {
                // Such as too many open files: it may pass.
                detail!("no connection taken: {e}");
                stop.wait(LOOK);
            }
        }
        if looked.is_none_or(|at| at.elapsed() >= LOOK) {
            follower.look();
            looked = Some(Instant::now());
        }
    }
    Ok(())
}

/// An answer: status line's end, more headers, media type, text.
type Answer = (&'static str, &'static str, &'static str, String);

/// One request and its answer.
fn answer(mut stream: TcpStream, text: &mut dyn FnMut() -> String) -> std::io::Result<()> {
    let end = Instant::now() + CONNECTION;
    stream.set_nonblocking(false)?;
    let request = read(&mut stream, end)?;
    let (head, (status, more, media, body)) = respond(request.as_deref(), text);
    let mut out = format!(
        "HTTP/1.1 {status}\r\nContent-Type: {media}\r\nContent-Length: {}\r\n{more}\
         Connection: close\r\n\r\n",
        body.len()
    )
    .into_bytes();
    if !head {
        out.extend_from_slice(body.as_bytes());
    }
    let mut rest = out.as_slice();
    while !rest.is_empty() {
        stream.set_write_timeout(Some(left(end)?))?;
        match stream.write(rest)? {
            0 => return Err(ErrorKind::WriteZero.into()),
            n => rest = rest.get(n..).unwrap_or_default(),
        }
    }
    Ok(())
}

/// Time that the connection has left.
fn left(end: Instant) -> std::io::Result<Duration> {
    let left = end.saturating_duration_since(Instant::now());
    if left.is_zero() {
        return Err(ErrorKind::TimedOut.into());
    }
    Ok(left)
}

/// A request up to its empty line; `None` if it is too long.
fn read(stream: &mut TcpStream, end: Instant) -> std::io::Result<Option<Vec<u8>>> {
    let mut request = Vec::new();
    let mut buffer = [0; 1024];
    while !request.windows(4).any(|w| w == b"\r\n\r\n") {
        if request.len() >= MAX_REQUEST {
            return Ok(None);
        }
        stream.set_read_timeout(Some(left(end)?))?;
        match stream.read(&mut buffer)? {
            0 => return Err(ErrorKind::UnexpectedEof.into()),
            n => request.extend_from_slice(buffer.get(..n).unwrap_or_default()),
        }
    }
    Ok(Some(request))
}

/// Whether the answer is of headers alone, and the answer.
fn respond(request: Option<&[u8]>, text: &mut dyn FnMut() -> String) -> (bool, Answer) {
    let plain = |status, more, why: &str| (status, more, "text/plain; charset=utf-8", why.into());
    let Some(request) = request else {
        let why = "A request may have 8192 bytes.\n";
        return (false, plain("431 Request Header Fields Too Large", "", why));
    };
    let line = request.split(|b| *b == b'\r').next().unwrap_or_default();
    let line = std::str::from_utf8(line).unwrap_or_default();
    let mut words = line.split(' ');
    let parts = (words.next(), words.next(), words.next(), words.next());
    let (Some(method), Some(target), Some("HTTP/1.1" | "HTTP/1.0"), None) = parts else {
        let why = "A request begins with GET /metrics HTTP/1.1.\n";
        return (false, plain("400 Bad Request", "", why));
    };
    let head = method == "HEAD";
    if !head && method != "GET" {
        let why = "GET and HEAD are allowed.\n";
        let answer = plain("405 Method Not Allowed", "Allow: GET, HEAD\r\n", why);
        return (false, answer);
    }
    let path = target.split('?').next().unwrap_or_default();
    if path != "/metrics" && path != "/" {
        return (
            head,
            plain("404 Not Found", "", "The metrics are at /metrics.\n"),
        );
    }
    (head, ("200 OK", "", MEDIA_TYPE, text()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn status(request: Option<&[u8]>) -> &'static str {
        respond(request, &mut || "text".into()).1.0
    }

    #[test]
    fn only_a_get_of_the_metrics_gets_them() {
        for (request, expected) in [
            ("GET /metrics HTTP/1.1\r\n\r\n", "200"),
            ("HEAD /?x=1 HTTP/1.0\r\n\r\n", "200"),
            ("GET /other HTTP/1.1\r\n\r\n", "404"),
            ("POST /metrics HTTP/1.1\r\n\r\n", "405"),
            ("GET /metrics\r\n\r\n", "400"),
            ("GET /a b HTTP/1.1\r\n\r\n", "400"),
            ("\r\n\r\n", "400"),
        ] {
            let got = status(Some(request.as_bytes()));
            assert!(got.starts_with(expected), "{request:?}: {got}");
        }
        assert!(status(Some(b"\xff\xfe\r\n\r\n")).starts_with("400"));
        assert!(status(None).starts_with("431"));
    }
}
