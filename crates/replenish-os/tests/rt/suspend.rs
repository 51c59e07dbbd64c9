//! Workers that are lowered or stopped while they hold locks: what they use then is a debt, no
//! thread above them is kept, and nothing of a thread outlives it.
#![expect(unsafe_code, reason = "a program blocks its signals")]

use crate::common::{MS, become_fifo, burn, cpu};
use replenish_os::{
    Account, CpuSet, Enforcer, EnforcerConfig, EnrollError, GrantedPolicy, Low, Meter, Params,
    PiMutex, SchedClass, clock, current_tid, granted, set_affinity, set_priority,
};
use replenish_testkit::harness::{Trial, rt_trial};
use replenish_testkit::progress::eventually;
use replenish_testkit::watchdog::watchdog;
use replenish_testkit::witness::Witness;
use sporadic::Kind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

fn enforcer(capacity: usize) -> Arc<Enforcer> {
    let config = EnforcerConfig {
        capacity,
        ..EnforcerConfig::on_cpu(cpu())
    };
    Enforcer::start(config).unwrap()
}

/// A thread with `budget` ms per 100 ms at priority 40, in its first callback.
fn worker<T: Send + 'static>(
    enforcer: &Arc<Enforcer>,
    low: Low,
    budget: u64,
    callback: impl FnOnce(&mut Account) -> T + Send + 'static,
) -> (JoinHandle<T>, Meter) {
    let enforcer = Arc::clone(enforcer);
    let (tx, rx) = mpsc::channel();
    let thread = std::thread::spawn(move || {
        become_fifo(cpu(), 40);
        let params = Params::new(40, low, budget * MS, 100 * MS, 16).unwrap();
        let mut account = enforcer.enroll(&params, Kind::Corrected).unwrap();
        tx.send(account.meter()).unwrap();
        account.activate(clock::monotonic());
        account.callback_begin().unwrap();
        let result = callback(&mut account);
        account.callback_end();
        account.block();
        result
    });
    (thread, rx.recv().unwrap())
}

/// A program that waits for its signals on one thread has blocked them all, and its workers inherit
/// that: without budget one ran on, in the time-sharing class, until its callback ended.
fn a_program_that_blocks_all_signals_has_its_workers_stopped() {
    let _dog = watchdog("signals are blocked", Duration::from_secs(120));
    let enforcer = enforcer(8);
    let program = std::thread::spawn(move || {
        // SAFETY: all-zero is a valid set to fill in.
        let mut all: libc::sigset_t = unsafe { std::mem::zeroed() };
        // SAFETY: the set lives across the call.
        unsafe { libc::sigfillset(&raw mut all) };
        let nothing = std::ptr::null_mut();
        // SAFETY: as above.
        unsafe { libc::pthread_sigmask(libc::SIG_BLOCK, &raw const all, nothing) };
        let (thread, _) = worker(&enforcer, Low::Suspend, 5, |_| {
            let (begin, cpu) = (clock::monotonic(), clock::thread_cpu());
            while clock::monotonic() < begin + 350 * MS {}
            clock::thread_cpu() - cpu
        });
        thread.join().unwrap()
    });
    let used = program.join().unwrap();
    assert!(used < 60 * MS, "{used} ns of 350 ms, with 5 ms in each 100");
}

/// It sleeps in a section, where nothing stops it: its raise took the sleep for a stop, and it had
/// two budgets in one piece when it woke.
fn a_worker_that_blocks_in_a_section_has_one_budget_when_it_wakes() {
    let _dog = watchdog("blocks in a section", Duration::from_secs(120));
    let enforcer = enforcer(8);
    let (thread, _) = worker(&enforcer, Low::Suspend, 10, |_| {
        let mutex = PiMutex::new(());
        let guard = mutex.lock();
        burn(12 * MS);
        clock::sleep_until(clock::monotonic() + 500 * MS);
        let from = clock::thread_cpu();
        while matches!(granted(current_tid()).unwrap().policy, GrantedPolicy::Fifo) {
            burn(MS / 10);
        }
        let high = clock::thread_cpu() - from;
        drop(guard);
        high
    });
    let high = thread.join().unwrap();
    assert!(high < 13 * MS, "{high} ns");
}

