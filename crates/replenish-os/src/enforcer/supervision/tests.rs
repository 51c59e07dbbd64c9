//! Looks in virtual time and with real locks.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

use super::*;
use crate::backend::sched::pretended::{self, Pretended};
use crate::backend::tid::current_tid;
use crate::backend::timer::TimerFd;
use crate::enforcer::account::Account;
use crate::{EnforcerConfig, Params};
use sporadic::{Kind, Low};

const MS: Nanos = 1_000_000;

/// An enforcer's state, the account of this thread at 50 ms every 100 ms and priority 60 or 6, and
/// what the watchdog knows.
fn enforced(
    config: EnforcerConfig,
    mode: Enforcement,
    timer: Option<TimerFd>,
) -> (Arc<EnforcerState>, Account, Arc<Watched>) {
    enforced_with(Low::Background(6), config, mode, timer)
}

fn enforced_with(
    low: Low,
    config: EnforcerConfig,
    mode: Enforcement,
    timer: Option<TimerFd>,
) -> (Arc<EnforcerState>, Account, Arc<Watched>) {
    let state = Arc::new(EnforcerState::new(config, mode, timer));
    let params = Params::new(60, low, 50 * MS, 100 * MS, 10).unwrap();
    let account = Account::enroll(&state, &params, Kind::Corrected).unwrap();
    let watched = Watched::of(&state);
    (state, account, watched)
}

/// A timer that nobody reads.
fn silent() -> Option<TimerFd> {
    Some(TimerFd::new().unwrap())
}

fn wait_until_overdue(state: &EnforcerState) {
    let due = state.views.due();
    assert!(due < clock::monotonic() + 100 * MS, "a check is due");
    clock::sleep_until(due + OVERDUE + MS);
}

/// Another thread holds the enforcer's lock until the result is called.
fn hold_the_lock(state: &Arc<EnforcerState>) -> impl FnOnce() + use<> {
    let (hold, held) = std::sync::mpsc::channel();
    let (release, released) = std::sync::mpsc::channel::<()>();
    let theirs = Arc::clone(state);
    let holder = std::thread::spawn(move || {
        let threads = theirs.threads.lock();
        hold.send(()).unwrap();
        released.recv().unwrap();
        drop(threads);
    });
    held.recv().unwrap();
    move || {
        release.send(()).unwrap();
        holder.join().unwrap();
    }
}

fn unpinned(mode: Enforcement) -> (Arc<EnforcerState>, Account, Arc<Watched>) {
    enforced(EnforcerConfig::unpinned(), mode, None)
}

/// A worker that is at its high priority of 60, as this pretended kernel has it, under an enforcer
/// that reads no timer.
fn activated() -> (Arc<EnforcerState>, Account, Arc<Watched>) {
    let (config, mode) = (EnforcerConfig::unpinned(), Enforcement::OtherCpu);
    let (state, mut account, watched) = enforced(config, mode, silent());
    let (refuses, priority) = (false, 60);
    pretended::begin(Pretended { priority, refuses });
    account.activate(clock::monotonic());
    (state, account, watched)
}

/// On b209253 it tried again for ever, at priority 99.
#[test]
fn an_enforcer_that_cannot_read_its_timer_ends_and_lowers_its_workers() {
    let (config, timer) = (EnforcerConfig::unpinned(), Some(TimerFd::broken()));
    let (_, account, watched) = enforced(config, Enforcement::Deferred, timer);
    assert!(!account.meter().usage().low);
    let theirs = Arc::clone(&watched);
    std::thread::spawn(move || theirs.run()).join().unwrap();
    assert!(watched.ended.load(Ordering::SeqCst));
    assert!(account.meter().usage().low);
}

/// A hypervisor took the CPU from a watchdog that had the enforcer's lock for a look: a torture
/// found a worker of 0.2 ms per 7.6 ms that had 12 ms in one piece.
#[test]
fn a_look_that_finds_nothing_wrong_takes_no_lock() {
    let (state, account, watched) = activated();
    let threads = state.threads.lock();
    // This thread would wait for itself, for ever or until the kernel says so.
    assert_eq!(watched.look(), 100 * MS);
    assert_eq!(watched.known.lock().silent, 0);
    drop(threads);
    drop(account);
}

