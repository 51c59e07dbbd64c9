//! Executors without threads: what each way of spinning runs, how long it takes at least, what it
//! says about it, and that waiting costs nothing.

use replenish::msg::std_msgs::Int32;
use replenish::{
    Budget, CallbackContext, Context, Error, Every, Executor, GuardCondition, LocalExecutor,
    Overrun, Policy, Qos, Removal, Semantics, SpinEnd, TimerHandle, Trigger,
};
use replenish_testkit::watchdog::watchdog;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);
const US: Duration = Duration::from_micros(1);

type Log = Arc<Mutex<Vec<String>>>;

fn note(log: &Log, what: impl Into<String>) {
    log.lock().unwrap().push(what.into());
}

fn taken(log: &Log) -> Vec<String> {
    std::mem::take(&mut *log.lock().unwrap())
}

/// Two subscriptions of one node, `b` added before `a`; and what publishes on them.
fn two(ctx: &Context, log: &Log) -> (Executor, impl Fn(&str, i32) + Send + use<>) {
    let node = ctx.node("n").unwrap();
    let mut exec = Executor::new(ctx);
    let heard = |topic: &'static str| {
        let log = Arc::clone(log);
        move |m: &Int32, _: &CallbackContext<'_>| note(&log, format!("{topic}{}", m.data))
    };
    exec.worker("w")
        .subscribe(&node, "b", Qos::reliable(), heard("b"))
        .unwrap()
        .subscribe(&node, "a", Qos::reliable(), heard("a"))
        .unwrap();
    let a = node.publisher::<Int32>("a", Qos::reliable()).unwrap();
    let b = node.publisher::<Int32>("b", Qos::reliable()).unwrap();
    let publish = move |topic: &str, data| match topic {
        "a" => a.publish(&Int32 { data }).unwrap(),
        _ => b.publish(&Int32 { data }).unwrap(),
    };
    (exec, publish)
}

#[test]
fn a_round_runs_each_handle_once_in_the_order_they_were_added() {
    let _dog = watchdog("spin_some", LIMIT);
    let (ctx, log) = (Context::in_process(), Log::default());
    let (exec, publish) = two(&ctx, &log);
    let mut local = exec.local().unwrap();
    for (topic, n) in [("a", 1), ("a", 2), ("b", 3), ("b", 4), ("a", 5)] {
        publish(topic, n);
    }
    let spun = local.spin_some(Duration::ZERO);
    assert_eq!((spun.callbacks, spun.end), (2, SpinEnd::Worked));
    assert_eq!(taken(&log), ["b3", "a1"]);
    assert_eq!(local.spin_some(Duration::ZERO).callbacks, 2);
    assert_eq!(taken(&log), ["b4", "a2"]);
    assert_eq!(local.spin_some(MS).callbacks, 1);
    assert_eq!(taken(&log), ["a5"]);
    let spun = local.spin_some(Duration::ZERO);
    assert_eq!((spun.callbacks, spun.end), (0, SpinEnd::TimedOut));
    assert_eq!(local.stats("/n/sub:/a").unwrap().executed, 3);
    assert_eq!(local.report().handles.len(), 2);
}

/// CPU time of this thread.
fn cpu() -> Duration {
    Duration::from_nanos(replenish_os::clock::thread_cpu())
}

/// rclc defects 1 and 8: a wait below 1 ms is no busy loop, and neither is one without handles.
#[test]
fn limits_are_kept_to_the_microsecond_and_without_work() {
    let _dog = watchdog("limits", LIMIT);
    for handles in [0, 1] {
        let (ctx, log) = (Context::in_process(), Log::default());
        let mut exec = match handles {
            0 => Executor::new(&ctx),
            _ => two(&ctx, &log).0,
        }
        .local()
        .unwrap();
        let waits: [fn(&mut LocalExecutor) -> replenish::SpinResult; 3] = [
            |e| e.spin_some(300 * US),
            |e| e.spin_for(300 * US),
            |e| e.spin_while(300 * US, || true),
        ];
        for wait in waits {
            let rounds = exec.report().dispatcher.rounds;
            let (mut shortest, mut slept) = (LIMIT, LIMIT);
            for _ in 0..20 {
                let since = Instant::now();
                std::thread::sleep(300 * US);
                slept = slept.min(since.elapsed());
                let since = Instant::now();
                let spun = wait(&mut exec);
                shortest = shortest.min(since.elapsed());
                assert!(since.elapsed() >= 300 * US, "{:?}", since.elapsed());
                assert_eq!((spun.callbacks, spun.end), (0, SpinEnd::TimedOut));
            }
            // The limit is no whole millisecond, however late this machine wakes us.
            assert!(shortest < slept + 500 * US, "{shortest:?} {slept:?}");
            // One look and one wait each: polling would make hundreds of rounds.
            let rounds = exec.report().dispatcher.rounds - rounds;
            assert!(rounds <= 60, "{rounds}");
        }
        let (wall, work) = (Instant::now(), cpu());
        exec.spin_for(200 * MS);
        assert!(wall.elapsed() >= 200 * MS);
        assert!(cpu() - work < 20 * MS, "{:?}", cpu() - work);
    }
}

