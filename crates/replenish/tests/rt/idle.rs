//! An executor that has nothing to do but its timers wakes once for each release, and for nothing
//! else. `cargo test -p replenish --test rt idle -- --nocapture` prints what that costs.

use replenish::{Context, Every, Executor, Report};
use replenish_testkit::harness::{Trial, trial};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

const TIMERS: u64 = 100;

/// Number of times that the thread of this name has blocked, in this process.
fn blocked(name: &str) -> u64 {
    let tasks = std::fs::read_dir("/proc/self/task").unwrap();
    let status = tasks
        .flatten()
        .find_map(|task| {
            let status = std::fs::read_to_string(task.path().join("status")).ok()?;
            let its = status.lines().next()?.strip_prefix("Name:")?.trim();
            (its == name).then_some(status)
        })
        .expect("a thread of that name");
    let count = status
        .lines()
        .find_map(|l| l.strip_prefix("voluntary_ctxt_switches:"));
    count.unwrap().trim().parse().unwrap()
}

fn cpu(report: &Report) -> Duration {
    let each = report.threads.iter();
    let sum = each.map(|t| t.usage.cpu_high + t.usage.cpu_low).sum();
    Duration::from_nanos(sum)
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![trial(
        "a_hundred_timers_wake_it_once_for_each_release",
        a_hundred_timers_wake_it_once_for_each_release,
    )]
}

fn a_hundred_timers_wake_it_once_for_each_release() {
    let ctx = Context::in_process();
    let mut exec = Executor::new(&ctx);
    exec.no_ledger();
    let fired = Arc::new(AtomicU64::new(0));
    let mut worker = exec.worker("idle-timers");
    for n in 0..TIMERS {
        let fired = Arc::clone(&fired);
        // Spread over the second, in the middle between the times at which this test looks.
        let every =
            Every::period(Duration::from_secs(1)).first_after(Duration::from_millis(5 + n * 10));
        worker = worker
            .timer(every, move |_| {
                fired.fetch_add(1, Ordering::Relaxed);
            })
            .unwrap();
    }
    let running = exec.start().unwrap();
    std::thread::sleep(Duration::from_millis(100));

    let begun = Instant::now();
    let before = (
        blocked("idle-timers"),
        blocked("dispatcher"),
        cpu(&running.report()),
    );
    let first = fired.load(Ordering::Relaxed);
    std::thread::sleep(Duration::from_millis(2000));
    let releases = fired.load(Ordering::Relaxed) - first;
    let after = (
        blocked("idle-timers"),
        blocked("dispatcher"),
        cpu(&running.report()),
    );
    let elapsed = begun.elapsed();
    let stats = running.stop();

    let (worker, dispatcher) = (after.0 - before.0, after.1 - before.1);
    let percent = (after.2 - before.2).as_secs_f64() * 100.0 / elapsed.as_secs_f64();
    println!(
        "{TIMERS} timers of 1 s: {releases} releases, worker blocked {worker} times, dispatcher \
         {dispatcher}; {percent:.3} % of one CPU"
    );
    let skipped: u64 = stats.handles.iter().map(|h| h.stats.skipped).sum();
    assert_eq!(skipped, 0);
    assert!(releases > TIMERS, "{releases}");
    // One of each may fall between two readings, and a page of code that must be read blocks, too.
    // Releases that a busy machine serves late together cost one wake-up for all.
    assert!(worker <= releases + 5, "{worker} for {releases}");
    assert_eq!(dispatcher, 0, "there was nothing to dispatch");
}
