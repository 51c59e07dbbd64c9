//! Serial lines over a pair of pseudo-terminals.

use replenish_os::tty::{Pty, Tty, baud_rates};
use replenish_os::{PollFd, clock, poll};
use std::io::ErrorKind;
use std::path::Path;

/// Reads until `len` bytes have come.
fn read(tty: &Tty, len: usize) -> Vec<u8> {
    let mut got = Vec::new();
    let deadline = clock::monotonic() + 5_000_000_000;
    while got.len() < len && clock::monotonic() < deadline {
        poll(&mut [PollFd::readable(tty)], Some(deadline)).unwrap();
        let mut buf = [0; 64];
        let n = tty.read(&mut buf).unwrap();
        got.extend(&buf[..n]);
    }
    got
}

#[test]
fn every_byte_passes_unchanged_both_ways() {
    let pty = Pty::open().unwrap();
    let tty = Tty::open(pty.path(), 115_200).unwrap();
    let bytes: Vec<u8> = (0..=255).collect();
    assert_eq!(tty.write(&bytes).unwrap(), 256);
    assert_eq!(read(&pty.tty, 256), bytes);
    assert_eq!(pty.tty.write(&bytes).unwrap(), 256);
    assert_eq!(read(&tty, 256), bytes, "and no echo");
    assert_eq!(
        pty.tty.read(&mut [0; 8]).unwrap_err().kind(),
        ErrorKind::WouldBlock
    );
}

#[test]
fn a_full_line_says_so_and_does_not_wait() {
    let pty = Pty::open().unwrap();
    let tty = Tty::open(pty.path(), 9_600).unwrap();
    let mut written = 0;
    let error = loop {
        match tty.write(&[7; 1000]) {
            Ok(n) => written += n,
            Err(error) => break error,
        }
        assert!(written < 10_000_000);
    };
    assert_eq!(error.kind(), ErrorKind::WouldBlock);
    assert_eq!(read(&pty.tty, written).len(), written);
}

#[test]
fn the_other_side_can_go() {
    let pty = Pty::open().unwrap();
    let tty = Tty::open(pty.path(), 9_600).unwrap();
    drop(pty);
    let mut fds = [PollFd::readable(&tty)];
    assert_eq!(poll(&mut fds, Some(0)).unwrap(), 1);
    assert!(fds[0].is_broken());
    assert!(tty.read(&mut [0; 8]).map_or(true, |n| n == 0));
}

#[test]
fn what_is_no_terminal_or_no_rate_is_refused() {
    let error = Tty::open(Path::new("/dev/null"), 9_600).unwrap_err();
    assert!(error.to_string().contains("ioctl"), "{error}");
    let pty = Pty::open().unwrap();
    let error = Tty::open(pty.path(), 12_345).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::InvalidInput);
    assert_eq!(error.to_string(), "no baud rate of terminals: 12345");
    for baud in baud_rates() {
        Tty::open(pty.path(), baud).unwrap();
    }
}
