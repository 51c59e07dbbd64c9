//! Waiting on descriptors with a deadline, and waking that wait.

use replenish_os::timer::TimerFd;
use replenish_os::{PollFd, WakeFd, clock, poll};
use replenish_testkit::watchdog::watchdog;
use std::io::Write;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::time::Duration;

const MS: u64 = 1_000_000;

#[test]
fn nothing_ready_waits_until_the_deadline_and_not_less() {
    let wake = WakeFd::new().unwrap();
    let mut fds = [PollFd::readable(&wake)];
    let deadline = clock::monotonic() + 5 * MS;
    assert_eq!(poll(&mut fds, Some(deadline)).unwrap(), 0);
    assert!(clock::monotonic() >= deadline);
    assert_eq!(
        poll(&mut fds, Some(0)).unwrap(),
        0,
        "a past deadline only looks"
    );
    assert!(!fds[0].is_ready());
}

#[test]
fn wakes_are_kept_until_cleared_and_coalesce() {
    let wake = WakeFd::new().unwrap();
    assert!(!wake.clear());
    wake.wake();
    wake.wake();
    for _ in 0..2 {
        let mut fds = [PollFd::readable(&wake)];
        assert_eq!(poll(&mut fds, None).unwrap(), 1);
        assert!(fds[0].is_ready() && !fds[0].is_broken());
    }
    assert!(wake.clear());
    assert!(!wake.clear());
}

#[test]
fn another_thread_ends_an_endless_wait() {
    let _dog = watchdog("a wait to be woken", Duration::from_secs(20));
    let wake = Arc::new(WakeFd::new().unwrap());
    let waiter = std::thread::spawn({
        let wake = Arc::clone(&wake);
        move || poll(&mut [PollFd::readable(&*wake)], None).unwrap()
    });
    clock::sleep_until(clock::monotonic() + 5 * MS);
    assert!(!waiter.is_finished());
    wake.wake();
    assert_eq!(waiter.join().unwrap(), 1);
}

#[test]
fn each_descriptor_tells_its_own_state() {
    let wake = WakeFd::new().unwrap();
    let timer = TimerFd::new().unwrap();
    let (mut near, far) = UnixStream::pair().unwrap();
    timer.arm(1).unwrap();
    let mut fds = [
        PollFd::readable(&wake),
        PollFd::readable(&timer),
        PollFd::readable(&far),
        PollFd::writable(&near),
    ];
    assert_eq!(
        poll(&mut fds, Some(clock::monotonic() + 1_000 * MS)).unwrap(),
        2
    );
    assert_eq!(
        fds.each_ref().map(PollFd::is_ready),
        [false, true, false, true]
    );
    near.write_all(b"x").unwrap();
    let mut fds = [PollFd::readable(&far)];
    assert_eq!(poll(&mut fds, Some(0)).unwrap(), 1);
    assert!(!fds[0].is_broken());
    drop(near);
    let mut fds = [PollFd::readable(&far)];
    poll(&mut fds, Some(0)).unwrap();
    assert!(fds[0].is_ready() && fds[0].is_broken());
}
