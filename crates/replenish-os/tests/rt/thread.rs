//! Threads have what was asked from their first instruction on, and refusals say why.

use crate::common::{MS, cpu};
use replenish_os::{
    GrantedPolicy, Low, Notify, Params, Policy, SchedClass, SpawnError, ThreadSpec, affinity,
    clock, current_tid, granted, set_priority, spawn,
};
use replenish_testkit::harness::{Trial, rt_trial, trial};
use replenish_testkit::tids;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial("a_plain_thread_has_its_name_and_cpu", plain_thread),
        trial("impossible_requests_are_refused_by_name", refusals),
        trial("a_panic_is_handed_to_join", || {
            let thread = spawn(ThreadSpec::new("panics"), || panic!("on purpose")).unwrap();
            let payload = thread.join().unwrap_err();
            assert_eq!(payload.downcast_ref::<&str>(), Some(&"on purpose"));
        }),
        trial(
            "join_until_reports_a_stuck_thread_and_keeps_it_joinable",
            stuck_thread,
        ),
        crate::unprivileged::trial(),
        trial("a_thread_with_the_id_of_one_that_ended_is_another", reused)
            .skipped_if(tids::missing()),
        rt_trial(
            "real_time_policies_are_in_force_before_user_code_runs",
            real_time_threads,
        ),
        rt_trial(
            "threads_of_a_worker_leave_its_class_unless_asked",
            reset_on_fork,
        ),
        rt_trial("a_hog_on_the_cpu_does_not_hold_up_the_start", beside_a_hog),
        rt_trial("a_deadline_reservation_is_granted", || {
            let policy = Policy::deadline(MS, 10 * MS, 100 * MS).unwrap();
            let spec = ThreadSpec::new("deadline").policy(policy);
            let seen = spawn(spec, || granted(current_tid()))
                .unwrap()
                .join()
                .unwrap()
                .unwrap();
            assert_eq!(
                seen.policy,
                GrantedPolicy::Deadline {
                    runtime: MS,
                    deadline: 10 * MS,
                    period: 100 * MS,
                    reclaim: false
                }
            );
            assert!(
                seen.to_string()
                    .starts_with("DEADLINE 1 ms/10 ms/100 ms, CPU"),
                "{seen}"
            );
        }),
    ]
}

fn plain_thread() {
    let cpu = cpu();
    let spec = ThreadSpec::new("more-than-fifteen-bytes")
        .cpu(cpu)
        .stack_size(256 << 10);
    let thread = spawn(spec, move || {
        let comm = std::fs::read_to_string("/proc/thread-self/comm").unwrap();
        (current_tid(), comm, granted(current_tid()).unwrap())
    });
    let thread = thread.unwrap();
    let tid = thread.tid();
    let (its_tid, comm, seen) = thread.join().unwrap();
    assert_eq!(tid, its_tid);
    assert_eq!(comm.trim_end(), "more-than-fifte");
    assert_eq!(seen.cpus.iter().collect::<Vec<_>>(), [cpu]);
    assert!(seen.reset_on_fork);
    assert!(matches!(seen.policy, GrantedPolicy::Other { .. }));
}

fn refusals() {
    let refused = |spec| spawn(spec, || ()).map(drop).unwrap_err();
    let spec = ThreadSpec::new("x").policy(Policy::Fifo { priority: 0 });
    assert_eq!(
        refused(spec).to_string(),
        "priority 0 is out of range: allowed 1 to 99"
    );
    assert!(matches!(
        refused(ThreadSpec::new("nul\0byte")),
        SpawnError::Name
    ));

    let policy = Policy::deadline(MS, 10 * MS, 10 * MS).unwrap();
    let text = refused(ThreadSpec::new("x").policy(policy).cpu(0)).to_string();
    assert!(
        text.contains("EPERM") && text.contains("leave the CPU out"),
        "{text}"
    );

    for nowhere in [1023, 1024, usize::MAX] {
        let error = refused(ThreadSpec::new("x").cpu(nowhere));
        let SpawnError::Cpu { cpu, allowed, .. } = &error else {
            panic!("{error}")
        };
        assert_eq!(
            (*cpu, **allowed),
            (nowhere, affinity(current_tid()).unwrap())
        );
        assert!(
            error.to_string().contains(&format!("may use {allowed}")),
            "{error}"
        );
    }
}

fn stuck_thread() {
    let release = Arc::new(Notify::new());
    let theirs = Arc::clone(&release);
    let spec = ThreadSpec::new("stuck");
    let thread = spawn(spec, move || theirs.wait()).unwrap();
    let deadline = clock::monotonic() + 5 * MS;
    let thread = thread.join_until(deadline).unwrap_err();
    assert!(clock::monotonic() >= deadline);
    assert!(!thread.is_finished());
    release.set();
    thread
        .join_until(clock::monotonic() + 10_000 * MS)
        .unwrap()
        .unwrap();

    let panics = spawn(ThreadSpec::new("panics"), || panic!("on purpose")).unwrap();
    assert!(
        panics
            .join_until(clock::monotonic() + 10_000 * MS)
            .unwrap()
            .is_err()
    );
}

