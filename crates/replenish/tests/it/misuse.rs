//! Callbacks should not wait. Each call of this crate that can wait, made in a callback, ends: at
//! its limit, with an error that says so, or with the awaited result. (Groups and removals
//! are in `groups.rs`, nested transitions and parameters in `managed_nodes.rs` and
//! `node_parameters.rs`.)

use crate::common::agent::TestAgent;
use crate::common::{Echo, eventually, executor};
use replenish::{
    Client, Context, Error, Every, Executor, HandleOptions, Qos, RunningExecutor, SpinEnd, Trigger,
};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

/// A callback waits for a server that is there, and for one that is not: no other thread has to run
/// for the answer, not even the executor of the callback.
fn waits_for_servers(asking: &Context, serving: &Context, local: bool) {
    let _dog = watchdog("server in a callback", LIMIT);
    let (serves, asks) = (
        serving.node("serves").unwrap(),
        asking.node("asks").unwrap(),
    );
    let (mut server, _) = executor(serving);
    server
        .worker("s")
        .serve::<Echo, _>(&serves, "there", Qos::services(), |_, _, _| ())
        .unwrap();
    let client = |name| -> Client<Echo> { asks.client(name, Qos::services(), LIMIT).unwrap() };
    let (there, nowhere) = (client("there"), client("nowhere"));
    let (mut exec, _) = executor(asking);
    let (tell, answers) = mpsc::channel();
    exec.worker("w")
        .timer(Every::once(MS), move |_| {
            let answers = (there.wait_for_server(LIMIT), nowhere.wait_for_server(MS));
            tell.send(answers).unwrap();
        })
        .unwrap();
    if local {
        let spun = exec.local().unwrap().spin_some(LIMIT);
        assert_eq!((spun.callbacks, spun.end), (1, SpinEnd::Worked));
    } else {
        let running = exec.start().unwrap();
        assert!(eventually(
            || running.stats("w/timer:0").unwrap().executed == 1
        ));
    }
    assert_eq!(answers.try_recv(), Ok((Ok(true), Ok(false))));
    drop(server);
}

#[test]
fn a_callback_that_waits_for_a_server_is_answered() {
    let bus = replenish::middleware::InProcessBus::new();
    let (a, b) = (bus.participant(), bus.participant());
    let (asking, serving) = (Context::new(a), Context::new(b));
    let agent = TestAgent::start("127.0.0.1:0");
    for local in [true, false] {
        waits_for_servers(&asking, &serving, local);
        waits_for_servers(&agent.context(), &agent.context(), local);
    }
}

/// A callback spins the context it is called from, in each way there is.
#[test]
fn spinning_in_a_callback_is_an_error() {
    let _dog = watchdog("spin in a callback", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let errors = Arc::new(Mutex::new(Vec::new()));
    let note = Arc::clone(&errors);
    exec.worker("w")
        .timer(Every::once(MS), move |cx| {
            let nested = || {
                let mut nested = Executor::new(&ctx);
                nested.worker("n").timer(MS, |_| ()).unwrap();
                nested
            };
            let all = [
                nested().spin().err(),
                nested().start().err(),
                nested().local().err(),
            ];
            note.lock().unwrap().extend(all);
            cx.stop();
        })
        .unwrap();
    exec.spin().unwrap();
    let errors = errors.lock().unwrap();
    assert_eq!(errors.len(), 3);
    let busy = |e: &Option<Error>| matches!(e, Some(Error::ContextBusy));
    assert!(errors.iter().all(busy), "{errors:?}");
}

/// A callback stops the executor it runs in by the owner's call, which joins all threads: all
/// others have ended when it returns, its own is named, and no thread waits out the grace period
/// for it.
#[test]
fn a_callback_that_stops_and_joins_its_own_executor_does_not_wait_for_itself() {
    let _dog = watchdog("stop in a callback", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, log) = executor(&ctx);
    exec.stop_grace(LIMIT * 10);
    let (place, other) = (Arc::new(Mutex::new(None)), Arc::new(AtomicU64::new(0)));
    let (mine, ran) = (Arc::clone(&place), Arc::clone(&other));
    let (tell, told) = mpsc::channel();
    exec.worker("self")
        .timer(MS, move |_| {
            let running: Option<RunningExecutor> = mine.lock().unwrap().take();
            if let Some(running) = running {
                let report = running.stop();
                tell.send((report.stuck, ran.load(Ordering::SeqCst)))
                    .unwrap();
            }
        })
        .unwrap();
    let count = Arc::clone(&other);
    exec.worker("other")
        .timer(MS, move |_| {
            count.fetch_add(1, Ordering::SeqCst);
        })
        .unwrap();
    *place.lock().unwrap() = Some(exec.start().unwrap());
    let (stuck, ran) = told.recv().unwrap();
    assert_eq!(stuck, ["self"]);
    std::thread::sleep(5 * MS);
    assert_eq!(other.load(Ordering::SeqCst), ran, "nobody else runs on");
    assert!(
        log.lines().iter().any(|line| line.contains("self")),
        "{:?}",
        log.lines()
    );
}

/// Hooks and triggers are the user's code as well: a panic is reported and disturbs nothing else.
#[test]
fn hooks_and_triggers_that_panic_end_nothing() {
    let _dog = watchdog("panics", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, log) = executor(&ctx);
    exec.worker("hook")
        .timer(MS, |_| Err("failed"))
        .unwrap()
        .options(HandleOptions::new().on_error(|_| panic!("error hook")));
    exec.worker("trigger")
        .trigger(Trigger::custom(|_| panic!("trigger")))
        .timer(MS, |_| ())
        .unwrap();
    exec.worker("other").timer(MS, |_| ()).unwrap();
    let running = exec.start().unwrap();
    let stats = |worker: &str| running.stats(&format!("{worker}/timer:0")).unwrap();
    let told = "trigger/trigger: callback panicked, the handle has stopped: trigger";
    assert!(eventually(|| log.has(told)), "{:?}", log.lines());
    let so_far = stats("other").executed;
    assert!(eventually(|| stats("hook").errors >= 3));
    assert!(eventually(|| stats("other").executed > so_far + 3));
    assert_eq!(stats("trigger").executed, 0);
    assert_eq!(log.lines().iter().filter(|l| *l == told).count(), 1);
    assert!(running.stop().stuck.is_empty());

    let mut exec = Executor::new(&ctx);
    exec.no_ledger().on_event(|_| panic!("event hook"));
    let mut n = 0;
    let count = move |cx: &replenish::CallbackContext<'_>| {
        n += 1;
        if n == 5 {
            cx.stop();
        }
        Err::<(), _>("failed")
    };
    exec.worker("w").timer(MS, count).unwrap();
    let report = exec.spin().unwrap();
    assert_eq!(report.handle("w/timer:0").unwrap().stats.errors, 5);
}
