//! Services, clients and actions that come and go while the executor runs; and what is left of a
//! removed handle at the agent: nothing.

use crate::common::fibonacci::{Fibonacci, Numbers, Order};
use crate::common::{eventually, executor};
use replenish::msg::Service;
use replenish::msg::std_msgs::{Int32, Int64};
use replenish::{
    ActionClient, ActionOptions, CallbackContext, Client, Context, Error, GoalState, GoalUpdate,
    NewGoal, ParameterOptions, PublishError, Qos, Removal, Responder, RunningExecutor,
};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);
const LONG: Removal = Removal::Wait(Duration::from_secs(30));

/// Doubles a number.
struct Double;

impl Service for Double {
    type Request = Int32;
    type Response = Int64;
    const TYPE_NAME: &'static str = "test_msgs/srv/Double";
}

fn running(ctx: &Context, capacity: usize) -> RunningExecutor {
    let (mut exec, _) = executor(ctx);
    exec.worker("w").capacity(capacity);
    exec.start().unwrap()
}

/// A service and its client are added, used and removed, again and again.
fn services_come_and_go(ctx: &Context, rounds: i32) {
    let node = ctx.node("n").unwrap();
    let running = running(ctx, 2);
    let change = running.handle();
    let last = Arc::new(AtomicI64::new(0));
    for n in 1..=rounds {
        let worker = || change.worker("w").unwrap();
        let double = |request: &Int32, reply: &mut Int64, _: &CallbackContext<'_>| {
            reply.data = 2 * i64::from(request.data);
        };
        let server = worker()
            .serve::<Double, _>(&node, "double", Qos::reliable(), double)
            .unwrap();
        let client: Client<Double> = node.client("double", Qos::reliable(), LIMIT).unwrap();
        let note = Arc::clone(&last);
        let replies = worker()
            .replies(&client, move |reply, _| {
                note.store(reply.unwrap().data, Ordering::SeqCst);
            })
            .unwrap();
        let number = client.call(&Int32 { data: n }).unwrap();
        let doubled = || last.load(Ordering::SeqCst) == 2 * i64::from(n);
        assert!(eventually(doubled), "request {number} of round {n}");
        let stats = change.remove(&server, LONG).unwrap();
        assert_eq!((stats.executed, stats.errors), (1, 0));
        assert_eq!(change.remove(&replies, LONG).unwrap().executed, 1);
        assert!(client.call(&Int32 { data: n }).is_err(), "it was removed");
    }
    assert!(running.report().handles.is_empty());
}

#[test]
fn services_come_and_go_in_one_process() {
    let _dog = watchdog("services come and go", LIMIT);
    services_come_and_go(&Context::in_process(), 1000); // more than there are readers
}

/// A removed handle's objects at the agent go, too; ids are used again.
#[cfg(feature = "xrce")]
#[test]
fn nothing_is_left_at_the_agent() {
    let _dog = watchdog("at the agent", 2 * LIMIT);
    let agent = crate::common::agent::TestAgent::start("127.0.0.1:0");
    let ctx = agent.context();
    services_come_and_go(&ctx, 100);
    let node = ctx.node("n").unwrap();
    let kept = node.publisher::<Int32>("kept", Qos::reliable()).unwrap();
    let running = running(&ctx, 2);
    let change = running.handle();
    let before = agent.entities();
    let heard = Arc::new(AtomicI64::new(0));
    for n in 0..600 {
        let topic = if n % 2 == 0 { "kept" } else { "other" };
        let note = Arc::clone(&heard);
        let id = change
            .worker("w")
            .unwrap()
            .subscribe(&node, topic, Qos::reliable(), move |_: &Int32, _| {
                note.fetch_add(1, Ordering::SeqCst);
            })
            .unwrap();
        if n == 598 {
            let with = agent.entities();
            assert_eq!(with.get("data_reader"), Some(&1), "{with:?}");
            kept.publish(&Int32 { data: n }).unwrap();
            assert!(eventually(|| heard.load(Ordering::SeqCst) == 1));
        }
        change.remove(&id, LONG).unwrap();
    }
    assert!(
        eventually(|| agent.entities() == before),
        "{:?}, {before:?}",
        agent.entities()
    );
    for kind in ["data_reader", "subscriber", "requester", "replier"] {
        assert_eq!(before.get(kind), None);
    }
    assert_eq!(before.get("topic"), Some(&1), "of the publisher");
    drop(kept);
    let left = || agent.entities().into_keys().collect::<Vec<_>>();
    assert!(eventually(|| left() == ["participant"]), "{:?}", left());
}

