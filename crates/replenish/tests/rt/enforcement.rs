//! The programs with which a review broke the guarantee at b209253, over the public API, judged by
//! the kernel's CPU clocks. Each says what it did there.
//!
//! Elsewhere: panics in `Drop` (e08, `it/drops.rs`), event hooks (e11, `it/hooks.rs`), a full
//! enforcer (e18, `replenish-os`), the bus (e32, `middleware`), records that are refused (e35).

use crate::common::{cpu, eventually, executor};
use replenish::{
    Budget, Context, Every, Group, Guarantee, HandleOptions, Low, OnMiss, Params, Policy, Usage,
};
use replenish_os::{Tid, clock};
use replenish_testkit::harness::{Trial, rt_trial};
use replenish_testkit::watchdog::watchdog;
use std::fs;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(120);
const MS: Duration = Duration::from_millis(1);
const US: u64 = 1000;

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        rt_trial("e02_inherited_priority_is_no_free_budget", inherited),
        rt_trial("e13_blocking_without_records_piles_nothing_up", blocking),
        rt_trial("e15_a_guarantee_knows_who_shares_its_group", group),
        rt_trial("e17_what_a_callback_owns_is_dropped_on_its_budget", dropped),
        rt_trial("e31_a_suspended_worker_is_held_inside_a_group", grouped),
        rt_trial("e34_a_stop_gives_a_suspended_worker_no_priority", stopped),
    ]
}

/// Consumes `us` microseconds of CPU time of the calling thread.
fn burn_us(us: u64) {
    let end = clock::thread_cpu() + us * US;
    while clock::thread_cpu() < end {}
}

/// The kernel's id of the thread of this name.
fn tid(name: &str) -> Tid {
    let named = || {
        fs::read_dir("/proc/self/task")
            .unwrap()
            .flatten()
            .find(|e| {
                fs::read_to_string(e.path().join("comm")).is_ok_and(|comm| comm.trim() == name)
            })
    };
    assert!(eventually(|| named().is_some()), "no thread {name}");
    let id = named().unwrap().file_name().to_string_lossy().parse();
    Tid::new(id.unwrap()).unwrap()
}

/// CPU time of a thread so far, by its clock.
fn used(thread: Tid) -> u64 {
    clock::ThreadCpuClock::of(thread).read().unwrap_or(0)
}

/// The real-time priority that a thread was given, 0 without one; what it inherits is not in it.
fn priority(thread: Tid) -> u64 {
    let stat = fs::read_to_string(format!("/proc/self/task/{}/stat", thread.get()));
    let stat = stat.unwrap_or_default();
    let fields = stat.rsplit_once(") ").map_or("", |(_, fields)| fields);
    // The 40th field; the third is the first behind the name.
    let mut fields = fields.split_whitespace();
    fields.nth(37).and_then(|f| f.parse().ok()).unwrap_or(0)
}

/// FIFO `high`, and FIFO 1 without budget.
fn sporadic(high: u8, budget: Duration, period: Duration) -> Policy {
    let (budget, period) = (budget.as_nanos() as u64, period.as_nanos() as u64);
    let params = Params::new(high, Low::Background(1), budget, period, 16).unwrap();
    Policy::sporadic(params).unwrap()
}

fn fifo(priority: u8) -> Policy {
    Policy::fifo(priority).unwrap()
}

/// CPU time of `threads` in `ms` milliseconds, and the time that really passed.
fn over<const N: usize>(ms: u32, threads: [Tid; N]) -> (u64, [u64; N]) {
    let (begin, before) = (clock::monotonic(), threads.map(used));
    std::thread::sleep(ms * MS);
    let mut after = threads.map(used);
    for (now, then) in after.iter_mut().zip(before) {
        *now -= then;
    }
    (clock::monotonic() - begin, after)
}

