//! Failures on the board: panics, allocations after the seal, stacks that are too small.

use crate::HEAP;
use crate::check::{MS, hold, join, task};
use alloc::sync::Arc;
use alloc::vec::Vec;
use core::sync::atomic::{AtomicU32, Ordering};
use firmware::say;
use firmware::work::Burst;
use replenish_os::freertos::{panicked, tasks};
use replenish_os::{Enforcer, EnforcerConfig, Low, Params, Policy, ThreadSpec, clock, spawn};
use sporadic::Kind;

/// The higher of two budgeted workers panics after 50 ms of work. The other keeps its share, and
/// the worker below gets what the first has left.
pub fn panic_halts_one(burst: Burst) {
    let Ok(enforcer) = Enforcer::start(EnforcerConfig::on_cpu(0)) else {
        hold!(false, "no enforcer");
        return;
    };
    let begin = clock::monotonic() + 5 * MS;
    let counts = [("mad", 60), ("good", 50), ("rest", 10)].map(|(name, priority)| {
        let count = Arc::new(AtomicU32::new(0));
        let (theirs, its) = (Arc::clone(&count), replenish_os::Arc::clone(&enforcer));
        task(name, priority, move || {
            let params = Params::new(priority, Low::Background(6), 30 * MS, 100 * MS, 10);
            let account = params.map(|p| its.enroll(&p, Kind::Corrected));
            let budgeted = priority > 10;
            let account = match account {
                Ok(Ok(account)) if budgeted => Some(account),
                _ => None,
            };
            clock::sleep_until(begin);
            if let Some(mut account) = account {
                account.activate(begin);
                core::mem::forget(account);
            }
            loop {
                burst.run_us(1_000);
                let n = theirs.fetch_add(1, Ordering::Relaxed);
                assert!(name != "mad" || n < 49, "the worker's mistake");
            }
        });
        count
    });
    let mad = tasks().find(|t| t.name == "mad").map(|t| t.tid);
    clock::sleep_until(begin + 2_000 * MS);
    let [mad_ran, good, rest] = counts.map(|c| c.load(Ordering::Relaxed));
    say!("{mad_ran}, {good}, {rest} ms of work in 2 s");
    hold!(mad_ran == 50, "mad went on after its panic: {mad_ran}");
    hold!(good.abs_diff(600) <= 2, "good had {good} ms instead of 600");
    hold!(
        rest.abs_diff(1350) <= 10,
        "rest had {rest} ms instead of 1350"
    );
    let seen = panicked();
    hold!(seen.count == 1 && seen.last == mad, "{seen:?}, not {mad:?}");
}

/// An allocation after the seal halts its task alone and is counted.
pub fn heap_sealed(burst: Burst) {
    let begin = clock::monotonic() + 5 * MS;
    let greedy = task("greedy", 50, move || {
        clock::sleep_until(begin);
        let mut list: Vec<u8> = Vec::with_capacity(100);
        list.push(1);
        hold!(false, "{list:?} was allocated after the seal");
    });
    let count = Arc::new(AtomicU32::new(0));
    let theirs = Arc::clone(&count);
    let modest = task("modest", 40, move || {
        clock::sleep_until(begin);
        for _ in 0..10 {
            burst.run_us(1_000);
            theirs.fetch_add(1, Ordering::Relaxed);
        }
    });
    HEAP.seal();
    let used = HEAP.usage().used;
    join(modest);
    let usage = HEAP.usage();
    hold!(count.load(Ordering::Relaxed) == 10, "modest did not go on");
    hold!(usage.refused == 1, "{} refused", usage.refused);
    hold!(
        usage.used == used,
        "{} bytes used after the seal",
        usage.used - used
    );
    hold!(!greedy.is_finished(), "greedy went on");
    hold!(panicked().count == 1, "{} panics", panicked().count);
    hold!(
        panicked().last == Some(greedy.tid()),
        "another task panicked"
    );
}

/// A task that handles a refused allocation goes on.
pub fn heap_refusal_handled(_: Burst) {
    HEAP.seal();
    let mut list: Vec<u8> = Vec::new();
    hold!(list.try_reserve(100).is_err(), "reserved after the seal");
    hold!(
        HEAP.usage().refused == 1,
        "{} refused",
        HEAP.usage().refused
    );
    hold!(panicked().count == 0, "a handled refusal halted a task");
}

/// Uses about 100 bytes of stack per step.
#[inline(never)]
fn dig(depth: u32) -> u32 {
    let mut room = [depth; 20];
    core::hint::black_box(&mut room);
    if depth == 0 {
        return room[0];
    }
    let below = dig(depth - 1);
    core::hint::black_box(&mut room);
    below + room[7]
}

fn overflow(depth: u32) {
    // Tasks before and after it in memory, which wait meanwhile.
    let sleep = || clock::sleep_until(clock::monotonic() + 500 * MS);
    task("before", 40, sleep);
    let spec = ThreadSpec::new("digger").policy(Policy::Fifo { priority: 50 });
    let digger = spawn(spec.stack_size(2048), move || {
        clock::sleep_until(clock::monotonic() + 20 * MS);
        let sum = dig(depth);
        clock::sleep_until(clock::monotonic() + 20 * MS);
        sum
    });
    task("after", 40, sleep);
    hold!(digger.is_ok(), "no digger");
    clock::sleep_until(clock::monotonic() + 100 * MS);
    hold!(false, "the board goes on");
}

/// A little more than there is: the kernel's bytes at the end are overwritten.
pub fn stack_overflow(_: Burst) {
    overflow(22);
}

/// Far more than there is: what the back end knows of the task is overwritten, too.
pub fn stack_overflow_deep(_: Burst) {
    overflow(40);
}
