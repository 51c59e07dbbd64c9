//! A wrong description is an error that names the field and the allowed range, when the executor
//! starts or at once, and never something else in silence.

use crate::common::{Echo, executor};
use replenish::msg::std_msgs::Int32;
use replenish::{
    Client, Context, Error, Every, HandleOptions, Low, Params, Policy, Qos, RawType, Topic,
    Trigger, WorkerBuilder,
};
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);

/// The error of a worker with these rules and one timer; with threads and without it is the same.
fn refused(rules: impl Fn(WorkerBuilder<'_>) -> WorkerBuilder<'_>) -> String {
    let ctx = Context::in_process();
    let described = || {
        let (mut exec, _) = executor(&ctx);
        rules(exec.worker("w")).timer(MS, |_| ()).unwrap();
        exec
    };
    let error = described().start().err().map(|e| e.to_string());
    assert_eq!(described().local().err().map(|e| e.to_string()), error);
    error.unwrap_or_default()
}

#[test]
fn how_a_handle_is_treated_is_said_behind_it() {
    assert_eq!(
        refused(|w| w.options(HandleOptions::new().priority(1))),
        r#"worker "w": options = set is not allowed: only after the handle it configures"#
    );
}

/// On b209253 it ran, and had no budget in a seventh of its callbacks (C12).
#[test]
fn one_pending_replenishment_is_too_few() {
    let policy = |max_repl| {
        let (budget, period) = (30_000_000, 100_000_000);
        let params = Params::new(60, Low::Background(6), budget, period, max_repl).unwrap();
        Policy::Sporadic(params)
    };
    // Without threads no policy is allowed at all.
    let (mut exec, _) = executor(&Context::in_process());
    exec.worker("w")
        .policy(policy(1))
        .timer(MS, |_| ())
        .unwrap();
    assert_eq!(
        exec.start().unwrap_err().to_string(),
        "worker \"w\": max_repl = 1 is not allowed: 2 to 128: with one pending replenishment each \
         callback puts all of the budget off, until nothing is there for a period"
    );
}

#[test]
fn a_trigger_waits_for_a_handle_of_its_worker() {
    assert_eq!(
        refused(|w| w.trigger(Trigger::one("w/timer:7"))),
        r#"worker "w": trigger = w/timer:7 is not allowed: a handle of this worker: w/timer:0"#
    );
    assert_eq!(refused(|w| w.trigger(Trigger::one("w/timer:0"))), "");
    // It may come later.
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let worker = exec.worker("w").capacity(2);
    let worker = worker.trigger(Trigger::one("w/timer:1"));
    worker.timer(MS, |_| ()).unwrap();
    drop(exec.start().unwrap());
}

#[test]
fn rounds_by_the_clock_have_a_period_that_begins_with_the_executor() {
    let allowed = "is not allowed: a period that begins with the executor";
    assert_eq!(
        refused(|w| w.every(Every::once(MS))),
        format!(r#"worker "w": every = once {allowed}"#)
    );
    assert_eq!(
        refused(|w| w.every(Every::period(MS).not_started())),
        format!(r#"worker "w": every = not_started {allowed}"#)
    );
    assert_eq!(
        refused(|w| w.every(Duration::ZERO)),
        r#"worker "w": every = 0 is not allowed: 1 ns or more"#
    );
}

#[test]
fn sizes_of_rounds_and_barriers_have_their_ranges() {
    assert_eq!(
        refused(|w| w.messages_per_round(0)),
        r#"worker "w": messages_per_round = 0 is not allowed: 1 or more"#
    );
    for (samples, bytes, why) in [
        (0, 64, "output_barrier.samples = 0 is not allowed: 1..=4096"),
        (
            4097,
            64,
            "output_barrier.samples = 4097 is not allowed: 1..=4096",
        ),
        (
            1,
            0,
            "output_barrier.bytes = 0 is not allowed: 1..=268435456",
        ),
        (
            1,
            usize::MAX,
            "output_barrier.bytes = 18446744073709551615 is not allowed: 1..=268435456",
        ),
    ] {
        assert_eq!(
            refused(|w| w.output_barrier(samples, bytes)),
            format!(r#"worker "w": {why}"#)
        );
    }
}

/// Its replies would go to whatever has the same place in the executor's middleware.
#[test]
fn a_client_of_another_context_is_refused() {
    let (ctx, other) = (Context::in_process(), Context::in_process());
    let client: Client<Echo> = other
        .node("n")
        .unwrap()
        .client("echo", Qos::services(), MS)
        .unwrap();
    let (mut exec, _) = executor(&ctx);
    let added = exec.worker("w").replies(&client, |_, _| ());
    assert_eq!(added.err(), Some(Error::ForeignNode("/n".into())));
    // It is as free as before.
    let (mut exec, _) = executor(&other);
    exec.worker("w").replies(&client, |_, _| ()).unwrap();
}

#[test]
fn clients_have_time_and_raw_types_have_names() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let client = node.client::<Echo>("echo", Qos::services(), Duration::ZERO);
    assert_eq!(
        client.unwrap_err().to_string(),
        "service /echo: limit = 0 is not allowed: 1 ns or more"
    );
    let ty = RawType {
        name: "",
        ..RawType::of::<Int32>()
    };
    let (mut exec, _) = executor(&ctx);
    let worker = exec.worker("w");
    let topic = Topic::named("t");
    let added = worker.subscribe_raw(&node, topic, ty, Qos::reliable(), |_, _| ());
    assert_eq!(
        added.err().unwrap().to_string(),
        r#"topic t: type = "" is not allowed: a name and a DDS name"#
    );
}
