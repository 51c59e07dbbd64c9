//! After the start nothing allocates, whatever a worker runs: every kind of handle, its hooks, its
//! errors and missed deadlines; triggers, Logical Execution Time and the output barrier.

use crate::ALLOC;
use crate::common::eventually;
use replenish::args::{Environment, LogLevel, RosArgs};
use replenish::msg::Service;
use replenish::msg::std_msgs::Int32;
use replenish::{
    Client, Context, Every, Executor, GuardCondition, HandleOptions, OnMiss, Overrun, Qos, RawType,
    Report, Semantics, TimerHandle, Topic, Trigger, log_debug, log_info, sleep,
};
use replenish_interfaces::rcl_interfaces::msg::{Log, LogView};
use replenish_interfaces::std_msgs::msg as text;
use replenish_testkit::alloc::exempt_this_thread;
use replenish_testkit::harness::{Trial, trial};
use replenish_testkit::watchdog::watchdog;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);
/// The count to wait for, of everything.
const ENOUGH: u64 = 200;

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial("no_kind_of_handle_allocates", kinds),
        trial("no_rule_of_a_worker_allocates", rules),
        trial("no_line_of_a_log_allocates", logs),
        trial("no_future_allocates", futures),
    ]
}

/// Doubles a number.
struct Double;

impl Service for Double {
    type Request = Int32;
    type Response = Int32;
    const TYPE_NAME: &'static str = "test_msgs/srv/Double";
}

fn quiet_executor(ctx: &Context) -> Executor {
    let mut exec = Executor::new(ctx);
    exec.no_ledger().on_event(|_| ());
    exec
}

/// Runs it until all of its handles have run often enough, and counts.
fn runs_without(exec: Executor) -> Report {
    let running = exec.start().unwrap();
    exempt_this_thread();
    let ids: Vec<_> = running.report().handles;
    let all = |least: u64| {
        let often = |id: &str| running.stats(id).is_some_and(|s| s.executed >= least);
        ids.iter().all(|h| often(&h.id))
    };
    // Once each first, so that every thread has begun, and the harness has nothing left to do.
    assert!(eventually(|| all(1)), "{}", running.report());
    ALLOC.arm();
    let done = eventually(|| all(1 + ENOUGH));
    let counted = ALLOC.disarm();
    let report = running.stop();
    assert!(done, "{report}");
    assert_eq!(counted, 0, "{report}");
    report
}

/// A timer drives every other kind of handle, from its callback.
fn kinds() {
    let _dog = watchdog("kinds", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable().keep_last(8);
    let topic = |name| node.publisher::<Int32>(name, qos).unwrap();
    let (typed, raw, large) = (topic("typed"), topic("raw"), topic("large"));
    let text = node.publisher::<text::String>("text", qos).unwrap();
    let client: Client<Double> = node.client("double", qos, LIMIT).unwrap();
    let later: Client<Double> = node.client("later", qos, LIMIT).unwrap();
    let (guard, once, changed) = (
        GuardCondition::new(),
        TimerHandle::new(),
        TimerHandle::new(),
    );
    let mut exec = quiet_executor(&ctx);
    let (ask, ask_later, wake) = (client.clone(), later.clone(), guard.clone());
    let (again, change) = (once.clone(), changed.clone());
    let every = Every::period(MS).overrun(Overrun::CatchUp);
    exec.worker("drive")
        .timer(every, move |cx| {
            let message = Int32 { data: 1 };
            typed.publish(&message)?;
            raw.publish(&message)?;
            large.publish(&message)?;
            text.publish_view(&text::StringView { data: "as it came" })?;
            ask.call(&message).ok();
            ask_later.call(&message).ok();
            wake.trigger();
            again.start();
            change
                .set_period(MS / (1 + u32::from(cx.now() % 2 == 0)))
                .ok();
            Ok::<(), replenish::PublishError>(())
        })
        .unwrap();
    let (missed, told) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicU64::new(0)));
    let (miss, tell) = (Arc::clone(&missed), Arc::clone(&told));
    let hooks = HandleOptions::new()
        .deadline(
            Duration::from_nanos(1),
            OnMiss::Call(Box::new(move |_| {
                miss.fetch_add(1, Ordering::Relaxed);
            })),
        )
        .on_error(move |_| {
            tell.fetch_add(1, Ordering::Relaxed);
        });
    exec.worker("serve")
        .serve::<Double, _>(&node, "double", qos, |request, response, _| {
            response.data = 2 * request.data;
        })
        .unwrap()
        .serve_later::<Double, _, _>(&node, "later", qos, |request, to, _| to.reply(request))
        .unwrap();
    exec.worker("run")
        .subscribe(&node, "typed", qos, |_: &Int32, cx| {
            assert!(cx.handle().is_some() && !cx.stop_handle().is_stopping());
            Err("always")
        })
        .unwrap()
        .options(hooks)
        .subscribe_raw(&node, "raw", RawType::of::<Int32>(), qos, |_: &[u8], _| ())
        .unwrap()
        .subscribe_view::<text::String, _, _>(&node, "text", qos, |text, _| {
            assert_eq!(text.data, "as it came");
        })
        .unwrap()
        .guard(&guard, |_| ())
        .unwrap()
        .timer_with(&once, Every::once(MS / 4), |_| ())
        .unwrap()
        .timer_with(&changed, MS, |_| ())
        .unwrap()
        .replies::<Double, _, _>(&client, |_, _| ())
        .unwrap()
        .replies::<Double, _, _>(&later, |_, _| ())
        .unwrap();
    runs_without(exec);
    assert!(missed.load(Ordering::Relaxed) >= ENOUGH);
    assert!(told.load(Ordering::Relaxed) >= ENOUGH);
}

