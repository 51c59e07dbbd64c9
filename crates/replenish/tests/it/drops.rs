//! A callback's values are dropped by its worker, are charged to its handle, and may panic in that:
//! nothing else ends, whichever side asked for it.

use crate::common::{burn, eventually, executor};
use replenish::{
    CallbackContext, Context, Executor, GuardCondition, HandleOptions, OnMiss, Removal, Semantics,
    Trigger, WorkerBuilder,
};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(120);
const MS: Duration = Duration::from_millis(1);

/// Calls a function when it is dropped.
struct OnDrop<F: FnMut()>(F);

impl<F: FnMut()> Drop for OnDrop<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}

/// Panics when it is dropped, and counts that.
fn evil(dropped: &Arc<AtomicU64>) -> OnDrop<impl FnMut() + Send + use<>> {
    let dropped = Arc::clone(dropped);
    OnDrop(move || {
        dropped.fetch_add(1, Ordering::SeqCst);
        panic!("state that panics in Drop");
    })
}

/// Timers, a trigger, hooks and a deadline whose state panics when it is dropped: seven of them.
fn evils(exec: &mut Executor, dropped: &Arc<AtomicU64>) {
    let on_event = evil(dropped);
    exec.on_event(move |_| {
        let _ = &on_event;
    });
    let trigger = evil(dropped);
    let mut worker = exec.worker("w").trigger(Trigger::custom(move |_| {
        let _ = &trigger;
        true
    }));
    for _ in 0..2 {
        let (state, miss, hook) = (evil(dropped), evil(dropped), evil(dropped));
        let called = Box::new(move |_: &replenish::DeadlineMiss<'_>| {
            let _ = &miss;
        });
        let options = HandleOptions::new()
            .deadline(LIMIT, OnMiss::Call(called))
            .on_error(move |_| {
                let _ = &hook;
            });
        let timer = move |_: &CallbackContext<'_>| {
            let _ = &state;
        };
        worker = worker.timer(MS, timer).unwrap().options(options);
    }
    let _: WorkerBuilder<'_> = worker;
}

/// On b209253 the second panic came while the first one unwound the worker's thread, and the
/// process was aborted.
#[test]
fn state_that_panics_when_dropped_ends_no_stop() {
    let _dog = watchdog("panics in Drop", LIMIT);
    let dropped = Arc::new(AtomicU64::new(0));
    let ctx = Context::in_process();
    let mut exec = Executor::new(&ctx);
    exec.no_ledger().stop_grace(LIMIT);
    evils(&mut exec, &dropped);
    let running = exec.start().unwrap();
    assert!(eventually(
        || running.stats("w/timer:1").unwrap().executed > 0
    ));
    let report = running.stop();
    assert!(report.stuck.is_empty(), "{report}");
    assert!(report.handles.iter().all(|h| h.stats.panicked), "{report}");
    drop(report);
    assert!(eventually(|| dropped.load(Ordering::SeqCst) == 8));
}

/// Without threads, never started, and refused at the start: on the program's own thread.
#[test]
fn state_that_panics_when_dropped_ends_nothing_on_the_programs_thread() {
    let _dog = watchdog("panics in Drop, own thread", LIMIT);
    let new = |dropped: &Arc<AtomicU64>| {
        let ctx = Context::in_process();
        let mut exec = Executor::new(&ctx);
        exec.no_ledger();
        evils(&mut exec, dropped);
        exec
    };
    let dropped = Arc::new(AtomicU64::new(0));
    let mut local = new(&dropped).local().unwrap();
    local.spin_some(LIMIT);
    drop(local);
    assert_eq!(dropped.swap(0, Ordering::SeqCst), 8);
    drop(new(&dropped));
    assert_eq!(dropped.swap(0, Ordering::SeqCst), 8);
    let mut refused = new(&dropped);
    let _: WorkerBuilder<'_> = refused.worker("w").capacity(1); // the second of its name
    assert!(refused.start().is_err());
    assert_eq!(dropped.swap(0, Ordering::SeqCst), 8);
}

