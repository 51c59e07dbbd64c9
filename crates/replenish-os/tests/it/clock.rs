//! Clocks tell time, and a thread's CPU clock counts that thread alone.

use replenish_os::clock::{self, ThreadCpuClock};
use replenish_os::{current_tid, timer::TimerFd};
use std::sync::{Arc, mpsc};

const MS: u64 = 1_000_000;

#[test]
fn sleep_until_is_never_early_and_the_past_is_now() {
    let t = clock::monotonic() + 5 * MS;
    clock::sleep_until(t);
    assert!(clock::monotonic() >= t);
    clock::sleep_until(0);
    clock::sleep_until(t);
}

#[test]
fn sleeping_costs_wall_time_and_hardly_any_cpu_time() {
    let (wall, cpu) = (clock::monotonic(), clock::thread_cpu());
    clock::sleep_until(wall + 20 * MS);
    assert!(clock::monotonic() - wall >= 20 * MS);
    assert!(clock::thread_cpu() - cpu < 10 * MS);
}

#[test]
fn another_threads_clock_counts_its_work_and_ends_with_it() {
    let (give, tid) = mpsc::channel();
    let (go, stop) = mpsc::channel::<()>();
    let worker = std::thread::spawn(move || {
        while clock::thread_cpu() < 5 * MS {}
        give.send((
            current_tid(),
            ThreadCpuClock::current(),
            clock::thread_cpu(),
        ))
        .unwrap();
        stop.recv().unwrap_err();
    });
    let (tid, own, seen) = tid.recv().unwrap();
    assert_eq!(own, ThreadCpuClock::of(tid));
    let read = own.read().unwrap();
    assert!(read >= seen && read >= 5 * MS, "{read} after {seen}");
    drop(go);
    worker.join().unwrap();
    // The kernel lets go of a thread a moment after `join` returns.
    let patience = clock::monotonic() + 2_000 * MS;
    while own.read().is_some() && clock::monotonic() < patience {
        std::thread::yield_now();
    }
    assert_eq!(own.read(), None);
}

#[test]
fn a_timer_fires_not_before_its_time_and_past_times_fire_at_once() {
    let timer = TimerFd::new().unwrap();
    let t = clock::monotonic() + 5 * MS;
    timer.arm(t).unwrap();
    timer.read().unwrap();
    assert!(clock::monotonic() >= t);
    for past in [0, 1, t] {
        timer.arm(past).unwrap();
        timer.read().unwrap();
    }
}

#[test]
fn arming_moves_the_timer_under_a_blocked_reader() {
    let timer = Arc::new(TimerFd::new().unwrap());
    let far = clock::monotonic() + 3_600_000 * MS;
    timer.arm(far).unwrap();
    let reader = std::thread::spawn({
        let timer = Arc::clone(&timer);
        move || timer.read().map(|()| clock::monotonic())
    });
    clock::sleep_until(clock::monotonic() + 5 * MS);
    assert!(!reader.is_finished());
    timer.disarm().unwrap();
    clock::sleep_until(clock::monotonic() + 5 * MS);
    assert!(!reader.is_finished());
    timer.arm(clock::monotonic()).unwrap();
    assert!(reader.join().unwrap().unwrap() < far);
}