/// C5. A budget of 1 ms every 100 ms above a hog, its callback of 80 ms in a group that a higher
/// worker wants every 10 ms. On b209253 it got 81 % of the CPU, and the hog 18.5 %.
fn inherited() {
    let _dog = watchdog("inherited", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let group = Group::new("g");
    let over_now = Arc::new(AtomicBool::new(false));
    let (small, hog) = (Arc::clone(&over_now), Arc::clone(&over_now));
    let section = 2;
    exec.worker("small")
        .policy(sporadic(60, MS, 100 * MS))
        .cpu(cpu())
        .timer(MS, move |_| {
            if !small.load(Ordering::Relaxed) {
                burn_us(section * 1000);
            }
        })
        .unwrap()
        .options(HandleOptions::new().group(&group));
    exec.worker("hog")
        .policy(fifo(50))
        .cpu(cpu())
        .timer(MS, move |_| {
            if !hog.load(Ordering::Relaxed) {
                burn_us(1000);
            }
        })
        .unwrap();
    exec.worker("high")
        .policy(fifo(80))
        .cpu(cpu())
        .timer(10 * MS, |_| burn_us(10))
        .unwrap()
        .options(HandleOptions::new().group(&group));
    let running = exec.start().unwrap();
    let (took, [small, hog]) = over(600, [tid("small"), tid("hog")]);
    over_now.store(true, Ordering::Relaxed);
    let periods = took / 100_000_000 + 2;
    // Its budget, as much again that it may inherit, and the section that it was in.
    let bound = periods * (2_000_000 + section * 1_000_000);
    assert!(small <= bound, "{small} of {bound} ns in {took}");
    assert!(hog >= 4 * small, "{hog} ns for the hog, {small} for it");
    drop(running.stop());
}

/// C2. 10 ms every 100 ms, without context-switch records; the callback sleeps 300 ms and computes.
/// On b209253 it ran 40 ms at high priority in one piece, and 60 ms after a longer sleep.
fn blocking() {
    let _dog = watchdog("blocking", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.switch_log(false);
    let longest = Arc::new(AtomicU64::new(0));
    let worst = Arc::clone(&longest);
    exec.worker("w")
        .policy(sporadic(60, 10 * MS, 100 * MS))
        .cpu(cpu())
        .timer(Every::once(MS), move |cx| {
            for _ in 0..2 {
                if cx.is_stopping() {
                    return;
                }
                std::thread::sleep(300 * MS);
                // A piece ends when something else had the CPU for a while, or nothing had it.
                let (start, mut last, mut piece) = (clock::thread_cpu(), clock::monotonic(), 0);
                while piece < 200_000_000 {
                    let now = clock::monotonic();
                    if now - last > 300_000 {
                        break;
                    }
                    (last, piece) = (now, clock::thread_cpu() - start);
                }
                worst.fetch_max(piece, Ordering::Relaxed);
            }
        })
        .unwrap();
    // It has the CPU whenever the other one is at its low priority.
    exec.worker("low")
        .policy(fifo(30))
        .cpu(cpu())
        .timer(MS, |_| burn_us(400))
        .unwrap();
    let running = exec.start().unwrap();
    let done = || running.stats("w/timer:0").unwrap().executed == 1;
    assert!(eventually(done));
    let longest = longest.load(Ordering::Relaxed);
    drop(running.stop());
    assert!(
        longest > 0 && longest < 15_000_000,
        "{longest} ns in one piece"
    );
}

/// C3. A guarantee whose group is shared with 25 ms of work that is in no analysis. On b209253 it
/// was admitted without a word, and 51 of 173 deadlines were missed.
fn group() {
    let _dog = watchdog("group", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let arm = Group::new("arm");
    let guarantee = Guarantee::at(100.0).taking(MS).deadline(5 * MS);
    exec.worker("control")
        .guarantee(guarantee)
        .cpu(cpu())
        .timer(10 * MS, |_| burn_us(300))
        .unwrap()
        .options(
            HandleOptions::new()
                .group(&arm)
                .deadline(5 * MS, OnMiss::Count),
        );
    exec.worker("calibration")
        .cpu(cpu())
        .timer(50 * MS, |_| burn_us(25_000))
        .unwrap()
        .options(HandleOptions::new().group(&arm));
    let said = match exec.start() {
        Err(refused) => refused.to_string(),
        Ok(running) => panic!("admitted: {:?}", running.report().admission),
    };
    assert!(said.contains("arm"), "{said}");
}

/// C8. What the callback owns takes 400 ms to drop, on a budget of 1 ms every 100 ms. On b209253
/// 115 ms of it ran at high priority.
fn dropped() {
    struct Slow;
    impl Drop for Slow {
        fn drop(&mut self) {
            burn_us(400_000);
        }
    }
    let _dog = watchdog("dropped", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let slow = Slow;
    exec.worker("w")
        .policy(sporadic(60, MS, 100 * MS))
        .cpu(cpu())
        .timer(50 * MS, move |_| {
            let _ = &slow;
        })
        .unwrap();
    let running = exec.start().unwrap();
    let thread = tid("w");
    let high = at_high(thread, move || drop(running.stop()));
    assert!(high < 50_000_000, "{high} ns at high priority");
}

/// Runs `during` and waits until `thread` has ended, or a second; the CPU time that the thread used
/// between two samples at a real-time priority above 1.
fn at_high(thread: Tid, during: impl FnOnce() + Send + 'static) -> u64 {
    let begin = clock::monotonic();
    let action = std::thread::spawn(during);
    let (mut sum, mut last, mut was_high) = (0, used(thread), false);
    while clock::monotonic() < begin + 1_000_000_000 {
        std::thread::sleep(MS);
        let now = used(thread);
        if now == 0 {
            break;
        }
        let is_high = priority(thread) > 1;
        if was_high && is_high {
            sum += now - last;
        }
        (last, was_high) = (now, is_high);
    }
    action.join().unwrap();
    sum
}

/// C1. 5 ms every 100 ms, suspended without budget, in a group of its own. On b209253 it got 98 %
/// of the CPU at FIFO 48, and a FIFO 30 timer ran 9 times instead of 576.
fn grouped() {
    let _dog = watchdog("grouped", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let group = Group::new("g");
    let ends = Arc::new(AtomicBool::new(false));
    let end = Arc::clone(&ends);
    exec.worker("wg")
        .budget(Budget::of(5 * MS).every(100 * MS).suspend())
        .cpu(cpu())
        .timer(
            Every::once(10 * MS),
            move |_| {
                while !end.load(Ordering::Relaxed) {}
            },
        )
        .unwrap()
        .options(HandleOptions::new().group(&group));
    exec.worker("low")
        .policy(fifo(30))
        .cpu(cpu())
        .timer(MS, |_| burn_us(900))
        .unwrap();
    let running = exec.start().unwrap();
    let (took, [held, low]) = over(600, [tid("wg"), tid("low")]);
    let usage: Usage = running.usage("wg").unwrap();
    ends.store(true, Ordering::Relaxed);
    drop(running.stop());
    let periods = took / 100_000_000 + 2;
    // The time-sharing class lets it run when no other thread wants to.
    assert!(usage.cpu_high <= periods * 5_000_000, "{usage:?}");
    assert!(held <= took / 4, "{held} of {took} ns");
    assert!(low >= 2 * held, "{low} ns for FIFO 30, {held} for it");
}

/// C8. A suspended worker whose callback does not end, stopped with a grace of 400 ms. On b209253
/// it ran at its high priority for all of it.
fn stopped() {
    let _dog = watchdog("stopped", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.stop_grace(400 * MS);
    let ends = Arc::new(AtomicBool::new(false));
    let end = Arc::clone(&ends);
    exec.worker("w")
        .budget(Budget::of(5 * MS).every(1000 * MS).suspend())
        .cpu(cpu())
        .timer(
            Every::once(10 * MS),
            move |_| {
                while !end.load(Ordering::Relaxed) {}
            },
        )
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| running.usage("w").unwrap().low));
    let thread = tid("w");
    let high = at_high(thread, move || {
        drop(running.stop());
        ends.store(true, Ordering::Relaxed);
    });
    assert!(high < 100_000_000, "{high} ns at high priority");
}