/// 40 ms in a critical section on a budget of 5: it leaves every real-time priority with the end of
/// its budget, and as it leaves the section it stops until the debt is paid. On b209253 it stayed
/// FIFO 40 in the section, and went on 100 ms after its first activation.
fn a_section_that_outlasts_the_budget_is_left_low_and_paid_for() {
    let _dog = watchdog("a long section", Duration::from_secs(120));
    let enforcer = enforcer(8);
    let (thread, meter) = worker(&enforcer, Low::Suspend, 5, |_| {
        let mutex = PiMutex::new(());
        let begin = clock::monotonic();
        let guard = mutex.lock();
        burn(10 * MS);
        let inside = granted(current_tid()).unwrap().policy;
        burn(30 * MS);
        let used = clock::thread_cpu();
        drop(guard);
        let (waited, at_large) = (clock::monotonic() - begin, clock::thread_cpu() - used);
        (inside, waited, at_large)
    });
    let (inside, waited, at_large) = thread.join().unwrap();
    let usage = meter.usage();
    assert!(matches!(inside, GrantedPolicy::Other { .. }), "{inside:?}");
    // 40 ms are eight budgets: the ninth comes 800 ms after the first.
    assert!(waited >= 790 * MS, "went on after {waited} ns: {usage:?}");
    assert!(at_large < MS, "{at_large} ns after the section: {usage:?}");
    assert!(
        usage.exhaustions >= 1 && usage.cpu_low >= 30 * MS,
        "{usage:?}"
    );
}

/// A thread above all others waits for the section of a worker that is stopped with it, below a
/// thread that never yields: the worker inherits, finishes, and stops.
fn a_waiter_is_kept_for_the_section_and_no_longer() {
    let _dog = watchdog("a waiter", Duration::from_secs(120));
    let enforcer = enforcer(8);
    let mutex = Arc::new(PiMutex::new(()));
    let exhausted = Arc::new(AtomicBool::new(false));
    let over = Arc::new(AtomicBool::new(false));
    let (theirs, low) = (mutex.clone(), exhausted.clone());
    let (thread, _) = worker(&enforcer, Low::Suspend, 5, move |_| {
        let begin = clock::monotonic();
        let guard = theirs.lock();
        burn(10 * MS);
        low.store(true, Ordering::SeqCst);
        burn(10 * MS);
        drop(guard);
        clock::monotonic() - begin
    });
    while !exhausted.load(Ordering::SeqCst) {
        std::thread::sleep(Duration::from_millis(1));
    }
    let hog = std::thread::spawn({
        let over = over.clone();
        move || {
            become_fifo(cpu(), 50);
            crate::common::spin(&over);
        }
    });
    let high = std::thread::spawn(move || {
        become_fifo(cpu(), 80);
        drop(mutex.lock());
        !over.swap(true, Ordering::SeqCst)
    });
    let overtook = high.join().unwrap();
    hog.join().unwrap();
    assert!(overtook, "the hog kept the section from its end");
    let waited = thread.join().unwrap();
    // 20 ms are four budgets: the fifth comes 400 ms after the first.
    assert!(waited >= 390 * MS, "went on after {waited} ns");
}

