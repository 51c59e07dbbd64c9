//! A worker without budget is stopped whatever kind of callback it is in: none of them runs under a
//! lock of the executor, where nothing would stop it.

use crate::common::fibonacci::{Fibonacci, Order};
use crate::common::{cpu, eventually, executor};
use replenish::msg::Service;
use replenish::msg::std_msgs::Int32;
use replenish::{
    ActionOptions, Budget, CallbackContext, Context, Every, NewGoal, Node, Qos, WorkerBuilder,
};
use replenish_os::{Tid, clock};
use replenish_testkit::harness::{Trial, rt_trial};
use replenish_testkit::watchdog::watchdog;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

struct Double;

impl Service for Double {
    type Request = Int32;
    type Response = Int32;
    const TYPE_NAME: &'static str = "test_msgs/srv/Double";
}

/// The worker's thread, and whether its callback is to end.
#[derive(Clone, Default)]
struct Spin(Arc<std::sync::Mutex<Option<Tid>>>, Arc<AtomicBool>);

impl Spin {
    /// The callback.
    fn run(&self) {
        *self.0.lock().unwrap() = Some(replenish_os::current_tid());
        while !self.1.load(Ordering::Relaxed) {}
    }
}

/// Gives the worker a handle whose callback spins, and the executor whatever makes it run.
type Adds = fn(&Node, WorkerBuilder<'_>, Spin);

pub(crate) fn trials() -> Vec<Trial> {
    let kinds: [(&str, Adds); 8] = [
        ("a_timer", |_, worker, spin| {
            let called = move |_: &CallbackContext<'_>| spin.run();
            worker.timer(Every::once(MS), called).unwrap();
        }),
        ("a_subscription", |node, worker, spin| {
            let called = move |_: &Int32, _: &CallbackContext<'_>| spin.run();
            let worker = worker
                .subscribe(node, "a", Qos::reliable(), called)
                .unwrap();
            publishes(node, worker);
        }),
        ("a_service", |node, worker, spin| {
            let served = move |_: &Int32, _: &mut Int32, _: &CallbackContext<'_>| spin.run();
            let worker = worker.serve::<Double, _>(node, "a", Qos::services(), served);
            calls(node, worker.unwrap());
        }),
        ("a_timers_future", |_, worker, spin| {
            let called = move || {
                let spin = spin.clone();
                async move { spin.run() }
            };
            worker.timer_async(Every::once(MS), called).unwrap();
        }),
        ("a_task", |_, worker, spin| {
            let task = async move {
                replenish::sleep(MS).await;
                spin.run();
            };
            worker.task(task).unwrap();
        }),
        ("a_subscriptions_future", |node, worker, spin| {
            let called = move |_: Int32| {
                let spin = spin.clone();
                async move { spin.run() }
            };
            let qos = Qos::reliable();
            publishes(
                node,
                worker.subscribe_async(node, "a", qos, called).unwrap(),
            );
        }),
        ("a_services_future", |node, worker, spin| {
            let served = move |request: Int32| {
                let spin = spin.clone();
                async move {
                    spin.run();
                    request
                }
            };
            let worker = worker.serve_async::<Double, _, _>(node, "a", Qos::services(), served);
            calls(node, worker.unwrap());
        }),
        ("news_of_a_goal", news_of_a_goal),
    ];
    let trial = |(name, adds): (&str, Adds)| rt_trial(name, move || is_stopped_in(adds));
    kinds.map(trial).into()
}

/// Publishes from the same worker, once.
fn publishes(node: &Node, worker: WorkerBuilder<'_>) {
    let publisher = node.publisher::<Int32>("a", Qos::reliable()).unwrap();
    let once = move |_: &CallbackContext<'_>| publisher.publish(&Int32 { data: 1 });
    worker.timer(Every::once(MS), once).unwrap();
}

/// Calls the service from the same worker, once.
fn calls(node: &Node, worker: WorkerBuilder<'_>) {
    let client = node.client::<Double>("a", Qos::services(), LIMIT).unwrap();
    let calls = client.clone();
    let once = move |_: &CallbackContext<'_>| calls.call(&Int32 { data: 1 }).map(drop);
    let ignored = |_: Result<&Int32, replenish::NoReply>, _: &CallbackContext<'_>| ();
    let worker = worker.replies(&client, ignored).unwrap();
    worker.timer(Every::once(MS), once).unwrap();
}

/// The server rejects, which the spinning callback is told.
fn news_of_a_goal(node: &Node, worker: WorkerBuilder<'_>, spin: Spin) {
    let options = ActionOptions::goals(1);
    let rejects = |_: &Order, new: NewGoal<Fibonacci>, _: &CallbackContext<'_>| new.reject();
    let worker = worker
        .serve_action(node, "fibonacci", options, rejects, |_, _| true)
        .unwrap();
    let client = node
        .action_client::<Fibonacci>("fibonacci", options)
        .unwrap();
    let sends = client.clone();
    worker
        .follow(&client, move |_, _, _: &CallbackContext<'_>| spin.run())
        .unwrap()
        .timer(Every::once(MS), move |_| {
            sends.send(&Order { order: 1 }).map(drop)
        })
        .unwrap();
}

/// 5 ms every 100 ms. In a future or in news of a goal the callback got the whole CPU: the
/// executor held a lock around it.
fn is_stopped_in(adds: Adds) {
    let _dog = watchdog("is_stopped_in", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let node = ctx.node("n").unwrap();
    let spin = Spin::default();
    let budget = Budget::of(5 * MS).every(100 * MS).suspend();
    adds(
        &node,
        exec.worker("w").budget(budget).cpu(cpu()),
        spin.clone(),
    );
    let running = exec.start().unwrap();
    assert!(eventually(|| running.usage("w").unwrap().low), "it spins");
    let thread = spin.0.lock().unwrap().unwrap();
    let used = || clock::ThreadCpuClock::of(thread).read().unwrap();
    let (from, before) = (clock::monotonic(), used());
    std::thread::sleep(300 * MS);
    let (took, took_cpu) = (clock::monotonic() - from, used() - before);
    spin.1.store(true, Ordering::Relaxed);
    drop(running.stop());
    assert!(took_cpu <= took / 4, "{took_cpu} of {took} ns");
}
