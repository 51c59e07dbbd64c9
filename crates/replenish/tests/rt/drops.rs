//! Code beside callbacks keeps to the budget: state that is dropped, and a stopped worker that
//! ends its callback while the executor stops.

use crate::common::{burn, cpu, eventually, executor};
use replenish::{Budget, CallbackContext, Context, Every, Executor, Low, Params, Policy, Removal};
use replenish_os::{SchedClass, Usage};
use replenish_testkit::harness::{Trial, rt_trial};
use replenish_testkit::tids;
use replenish_testkit::watchdog::watchdog;
use std::cell::RefCell;
use std::fs::read_to_string;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(120);
const MS: Duration = Duration::from_millis(1);
const PRIORITY: u8 = 60;

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        rt_trial("state_is_dropped_under_the_budget_at_a_removal", removal),
        rt_trial("state_is_dropped_under_the_budget_at_a_stop", stop),
        rt_trial("thread_locals_are_dropped_under_the_budget", thread_locals),
        rt_trial("a_stopped_worker_ends_its_callback_low_during_a_stop", low),
        rt_trial("handles_that_come_and_go_are_on_the_account", changes),
        rt_trial("a_thread_that_has_the_id_of_a_worker_is_left_alone", reused)
            .skipped_if(tids::missing()),
    ]
}

/// CPU time, in ms, that the state of the callback takes when it is dropped.
const DROP: u64 = 100;

struct Slow;

impl Drop for Slow {
    fn drop(&mut self) {
        burn(DROP);
    }
}

/// Dropped, it takes [`DROP`] and until `over` is set.
struct Endless {
    over: Arc<AtomicBool>,
}

impl Drop for Endless {
    fn drop(&mut self) {
        burn(DROP);
        while !self.over.load(Ordering::SeqCst) {
            burn(1);
        }
    }
}

/// A worker with 1 ms in an hour and a handle whose state is slow to drop.
fn slow(exec: &mut Executor) {
    let state = Slow;
    exec.stop_grace(LIMIT);
    exec.worker("w")
        .policy(Policy::fifo(PRIORITY).unwrap())
        .budget(Budget::of(MS).every(3_600_000 * MS))
        .cpu(cpu())
        .timer(Every::once(MS), move |_: &CallbackContext<'_>| {
            let _ = &state;
        })
        .unwrap();
}

