//! Sweeps over threads that wait for the CPU.
#![allow(clippy::unwrap_used, reason = "tests may panic")]

use super::*;
use crate::backend::blocking_detector::BlockingDetector;
use crate::backend::sched::pretended::{self, Pretended};
use crate::backend::suspend::SuspendCell;
use crate::enforcer::account::Account;
use crate::enforcer::config::AnyServer;
use crate::{Arc, Low, Params, current_tid};
use alloc::boxed::Box;
use sporadic::{BudgetServer, Kind, Level, Readings, Reservation, Tuning};
use std::sync::mpsc;
use std::time::Duration;

const MS: Nanos = 1_000_000;

/// Later than any real CPU clock, whose readings therefore change nothing.
const CPU: Nanos = 1 << 50;

/// A thread that has used up its budget of 1 ms, which comes back in 2 ms, at its high level.
fn overdrawn(low: Low, now: Nanos) -> EnforcedThread {
    let params = Params::new(60, low, MS, 2 * MS, 10).unwrap();
    let server = AnyServer::clamped(Kind::Corrected, params, now);
    let mut reservation = Reservation::new(server, Tuning::LINUX, now, CPU);
    reservation.activate(now, now, CPU);
    reservation.observe(now, CPU + MS, Readings::Exact(&[]));
    let (detector, _) = BlockingDetector::new(current_tid(), false, 1);
    let suspend = Arc::new(SuspendCell::new());
    EnforcedThread::new(
        reservation,
        current_tid(),
        detector,
        suspend,
        Box::default(),
    )
}

/// The same at its low level.
fn exhausted() -> EnforcedThread {
    let now = clock::monotonic();
    let mut thread = overdrawn(Low::Background(6), now);
    thread.reservation.applied(Level::Low, now, CPU + MS);
    thread
}

/// Runs `test` beside an enrolled thread that has this budget every 100 ms, was activated and
/// sleeps; whether its records are exact.
fn beside_a_sleeper(budget: Nanos, test: impl FnOnce(&EnforcerState, bool)) {
    let config = EnforcerConfig::unpinned();
    let state = Arc::new(EnforcerState::new(config, Enforcement::Deferred, None));
    let (tell, told) = mpsc::channel();
    let (end, ended) = mpsc::channel::<()>();
    let theirs = Arc::clone(&state);
    let thread = std::thread::spawn(move || {
        let params = Params::new(60, Low::Background(6), budget, 100 * MS, 10).unwrap();
        let mut account = Account::enroll(&theirs, &params, Kind::Corrected).unwrap();
        account.activate(clock::monotonic());
        tell.send(account.meter().sees_blocking()).unwrap();
        ended.recv().unwrap();
    });
    test(&state, told.recv().unwrap());
    end.send(()).unwrap();
    thread.join().unwrap();
}

/// A change of level gives the CPU to one of the threads that wait for it. A check of one that
/// has not run would find what the last one found, and cost as much as the change.
#[test]
fn a_thread_that_waits_for_the_cpu_is_judged_where_nothing_else_changes() {
    // A thread of its own: the kernel that it pretends is its own, too.
    std::thread::spawn(sweep_beside_a_change).join().unwrap();
}

fn sweep_beside_a_change() {
    beside_a_sleeper(5 * MS, |state, exact| {
        std::thread::sleep(Duration::from_millis(1));
        let mut threads = state.threads.lock();
        let waiting = threads.enrolled.first_mut().unwrap();
        waiting.observe(clock::monotonic()); // its records end with it asleep
        threads.enrolled.push(exhausted());
        pretended::begin(Pretended {
            priority: 6,
            refuses: false,
        });
        let judged = |threads: &EnforcedThreads| {
            let waiting = threads.enrolled.first().unwrap();
            let counters = waiting.reservation.counters();
            (counters.early_checks, waiting.check_at())
        };
        std::thread::sleep(Duration::from_millis(8));
        assert!(state.sweep(&mut threads, Enforcement::SameCpu), "a raise");
        let (checks, next) = judged(&threads);
        assert_eq!(checks, u64::from(!exact));
        assert!(next > clock::monotonic() || !exact);
        std::thread::sleep(Duration::from_millis(8));
        assert!(!state.sweep(&mut threads, Enforcement::SameCpu));
        assert_eq!(judged(&threads).0, 1 + u64::from(!exact));
    });
}

/// The second of two threads on a CPU is to be checked when it can have used its budget,
/// and it has not begun. On b209253 its check came when the first one's did: an early check for
/// every thread and period, each with its wake-up.
#[test]
fn the_check_of_a_thread_that_waits_for_the_cpu_counts_from_the_change() {
    beside_a_sleeper(50 * MS, |state, exact| {
        std::thread::sleep(Duration::from_millis(5));
        let mut threads = state.threads.lock();
        let thread = threads.enrolled.first_mut().unwrap();
        thread.observe(clock::monotonic());
        let left = thread.reservation.server().available(clock::monotonic());
        let before = thread.check_at();
        let now = clock::monotonic();
        thread.catch_up(now);
        // Without records the enforcer does not know that the thread has not run.
        let after = if exact { now + left } else { before };
        assert!(left > 49 * MS && before < now + left);
        assert_eq!(thread.check_at(), after);
    });
}

/// The thread that begins to wait without budget is lowered, or stopped, by the next sweep, and is
/// raised as it waits.
#[test]
fn a_thread_that_begins_to_wait_without_budget_is_lowered() {
    for (low, priority) in [(Low::Background(6), 6), (Low::Suspend, 0)] {
        let test = move || {
            let config = EnforcerConfig::unpinned();
            let state = EnforcerState::new(config, Enforcement::Deferred, None);
            let mut threads = state.threads.lock();
            let mut thread = overdrawn(low, clock::monotonic());
            pretended::begin(Pretended {
                priority: 60,
                refuses: false,
            });
            thread.block(clock::monotonic());
            threads.enrolled.push(thread);
            assert!(state.sweep(&mut threads, Enforcement::SameCpu));
            assert_eq!(pretended::get().unwrap().priority, priority);
            std::thread::sleep(Duration::from_millis(3));
            assert!(state.sweep(&mut threads, Enforcement::SameCpu));
            assert_eq!(pretended::get().unwrap().priority, 60);
        };
        // A thread of its own: the kernel that it pretends is its own, too.
        std::thread::spawn(test).join().unwrap();
    }
}

/// A thread that waits in the kernel is handed the lock before it has its CPU, and the enforcer
/// waits until it does.
#[test]
fn a_reader_does_not_wait_for_the_lock_in_the_kernel() {
    let config = EnforcerConfig::unpinned();
    let state = Arc::new(EnforcerState::new(config, Enforcement::Deferred, None));
    let params = Params::new(60, Low::Background(6), MS, 100 * MS, 10).unwrap();
    let account = Account::enroll(&state, &params, Kind::Corrected).unwrap();
    let meter = account.meter();
    // Not longer than a reader is patient, also where the machine stood still meanwhile.
    let short = (0..1000).any(|_| {
        let begun = clock::monotonic();
        let threads = state.threads.lock();
        let reader = {
            let meter = meter.clone();
            std::thread::spawn(move || (meter.usage(), meter.overruns(), meter.stalls()))
        };
        let mut awaited = false;
        while since(clock::monotonic(), begun) < MS {
            awaited |= state.threads.is_awaited();
        }
        drop(threads);
        let short = since(clock::monotonic(), begun) < 3 * MS / 2;
        reader.join().unwrap();
        assert!(!(short && awaited), "waits in the kernel");
        short
    });
    assert!(short, "the machine stood still each time");
}
