//! The assertions of the tests on Linux, checked on the system itself.
//!
//! Hand-off, waits, timers, locks with inheritance, blocking inside callbacks, a panic: each prints
//! `ok` or `FAILED`.

use crate::say;
use alloc::sync::Arc;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use replenish_os::timer::TimerFd;
use replenish_os::{
    Enforcer, EnforcerConfig, Low, Notify, Params, PiMutex, Policy, Thread, ThreadSpec, clock,
    current_tid, demote_to_tail, granted, nuttx, spawn,
};

const MS: u64 = 1_000_000;

/// The main thread's priority: above the loads, so that it ends each measurement on time, and below
/// the enforcer.
pub(crate) const MAIN: u8 = 90;

/// A check by name.
type Check = (&'static str, fn() -> bool);

/// Runs them all; how many failed.
pub(crate) fn run() -> u32 {
    let checks: [Check; 10] = [
        ("two threads hand over 1000 times", hand_off),
        ("no wait ends early, none 2 ticks late", waits),
        ("a timer moves under a blocked reader", timer),
        ("a limited wait for a lock ends in time", limited),
        ("a waiter lends its priority", inversion),
        ("through a chain of locks", chain),
        ("lowering an owner leaves its boost", lowered),
        ("blocking inside a callback is seen", blocking),
        ("a panic stops its thread alone", panic_stops),
        ("ended threads leave their records", records),
    ];
    let mut failed = 0;
    for (name, check) in checks {
        let good = check();
        failed += u32::from(!good);
        say!("  {}: {name}", if good { "ok" } else { "FAILED" });
    }
    failed
}

fn at(priority: u8, f: impl FnOnce() -> bool + Send + 'static) -> Option<Thread<bool>> {
    let spec = ThreadSpec::new("check").policy(Policy::Fifo { priority });
    spawn(spec, f).ok()
}

fn ended(thread: Option<Thread<bool>>) -> bool {
    let patience = clock::monotonic() + 5_000 * MS;
    let done = thread.and_then(|t| t.join_until(patience).ok());
    matches!(done, Some(Ok(true)))
}

fn burn(ns: u64) {
    let end = clock::thread_cpu() + ns;
    while clock::thread_cpu() < end {}
}

fn priority() -> u8 {
    granted(current_tid()).map_or(0, |g| g.priority)
}

fn hand_off() -> bool {
    const ROUNDS: u32 = 1000;
    let [ping, pong] = [(); 2].map(|()| Arc::new(Notify::new()));
    let (theirs, back) = (Arc::clone(&ping), Arc::clone(&pong));
    let other = at(80, move || {
        for _ in 0..ROUNDS {
            theirs.wait();
            back.set();
        }
        true
    });
    let answered = (0..ROUNDS).all(|_| {
        ping.set();
        pong.wait_until(clock::monotonic() + 1_000 * MS)
    });
    answered && ended(other)
}

fn waits() -> bool {
    let tick = nuttx::check().map_or(MS, |f| f.tick);
    (1..40).all(|i| {
        let until = clock::monotonic() + i * 137_000;
        clock::sleep_until(until);
        let now = clock::monotonic();
        now >= until && now < until + 2 * tick + MS / 10
    })
}

fn timer() -> bool {
    let Ok(timer) = TimerFd::new().map(Arc::new) else {
        return false;
    };
    timer.arm(clock::monotonic() + 3_600_000 * MS).ok();
    let theirs = Arc::clone(&timer);
    let reader = at(80, move || theirs.read().is_ok());
    clock::sleep_until(clock::monotonic() + 5 * MS);
    let waited = reader.as_ref().is_some_and(|r| !r.is_finished());
    timer.arm(clock::monotonic() + MS).ok();
    waited && ended(reader)
}

fn limited() -> bool {
    let lock = Arc::new(PiMutex::new(()));
    let held = lock.lock();
    let theirs = Arc::clone(&lock);
    let waiter = at(95, move || {
        let limit = clock::monotonic() + 3 * MS;
        let none = theirs.lock_until(limit).is_none();
        none && clock::monotonic() >= limit
    });
    let (in_time, mine) = (ended(waiter), priority());
    drop(held);
    in_time && mine == MAIN && lock.try_lock().is_some()
}

/// Low locks, middle starts and wakes high, high wants the lock, and the middle one hogs the CPU.
fn inversion() -> bool {
    let lock = Arc::new(PiMutex::new(()));
    let [hog_ended, overtook] = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
    let [wake_high, wake_middle] = [(); 2].map(|()| Arc::new(Notify::new()));
    let high = {
        let (lock, ended, bell) = (lock.clone(), hog_ended.clone(), wake_high.clone());
        let overtook = overtook.clone();
        at(80, move || {
            bell.wait();
            let _guard = lock.lock();
            overtook.store(!ended.load(Ordering::SeqCst), Ordering::SeqCst);
            true
        })
    };
    let middle = {
        let (ended, bell) = (hog_ended.clone(), wake_middle.clone());
        at(70, move || {
            bell.wait();
            wake_high.set();
            burn(40 * MS);
            ended.store(true, Ordering::SeqCst);
            true
        })
    };
    let low = at(30, move || {
        let _guard = lock.lock();
        wake_middle.set();
        burn(2 * MS);
        true
    });
    ended(high) & ended(middle) & ended(low) && overtook.load(Ordering::SeqCst)
}

fn lowered() -> bool {
    let lock = Arc::new(PiMutex::new(()));
    let theirs = Arc::clone(&lock);
    owner_at_30(&lock, move || drop(theirs.lock()))
}

/// A thread at 70 waits for the lock of one at 40, which waits for the owner's.
fn chain() -> bool {
    let [first, second] = [(); 2].map(|()| Arc::new(PiMutex::new(())));
    let (f, s) = (Arc::clone(&first), Arc::clone(&second));
    let holds = Arc::new(AtomicBool::new(false));
    let tell = Arc::clone(&holds);
    let middle = at(40, move || {
        clock::sleep_until(clock::monotonic() + 10 * MS);
        let _second = s.lock();
        tell.store(true, Ordering::SeqCst);
        drop(f.lock());
        true
    });
    let good = owner_at_30(&first, move || {
        while !holds.load(Ordering::SeqCst) {
            clock::sleep_until(clock::monotonic() + MS);
        }
        clock::sleep_until(clock::monotonic() + 2 * MS);
        drop(second.lock());
    });
    good & ended(middle)
}

/// An owner at 30 is raised to 70 by `wait`, is lowered to 5, keeps 70, and has 5 when it unlocks.
fn owner_at_30(lock: &Arc<PiMutex<()>>, wait: impl FnOnce() + Send + 'static) -> bool {
    let (theirs, locked) = (Arc::clone(lock), Arc::new(Notify::new()));
    let tell = Arc::clone(&locked);
    let owner = at(30, move || {
        let guard = theirs.lock();
        let alone = priority();
        tell.set();
        let end = clock::monotonic() + 2_000 * MS;
        while priority() < 70 && clock::monotonic() < end {
            burn(MS / 10);
        }
        let boosted = priority();
        demote_to_tail(current_tid(), 5).ok();
        let lowered = priority();
        drop(guard);
        (alone, boosted, lowered, priority()) == (30, 70, 70, 5)
    });
    locked.wait();
    let waiter = at(70, move || {
        wait();
        true
    });
    ended(waiter) & ended(owner)
}

/// 4 ms of work and 16 ms of sleep inside a callback stay within 30 % and are never lowered.
fn blocking() -> bool {
    let Ok(enforcer) = Enforcer::start(EnforcerConfig::on_cpu(0)) else {
        return false;
    };
    let Ok(params) = Params::new(60, Low::Background(6), 30 * MS, 100 * MS, 10) else {
        return false;
    };
    let worker = at(60, move || {
        let Ok(mut account) = enforcer.enroll(&params, sporadic::Kind::Corrected) else {
            return false;
        };
        account.activate(clock::monotonic());
        for _ in 0..20 {
            if account.callback_begin().is_err() {
                return false;
            }
            burn(4 * MS);
            clock::sleep_until(clock::monotonic() + 16 * MS);
            account.callback_end();
        }
        let usage = account.meter().usage();
        // Between two readings by the enforcer it distinguishes four stretches.
        let seen = account.meter().sees_blocking() && usage.blocked_inside >= 4;
        if !seen || usage.cpu_low > 0 {
            say!("  {usage:?}");
        }
        seen && usage.cpu_low == 0
    });
    ended(worker)
}

fn panic_stops() -> bool {
    let before = nuttx::panicked().count;
    let thread = at(80, || {
        let nothing: Option<bool> = core::hint::black_box(None);
        nothing.expect("on purpose")
    });
    clock::sleep_until(clock::monotonic() + 5 * MS);
    nuttx::panicked().count == before + 1 && thread.is_some_and(|t| !t.is_finished())
}

/// Thirty threads one after the other take no more than a few numbers.
fn records() -> bool {
    let highest = Arc::new(AtomicU32::new(0));
    let all = (0..30).all(|_| {
        let seen = Arc::clone(&highest);
        let thread = at(95, move || {
            let id = u32::try_from(current_tid().get()).unwrap_or(u32::MAX);
            seen.fetch_max(id, Ordering::SeqCst);
            true
        });
        ended(thread)
    });
    all && highest.load(Ordering::SeqCst) < 12
}
