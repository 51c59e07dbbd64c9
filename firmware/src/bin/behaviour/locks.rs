//! Priority inheritance: the task that holds a lock has the priority of the highest that waits for
//! it, through chains of locks, and also if it is lowered while it holds it.

use crate::check::{MS, Order, hold, join, my_priority, task};
use alloc::sync::Arc;
use firmware::work::Burst;
use replenish_os::{Enforcer, EnforcerConfig, Low, Nanos, Params, PiMutex, clock};
use sporadic::Kind;

/// Low holds the lock, high waits for it, mid would keep low from giving it back.
pub fn inherits(burst: Burst) {
    let lock = Arc::new(PiMutex::new(()));
    let order = Order::new();
    let begin = clock::monotonic() + 5 * MS;
    let (theirs, noted) = (Arc::clone(&lock), order.clone());
    let low = task("low", 10, move || {
        clock::sleep_until(begin);
        let guard = theirs.lock();
        let before = my_priority();
        burst.run_us(20_000);
        let held = my_priority();
        noted.note('l');
        drop(guard);
        (before, held, my_priority())
    });
    let noted = order.clone();
    let mid = task("mid", 30, move || {
        clock::sleep_until(begin + 5 * MS);
        burst.run_us(50_000);
        noted.note('m');
    });
    let (theirs, noted) = (Arc::clone(&lock), order.clone());
    let high = task("high", 50, move || {
        clock::sleep_until(begin + 6 * MS);
        drop(theirs.lock());
        noted.note('h');
        clock::monotonic() - begin
    });
    let (before, held, after) = join(low);
    join(mid);
    let waited = join(high);
    hold!(order.is("lhm"), "low gives it back before mid is done");
    hold!(
        (before, held, after) == (10, 50, 10),
        "priority of the owner: {before}, {held}, {after} instead of 10, 50, 10"
    );
    // 20 ms of work under the lock, of which mid took 1 ms before high came.
    hold!(waited < 22 * MS, "high waited until {waited} ns");
}

/// high waits for what mid holds, who waits for what low holds: low inherits from high.
pub fn chain(burst: Burst) {
    let locks = Arc::new((PiMutex::new(()), PiMutex::new(())));
    let order = Order::new();
    let begin = clock::monotonic() + 5 * MS;
    let (theirs, noted) = (Arc::clone(&locks), order.clone());
    let low = task("low", 10, move || {
        clock::sleep_until(begin);
        let guard = theirs.0.lock();
        burst.run_us(20_000);
        let held = my_priority();
        noted.note('l');
        drop(guard);
        (held, my_priority())
    });
    let (theirs, noted) = (Arc::clone(&locks), order.clone());
    let mid = task("mid", 30, move || {
        clock::sleep_until(begin + MS);
        let outer = theirs.1.lock();
        drop(theirs.0.lock());
        let held = my_priority();
        noted.note('m');
        drop(outer);
        (held, my_priority())
    });
    let (theirs, noted) = (Arc::clone(&locks), order.clone());
    let high = task("high", 50, move || {
        clock::sleep_until(begin + 2 * MS);
        drop(theirs.1.lock());
        noted.note('h');
    });
    let noted = order.clone();
    let other = task("other", 40, move || {
        clock::sleep_until(begin + 3 * MS);
        burst.run_us(50_000);
        noted.note('o');
    });
    let (low, mid) = (join(low), join(mid));
    join(high);
    join(other);
    hold!(
        order.is("lmho"),
        "the chain is released before other is done"
    );
    hold!(low == (50, 10), "low had {low:?} instead of (50, 10)");
    hold!(mid == (50, 30), "mid had {mid:?} instead of (50, 30)");
}

/// Waiters of a lock get it by priority, equals in order of arrival.
pub fn order(burst: Burst) {
    let lock = Arc::new(PiMutex::new(()));
    let order = Order::new();
    let begin = clock::monotonic() + 5 * MS;
    let theirs = Arc::clone(&lock);
    let owner = task("owner", 60, move || {
        clock::sleep_until(begin);
        let guard = theirs.lock();
        clock::sleep_until(begin + 10 * MS);
        drop(guard);
    });
    let wanted = [('a', 20, 1), ('b', 40, 2), ('c', 30, 3), ('d', 40, 4)];
    let waiters = wanted.map(|(name, priority, at)| {
        let (theirs, noted) = (Arc::clone(&lock), order.clone());
        task("waiter", priority, move || {
            clock::sleep_until(begin + at * MS);
            let guard = theirs.lock();
            noted.note(name);
            burst.run_us(500);
            drop(guard);
        })
    });
    join(owner);
    waiters.into_iter().for_each(join);
    hold!(order.is("bdca"), "by priority, then by arrival");
}

