//! Bad input gives an error that names the field and what is allowed; nothing runs.

use crate::common::executor;
use replenish::middleware::InProcessBus;
use replenish::msg::std_msgs::{BoundedHeader, Int32};
use replenish::{Budget, Context, Every, Qos, Topic};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

#[test]
fn names_and_depths_are_checked_where_they_are_given() {
    let ctx = Context::in_process();
    let says = |e: replenish::Error| e.to_string();
    assert!(says(ctx.node("a b").unwrap_err()).contains("node name \"a b\""));
    let node = ctx.node("n").unwrap();
    let publisher = |topic, qos| node.publisher::<Int32>(topic, qos).unwrap_err().to_string();
    assert!(publisher("2nd", Qos::reliable()).contains("topic name \"2nd\""));
    let depth = publisher("t", Qos::reliable().keep_last(0));
    assert_eq!(depth, "topic /t: qos.depth = 0 is not allowed: 1..=4096");

    let subscription = |topic: Topic<'_>, qos| {
        let (mut exec, _) = executor(&ctx);
        let added = exec
            .worker("w")
            .subscribe(&node, topic, qos, |_: &Int32, _| ());
        added.err().unwrap().to_string()
    };
    assert!(subscription("a//b".into(), Qos::reliable()).contains("two / in a row"));
    assert!(subscription("t".into(), Qos::reliable().keep_all(0)).contains("qos.depth = 0"));
    assert!(subscription("t".into(), Qos::reliable().keep_all(4097)).contains("qos.depth = 4097"));
    let size = subscription(Topic::named("t").max_size(5), Qos::reliable());
    assert_eq!(size, "topic /t: max_size = 5 is not allowed: 1..=4 bytes");
    assert!(subscription(Topic::named("t").max_size(0), Qos::reliable()).contains("max_size = 0"));
}

#[test]
fn timers_need_a_period() {
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let e = exec
        .worker("w")
        .timer(Every::period(Duration::ZERO), |_| ())
        .err()
        .unwrap();
    assert_eq!(
        e.to_string(),
        "timer of worker \"w\": period = 0 is not allowed: 1 ns or more"
    );
}

#[test]
fn a_topic_has_one_type() {
    let bus = InProcessBus::new();
    let (one, two) = (
        Context::new(bus.participant()),
        Context::new(bus.participant()),
    );
    let a = one.node("a").unwrap();
    let _uses_it = a.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let b = two.node("b").unwrap();
    let e = b
        .publisher::<BoundedHeader>("t", Qos::reliable())
        .unwrap_err();
    assert_eq!(
        e.to_string(),
        "publisher /t: the topic exists with type std_msgs/msg/Int32"
    );
}

#[test]
fn workers_are_checked_when_the_executor_starts() {
    let ctx = Context::in_process();
    let start = |describe: &dyn Fn(&mut replenish::Executor)| {
        let (mut exec, _) = executor(&ctx);
        describe(&mut exec);
        exec.start().unwrap_err().to_string()
    };
    let twice = start(&|e| {
        e.worker("w").timer(MS, |_| ()).unwrap();
        e.worker("w").timer(MS, |_| ()).unwrap();
    });
    assert_eq!(twice, "there are two workers named \"w\"");
    let reserved = start(&|e| {
        e.worker("dispatcher").timer(MS, |_| ()).unwrap();
    });
    assert_eq!(reserved, "there are two workers named \"dispatcher\"");
    let idle = start(&|e| {
        e.worker("w").cpu(0);
    });
    assert_eq!(idle, "worker \"w\" has no handle and no capacity for any");
    let nameless = start(&|e| {
        e.worker("").timer(MS, |_| ()).unwrap();
    });
    assert_eq!(nameless, "worker name \"\": it is empty");
    let budget = start(&|e| {
        let worker = e.worker("w").budget(Budget::of(2 * MS).every(MS));
        worker.timer(MS, |_| ()).unwrap();
    });
    assert!(
        budget.starts_with("worker \"w\": budget = 2 ms every 1 ms is not allowed"),
        "{budget}"
    );
    let stack = start(&|e| {
        e.worker("w").stack_size(1).timer(MS, |_| ()).unwrap();
    });
    assert!(
        stack.contains("worker \"w\": stack_size = 1 is not allowed"),
        "{stack}"
    );
    let enforcer = start(&|e| {
        e.enforcer_priority(1);
    });
    assert_eq!(
        enforcer,
        "executor: enforcer_priority = 1 is not allowed: 2..=99"
    );
    let cpu = start(&|e| {
        e.worker("w").cpu(4095).timer(MS, |_| ()).unwrap();
    });
    assert!(cpu.contains("w") && cpu.contains("4095"), "{cpu}");
    // After all that, the context is free.
    executor(&ctx).0.start().unwrap().stop();
}

#[test]
fn a_node_of_another_context_is_refused() {
    let (ctx, other) = (Context::in_process(), Context::in_process());
    let foreign = other.node("elsewhere").unwrap();
    let (mut exec, _) = executor(&ctx);
    let added = exec
        .worker("w")
        .subscribe(&foreign, "t", Qos::reliable(), |_: &Int32, _| ());
    let e = added.err().unwrap().to_string();
    assert_eq!(
        e,
        "node /elsewhere belongs to another context than the executor"
    );
}