/// On b209253 the thread that removed the handle dropped it, at its own priority.
fn removal() {
    let _dog = watchdog("drop at a removal", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    slow(&mut exec);
    let running = exec.start().unwrap();
    let stats = running
        .handle()
        .remove("w/timer:0", Removal::Wait(LIMIT))
        .unwrap();
    let usage = running.usage("w").unwrap();
    assert!(usage.low && usage.exhaustions == 1, "{usage:?}");
    let both = usage.cpu_high + usage.cpu_low;
    assert!(
        both >= DROP * 1_000_000 && usage.cpu_high < both / 2,
        "{usage:?}"
    );
    assert!(
        stats.cpu_high + stats.cpu_background >= DROP * 1_000_000,
        "{stats:?}"
    );
}

/// On b209253 the account was closed before: 119 ms at the high priority for a budget of 1 ms.
fn stop() {
    let _dog = watchdog("drop at a stop", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    slow(&mut exec);
    let running = exec.start().unwrap();
    assert!(eventually(
        || running.stats("w/timer:0").unwrap().executed == 1
    ));
    let report = running.stop();
    assert!(report.stuck.is_empty(), "{report}");
    let usage = report.thread("w").unwrap().usage;
    let both = usage.cpu_high + usage.cpu_low;
    assert!(
        both >= DROP * 1_000_000 && usage.cpu_high < both / 2,
        "{usage:?}"
    );
}

/// A thread of this process by its name.
fn thread(name: &str) -> Option<String> {
    let threads = std::fs::read_dir("/proc/self/task").unwrap().flatten();
    let mut paths = threads.map(|thread| thread.path().display().to_string());
    paths.find(|path| read_to_string(format!("{path}/comm")).is_ok_and(|comm| comm.trim() == name))
}

/// Its real-time priority, and its CPU time in ns.
fn state(thread: &str) -> Option<(u8, u64)> {
    let stat = read_to_string(format!("{thread}/stat")).ok()?;
    let (_, fields) = stat.rsplit_once(')')?;
    let priority = fields.split_whitespace().nth(37)?.parse().ok()?;
    let schedule = read_to_string(format!("{thread}/schedstat")).ok()?;
    let cpu = schedule.split_whitespace().next()?.parse().ok()?;
    Some((priority, cpu))
}

/// Sums what a thread uses at the high priority, as the kernel says.
struct Watch {
    ended: Arc<AtomicBool>,
    sum: JoinHandle<u64>,
}

impl Watch {
    fn over(name: &str) -> Self {
        let thread = thread(name).unwrap();
        let mut before = state(&thread).unwrap();
        let ended = Arc::new(AtomicBool::new(false));
        let end = Arc::clone(&ended);
        let sum = std::thread::spawn(move || {
            let mut high = 0;
            while !end.load(Ordering::SeqCst) {
                std::thread::sleep(MS);
                let Some(now) = state(&thread) else {
                    break;
                };
                if before.0 == PRIORITY && now.0 == PRIORITY {
                    high += now.1 - before.1;
                }
                before = now;
            }
            high
        });
        Self { ended, sum }
    }

    fn end(self) -> u64 {
        self.ended.store(true, Ordering::SeqCst);
        self.sum.join().unwrap()
    }
}

/// A thread drops its thread locals last. On b209253 nothing held it to its budget then: 100 ms at
/// the high priority.
fn thread_locals() {
    thread_local! {
        static LEFT: RefCell<Option<Endless>> = const { RefCell::new(None) };
    }
    let _dog = watchdog("thread locals", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.stop_grace(Duration::from_millis(DROP / 5));
    let (id, over) = ("leaves-locals", Arc::new(AtomicBool::new(false)));
    let theirs = Arc::clone(&over);
    exec.worker(id)
        .policy(Policy::fifo(PRIORITY).unwrap())
        .budget(Budget::of(MS).every(3_600_000 * MS))
        .cpu(cpu())
        .timer(Every::once(MS), move |_| {
            let over = Arc::clone(&theirs);
            LEFT.set(Some(Endless { over }));
        })
        .unwrap();
    let running = exec.start().unwrap();
    let timer = format!("{id}/timer:0");
    assert!(eventually(|| running.stats(&timer).unwrap().executed == 1));
    let watch = Watch::over(id);
    let report = running.stop();
    over.store(true, Ordering::SeqCst);
    assert_eq!(report.stuck, [id], "it is still dropping");
    assert!(eventually(|| thread(id).is_none()));
    let high = watch.end();
    assert!(
        high < DROP * 1_000_000 / 2,
        "{high} ns at the high priority"
    );
}

/// On b209253 a stop woke the stopped worker at its high priority, where it ran on until the grace
/// was over: 379 of 400 ms.
fn low() {
    const GRACE: u64 = 400;
    let _dog = watchdog("suspended during a stop", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.stop_grace(Duration::from_millis(GRACE));
    let params = Params::new(PRIORITY, Low::Suspend, 5_000_000, 3_600_000_000_000, 4).unwrap();
    exec.worker("stopped-worker")
        .policy(Policy::sporadic(params).unwrap())
        .cpu(cpu())
        .timer(Every::once(MS), |_| burn(1000))
        .unwrap();
    let running = exec.start().unwrap();
    let id = "stopped-worker";
    assert!(eventually(|| running.usage(id).unwrap().low));
    let watch = Watch::over(id);
    drop(running.stop());
    let high = watch.end();
    assert!(
        high < GRACE * 1_000_000 / 4,
        "{high} ns at the high priority"
    );
}

/// A worker may have ended long before it is joined. It was reported as stuck then, and the thread
/// that had its id lost its priority.
fn reused() {
    let _dog = watchdog("the id of a worker", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.worker("gone").timer(MS, |_| ()).unwrap();
    let running = exec.start().unwrap();
    let path = thread("gone").unwrap();
    let tid: i32 = path.rsplit('/').next().unwrap().parse().unwrap();
    running.stop_handle().stop();
    assert!(eventually(|| !tids::exists(tid)));
    let (end, ends) = mpsc::channel::<()>();
    let stranger = tids::reuse(tid, move || ends.recv().is_err()).expect("no such id to be had");
    let id = replenish_os::Tid::new(tid).unwrap();
    replenish_os::set_priority(id, SchedClass::Fifo(PRIORITY)).unwrap();
    let report = running.stop();
    assert!(report.stuck.is_empty(), "{report}");
    let (priority, _) = state(&path).unwrap();
    assert_eq!(priority, PRIORITY);
    drop(end);
    assert!(stranger.join().unwrap());
}

/// Each nanosecond of the thread is on its account, those of handles that are added, run, removed
/// and dropped, too.
fn changes() {
    static CLOCK: AtomicU64 = AtomicU64::new(0);
    const PERIOD: u64 = 50_000_000;
    const BUDGET: u64 = 10_000_000;
    let _dog = watchdog("changes on the account", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let params = Params::new(PRIORITY, Low::Background(6), BUDGET, PERIOD, 16).unwrap();
    exec.worker("counted")
        .policy(Policy::sporadic(params).unwrap())
        .cpu(cpu())
        .capacity(4)
        .timer(5 * MS, |_| burn(1))
        .unwrap();
    let running = exec.start().unwrap();
    let began = replenish_os::clock::monotonic();
    let change = running.handle();
    let add = |body: fn(&CallbackContext<'_>)| {
        let worker = change.worker("counted").unwrap();
        worker.timer(MS, body).unwrap()
    };
    // The account of a thread that runs is exact at any moment: between its clock before and after.
    let read = || {
        let busy = add(|cx| {
            while !cx.is_cancelled() && !cx.is_stopping() {
                CLOCK.store(replenish_os::clock::thread_cpu(), Ordering::SeqCst);
            }
        });
        let newer = |than| {
            assert!(eventually(|| CLOCK.load(Ordering::SeqCst) > than));
            CLOCK.load(Ordering::SeqCst)
        };
        let before = newer(CLOCK.load(Ordering::SeqCst));
        let usage = running.usage("counted").unwrap();
        // A reading of the clock that began after the account was read.
        let after = newer(newer(CLOCK.load(Ordering::SeqCst)));
        change.remove(&busy, Removal::Cancel(LIMIT)).unwrap();
        (before, usage, after)
    };
    let first = read();
    for round in 0..30 {
        let id = add(|_| burn(1));
        std::thread::sleep(3 * MS);
        if round % 2 == 0 {
            change.remove(&id, Removal::Wait(LIMIT)).unwrap();
        } else {
            change.remove(&id, Removal::Detach).unwrap();
        }
    }
    let last = read();
    let account = |usage: &Usage| usage.cpu_high + usage.cpu_low;
    let used = account(&last.1) - account(&first.1);
    let (least, most) = (last.0 - first.2, last.2 - first.0);
    assert!((least..=most).contains(&used), "{first:?} {last:?}");
    let periods = (replenish_os::clock::monotonic() - began) / PERIOD + 3;
    assert!(last.1.cpu_high <= periods * BUDGET, "{periods} {last:?}");
    assert!(running.stop().stuck.is_empty());
}
