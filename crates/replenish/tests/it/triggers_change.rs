//! Another trigger for a worker that runs.

use crate::common::{eventually, executor, settles};
use replenish::{Context, Error, GuardCondition, Trigger};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::ThreadId;
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);

#[test]
fn a_running_worker_gets_another_trigger_and_keeps_its_input() {
    let _dog = watchdog("triggers while running", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let (a, b) = (GuardCondition::new(), GuardCondition::new());
    exec.worker("w")
        .guard(&a, |_| ())
        .unwrap()
        .guard(&b, |_| ())
        .unwrap();
    let running = exec.start().unwrap();
    let handle = running.handle();
    let set = |trigger| handle.worker("w").unwrap().set_trigger(trigger).unwrap();
    let ran = || {
        let of = |id: &str| running.stats(id).unwrap().executed;
        (of("w/guard:0"), of("w/guard:1"))
    };
    a.trigger();
    assert!(eventually(|| ran() == (1, 0)));
    set(Trigger::All);
    a.trigger();
    assert!(settles(|| running.usage("w").unwrap().cpu_high), "it spins");
    assert_eq!(ran(), (1, 0), "it waits for both");
    b.trigger();
    assert!(eventually(|| ran() == (2, 1)));
    a.trigger();
    assert!(settles(ran));
    set(Trigger::one("w/guard:1"));
    assert!(settles(ran));
    assert_eq!(ran(), (2, 1));
    set(Trigger::Any); // what waits is served at once
    assert!(eventually(|| ran() == (3, 1)));
    let asked = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&asked);
    set(Trigger::custom(move |handles| {
        count.fetch_add(1, Ordering::Relaxed);
        handles.is_ready("w/guard:1")
    }));
    a.trigger();
    assert!(eventually(|| asked.load(Ordering::Relaxed) > 0));
    assert_eq!(ran(), (3, 1));
    b.trigger();
    assert!(eventually(|| ran() == (4, 2)));
}

/// Says on which thread it was dropped.
struct Dropped(Arc<Mutex<Vec<ThreadId>>>);

impl Drop for Dropped {
    fn drop(&mut self) {
        self.0.lock().unwrap().push(std::thread::current().id());
    }
}

#[test]
fn a_callback_sets_it_too_and_the_worker_drops_no_old_one() {
    let _dog = watchdog("triggers from a callback", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let (a, b) = (GuardCondition::new(), GuardCondition::new());
    let dropped = Arc::new(Mutex::new(Vec::new()));
    let owned = Dropped(Arc::clone(&dropped));
    let mut set = false;
    exec.worker("w")
        .trigger(Trigger::custom(move |_| {
            let _owned = &owned;
            true
        }))
        .guard(&a, move |cx| {
            let handle = cx.handle().expect("it runs");
            if std::mem::replace(&mut set, true) {
                return Ok(());
            }
            handle.worker("w")?.set_trigger(Trigger::All)
        })
        .unwrap()
        .guard(&b, |_| ())
        .unwrap();
    let running = exec.start().unwrap();
    let ran = |id: &str| running.stats(id).unwrap().executed;
    a.trigger();
    assert!(eventually(|| ran("w/guard:0") == 1));
    a.trigger();
    assert!(settles(|| ran("w/guard:0")));
    assert_eq!(ran("w/guard:0"), 1, "it waits for both");
    b.trigger();
    assert!(eventually(|| ran("w/guard:1") == 1));
    assert!(dropped.lock().unwrap().is_empty());
    // The next call drops it, on the thread that calls.
    let worker = running.handle();
    worker
        .worker("w")
        .unwrap()
        .set_trigger(Trigger::Any)
        .unwrap();
    assert!(eventually(|| {
        let any = worker.worker("w").unwrap().set_trigger(Trigger::Any);
        any.is_ok() && !dropped.lock().unwrap().is_empty()
    }));
    assert_eq!(*dropped.lock().unwrap(), [std::thread::current().id()]);
}

#[test]
fn triggers_that_cannot_be_met_or_come_too_late_are_refused() {
    let _dog = watchdog("triggers refused", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.worker("w")
        .guard(&GuardCondition::new(), |_| ())
        .unwrap();
    exec.worker("clocked")
        .every(Duration::from_millis(1))
        .guard(&GuardCondition::new(), |_| ())
        .unwrap();
    let running = exec.start().unwrap();
    let handle = running.handle();
    let set = |worker, trigger| handle.worker(worker).unwrap().set_trigger(trigger);
    let error = set("w", Trigger::one("clocked/guard:0")).unwrap_err();
    let text = "worker \"w\": trigger = clocked/guard:0 is not allowed: a handle of this worker";
    assert_eq!(error.to_string(), text);
    let error = set("w", Trigger::Always).unwrap_err().to_string();
    assert!(error.contains("with .every(…) only"), "{error}");
    set("clocked", Trigger::Always).unwrap();
    set("clocked", Trigger::one("clocked/guard:0")).unwrap();
    running.stop();
    assert_eq!(set("w", Trigger::All).unwrap_err(), Error::Stopped);
}
