//! Ways in which a budget was broken on Linux once, tried on the board; what each costs is printed.

use crate::budgets::enforcer;
use crate::check::{MS, US, hold, task};
use alloc::sync::Arc;
use firmware::say;
use firmware::work::Burst;
use replenish_os::{Account, Low, Meter, Nanos, Params, PiMutex, Usage, clock};
use sporadic::Kind;

/// A worker of priority 60 that does this with its account from `begin` on, and its meter.
fn worker(
    params: (Low, Nanos, Nanos, u16),
    begin: Nanos,
    body: impl FnOnce(&mut Account) + Send + 'static,
) -> Arc<PiMutex<Option<Meter>>> {
    let (low, budget, period, repl) = params;
    let Ok(params) = Params::new(60, low, budget, period, repl) else {
        say!("wrong: no parameters");
        firmware::console::exit(false)
    };
    let (meter, enforcer) = (Arc::new(PiMutex::new(None)), enforcer());
    let theirs = Arc::clone(&meter);
    task("worker", 60, move || {
        let Ok(mut account) = enforcer.enroll(&params, Kind::Corrected) else {
            say!("wrong: not enrolled");
            firmware::console::exit(false)
        };
        *theirs.lock() = Some(account.meter());
        clock::sleep_until(begin);
        account.activate(begin);
        body(&mut account);
    });
    meter
}

fn used(meter: &PiMutex<Option<Meter>>) -> Usage {
    meter.lock().as_ref().map(Meter::usage).unwrap_or_default()
}

fn endless() -> ! {
    loop {
        core::hint::black_box(());
    }
}

/// A budget that suspends ends inside a lock for which no task waits as everywhere else.
pub fn suspended_in_lock(_: Burst) {
    let begin = clock::monotonic() + 5 * MS;
    let params = (Low::Suspend, 5 * MS, 100 * MS, 10);
    let meter = worker(params, begin, |_| {
        let lock = PiMutex::new(());
        let _held = lock.lock();
        endless();
    });
    clock::sleep_until(begin + 495 * MS);
    let usage = used(&meter);
    say!(
        "5 ms per 100 ms in a lock: {} us high, {} us low in 495 ms",
        usage.cpu_high / US,
        usage.cpu_low / US
    );
    hold!(
        usage.cpu_high.abs_diff(25 * MS) < 100 * US,
        "{} ns instead of 25 ms",
        usage.cpu_high
    );
    hold!(
        usage.cpu_low < 100 * US,
        "{} ns while suspended",
        usage.cpu_low
    );
}

/// A worker whose budget ends in each of its long sections, for which another task waits, has one
/// section per replenishment on top.
pub fn inherited(burst: Burst) {
    let begin = clock::monotonic() + 5 * MS;
    let lock = Arc::new(PiMutex::new(()));
    let (theirs, params) = (Arc::clone(&lock), (Low::Background(6), MS, 100 * MS, 10));
    let meter = worker(params, begin, move |account| {
        while account.callback_begin().is_ok() {
            let held = theirs.lock();
            burst.run_us(50_000);
            drop(held);
            account.callback_end();
        }
    });
    let theirs = Arc::clone(&lock);
    task("waiter", 50, move || {
        clock::sleep_until(begin);
        loop {
            clock::sleep_until(clock::monotonic() + MS);
            drop(theirs.lock());
        }
    });
    task("third", 40, move || {
        clock::sleep_until(begin);
        endless();
    });
    clock::sleep_until(begin + 2_000 * MS);
    let usage = used(&meter);
    let all = usage.cpu_high + usage.cpu_low;
    say!(
        "1 ms per 100 ms, sections of 50 ms: {} us of 2 s, {} us of it high",
        all / US,
        usage.cpu_high / US
    );
    // Inherited time is not charged here: twenty budgets, each with the rest of one section.
    hold!(
        all < 20 * 50 * MS + 2 * MS,
        "{} us by inheritance",
        usage.cpu_low / US
    );
}

/// Odd and small reservations get their share to a thousandth of the CPU.
pub fn shares(_: Burst) {
    let begin = clock::monotonic() + 5 * MS;
    for (budget, period) in [(800 * US, 3 * MS), (100 * US, MS), (50 * US, 500 * US)] {
        let start = clock::monotonic().max(begin) + MS;
        let meter = worker((Low::Background(6), budget, period, 10), start, |_| {
            endless()
        });
        clock::sleep_until(start + 600 * MS);
        let wanted = 600 * MS / period * budget;
        let high = used(&meter).cpu_high;
        say!(
            "{} us per {} us: {} us high of {}",
            budget / US,
            period / US,
            high / US,
            wanted / US
        );
        hold!(
            high.abs_diff(wanted) < 600 * US,
            "{high} ns instead of {wanted}"
        );
        let Some(meter) = meter.lock().take() else {
            return;
        };
        meter.abandon();
        replenish_os::set_priority(meter.tid(), replenish_os::SchedClass::Fifo(1)).ok();
    }
}

/// A small budget that blocks inside its callback ends on time.
pub fn small_and_blocking(burst: Burst) {
    let begin = clock::monotonic() + 5 * MS;
    let meter = worker(
        (Low::Background(6), 200 * US, 10 * MS, 10),
        begin,
        move |account| {
            for round in 0.. {
                let release = begin + round * 10 * MS;
                clock::sleep_until(release);
                account.activate(release);
                if account.callback_begin().is_err() {
                    return;
                }
                burst.run_us(100);
                clock::sleep_until(clock::monotonic() + 300 * US);
                burst.run_us(800);
                account.callback_end();
                account.block();
            }
        },
    );
    clock::sleep_until(begin + 500 * MS);
    let worst = meter
        .lock()
        .as_ref()
        .map(Meter::overruns)
        .unwrap_or_default();
    let usage = used(&meter);
    say!(
        "200 us per 10 ms, blocking: {} us high in 50 periods; overrun median {} ns, p99 {} ns",
        usage.cpu_high / US,
        worst.median,
        worst.p99
    );
    hold!(
        usage.cpu_high < 50 * 200 * US + 100 * US,
        "{} ns high",
        usage.cpu_high
    );
}

/// A worker that asks for a sixth of its budget in small pieces is never without where there is
/// room for the pieces; with one replenishment, which takes them all together, it is once in 60
/// pieces.
pub fn small_pieces(burst: Burst) {
    for (repl, most) in [(10, 0), (1, 1)] {
        let begin = clock::monotonic() + 5 * MS;
        let params = (Low::Background(6), 30 * MS, 100 * MS, repl);
        let meter = worker(params, begin, move |account| {
            for round in 0..95 {
                let release = begin + round * 10 * MS;
                clock::sleep_until(release);
                account.activate(release);
                if account.callback_begin().is_err() {
                    return;
                }
                burst.run_us(500);
                account.callback_end();
                account.block();
            }
            clock::sleep_until(begin + 2_000 * MS);
        });
        clock::sleep_until(begin + 1_000 * MS);
        let usage = used(&meter);
        say!(
            "5 of 30 ms per 100 ms, {repl} replenishments: {} exhaustions, {} us low",
            usage.exhaustions,
            usage.cpu_low / US
        );
        hold!(
            usage.exhaustions <= most,
            "{} exhaustions",
            usage.exhaustions
        );
    }
}
