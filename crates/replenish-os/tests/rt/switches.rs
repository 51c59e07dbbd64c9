//! The kernel's switch records, and the cheap counter that stands in for them.

use replenish_os::{
    ContextSwitch, ContextSwitchLog, CpuSet, SchedClass, SwitchDirection, clock, current_tid,
    set_affinity, set_priority, voluntary_switches,
};
use replenish_testkit::harness::{Trial, rt_trial, skip, trial};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

const MS: u64 = 1_000_000;
const NO_RECORDS: &str = "no switch records here (kernel.perf_event_paranoid)";

fn drain(log: &mut ContextSwitchLog) -> Vec<ContextSwitch> {
    let mut all = Vec::new();
    assert!(!log.drain(&mut |s| all.push(s)).lost);
    all
}

fn sleeps_are_voluntary_and_timed() {
    let Ok(mut log) = ContextSwitchLog::open(current_tid()) else {
        skip(NO_RECORDS);
    };
    let from = clock::monotonic();
    for _ in 0..3 {
        clock::sleep_until(clock::monotonic() + 2 * MS);
    }
    let to = clock::monotonic();
    let switches = drain(&mut log);
    let outs: Vec<_> = switches
        .iter()
        .filter(|s| s.kind == SwitchDirection::Out { preempted: false })
        .collect();
    assert_eq!(outs.len(), 3, "{switches:?}");
    assert!(
        switches.iter().all(|s| (from..=to).contains(&s.time)),
        "{switches:?}"
    );
    assert!(switches.is_sorted_by_key(|s| s.time));
    // Every way out is followed by a way in, at least the sleep later.
    let pairs = switches
        .windows(2)
        .filter(|p| p[0].kind == SwitchDirection::Out { preempted: false });
    for pair in pairs {
        assert_eq!(pair[1].kind, SwitchDirection::In);
        assert!(pair[1].time - pair[0].time >= MS, "{pair:?}");
    }
    assert_eq!(drain(&mut log), [], "a second reading finds nothing old");
}

fn a_full_ring_says_that_it_lost_something() {
    let Ok(mut log) = ContextSwitchLog::open(current_tid()) else {
        skip(NO_RECORDS);
    };
    for _ in 0..3000 {
        clock::sleep_until(clock::monotonic() + 1000);
    }
    // At once, although the kernel's own record of the loss comes only with the next switch that
    // fits: on b209253 this reading was believed.
    let mut seen = 0;
    assert!(log.drain(&mut |_| seen += 1).lost, "{seen}");
    assert!(seen > 1000, "{seen}");
    // The kernel's record.
    clock::sleep_until(clock::monotonic() + 1000);
    assert!(log.drain(&mut |_| ()).lost);
    clock::sleep_until(clock::monotonic() + 1000);
    assert_eq!(drain(&mut log).len(), 2, "from here on they are complete");
}

fn preemption_is_told_from_blocking() {
    let cpu = std::thread::available_parallelism().unwrap().get() - 1;
    let place = move |priority| {
        set_affinity(current_tid(), &CpuSet::one(cpu)).unwrap();
        set_priority(current_tid(), SchedClass::Fifo(priority)).unwrap();
    };
    let worker = std::thread::spawn(move || {
        place(10);
        let mut log = ContextSwitchLog::open(current_tid()).unwrap();
        let ended = Arc::new(AtomicBool::new(false));
        let end = Arc::clone(&ended);
        let high = std::thread::spawn(move || {
            place(20);
            for _ in 0..9 {
                clock::sleep_until(clock::monotonic() + 2 * MS);
            }
            end.store(true, Ordering::SeqCst);
        });
        // It inherits our priority and CPU: let it place itself.
        clock::sleep_until(clock::monotonic() + 2 * MS);
        crate::common::spin(&ended);
        let switches = drain(&mut log);
        high.join().unwrap();
        switches
    });
    let switches = worker.join().unwrap();
    let preempted = switches
        .iter()
        .filter(|s| s.kind == SwitchDirection::Out { preempted: true })
        .count();
    assert!(preempted >= 5, "{switches:?}");
}

fn the_cheap_counter_counts_sleeps() {
    let before = voluntary_switches();
    for _ in 0..4 {
        clock::sleep_until(clock::monotonic() + MS);
    }
    assert!(voluntary_switches() - before >= 4);
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial(
            "sleeps_are_voluntary_and_timed",
            sleeps_are_voluntary_and_timed,
        ),
        trial(
            "a_full_ring_says_that_it_lost_something",
            a_full_ring_says_that_it_lost_something,
        ),
        rt_trial(
            "preemption_is_told_from_blocking",
            preemption_is_told_from_blocking,
        ),
        trial(
            "the_cheap_counter_counts_sleeps",
            the_cheap_counter_counts_sleeps,
        ),
    ]
}