/// Rounds by the clock with a custom trigger, snapshots and a barrier; several messages per round;
/// callbacks of every round; priorities.
fn rules() {
    let _dog = watchdog("rules", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable().keep_last(8);
    let out = node.publisher::<Int32>("t", qos).unwrap();
    let mut exec = quiet_executor(&ctx);
    exec.worker("let")
        .every(MS)
        .trigger(Trigger::custom(|handles| handles.iter().any(|(_, r)| r)))
        .semantics(Semantics::LogicalExecutionTime)
        .output_barrier(4, 8)
        .timer(MS, move |cx| {
            cx.publish(&out, &Int32 { data: 1 })?;
            cx.publish(&out, &Int32 { data: 2 })
        })
        .unwrap()
        .subscribe(&node, "t", qos, |_: &Int32, _| ())
        .unwrap();
    for (name, trigger) in [("any", Trigger::Any), ("one", Trigger::one("/n/sub:/t#4"))] {
        exec.worker(name)
            .trigger(trigger)
            .messages_per_round(3)
            .subscribe(&node, "t", qos, |_: &Int32, _| ())
            .unwrap()
            .subscribe_always(&node, "t", qos, |_: Option<&Int32>, _| ())
            .unwrap()
            .options(HandleOptions::new().priority(7));
    }
    runs_without(exec);
}

/// Callbacks log, and so do threads beside them; the thread that writes allocates nothing, either.
fn logs() {
    let _dog = watchdog("logs", LIMIT);
    let line = "p --ros-args --disable-stdout-logs"
        .split(' ')
        .map(String::from);
    let args = RosArgs::parse(line, &Environment::default()).unwrap();
    let ctx = Context::in_process().with_args(args);
    let node = ctx.node("n").unwrap();
    node.logger().install().unwrap();
    let mut exec = quiet_executor(&ctx);
    for worker in ["a", "b"] {
        let logger = node.logger().child(worker);
        let mut n = 0;
        exec.worker(worker)
            .timer(MS, move |_| {
                n += 1;
                log_info!(logger, "line {n} of {:?}", logger.name());
                log_info!(logger.once(), "first");
                log_info!(logger.throttle(MS * 10), "{:600}", "cut");
                log_debug!(logger, "not enabled");
                log::info!(target: "library::part", "line {n} of the facade");
                log::trace!("not enabled");
                logger.set_level(LogLevel::Info);
            })
            .unwrap();
    }
    let qos = Qos::reliable().keep_last(100);
    let topic = Topic::named("/rosout").max_size(1400);
    exec.worker("listener")
        .subscribe_view::<Log, _, _>(&node, topic, qos, |_: &LogView<'_>, _| ())
        .unwrap();
    runs_without(exec);
}

/// Every kind of async callback awaits a call in each of its turns.
fn futures() {
    let _dog = watchdog("futures", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let qos = Qos::reliable().keep_last(8);
    let out = node.publisher::<Int32>("t", qos).unwrap();
    let client: Client<Double> = node.client("double", qos, LIMIT).unwrap();
    let outer: Client<Double> = node.client("outer", qos, LIMIT).unwrap();
    let [of_timer, of_topic, of_outer, of_task] = [(); 4].map(|()| client.clone());
    let outer_of_timer = outer.clone();
    let mut exec = quiet_executor(&ctx);
    exec.worker("server")
        .serve::<Double, _>(&node, "double", qos, |request, response, _| {
            response.data = 2 * request.data;
        })
        .unwrap();
    exec.worker("w")
        .calls(&client)
        .unwrap()
        .calls(&outer)
        .unwrap()
        .timer_async(MS, move || {
            let (client, outer, out) = (of_timer.clone(), outer_of_timer.clone(), out.clone());
            async move {
                let one = client.call_async(&Int32 { data: 1 }).await;
                let two = outer.call_async(&one.unwrap()).await;
                out.publish(&two.unwrap())
            }
        })
        .unwrap()
        .subscribe_async(&node, "t", qos, move |message: Int32| {
            let client = of_topic.clone();
            async move { client.call_async(&message).await.map(|_| ()) }
        })
        .unwrap()
        .serve_async::<Double, _, _>(&node, "outer", qos, move |request: Int32| {
            let client = of_outer.clone();
            async move { client.call_async(&request).await.unwrap() }
        })
        .unwrap()
        .task(async move {
            loop {
                of_task.call_async(&Int32 { data: 3 }).await.unwrap();
            }
        })
        .unwrap()
        .task(async {
            loop {
                sleep(MS).await;
            }
        })
        .unwrap();
    runs_without(exec);
}
