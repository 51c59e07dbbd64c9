//! The hand-off cell over the real futex; its interleavings are in `loom_signal.rs`.

use replenish_os::{Notify, clock};
use replenish_testkit::watchdog::watchdog;
use std::sync::Arc;
use std::time::Duration;

const MS: u64 = 1_000_000;

#[test]
fn sets_coalesce_and_are_consumed_once() {
    let signal = Notify::new();
    assert!(!signal.take());
    signal.set();
    signal.set();
    assert!(signal.take());
    assert!(!signal.take());
    signal.set();
    signal.wait();
    assert!(!signal.take());
}

#[test]
fn a_deadline_ends_the_wait_not_before_its_time() {
    let signal = Notify::new();
    let deadline = clock::monotonic() + 5 * MS;
    assert!(!signal.wait_until(deadline));
    assert!(clock::monotonic() >= deadline);
    assert!(!signal.wait_until(0));
    signal.set();
    assert!(
        signal.wait_until(0),
        "a set that is there is taken after the deadline too"
    );
}

#[test]
fn a_timed_out_wait_leaves_nothing_behind() {
    let signal = Notify::new();
    assert!(!signal.wait_until(clock::monotonic() + MS));
    signal.set();
    signal.wait();
    assert!(!signal.take());
}

#[test]
fn two_threads_play_ping_pong() {
    let _dog = watchdog("ping-pong over signals", Duration::from_secs(60));
    const ROUNDS: u32 = 10_000;
    let [ping, pong] = [(); 2].map(|()| Arc::new(Notify::new()));
    let there = std::thread::spawn({
        let (ping, pong) = (Arc::clone(&ping), Arc::clone(&pong));
        move || {
            for _ in 0..ROUNDS {
                ping.wait();
                pong.set();
            }
        }
    });
    for _ in 0..ROUNDS {
        ping.set();
        assert!(pong.wait_until(clock::monotonic() + 30_000 * MS));
    }
    there.join().unwrap();
}
