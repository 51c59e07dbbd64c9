//! Event hooks that act on the executor: on the dispatcher's thread, where all messages wait for
//! them, and on workers; over a middleware that holds a lock while it takes, too.

use crate::common::{Gate, eventually};
use replenish::msg::std_msgs::{BoundedString, Int32};
use replenish::{
    Context, Error, Event, Executor, ExecutorHandle, HandleId, HandleOptions, HandleStats, Qos,
    Removal, RunningExecutor, Topic,
};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock};
use std::time::Duration;

type Text = BoundedString;

/// Longer than any `eventually` waits: a hook that waited would fail the test.
const LIMIT: Duration = Duration::from_secs(600);
const MS: Duration = Duration::from_millis(1);

type Act = Box<dyn Fn(&ExecutorHandle, &str) + Send + Sync>;

/// The result of the one thing that the hook did.
type Done<T> = Arc<Mutex<Option<T>>>;

/// An executor with a subscription that takes short texts only, one that takes numbers, and
/// whatever `more` adds. `act` runs in the hook for the text that is too long, after which numbers
/// must come as before.
fn acts_on_oversize(
    ctx: &Context,
    peer: &Context,
    more: impl FnOnce(&mut Executor),
    act: impl Fn(&ExecutorHandle, &str) + Send + Sync + 'static,
) -> RunningExecutor {
    let node = ctx.node("n").unwrap();
    let other = peer.node("peer").unwrap();
    let long = other.publisher::<Text>("long", Qos::reliable()).unwrap();
    let numbers = other
        .publisher::<Int32>("numbers", Qos::reliable())
        .unwrap();
    let mut exec = Executor::new(ctx);
    exec.no_ledger();
    let handle: Arc<OnceLock<ExecutorHandle>> = Arc::default();
    let (known, act): (_, Act) = (Arc::clone(&handle), Box::new(act));
    exec.on_event(move |event| {
        if let Event::Oversize { handle, .. } = event {
            act(known.get().unwrap(), handle);
        }
    });
    let heard = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&heard);
    exec.worker("w")
        .capacity(4)
        .subscribe(
            &node,
            Topic::named("long").max_size(16),
            Qos::reliable(),
            |_: &Text, _| (),
        )
        .unwrap()
        .subscribe(&node, "numbers", Qos::reliable(), move |_: &Int32, _| {
            count.fetch_add(1, Ordering::SeqCst);
        })
        .unwrap();
    more(&mut exec);
    let running = exec.start().unwrap();
    handle.set(running.handle()).unwrap();
    let hears = |number: u64| {
        numbers.publish(&Int32::default()).unwrap();
        assert!(
            eventually(|| heard.load(Ordering::SeqCst) >= number),
            "the dispatcher brings nothing"
        );
    };
    hears(1);
    let text = "x".repeat(100);
    long.publish(&Text {
        data: text.as_str().try_into().unwrap(),
    })
    .unwrap();
    // Only the dispatcher can end the hook, and bring the next number.
    hears(2);
    running
}

fn note<T>(done: &Done<T>, result: T) {
    *done.lock().unwrap() = Some(result);
}

fn done<T>(done: &Done<T>) -> T {
    assert!(
        eventually(|| done.lock().unwrap().is_some()),
        "the hook has not ended"
    );
    done.lock().unwrap().take().unwrap()
}

/// On b209253 the dispatcher waited for itself to let go of the handle: no handle got a message for
/// the whole limit of the removal (4005 ms of 4 s).
#[test]
fn a_hook_that_removes_its_handle_holds_up_nobody() {
    let _dog = watchdog("removal in a hook", LIMIT);
    let ctx = Context::in_process();
    let removed: Done<Result<HandleStats, Error>> = Arc::default();
    let result = Arc::clone(&removed);
    let running = acts_on_oversize(
        &ctx,
        &ctx,
        |_| (),
        move |executor, handle| {
            note(&result, executor.remove(handle, Removal::Wait(LIMIT)));
        },
    );
    assert_eq!(done(&removed).unwrap().oversize, 1);
    assert!(eventually(|| running.stats("/n/sub:/long").is_none()));
    assert!(eventually(|| running.report().handles.len() == 1));
}