/// It was waited for until the deadline, and put into the time-sharing class in place of the one
/// that had ended.
fn reused() {
    let ended = spawn(ThreadSpec::new("ends"), || 7).unwrap();
    let tid = ended.tid();
    while tids::exists(tid.get()) {
        std::thread::yield_now();
    }
    let (end, ends) = mpsc::channel::<()>();
    let other = tids::reuse(tid.get(), move || ends.recv().is_err()).expect("no such id to be had");
    set_priority(tid, SchedClass::Idle).unwrap();
    let before = granted(tid).unwrap().policy;
    ended.lower();
    assert_eq!(granted(tid).unwrap().policy, before);
    let deadline = clock::monotonic() + 10_000 * MS;
    assert_eq!(ended.join_until(deadline).unwrap().unwrap(), 7);
    assert!(
        clock::monotonic() < deadline,
        "it waited for another thread"
    );
    drop(end);
    assert!(other.join().unwrap());
}

fn real_time_threads() {
    let cpu = cpu();
    let params = Params::new(60, Low::Background(6), 30 * MS, 100 * MS, 10).unwrap();
    for (policy, class, priority) in [
        (Policy::fifo(50).unwrap(), GrantedPolicy::Fifo, 50),
        (
            Policy::round_robin(40).unwrap(),
            GrantedPolicy::RoundRobin,
            40,
        ),
        (Policy::sporadic(params).unwrap(), GrantedPolicy::Fifo, 60),
    ] {
        let spec = ThreadSpec::new("rt").policy(policy).cpu(cpu);
        let thread = spawn(spec, || granted(current_tid()).unwrap()).unwrap();
        let seen = thread.join().unwrap();
        assert_eq!((seen.policy, seen.priority), (class, priority));
        assert_eq!(seen.cpus.iter().collect::<Vec<_>>(), [cpu]);
        assert!(seen.reset_on_fork);
    }
}

fn reset_on_fork() {
    let GrantedPolicy::Other { nice: own } = granted(current_tid()).unwrap().policy else {
        panic!("the trial itself is no ordinary thread");
    };
    for reset in [true, false] {
        let policy = Policy::fifo(50).unwrap();
        let spec = ThreadSpec::new("parent")
            .policy(policy)
            .cpu(cpu())
            .reset_on_fork(reset);
        let parent = spawn(spec, || {
            let escaped = std::thread::spawn(|| granted(current_tid()).unwrap())
                .join()
                .unwrap();
            let asked = spawn(ThreadSpec::new("child"), || granted(current_tid()).unwrap());
            (escaped, asked.unwrap().join().unwrap())
        });
        let (escaped, asked) = parent.unwrap().join().unwrap();
        assert_eq!(escaped.policy == GrantedPolicy::Fifo, !reset, "{escaped}");
        // The nice value is the kernel's 0 after a reset, and what the test run has otherwise.
        let nice = if reset { 0 } else { own };
        assert_eq!(asked.policy, GrantedPolicy::Other { nice });
    }
}

/// Threads start above and below a hog that keeps their CPU: `spawn` returns before the hog ends,
/// the one above runs at once, the one below has all it was given although it waits.
fn beside_a_hog() {
    let cpu = cpu();
    let (started, over, ended) = (
        Notify::new(),
        AtomicBool::new(false),
        AtomicBool::new(false),
    );
    let [over, ended] = [over, ended].map(Arc::new);
    let started = Arc::new(started);
    let fifo = |priority| Policy::fifo(priority).unwrap();
    let spec = ThreadSpec::new("hog").policy(fifo(50)).cpu(cpu);
    let hog = spawn(spec, {
        let (started, over, ended) = (Arc::clone(&started), Arc::clone(&over), Arc::clone(&ended));
        move || {
            started.set();
            crate::common::spin(&over);
            ended.store(true, Ordering::SeqCst);
        }
    });
    started.wait();
    let look = || {
        let ended = Arc::clone(&ended);
        move || ended.load(Ordering::SeqCst)
    };
    let above = spawn(ThreadSpec::new("above").policy(fifo(60)).cpu(cpu), look()).unwrap();
    let below = spawn(ThreadSpec::new("below").policy(fifo(40)).cpu(cpu), look()).unwrap();
    assert!(
        !ended.load(Ordering::SeqCst),
        "spawn waited for the hog to end"
    );
    assert_eq!(
        granted(below.tid()).unwrap().to_string(),
        format!("FIFO 40, CPU {cpu}")
    );
    assert!(!above.join().unwrap(), "the thread above ran after the hog");
    over.store(true, Ordering::SeqCst);
    assert!(
        below.join().unwrap(),
        "the thread below ran before the hog ended"
    );
    hog.unwrap().join().unwrap();
}
