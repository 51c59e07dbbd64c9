//! Waiting: hand-off, timers, timeouts, sleep, and the overflow of the board's clock.

use crate::check::{MS, Order, US, hold, join, task};
use alloc::sync::Arc;
use core::sync::atomic::{AtomicU32, Ordering};
use firmware::regs::{IRQ_USART2, Reg, enable_interrupt};
use firmware::work::Burst;
use replenish_os::{Nanos, Notify, WakeFd, clock, timer::TimerFd};

/// Every set wakes the waiter: one above the caller before the caller goes on, one below it when
/// the caller waits; nothing is lost in 1000 rounds.
pub fn hand_off(_: Burst) {
    const ROUNDS: u32 = 1000;
    let there = Arc::new((Notify::new(), Notify::new(), AtomicU32::new(0)));
    let theirs = Arc::clone(&there);
    let above = task("above", 50, move || {
        for _ in 0..ROUNDS {
            theirs.0.wait();
            theirs.2.fetch_add(1, Ordering::SeqCst);
            theirs.1.set();
        }
    });
    let theirs = Arc::clone(&there);
    let below = task("below", 20, move || {
        let mut at_once = 0;
        for round in 0..ROUNDS {
            theirs.0.set();
            at_once += u32::from(theirs.2.load(Ordering::SeqCst) == round + 1);
            theirs.1.wait();
        }
        at_once
    });
    join(above);
    let at_once = join(below);
    hold!(
        at_once == ROUNDS,
        "{at_once} of {ROUNDS} waiters ran at once"
    );

    let order = Order::new();
    let signal = Arc::new(Notify::new());
    let (theirs, noted) = (Arc::clone(&signal), order.clone());
    let waiter = task("waiter", 20, move || {
        theirs.wait();
        noted.note('w');
    });
    let noted = order.clone();
    let caller = task("caller", 30, move || {
        clock::sleep_until(clock::monotonic() + MS);
        signal.set();
        signal.set(); // counts once
        noted.note('c');
    });
    join(caller);
    join(waiter);
    hold!(
        order.is("cw"),
        "the lower one runs when the caller has ended"
    );
}

static FROM_INTERRUPT: Notify = Notify::new();

/// A signal set by an interrupt handler.
pub fn hand_off_interrupt(burst: Burst) {
    const ROUNDS: u32 = 100;
    firmware::board::on_usart2(|| FROM_INTERRUPT.set());
    enable_interrupt(IRQ_USART2);
    let count = Arc::new(AtomicU32::new(0));
    let theirs = Arc::clone(&count);
    let waiter = task("waiter", 50, move || {
        for _ in 0..ROUNDS {
            FROM_INTERRUPT.wait();
            theirs.fetch_add(1, Ordering::SeqCst);
        }
    });
    let at_once = join(task("raiser", 20, move || {
        let mut at_once = 0;
        for round in 0..ROUNDS {
            // NVIC_ISPR: as if the port had raised it.
            Reg(0xE000_E200 + IRQ_USART2 / 32 * 4).set(1 << (IRQ_USART2 % 32));
            burst.run_us(10);
            at_once += u32::from(count.load(Ordering::SeqCst) == round + 1);
        }
        at_once
    }));
    hold!(at_once == ROUNDS, "{at_once} of {ROUNDS} ran within 10 us");
    join(waiter);
}