/// On b209253 the entry was dropped by the thread that removed it: the callback that did so was
/// stopped for the other's panic, and a removal on the program's thread panicked.
#[test]
fn a_panic_in_drop_is_the_removed_handles_own() {
    let _dog = watchdog("removal", LIMIT);
    let dropped = Arc::new(AtomicU64::new(0));
    let ctx = Context::in_process();
    let (mut exec, log) = executor(&ctx);
    for name in ["a", "b"] {
        let state = evil(&dropped);
        exec.worker(name)
            .capacity(2)
            .timer(MS, move |_| {
                let _ = &state;
            })
            .unwrap();
    }
    let remove = GuardCondition::new();
    let removed = Arc::new(Mutex::new(None));
    let result = Arc::clone(&removed);
    exec.worker("remover")
        .guard(&remove, move |cx| {
            let executor = cx.handle().unwrap();
            let end = executor.remove("a/timer:0", Removal::Wait(LIMIT));
            *result.lock().unwrap() = Some(end);
        })
        .unwrap();
    let running = exec.start().unwrap();
    remove.trigger();
    assert!(eventually(|| removed.lock().unwrap().is_some()));
    let stats = removed.lock().unwrap().take().unwrap().unwrap();
    assert!(stats.panicked);
    let stats = running
        .handle()
        .remove("b/timer:0", Removal::Wait(LIMIT))
        .unwrap();
    assert!(stats.panicked);
    assert_eq!(dropped.load(Ordering::SeqCst), 2);
    // Both workers and the remover go on.
    for name in ["a", "b"] {
        let executor = running.handle();
        let id = executor.worker(name).unwrap().timer(MS, |_| ()).unwrap();
        assert!(eventually(|| running.stats(&id).unwrap().executed > 0));
    }
    remove.trigger();
    assert!(eventually(|| running
        .stats("remover/guard:0")
        .unwrap()
        .executed
        == 2));
    assert!(!running.stats("remover/guard:0").unwrap().panicked);
    for id in ["a/timer:0", "b/timer:0"] {
        assert!(
            log.has(&format!("{id}: callback panicked")),
            "{:?}",
            log.lines()
        );
    }
}

/// On b209253 the state was dropped on the thread that removed the handle, and no budget was
/// charged.
#[test]
fn what_a_callback_owns_is_dropped_by_its_worker_and_charged_to_its_handle() {
    let _dog = watchdog("dropping thread", LIMIT);
    let threads = Arc::new(Mutex::new(Vec::new()));
    let state = || {
        let threads = Arc::clone(&threads);
        let state = OnDrop(move || {
            burn(20);
            let thread = std::thread::current();
            threads
                .lock()
                .unwrap()
                .push(thread.name().map(String::from));
        });
        move |_: &CallbackContext<'_>| {
            let _ = &state;
        }
    };
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.stop_grace(LIMIT);
    exec.worker("w")
        .semantics(Semantics::LogicalExecutionTime)
        .timer(MS, state())
        .unwrap()
        .timer(MS, state())
        .unwrap()
        .timer(MS, state())
        .unwrap();
    let running = exec.start().unwrap();
    let waited = running
        .handle()
        .remove("w/timer:0", Removal::Wait(LIMIT))
        .unwrap();
    assert!(waited.cpu_high >= 20_000_000, "{waited:?}");
    assert_eq!(
        threads.lock().unwrap().len(),
        1,
        "dropped when the removal has returned"
    );
    running
        .handle()
        .remove("w/timer:1", Removal::Detach)
        .unwrap();
    let report = running.stop();
    let left = report.handle("w/timer:2").unwrap().stats;
    assert!(left.cpu_high >= 20_000_000, "{left:?}");
    assert_eq!(
        *threads.lock().unwrap(),
        [(); 3].map(|()| Some("w".to_string()))
    );
}