/// A time-sharing thread's server took the CPU from a watchdog that had the enforcer's lock, for
/// 5.5 ms: a torture found a worker of 13 ms per 75 ms that had 2.8 ms too much.
#[test]
fn a_look_amid_a_change_takes_no_lock() {
    let (state, account, watched) = activated();
    let threads = state.threads.lock();
    pretended::is_amid_a_change(0);
    // This thread would wait for itself until the kernel says so, and find the enforcer silent.
    assert_eq!(watched.look(), 100 * MS);
    drop(threads);
    assert_eq!(pretended::get().unwrap().priority, 60);
    // Another priority that stays is a fault.
    pretended::begin(Pretended {
        priority: 7,
        refuses: false,
    });
    watched.look();
    assert_eq!(pretended::get().unwrap().priority, 60);
    assert_eq!(state.threads.lock().stats.faults, 1);
    drop(account);
}

/// A lock that is handed over has an owner that may not have its CPU: a torture found a worker of
/// 50 us per 500 us that had 6.6 ms too much, while the watchdog's CPU stood still for 20 ms.
#[test]
fn a_look_does_not_wait_for_the_lock_in_the_kernel() {
    let (state, account, watched) = activated();
    wait_until_overdue(&state);
    let (hold, held) = std::sync::mpsc::channel();
    let looked = Arc::new(AtomicBool::new(false));
    let (theirs, over) = (Arc::clone(&state), Arc::clone(&looked));
    let busy = std::thread::spawn(move || {
        let threads = theirs.threads.lock();
        hold.send(()).unwrap();
        let mut awaited = false;
        while !over.load(Ordering::SeqCst) {
            awaited |= theirs.threads.is_awaited();
        }
        drop(threads);
        awaited
    });
    held.recv().unwrap();
    assert_eq!(watched.look(), watchdog::SHORTEST);
    looked.store(true, Ordering::SeqCst);
    assert!(!busy.join().unwrap());
    watched.look();
    drop(account);
}

/// An enforcer that the kernel stops in the middle of a judgement keeps its lock. A torture
/// found it: a worker of 0.24 ms per 63 ms had 24.8 ms in one piece.
#[test]
fn workers_are_lowered_while_the_enforcers_lock_cannot_be_had() {
    lowered_while_shut_out(Low::Background(6), 6);
}

/// The watchdog found workers that it had lowered itself, did not get the lock, and lowered them
/// again, for 10 s: seed 68 of a torture. The enforcer judged all the time.
#[test]
fn an_enforcer_that_judges_in_time_keeps_its_workers() {
    let (config, mode) = (EnforcerConfig::unpinned(), Enforcement::OtherCpu);
    let (state, mut account, watched) = enforced(config, mode, silent());
    let pretend = |priority| {
        let refuses = false;
        pretended::begin(Pretended { priority, refuses });
    };
    pretend(60);
    watched.look();
    account.activate(clock::monotonic());
    assert!(state.views.due() > clock::monotonic(), "nothing is overdue");
    pretend(50); // somebody has changed it
    let release = hold_the_lock(&state);
    let looked = watched.look();
    // The machine may have stood still meanwhile.
    if clock::monotonic() < state.views.due() {
        assert_eq!(looked, watchdog::SHORTEST);
        assert_eq!(pretended::get().unwrap().priority, 50);
        assert_eq!(watched.known.lock().silent, 0);
    }
    release();
    watched.look();
    assert_eq!(pretended::get().unwrap().priority, 60);
    drop(account);
}

/// One that a judgement would suspend goes on in the time-sharing class: nobody could resume it.
#[test]
fn a_worker_that_would_be_suspended_is_lowered_and_given_back_as_well() {
    lowered_while_shut_out(Low::Suspend, 0);
}

fn lowered_while_shut_out(low: Low, lowered: u8) {
    let (config, mode) = (EnforcerConfig::unpinned(), Enforcement::OtherCpu);
    let (state, mut account, watched) = enforced_with(low, config, mode, silent());
    let (refuses, priority) = (false, 60);
    pretended::begin(Pretended { priority, refuses });
    let has = || pretended::get().unwrap().priority;
    watched.look();
    assert_eq!(has(), 60);
    account.activate(clock::monotonic());
    let release = hold_the_lock(&state);
    assert_eq!(watched.look(), 100 * MS, "nothing is due yet");
    assert_eq!(has(), 60);
    wait_until_overdue(&state);
    assert_eq!(watched.look(), watchdog::SHORTEST);
    assert_eq!(has(), lowered);
    release();
    watched.look();
    assert_eq!(has(), 60);
    assert!(!account.meter().usage().low);
    assert_eq!(state.threads.lock().enrolled[0].supervised.foreign, 0);
    drop(account);
}