/// A worker with 2 ms per 100 is in sections of 20 ms that a high thread waits for all the time,
/// and between them in the background. It inherits, at most its budget and one section, and then
/// it pays. On b209253 it had 80 % of the CPU above the thread at 50, for a budget of 2 %.
fn inherited_time_is_charged() {
    let _dog = watchdog("inherited time", Duration::from_secs(120));
    let enforcer = enforcer(8);
    let mutex = Arc::new(PiMutex::new(()));
    let stop = Arc::new(AtomicBool::new(false));
    let (theirs, quit) = (mutex.clone(), stop.clone());
    let (thread, meter) = worker(&enforcer, Low::Background(1), 2, move |account| {
        while !quit.load(Ordering::SeqCst) {
            let guard = theirs.lock();
            let end = clock::thread_cpu() + 20 * MS;
            while clock::thread_cpu() < end && !quit.load(Ordering::SeqCst) {}
            drop(guard);
            account.callback_end();
            if account.callback_begin().is_err() {
                return;
            }
        }
    });
    let (there, has_waited) = mpsc::channel();
    let high = std::thread::spawn({
        let (mutex, stop) = (mutex.clone(), stop.clone());
        move || {
            become_fifo(cpu(), 80);
            while !stop.load(Ordering::SeqCst) {
                drop(mutex.lock());
                there.send(()).unwrap();
                clock::sleep_until(clock::monotonic() + MS);
            }
        }
    });
    has_waited.recv().unwrap(); // until then the background was free
    let (from, before) = (clock::monotonic(), meter.usage());
    clock::sleep_until(from + 600 * MS);
    let (after, took) = (meter.usage(), clock::monotonic() - from);
    let stops = eventually(|| meter.usage().low);
    stop.store(true, Ordering::SeqCst);
    meter.cancel();
    high.join().unwrap();
    thread.join().unwrap();
    let used = after.cpu_high + after.cpu_low - before.cpu_high - before.cpu_low;
    // The idle CPU is free in the background, and yet the worker stops with the first section in
    // which it inherits as much as its budget: one for each of two budgets at most.
    let most = 60 * MS * took.div_ceil(650 * MS);
    assert!(used <= most, "{used} ns in {took}: {before:?} {after:?}");
    assert!(stops, "{after:?}");
}

/// A refused enrolment left a pointer to freed memory in its thread, and so did an account that was
/// dropped elsewhere: on b209253 the next unlock read it, and hung for ever if the memory said so.
fn nothing_of_an_account_stays_in_its_thread() {
    let _dog = watchdog("a refused enrolment", Duration::from_secs(20));
    let enforcer = enforcer(1);
    let params = Params::new(40, Low::Suspend, MS, 100 * MS, 16).unwrap();
    let unlock_among_junk = || {
        let junk: Vec<Box<[u32; 6]>> = (0..64).map(|_| Box::new([1; 6])).collect();
        let mutex = PiMutex::new(0);
        *mutex.lock() += 1;
        drop(junk);
    };
    let account = enforcer.enroll(&params, Kind::Corrected).unwrap();
    let full = Arc::clone(&enforcer);
    let refused = std::thread::spawn(move || {
        let refused = full.enroll(&params, Kind::Corrected);
        assert!(matches!(refused, Err(EnrollError::Full { capacity: 1 })));
        unlock_among_junk();
    });
    refused.join().unwrap();
    std::thread::scope(|s| {
        s.spawn(move || drop(account));
    });
    enforcer.stop();
    drop(enforcer);
    unlock_among_junk();
}

/// Threads race for the last places of an enforcer: those that get one, and those that do not, use
/// locks afterwards.
fn enrolments_race_for_the_last_places() {
    let _dog = watchdog("enrolments", Duration::from_secs(120));
    for _ in 0..20 {
        let enforcer = enforcer(3);
        let mutex = Arc::new(PiMutex::new(0));
        let threads: Vec<_> = (0..8)
            .map(|_| {
                let (enforcer, mutex) = (enforcer.clone(), mutex.clone());
                std::thread::spawn(move || {
                    let params = Params::new(40, Low::Suspend, MS, 100 * MS, 16).unwrap();
                    let account = enforcer.enroll(&params, Kind::Corrected);
                    for _ in 0..100 {
                        *mutex.lock() += 1;
                    }
                    (account.is_ok(), account.ok())
                })
            })
            .collect();
        let ends: Vec<_> = threads.into_iter().map(|t| t.join().unwrap()).collect();
        assert_eq!(ends.iter().filter(|end| end.0).count(), 3);
        assert_eq!(*mutex.lock(), 800);
    }
}

