//! The same promises through the executor.

use crate::HEAP;
use crate::check::{MS, hold};
use alloc::string::ToString;
use core::sync::atomic::{AtomicU32, Ordering};
use core::time::Duration;
use firmware::say;
use firmware::work::Burst;
use replenish::{Budget, Context, Error, Executor, Policy, RunningExecutor};
use replenish_os::clock;
use replenish_os::freertos::{kernel, panicked};

const STACK: usize = 4096;

fn or_fail<T>(done: Result<T, Error>) -> Option<T> {
    done.inspect_err(|e| hold!(false, "{e}")).ok()
}

/// Ten timers of 100 ms: one wake-up of the board for each release, none besides.
pub fn idle_ten_timers(_: Burst) {
    static RELEASES: AtomicU32 = AtomicU32::new(0);
    let ten = || -> Result<RunningExecutor, Error> {
        let context = Context::in_process();
        let mut exec = Executor::new(&context);
        let mut worker = exec
            .worker("timers")
            .policy(Policy::fifo(60)?)
            .stack_size(STACK);
        for i in 0..10 {
            let every = replenish::Every::period(Duration::from_millis(100))
                .first_after(Duration::from_millis(100 + i * 10));
            worker = worker.timer(every, |_| {
                RELEASES.fetch_add(1, Ordering::Relaxed);
            })?;
        }
        exec.start()
    };
    let Some(running) = or_fail(ten()) else {
        return;
    };
    HEAP.seal();
    clock::sleep_until(clock::monotonic() + 255 * MS);
    let (before, first) = (kernel(), RELEASES.load(Ordering::Relaxed));
    clock::sleep_until(clock::monotonic() + 10_000 * MS);
    let (after, last) = (kernel(), RELEASES.load(Ordering::Relaxed));
    let alarms = after.alarms.wrapping_sub(before.alarms);
    let waits = after.idle_waits.wrapping_sub(before.idle_waits);
    let releases = last - first;
    say!("10 s: {releases} releases, {alarms} interrupts of the timer, {waits} sleeps");
    hold!(releases == 1000, "{releases} releases, not 1000");
    // One more of each: the end of this measurement.
    hold!(
        alarms <= releases + 1,
        "{alarms} interrupts for {releases} releases"
    );
    hold!(
        waits <= releases + 1,
        "{waits} sleeps for {releases} releases"
    );
    core::mem::forget(running);
}

/// The report tells the policy that the kernel has, not the one that was asked for.
pub fn granted_as_asked(_: Burst) {
    let described = || -> Result<RunningExecutor, Error> {
        let context = Context::in_process();
        let mut exec = Executor::new(&context);
        exec.worker("held")
            .policy(Policy::fifo(60)?)
            .budget(Budget::of(Duration::from_millis(30)).every(Duration::from_millis(100)))
            .stack_size(STACK)
            .timer(Duration::from_millis(10), |_| ())?;
        exec.worker("free")
            .policy(Policy::fifo(40)?)
            .stack_size(STACK)
            .timer(Duration::from_millis(10), |_| ())?;
        exec.start()
    };
    let Some(running) = or_fail(described()) else {
        return;
    };
    clock::sleep_until(clock::monotonic() + 50 * MS);
    let report = running.report();
    for (name, priority) in [("held", 60), ("free", 40)] {
        let Some(thread) = report.thread(name) else {
            hold!(false, "no {name}");
            continue;
        };
        let wanted = alloc::format!("FIFO {priority}");
        let (asked, got) = (&thread.requested, &thread.granted);
        say!(
            "{name}: asked {asked}, granted {got}, {:?}",
            thread.enforcement
        );
        hold!(got.contains(&wanted), "{name} is told to have {got}");
    }
    let held = report
        .thread("held")
        .is_some_and(|t| t.enforcement.is_some());
    hold!(held, "the budget is not told to be held");
    core::mem::forget(running);
}

/// A worker whose policy cannot be granted: the executor does not start, and says whose and why.
pub fn refused(_: Burst) {
    let start = |policy: Policy| {
        let context = Context::in_process();
        let mut exec = Executor::new(&context);
        let worker = exec.worker("odd").policy(policy).stack_size(STACK);
        let described = worker.timer(Duration::from_millis(10), |_| ()).map(drop);
        described.and_then(|()| exec.start())
    };
    let Some(robin) = or_fail(Policy::round_robin(5).map_err(Error::from)) else {
        return;
    };
    match start(robin) {
        Ok(_) => hold!(false, "round-robin was granted"),
        Err(e) => {
            let text = e.to_string();
            say!("{text}");
            hold!(text.contains("odd"), "`{text}` does not name the worker");
            hold!(
                text.contains("FreeRTOS has FIFO"),
                "`{text}` does not say why"
            );
        }
    }
}

/// A callback that panics halts its worker, and no other loses anything.
pub fn panic_halts_one(burst: Burst) {
    static GOOD: AtomicU32 = AtomicU32::new(0);
    static REST: AtomicU32 = AtomicU32::new(0);
    let described = || -> Result<RunningExecutor, Error> {
        let context = Context::in_process();
        let mut exec = Executor::new(&context);
        let ms = Duration::from_millis;
        let mut left = 3;
        exec.worker("mad")
            .policy(Policy::fifo(60)?)
            .budget(Budget::of(ms(30)).every(ms(100)))
            .stack_size(STACK)
            .timer(ms(50), move |_| {
                burst.run();
                left -= 1;
                assert!(left > 0, "a callback's mistake");
            })?;
        exec.worker("good")
            .policy(Policy::fifo(50)?)
            .budget(Budget::of(ms(30)).every(ms(100)))
            .stack_size(STACK)
            .timer(ms(50), move |_| {
                burst.run();
                GOOD.fetch_add(1, Ordering::Relaxed);
            })?;
        exec.worker("rest")
            .policy(Policy::fifo(10)?)
            .stack_size(STACK)
            .timer(ms(25), move |_| {
                burst.run_us(1_000);
                REST.fetch_add(1, Ordering::Relaxed);
            })?;
        exec.start()
    };
    let Some(running) = or_fail(described()) else {
        return;
    };
    HEAP.seal();
    clock::sleep_until(clock::monotonic() + 2_035 * MS);
    let (good, rest) = (GOOD.load(Ordering::Relaxed), REST.load(Ordering::Relaxed));
    hold!(good == 40, "the worker below ran {good} times, not 40");
    hold!(
        rest == 81,
        "the worker without budget ran {rest} times, not 81"
    );
    hold!(panicked().count == 1, "{} panics", panicked().count);
    hold!(HEAP.usage().refused == 0, "something was allocated");
    core::mem::forget(running);
}
