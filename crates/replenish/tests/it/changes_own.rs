//! Callbacks that change their own worker: while they run, again and again, with threads and
//! without.

use crate::common::{eventually, executor};
use replenish::msg::std_msgs::Int32;
use replenish::{CallbackContext, Context, Error, Every, Executor, HandleId, Qos, Removal};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);
const NOW: Every = Every::once(Duration::ZERO);

/// A handle may run before the call that adds it has returned, and knows itself all the same.
#[test]
fn a_handle_removes_itself_in_its_first_callback() {
    let _dog = watchdog("own removal", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.worker("w").capacity(4).timer(LIMIT, |_| ()).unwrap();
    let running = exec.start().unwrap();
    let change = running.handle();
    let removed = Arc::new(Mutex::new(Vec::new()));
    for n in 1..=500 {
        let note = Arc::clone(&removed);
        let worker = change.worker("w").unwrap();
        let own = move |cx: &CallbackContext<'_>| {
            let change = cx.handle().unwrap();
            let result = change.remove(cx.id(), Removal::Detach).map(drop);
            note.lock().unwrap().push(result);
        };
        // The place of the one before may be free in a moment only.
        worker.timer(NOW, own).unwrap();
        let end = Instant::now() + LIMIT;
        while removed.lock().unwrap().len() < n || running.report().handles.len() > 1 {
            assert!(Instant::now() < end);
            std::hint::spin_loop();
        }
    }
    let removed = removed.lock().unwrap();
    assert!(removed.iter().all(Result::is_ok), "{removed:?}");
}

/// In every callback a new handle, which removes itself: three places are enough for ever.
fn renews(exec: &mut Executor, limit: u64) -> Arc<AtomicU64> {
    let ran = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&ran);
    let change = move |cx: &CallbackContext<'_>| {
        let count = Arc::clone(&count);
        let worker = cx.handle().unwrap();
        let added = worker.worker("w").unwrap().timer(NOW, move |cx| {
            let change = cx.handle().unwrap();
            change.remove(cx.id(), Removal::Detach).unwrap();
            if count.fetch_add(1, Ordering::SeqCst) + 1 == limit {
                cx.stop();
            }
        });
        added.map(drop)
    };
    exec.worker("w").capacity(3).timer(MS, change).unwrap();
    ran
}

#[test]
fn places_that_a_worker_frees_itself_are_free_again() {
    let _dog = watchdog("own places", LIMIT);
    for local in [true, false] {
        let ctx = Context::in_process();
        let (mut exec, log) = executor(&ctx);
        let ran = renews(&mut exec, 20);
        let errors = if local {
            let mut local = exec.local().unwrap();
            local.spin_for(LIMIT);
            local.report().handles[0].stats.errors
        } else {
            exec.spin().unwrap().handles[0].stats.errors
        };
        assert_eq!(ran.load(Ordering::SeqCst), 20, "{:?}", log.lines());
        assert_eq!(errors, 0, "{:?}", log.lines());
    }
}

/// The usual worker, which looks at what has input only, looks at all from then on.
#[test]
fn a_subscription_for_every_round_comes_to_a_worker_that_runs() {
    let _dog = watchdog("always", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    exec.worker("w").capacity(2).timer(MS, |_| ()).unwrap();
    let running = exec.start().unwrap();
    let change = running.handle();
    let (with, without) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
    let counts = [Arc::clone(&without), Arc::clone(&with)];
    let worker = change.worker("w").unwrap();
    let called = move |m: Option<&Int32>, _: &CallbackContext<'_>| {
        counts[usize::from(m.is_some())].fetch_add(1, Ordering::SeqCst);
    };
    let id = worker
        .subscribe_always(&node, "t", Qos::reliable(), called)
        .unwrap();
    assert!(eventually(|| without.load(Ordering::SeqCst) >= 3));
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    out.publish(&Int32 { data: 1 }).unwrap();
    assert!(eventually(|| with.load(Ordering::SeqCst) == 1));
    let stats = change.remove(&id, Removal::Wait(LIMIT)).unwrap();
    assert_eq!(stats.executed, 1);
    assert_eq!(stats.without_input, without.load(Ordering::SeqCst));
}

/// The ids that the description and the running worker return serve wherever a text does, and
/// outlive what they name.
#[test]
fn handles_are_removed_by_the_ids_that_adding_returned() {
    let _dog = watchdog("ids", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let worker = exec.worker("w").capacity(16);
    assert!(worker.added_ids().is_empty());
    let worker = worker.timer(LIMIT, |_| ()).unwrap();
    let timer = worker.added_ids();
    let subscribed = worker
        .subscribe(&node, "t", Qos::reliable(), |_: &Int32, _| ())
        .unwrap()
        .added_ids();
    let parameters = node.parameters(replenish::ParameterOptions::new()).unwrap();
    let together = exec
        .worker("p")
        .parameters(&parameters)
        .unwrap()
        .added_ids();
    assert_eq!(timer, ["w/timer:0"]);
    assert_eq!(subscribed, ["/n/sub:/t"]);
    assert_eq!(together.len(), 6, "{together:?}");

    let running = exec.start().unwrap();
    let change = running.handle();
    let again = change.worker("w").unwrap();
    let again: HandleId = again
        .subscribe(&node, "t", Qos::reliable(), |_: &Int32, _| ())
        .unwrap();
    assert_eq!(again, "/n/sub:/t#2");
    let left = || running.report().handles.len();
    assert_eq!(left(), 9);
    let first = subscribed.into_iter().next().unwrap();
    for id in timer.iter().chain(&together).chain([&again]) {
        assert!(running.stats(id).is_some(), "{id}");
        change.remove(id, Removal::Wait(LIMIT)).unwrap();
        assert!(running.stats(id).is_none(), "{id}");
    }
    assert_eq!(left(), 1);
    assert!(running.stats(&first).is_some());
    change.remove(first.clone(), Removal::Wait(LIMIT)).unwrap();
    assert_eq!(left(), 0);
    let unknown = change.remove(&first, Removal::Detach).unwrap_err();
    assert_eq!(unknown, Error::UnknownHandle(first.into()));
}