/// A guard that is forgotten in one callback does not keep the thread from being stopped in the
/// middle of the next. On b209253 it could never be stopped in a callback again.
fn a_forgotten_guard_keeps_nothing_from_stopping() {
    let _dog = watchdog("a forgotten guard", Duration::from_secs(120));
    let enforcer = enforcer(8);
    let (thread, meter) = worker(&enforcer, Low::Suspend, 10, |account| {
        let begin = clock::monotonic();
        std::mem::forget(PiMutex::new(()).lock());
        account.callback_end();
        account.callback_begin().unwrap();
        burn(30 * MS);
        clock::monotonic() - begin
    });
    let took = thread.join().unwrap();
    assert!(took >= 190 * MS, "30 ms at 10 per 100 after {took} ns");
    assert!(meter.usage().cpu_low < 2 * MS, "{:?}", meter.usage());
}

/// A worker that allocates all the time is stopped, and a thread above it frees what it allocated,
/// which takes the lock of the worker's heap. On b209253 that thread waited for the next
/// replenishment whenever the worker had been stopped inside `malloc`: up to 99 ms.
fn a_stopped_worker_does_not_keep_the_heap() {
    let _dog = watchdog("the heap", Duration::from_secs(120));
    let enforcer = enforcer(8);
    let stop = Arc::new(AtomicBool::new(false));
    let (blocks, given) = mpsc::sync_channel::<Vec<u8>>(4096);
    let quit = stop.clone();
    // Too large for the thread's own cache, too small to be mapped one by one.
    let (thread, meter) = worker(&enforcer, Low::Suspend, 10, move |_| {
        let mut kept = Vec::new();
        while !quit.load(Ordering::SeqCst) {
            if kept.len() < 512 {
                kept.push(vec![0_u8; 4096 + 64 * kept.len()]);
            } else {
                for block in kept.drain(..) {
                    blocks.try_send(block).ok();
                }
            }
        }
    });
    become_fifo(cpu(), 80);
    let (witness, from) = (Witness::start(), clock::monotonic());
    let (mut worst, mut judged) = (0, 0);
    let over = || clock::monotonic() - from >= 1_500 * MS && meter.usage().exhaustions >= 3;
    while !over() || judged < 500 {
        let (still, begin) = (witness.so_far(), clock::monotonic());
        drop(given.try_recv());
        let took = clock::monotonic() - begin;
        // Everything is late when the machine stands still; the witness is above this thread.
        if witness.so_far() == still {
            worst = worst.max(took);
            judged += 1;
        }
        clock::sleep_until(clock::monotonic() + MS);
    }
    let elapsed = clock::monotonic() - from;
    stop.store(true, Ordering::SeqCst);
    meter.cancel();
    thread.join().unwrap();
    let usage = meter.usage();
    assert!(worst < 20 * MS, "a free took {worst} ns");
    // The worker pays later for CPU time in the library after its budget; the last stretch of it is
    // still owed. Each stretch took up to 50 ms while a thread that runs was left alone for longer
    // and longer. An unstopped worker would use all of the time.
    let used = usage.cpu_high + usage.cpu_low;
    println!("{used} ns of {elapsed}, {usage:?}");
    assert!(used < elapsed / 10 + 50 * MS, "of {elapsed} ns: {usage:?}");
}