#[test]
fn spinning_for_a_time_runs_what_comes_meanwhile() {
    let _dog = watchdog("spin_for", LIMIT);
    let (ctx, log) = (Context::in_process(), Log::default());
    let (mut exec, publish) = two(&ctx, &log);
    let ticks = Arc::clone(&log);
    exec.worker("t")
        .timer(Every::once(5 * MS), move |_| {
            publish("a", 7);
            note(&ticks, "tick");
        })
        .unwrap();
    let mut local = exec.local().unwrap();
    let end = replenish_os::clock::monotonic() + 500_000_000;
    let spun = local.spin_until(end);
    assert!(replenish_os::clock::monotonic() >= end);
    assert_eq!((spun.callbacks, spun.end), (2, SpinEnd::TimedOut));
    assert_eq!(taken(&log), ["tick", "a7"]);
}

#[test]
fn spinning_while_something_holds_ends_when_it_does_not() {
    let _dog = watchdog("spin_while", LIMIT);
    let (ctx, log) = (Context::in_process(), Log::default());
    let (exec, publish) = two(&ctx, &log);
    let mut local = exec.local().unwrap();
    (0..4).for_each(|n| publish("a", n));
    let seen = Arc::clone(&log);
    let spun = local.spin_while(LIMIT, || seen.lock().unwrap().len() < 3);
    assert_eq!((spun.callbacks, spun.end), (3, SpinEnd::Worked));
}

#[test]
fn other_threads_end_the_wait() {
    let _dog = watchdog("wake", LIMIT);
    let ctx = Context::in_process();
    let (guard, timer) = (GuardCondition::new(), TimerHandle::new());
    let mut exec = Executor::new(&ctx);
    exec.worker("w")
        .capacity(3)
        .guard(&guard, |_| ())
        .unwrap()
        .timer_with(&timer, Every::once(MS).not_started(), |_| ())
        .unwrap();
    let mut local = exec.local().unwrap();
    let (stop, live) = (local.stop_handle(), local.handle());
    let wakers: [(Box<dyn FnOnce() + Send>, SpinEnd); 4] = [
        (Box::new(move || guard.trigger()), SpinEnd::Worked),
        (Box::new(move || timer.start()), SpinEnd::Worked),
        (
            Box::new(move || {
                let worker = live.worker("w").unwrap();
                worker
                    .timer(Every::once(Duration::ZERO), |_| ())
                    .map(drop)
                    .unwrap();
            }),
            SpinEnd::Worked,
        ),
        (Box::new(move || stop.stop()), SpinEnd::Stopped),
    ];
    for (waker, end) in wakers {
        let thread = std::thread::spawn(move || {
            std::thread::sleep(10 * MS);
            waker();
        });
        let spun = local.spin_some(LIMIT);
        assert_eq!(spun.end, end);
        assert_eq!(spun.callbacks, u64::from(end == SpinEnd::Worked));
        thread.join().unwrap();
    }
    assert_eq!(local.spin().end, SpinEnd::Stopped, "it stays stopped");
}