/// Tasks wake in the order of their times; at one time, by priority. A timer that is moved fires
/// when it says last.
pub fn timers_ordered(_: Burst) {
    let begin = clock::monotonic() + 5 * MS;
    let order = Order::new();
    let set = [
        ('d', 20, 5 * MS),
        ('a', 30, MS),
        ('c', 10, 3 * MS),
        ('b', 40, 3 * MS),
        ('e', 60, 5 * MS + 300 * US),
    ];
    let sleepers = set.map(|(name, priority, after)| {
        let noted = order.clone();
        task("sleeper", priority, move || {
            clock::sleep_until(begin + after);
            noted.note(name);
            clock::monotonic() - begin - after
        })
    });
    let late = sleepers.map(join);
    hold!(order.is("abcde"), "by time, then by priority");
    hold!(late.iter().all(|l| *l < 200 * US), "late by {late:?} ns");

    let Ok(timer) = TimerFd::new() else {
        hold!(false, "no timer");
        return;
    };
    let timer = Arc::new(timer);
    let theirs = Arc::clone(&timer);
    let begin = clock::monotonic();
    timer.arm(begin + 9 * MS).ok();
    let reader = task("reader", 50, move || {
        let mut fired = [0; 3];
        for at in &mut fired {
            theirs.read().ok();
            *at = clock::monotonic() - begin;
        }
        fired
    });
    clock::sleep_until(begin + MS);
    timer.arm(begin + 3 * MS).ok(); // earlier
    clock::sleep_until(begin + 4 * MS);
    timer.arm(begin + 5 * MS).ok();
    timer.arm(begin + 8 * MS).ok(); // later
    clock::sleep_until(begin + 10 * MS);
    timer.arm(begin + 11 * MS).ok();
    timer.disarm().ok();
    clock::sleep_until(begin + 15 * MS);
    timer.arm(1).ok(); // passed long ago: at once
    let fired = join(reader);
    let wanted = [3 * MS, 8 * MS, 15 * MS];
    let near = |(f, w): (&Nanos, &Nanos)| *f >= *w && *f - *w < 200 * US;
    hold!(fired.iter().zip(&wanted).all(near), "fired at {fired:?}");
}

/// A wait with an end ends then, not before; a set that came is taken also after it.
pub fn timeouts(_: Burst) {
    let signal = Arc::new(Notify::new());
    let begin = clock::monotonic();
    for i in 1..=20 {
        let end = begin + i * MS + i * 137;
        let woken = signal.wait_until(end);
        let now = clock::monotonic();
        hold!(!woken, "nobody set it");
        hold!(now >= end && now - end < 100 * US, "{now} for {end}");
    }
    signal.set();
    hold!(
        signal.wait_until(1),
        "a set that is there is taken after the end"
    );
    hold!(!signal.wait_until(1), "and only once");
    let theirs = Arc::clone(&signal);
    let setter = task("setter", 20, move || {
        clock::sleep_until(clock::monotonic() + 2 * MS);
        theirs.set();
    });
    let before = clock::monotonic();
    hold!(signal.wait_until(before + 50 * MS), "set in between");
    let waited = clock::monotonic() - before;
    hold!(waited < 3 * MS, "{waited} ns for a set after 2 ms");
    join(setter);
    if let Ok(wake) = WakeFd::new() {
        let end = clock::monotonic() + MS;
        hold!(!wake.wait_until(Some(end)), "nobody woke it");
        wake.wake();
        hold!(wake.wait_until(Some(1)), "woken before");
    } else {
        hold!(false, "no wake-up");
    }
    let endless = task("endless", 10, || Notify::new().wait());
    let left = endless.join_until(clock::monotonic() + 2 * MS);
    hold!(left.is_err(), "a task that waits for ever was joined");
}

/// Sleeps of 1 us to 50 ms never end early and are late by the same few instructions.
pub fn sleep(_: Burst) {
    let late = join(task("sleeper", 60, || {
        let mut worst: Nanos = 0;
        for i in 0..1000_u64 {
            // Lengths spread over five decades.
            let length = (i * 7919 % 50_000 + 1) * if i % 2 == 0 { US } else { 13 };
            let end = clock::monotonic() + length;
            clock::sleep_until(end);
            let now = clock::monotonic();
            hold!(now >= end, "woke {} ns early from {length} ns", end - now);
            worst = worst.max(now.saturating_sub(end));
        }
        worst
    }));
    hold!(late < 50 * US, "late by up to {late} ns");
    firmware::say!("late by at most {late} ns in 1000 sleeps");
}

/// The 32-bit timer under the clock goes round after 18 minutes: time goes on evenly.
pub fn long_clock(_: Burst) {
    let begin = clock::monotonic();
    let mut last = begin;
    for minute in 1..=40_u64 {
        let end = begin + minute * 60_000 * MS;
        clock::sleep_until(end);
        let now = clock::monotonic();
        hold!(
            now >= end && now - end < 100 * US,
            "minute {minute}: {now} for {end}"
        );
        hold!(now > last, "minute {minute}: time went back");
        last = now;
    }
}