/// A late reply reaches no client, not even another one in the same place.
#[test]
fn a_late_reply_does_not_reach_the_next_one() {
    let _dog = watchdog("late reply", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let running = running(&ctx, 3);
    let change = running.handle();
    let waiting: Arc<Mutex<Vec<Responder<Double>>>> = Arc::default();
    let keep = Arc::clone(&waiting);
    let worker = || change.worker("w").unwrap();
    worker()
        .serve_later::<Double, _, _>(&node, "double", Qos::reliable(), move |_, to, _| {
            keep.lock().unwrap().push(to);
        })
        .unwrap();
    let client: Client<Double> = node.client("double", Qos::reliable(), LIMIT).unwrap();
    let replies = worker().replies(&client, |_, _| ()).unwrap();
    client.call(&Int32 { data: 1 }).unwrap();
    assert!(eventually(|| waiting.lock().unwrap().len() == 1));
    change.remove(&replies, LONG).unwrap();
    let next = worker()
        .subscribe(&node, "numbers", Qos::reliable(), |_: &Int64, _| ())
        .unwrap();
    let late = waiting.lock().unwrap().pop().unwrap();
    assert_eq!(late.reply(&Int64 { data: 2 }), Err(PublishError::LinkDown));
    assert_eq!(change.remove(&next, LONG).unwrap().received, 0);
}

#[test]
fn actions_come_and_go_whole() {
    let _dog = watchdog("actions come and go", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let running = running(&ctx, 9);
    let change = running.handle();
    let serve = || {
        let goal = |goal: &Order, new: NewGoal<Fibonacci>, _: &CallbackContext<'_>| {
            let order = usize::try_from(goal.order).unwrap();
            new.accept()?.succeed(&Numbers::of(order))
        };
        let worker = change.worker("w").unwrap();
        worker.serve_action(&node, "fib", ActionOptions::goals(2), goal, |_, _| true)
    };
    for order in (2..60).cycle().take(300) {
        let server = serve().unwrap();
        let client: ActionClient<Fibonacci> =
            node.action_client("fib", ActionOptions::goals(2)).unwrap();
        let results = Arc::new(Mutex::new(Vec::new()));
        let note = Arc::clone(&results);
        let follow = change
            .worker("w")
            .unwrap()
            .follow(&client, move |_, update, _| {
                if let GoalUpdate::Result(GoalState::Succeeded, numbers) = update {
                    note.lock().unwrap().push(numbers.clone());
                }
            });
        client.send(&Order { order }).unwrap();
        assert!(eventually(|| results.lock().unwrap().len() == 1));
        let expected = Numbers::of(usize::try_from(order).unwrap());
        assert_eq!(results.lock().unwrap()[0], expected);
        // There is no room for a part of one more: none of it is added.
        assert!(matches!(serve(), Err(Error::Capacity { limit: 9, .. })));
        for id in server.iter().chain(&follow.unwrap()) {
            change.remove(id, LONG).unwrap();
        }
        let empty = || running.report().handles.is_empty();
        assert!(eventually(empty));
    }
    assert!(
        !change
            .worker("w")
            .unwrap()
            .timer(MS, |_| ())
            .unwrap()
            .is_empty()
    );
}

/// A builder says the ids of what was added last; a timer's id does not change with an action or
/// parameters before it; what the builder says can be removed.
#[test]
fn ids_are_stable_and_the_builder_says_them() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    let ids = |worker: &replenish::WorkerBuilder<'_>| -> Vec<String> {
        worker.added().map(String::from).collect()
    };
    let worker = exec.worker("w");
    assert!(ids(&worker).is_empty());
    let worker = worker
        .serve_action::<Fibonacci, _, _, _>(
            &node,
            "fib",
            ActionOptions::goals(2),
            |_: &Order, new: NewGoal<Fibonacci>, _| new.reject(),
            |_, _| true,
        )
        .unwrap();
    let action = ids(&worker);
    let parts = ["timer:/fib/_action/expiry", "srv:/fib/_action/get_result"];
    assert_eq!(action[..2], parts.map(|part| format!("/n/{part}")));
    assert_eq!(action.len(), 4);
    let parameters = node.parameters(ParameterOptions::new()).unwrap();
    let worker = worker.parameters(&parameters).unwrap();
    assert_eq!(ids(&worker).len(), 6);
    let worker = worker.timer(MS, |_| ()).unwrap();
    assert_eq!(ids(&worker), ["w/timer:0"]);
    let worker = worker.task(async {}).unwrap();
    assert_eq!(ids(&worker), ["w/guard:0"]);
    let running = exec.start().unwrap();
    for id in action {
        running.handle().remove(&id, LONG).unwrap();
    }
    assert_eq!(running.report().handles.len(), 8);
    assert!(running.stats("w/timer:0").is_some());
}