/// Nothing is lost on the way, and no stop is: whenever it comes, the next spin ends, until it is
/// taken back.
#[test]
fn a_stopped_executor_spins_again_after_a_restart() {
    let _dog = watchdog("restart", LIMIT);
    let (ctx, log) = (Context::in_process(), Log::default());
    let (mut exec, publish) = two(&ctx, &log);
    exec.worker("late")
        .timer(MS, |cx: &CallbackContext<'_>| cx.stop())
        .unwrap();
    let mut local = exec.local().unwrap();
    let stop = local.stop_handle();
    for n in 0..3 {
        assert_eq!(local.spin().end, SpinEnd::Stopped); // by the timer
        let stopped = local.spin();
        assert_eq!((stopped.callbacks, stopped.end), (0, SpinEnd::Stopped));
        publish("a", n);
        local.restart();
        assert!(!stop.is_stopping());
        stop.stop(); // also before the spin
        assert_eq!(local.spin_for(LIMIT).end, SpinEnd::Stopped);
        assert_eq!(local.spin_one_period(MS).end, SpinEnd::Stopped);
        local.restart();
    }
    assert_eq!(local.spin().end, SpinEnd::Stopped);
    let heard = local.stats("/n/sub:/a").unwrap();
    assert_eq!((heard.received, heard.executed), (3, 3), "none is lost");
    local.restart();
    assert_eq!(local.spin_some(LIMIT).end, SpinEnd::Stopped); // the timer again
}

#[test]
fn periods_that_are_overrun_follow_the_rule() {
    let _dog = watchdog("spin_period", LIMIT);
    for rule in [Overrun::Skip, Overrun::CatchUp, Overrun::Delay] {
        let (ctx, log) = (Context::in_process(), Log::default());
        let (exec, publish) = two(&ctx, &log);
        let mut local = exec.local().unwrap();
        let every = Every::period(20 * MS).overrun(rule);
        let since = Instant::now();
        local.spin_one_period(every);
        assert!(since.elapsed() >= 20 * MS);
        (0..9).for_each(|n| publish("a", n));
        std::thread::sleep(90 * MS); // four releases are missed
        let again = Instant::now();
        let late = local.spin_one_period(every);
        assert_eq!((late.callbacks, late.end), (1, SpinEnd::Worked));
        for _ in 0..3 {
            assert_eq!(local.spin_one_period(every).callbacks, 1);
        }
        match rule {
            Overrun::Skip => assert!(late.skipped >= 3, "{late:?}"),
            Overrun::CatchUp => assert_eq!(late.skipped, 0),
            Overrun::Delay => assert!(again.elapsed() >= 60 * MS, "the grid has moved"),
        }
        if rule != Overrun::Delay {
            let count = u32::try_from(late.skipped).unwrap() + 5;
            assert!(since.elapsed() >= 20 * MS * count, "the grid stays");
        }
    }
}

#[test]
fn a_period_runs_until_somebody_stops_it() {
    let _dog = watchdog("spin_period", LIMIT);
    let ctx = Context::in_process();
    let mut exec = Executor::new(&ctx);
    let mut n = 0;
    exec.worker("w")
        .timer(Duration::from_nanos(1), move |cx| {
            n += 1;
            if n == 5 {
                cx.stop();
            }
        })
        .unwrap();
    let mut local = exec.local().unwrap();
    let since = Instant::now();
    let spun = local.spin_period(2 * MS);
    assert_eq!((spun.callbacks, spun.end), (5, SpinEnd::Stopped));
    assert!(since.elapsed() >= 10 * MS);
}

#[test]
fn triggers_and_logical_execution_time_are_those_of_a_worker() {
    let _dog = watchdog("rules", LIMIT);
    let (ctx, log) = (Context::in_process(), Log::default());
    let (mut exec, publish) = two(&ctx, &log);
    exec.worker("empty").capacity(1);
    let mut local = exec.local().unwrap();
    local.spin_some(Duration::ZERO);
    publish("a", 1);
    assert_eq!(local.spin_some(Duration::ZERO).callbacks, 1);
    drop(local);
    taken(&log);

    let node = ctx.node("n2").unwrap();
    let publisher = node.publisher::<Int32>("x", Qos::reliable()).unwrap();
    let (first, second) = (Arc::clone(&log), Arc::clone(&log));
    let again = publisher.clone();
    let mut exec = Executor::new(&ctx);
    exec.worker("w")
        .trigger(Trigger::All)
        .semantics(Semantics::LogicalExecutionTime)
        .subscribe(&node, "y", Qos::reliable(), move |m: &Int32, _| {
            again.publish(&Int32 { data: 9 }).unwrap(); // not seen in this round
            note(&first, format!("y{}", m.data));
        })
        .unwrap()
        .subscribe(
            &node,
            "x",
            Qos::reliable().keep_last(1),
            move |m: &Int32, _| {
                note(&second, format!("x{}", m.data));
            },
        )
        .unwrap();
    let mut local = exec.local().unwrap();
    publisher.publish(&Int32 { data: 1 }).unwrap();
    assert_eq!(local.spin_some(MS).end, SpinEnd::TimedOut, "y is missing");
    let y = node.publisher::<Int32>("y", Qos::reliable()).unwrap();
    y.publish(&Int32 { data: 2 }).unwrap();
    assert_eq!(local.spin_some(LIMIT).callbacks, 2);
    assert_eq!(taken(&log), ["y2", "x1"]);
    assert_eq!(local.spin_some(MS).end, SpinEnd::TimedOut, "9 alone");
}

#[test]
fn what_needs_a_thread_is_refused_by_name() {
    let ctx = Context::in_process();
    let mut exec = Executor::new(&ctx);
    exec.worker("w").budget(Budget::of(MS).every(10 * MS));
    let error = exec.local().unwrap_err();
    assert!(
        matches!(
            &error,
            Error::Parameter {
                field: "budget",
                ..
            }
        ),
        "{error}"
    );
    type Ask = fn(&mut Executor) -> &mut Executor;
    let asks: [(&str, Ask); 3] = [
        ("dispatcher", |e| e.dispatcher(Policy::Other)),
        ("dispatcher_cpu", |e| e.dispatcher_cpu(0)),
        ("lock_memory", |e| e.lock_memory(true)),
    ];
    for (field, ask) in asks {
        let mut exec = Executor::new(&ctx);
        ask(&mut exec);
        let allowed = "none in Executor::local: the thread that spins is yours";
        assert_eq!(
            exec.local().unwrap_err().to_string(),
            format!("executor: {field} = set is not allowed: {allowed}")
        );
    }
    let local = Executor::new(&ctx).local().unwrap();
    assert_eq!(Executor::new(&ctx).local().unwrap_err(), Error::ContextBusy);
    let live = local.handle();
    drop(local);
    Executor::new(&ctx).local().unwrap();
    assert!(live.remove("x", Removal::Detach).is_err());
}