/// The fair server may keep an enforcer, and each of its workers, from their CPU for 50 ms. A
/// torture found workers that were lowered then, and had little of what was left to them.
#[test]
fn workers_keep_their_priority_while_the_locks_owner_waits_for_their_cpu() {
    let cpu = affinity(current_tid()).unwrap().iter().next().unwrap();
    let config = EnforcerConfig {
        cpu: Some(cpu),
        ..EnforcerConfig::unpinned()
    };
    let (state, mut account, watched) = enforced(config, Enforcement::SameCpu, silent());
    let (refuses, priority) = (false, 60);
    pretended::begin(Pretended { priority, refuses });
    let has = || pretended::get().unwrap().priority;
    watched.look();
    account.activate(clock::monotonic());
    wait_until_overdue(&state);
    let (hold, held) = std::sync::mpsc::channel();
    let (block, blocked) = (Arc::new(AtomicBool::new(false)), std::sync::mpsc::channel());
    let (release, released) = blocked;
    let (theirs, blocks) = (Arc::clone(&state), Arc::clone(&block));
    let owner = std::thread::spawn(move || {
        set_affinity(current_tid(), &CpuSet::one(cpu)).unwrap();
        let threads = theirs.threads.lock();
        hold.send(()).unwrap();
        while !blocks.load(Ordering::SeqCst) {
            core::hint::spin_loop();
        }
        let () = released.recv().unwrap();
        drop(threads);
    });
    held.recv().unwrap();
    assert_eq!(watched.look(), watchdog::SHORTEST);
    assert_eq!(has(), 60, "the owner wants its CPU");
    block.store(true, Ordering::SeqCst);
    let id = state.threads.owner().unwrap();
    while wants_cpu(id, cpu) {
        std::thread::yield_now();
    }
    assert_eq!(watched.look(), watchdog::SHORTEST);
    assert_eq!(has(), 6, "the owner is blocked");
    release.send(()).unwrap();
    owner.join().unwrap();
    assert!(
        !watched.workers_run_on(),
        "seed 177: the lock is free by now"
    );
    watched.look();
    assert_eq!(has(), 60);
    drop(account);
}

/// A privilege may be gone by the time at which the enforcer's lock is free again, or somebody else
/// lowers a worker that nobody may raise: its account must not call it high for good.
#[test]
fn a_worker_whose_priority_cannot_be_given_back_is_low_by_its_account_and_reported() {
    let (state, account, watched) = unpinned(Enforcement::OtherCpu);
    let thread = |priority, refuses| pretended::begin(Pretended { priority, refuses });
    let is_high = || !account.meter().usage().low;
    thread(60, false);
    watched.look();
    assert!(is_high());
    thread(6, true); // its callback lowered it
    watched.look();
    assert!(!is_high(), "low in truth");
    let judged = || {
        let mut threads = state.threads.lock();
        let due = threads.enrolled[0].check_at();
        assert!(due < clock::monotonic() + 100 * MS, "it is tried again");
        while clock::monotonic() < due {
            std::thread::yield_now();
        }
        state.sweep(&mut threads, Enforcement::OtherCpu);
    };
    judged();
    assert!(!is_high(), "refused");
    watched.look(); // finds the refusal
    let is_reported = |thread: &EnforcedThread| thread.supervised.view.is_reported();
    assert!(is_reported(&state.threads.lock().enrolled[0]));
    thread(6, false); // the privilege is back
    judged();
    assert!(is_high());
    assert_eq!(pretended::get().unwrap().priority, 60);
    drop(account);
}

/// The kernel is asked without the lock: the enforcer may change a priority between the glance
/// and the answer. That is no fault, and nothing is restored.
#[test]
fn a_change_of_the_enforcers_own_during_a_look_is_no_fault() {
    let (state, account, watched) = unpinned(Enforcement::Deferred);
    let (mut known, mut faults) = (watched.known.lock(), Vec::new());
    // This thread is in the time-sharing class. It was given another one before the glance.
    let period = watched.glance(&mut known, &mut faults);
    assert_eq!((known.workers.len(), period), (1, 100 * MS));
    known.workers.retain(Worker::seems_changed);
    assert_eq!(known.workers.len(), 1);
    state.threads.lock().enrolled[0].supervised.give(Some(0));
    assert!(watched.correct(0, &mut known, &mut faults));
    assert!(faults.is_empty(), "{faults:?}");
    assert_eq!(state.threads.lock().stats.faults, 0);
    watched.glance(&mut known, &mut faults);
    known.workers.retain(Worker::seems_changed);
    assert!(known.workers.is_empty());
    drop(account);
}