/// Neither does it wait for a callback of the handle that runs: there, too, all messages would.
/// (On b209253 the dispatcher stood still until the callback ended.)
#[test]
fn a_hook_that_removes_another_handle_does_not_wait_for_its_callback() {
    let _dog = watchdog("removal of another", LIMIT);
    let ctx = Context::in_process();
    let gate = Gate::closed();
    let (passing, inside) = (gate.clone(), gate.clone());
    let removed: Done<Result<HandleStats, Error>> = Arc::default();
    let result = Arc::clone(&removed);
    let running = acts_on_oversize(
        &ctx,
        &ctx,
        move |exec| {
            exec.worker("long")
                .timer(MS, move |_| passing.pass())
                .unwrap();
        },
        move |executor, _| {
            inside.arrived();
            note(
                &result,
                executor.remove("long/timer:0", Removal::Cancel(LIMIT)),
            );
        },
    );
    assert!(done(&removed).is_ok());
    gate.open();
    drop(running);
}

/// Adding, removing, publishing, asking and stopping in the hook, over both middlewares. On b209253
/// the hook ran while XRCE held its lock, and the first of these that needs the network waited for
/// that lock for ever.
#[test]
fn a_hook_may_do_whatever_a_callback_may() {
    let _dog = watchdog("acting hooks", LIMIT);
    let bus = Context::in_process();
    may_do_everything(&bus, &bus);
    #[cfg(feature = "xrce")]
    {
        let agent = crate::common::agent::TestAgent::start("127.0.0.1:0");
        may_do_everything(&agent.context(), &agent.context());
    }
}

fn may_do_everything(ctx: &Context, peer: &Context) {
    let node = ctx.node("hook").unwrap();
    let out = node.publisher::<Int32>("numbers", Qos::reliable()).unwrap();
    let added: Done<Result<HandleId, Error>> = Arc::default();
    let result = Arc::clone(&added);
    let running = acts_on_oversize(
        ctx,
        peer,
        |_| (),
        move |executor, handle| {
            out.publish(&Int32::default()).unwrap();
            let worker = executor.worker("w").unwrap();
            note(
                &result,
                worker.subscribe(&node, "more", Qos::reliable(), |_: &Int32, _| ()),
            );
            executor.remove(handle, Removal::Wait(LIMIT)).unwrap();
        },
    );
    assert_eq!(done(&added).unwrap(), "/hook/sub:/more");
    assert!(running.stats("/hook/sub:/more").is_some());
    assert!(running.stop().stuck.is_empty());
}

/// A stop in the hook ends the executor as one in a callback does.
#[test]
fn a_hook_on_the_dispatcher_stops_the_executor() {
    let _dog = watchdog("stop in a hook", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let mut exec = Executor::new(&ctx);
    let stop = exec.stop_handle();
    exec.no_ledger().on_event(move |event| {
        if let Event::Oversize { .. } = event {
            stop.stop();
        }
    });
    let topic = Topic::named("long").max_size(16);
    exec.worker("w")
        .subscribe(&node, topic, Qos::reliable(), |_: &Text, _| ())
        .unwrap();
    let long = node.publisher::<Text>("long", Qos::reliable()).unwrap();
    let running = exec.start().unwrap();
    let text = "x".repeat(100);
    long.publish(&Text {
        data: text.as_str().try_into().unwrap(),
    })
    .unwrap();
    let report = running.wait();
    assert!(report.stuck.is_empty(), "{report}");
}

/// A hook of a worker: its own handle goes when the callback has ended, another worker's at once.
#[test]
fn a_hook_on_a_worker_removes_handles() {
    let _dog = watchdog("hook on a worker", LIMIT);
    let ctx = Context::in_process();
    let mut exec = Executor::new(&ctx);
    exec.no_ledger().on_event(|_| ());
    let handle: Arc<OnceLock<ExecutorHandle>> = Arc::default();
    let known = Arc::clone(&handle);
    let removed: Done<[Result<HandleStats, Error>; 2]> = Arc::default();
    let result = Arc::clone(&removed);
    let hook = HandleOptions::new().on_error(move |_| {
        let Some(executor) = known.get() else {
            return;
        };
        let both = ["own/timer:0", "other/timer:0"];
        note(
            &result,
            both.map(|id| executor.remove(id, Removal::Wait(LIMIT))),
        );
    });
    exec.worker("own")
        .timer(MS, |_| Err("again"))
        .unwrap()
        .options(hook);
    exec.worker("other").timer(MS, |_| ()).unwrap();
    let running = exec.start().unwrap();
    handle.set(running.handle()).unwrap();
    let [own, other] = done(&removed);
    assert!(own.unwrap().errors > 0);
    other.unwrap();
    assert!(eventually(|| running.report().handles.is_empty()));
}