/// A worker that lives in the C library is moved from CPU to CPU while it is stopped and goes on,
/// and supervision ends while it is there: it is stopped nowhere for good, and pays on either CPU.
fn a_stopped_worker_is_moved_and_let_go_inside_the_c_library() {
    let _dog = watchdog("moved in the C library", Duration::from_secs(120));
    let enforcer = enforcer(8);
    let stop = Arc::new(AtomicBool::new(false));
    let (quit, (tell, told)) = (stop.clone(), mpsc::channel());
    let (thread, meter) = worker(&enforcer, Low::Suspend, 10, move |_| {
        tell.send(current_tid()).unwrap();
        let mut kept = Vec::new();
        while !quit.load(Ordering::SeqCst) {
            kept.push(vec![0_u8; 4096 + 64 * kept.len()]);
            if kept.len() == 512 {
                kept.clear();
            }
        }
    });
    let tid = told.recv().unwrap();
    let (from, mut to) = (clock::monotonic(), 0);
    while clock::monotonic() - from < 800 * MS || meter.usage().exhaustions < 3 {
        set_affinity(tid, &CpuSet::one(to)).unwrap();
        to = 1 - to;
        std::thread::sleep(Duration::from_millis(7));
    }
    let usage = meter.usage();
    println!("{usage:?}");
    let (used, elapsed) = (usage.cpu_high + usage.cpu_low, clock::monotonic() - from);
    assert!(used < elapsed / 10 + 220 * MS, "of {elapsed} ns: {usage:?}");
    // Low or high, stopped or not: no enforcer stops it any more, and it ends.
    meter.abandon();
    set_priority(tid, SchedClass::Other).unwrap();
    stop.store(true, Ordering::SeqCst);
    thread.join().unwrap();
}

/// A stop ends every wait for budget: the callback goes on, in the time-sharing class.
fn a_cancelled_worker_finishes_low() {
    let _dog = watchdog("cancel", Duration::from_secs(120));
    let enforcer = enforcer(8);
    let (thread, meter) = worker(&enforcer, Low::Suspend, 5, |account| {
        burn(30 * MS);
        let policy = granted(current_tid()).unwrap().policy;
        (policy, account.callback_begin().is_err())
    });
    while !meter.usage().low {
        std::thread::sleep(Duration::from_millis(1));
    }
    meter.cancel();
    let (policy, ended) = thread.join().unwrap();
    assert!(matches!(policy, GrantedPolicy::Other { .. }), "{policy:?}");
    assert!(ended);
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        rt_trial(
            "a_program_that_blocks_all_signals_has_its_workers_stopped",
            a_program_that_blocks_all_signals_has_its_workers_stopped,
        ),
        rt_trial(
            "a_worker_that_blocks_in_a_section_has_one_budget_when_it_wakes",
            a_worker_that_blocks_in_a_section_has_one_budget_when_it_wakes,
        ),
        rt_trial(
            "a_section_that_outlasts_the_budget_is_left_low_and_paid_for",
            a_section_that_outlasts_the_budget_is_left_low_and_paid_for,
        ),
        rt_trial(
            "a_waiter_is_kept_for_the_section_and_no_longer",
            a_waiter_is_kept_for_the_section_and_no_longer,
        ),
        rt_trial("inherited_time_is_charged", inherited_time_is_charged),
        rt_trial(
            "nothing_of_an_account_stays_in_its_thread",
            nothing_of_an_account_stays_in_its_thread,
        ),
        rt_trial(
            "enrolments_race_for_the_last_places",
            enrolments_race_for_the_last_places,
        ),
        rt_trial(
            "a_forgotten_guard_keeps_nothing_from_stopping",
            a_forgotten_guard_keeps_nothing_from_stopping,
        ),
        rt_trial(
            "a_stopped_worker_does_not_keep_the_heap",
            a_stopped_worker_does_not_keep_the_heap,
        ),
        rt_trial(
            "a_stopped_worker_is_moved_and_let_go_inside_the_c_library",
            a_stopped_worker_is_moved_and_let_go_inside_the_c_library,
        ),
        rt_trial(
            "a_cancelled_worker_finishes_low",
            a_cancelled_worker_finishes_low,
        ),
    ]
}