/// A limited wait ends in time, and takes the priority back that it had lent; a later one gets the
/// lock. (The owner sleeps at the end of the wait: as long as it runs with the waiter's priority,
/// the waiter, its equal, does not.)
pub fn limited_wait(burst: Burst) {
    for again in [false, true] {
        let lock = Arc::new(PiMutex::new(()));
        let begin = clock::monotonic() + 5 * MS;
        let theirs = Arc::clone(&lock);
        let owner = task("owner", 20, move || {
            clock::sleep_until(begin);
            let guard = theirs.lock();
            burst.run_us(2_000);
            let lent = my_priority();
            clock::sleep_until(begin + 6 * MS);
            let later = my_priority();
            drop(guard);
            (lent, later, my_priority())
        });
        let waiter = task("waiter", 40, move || {
            clock::sleep_until(begin + MS);
            let none = lock.lock_until(begin + 5 * MS).is_none();
            let late = clock::monotonic() - begin;
            let there = again && lock.lock_until(begin + 50 * MS).is_some();
            (none, late, there)
        });
        let priorities = join(owner);
        let (none, late, there) = join(waiter);
        let wanted = (40, if again { 40 } else { 20 }, 20);
        hold!(
            priorities == wanted,
            "the owner had {priorities:?} instead of {wanted:?}"
        );
        hold!(none && there == again, "none {none}, then there {there}");
        let in_time = 5 * MS..5 * MS + MS / 10;
        hold!(in_time.contains(&late), "the wait ended at {late} ns");
    }
}

/// A worker whose budget ends while it holds a lock goes on at its waiter's priority, whether that
/// came before or after the end, and is at its background priority when it has given it back.
pub fn in_background(burst: Burst) {
    for waits_at in [2 * MS, 10 * MS] {
        exhausted_owner(burst, Low::Background(6), waits_at);
    }
}

/// The same for a worker that is suspended when its budget has ended.
pub fn in_suspension(burst: Burst) {
    for waits_at in [2 * MS, 10 * MS] {
        exhausted_owner(burst, Low::Suspend, waits_at);
    }
}

fn exhausted_owner(burst: Burst, low: Low, waits_at: Nanos) {
    let Ok(enforcer) = Enforcer::start(EnforcerConfig::on_cpu(0)) else {
        hold!(false, "no enforcer");
        return;
    };
    let params = Params::new(60, low, 5 * MS, 100 * MS, 10);
    let Ok(params) = params else {
        hold!(false, "no parameters");
        return;
    };
    let lock = Arc::new(PiMutex::new(()));
    let begin = clock::monotonic() + 5 * MS;
    let (theirs, its) = (Arc::clone(&lock), replenish_os::Arc::clone(&enforcer));
    let worker = task("worker", 60, move || {
        let Ok(mut account) = its.enroll(&params, Kind::Corrected) else {
            return (0, 0, 0);
        };
        clock::sleep_until(begin);
        account.activate(begin);
        account.callback_begin().ok();
        let guard = theirs.lock();
        burst.run_us(1_000);
        // The waiter that comes now finds an owner above it, and nothing to inherit yet.
        clock::sleep_until(begin + 3 * MS);
        burst.run_us(14_000);
        let held = my_priority();
        drop(guard);
        (held, my_priority(), clock::monotonic() - begin)
    });
    let theirs = Arc::clone(&lock);
    let waiter = task("waiter", 50, move || {
        clock::sleep_until(begin + waits_at);
        drop(theirs.lock());
        clock::monotonic() - begin
    });
    let hog = task("hog", 40, move || {
        clock::sleep_until(begin);
        burst.run_us(60_000);
    });
    let got = join(waiter);
    join(hog);
    let (held, after, resumed) = join(worker);
    hold!(
        held == 50,
        "{low:?}, wait at {waits_at}: owner at {held}, waiter at 50"
    );
    // The budget ends at 7 ms; 15 ms of work under the lock, 2 ms blocked, and 3 ms of the hog's
    // while no task waited.
    hold!(
        got < 21 * MS,
        "{low:?}, wait at {waits_at}: the lock came after {got} ns"
    );
    match low {
        Low::Background(p) => {
            hold!(after == p, "at {after} after the unlock instead of {p}");
        }
        // The worker went on only when its budget came back.
        Low::Suspend => {
            hold!(
                after == 60 && resumed > 99 * MS,
                "suspended after the unlock, but at {after} after {resumed} ns"
            );
        }
    }
    enforcer.stop();
}
