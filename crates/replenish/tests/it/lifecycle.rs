//! Failing, panicking and looping callbacks; stopping from everywhere; timers.

use crate::common::{Gate, eventually, executor};
use crate::services::Square;
use replenish::middleware::rtps::{DiscoveryRange, Rtps, RtpsConfig};
use replenish::msg::std_msgs::Int32;
use replenish::{
    Context, Error, Every, Executor, Guarantee, Overrun, ParameterOptions, Qos, Removal,
};
use replenish_testkit::domain::domain;
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const LIMIT: Duration = Duration::from_secs(60);
const MS: Duration = Duration::from_millis(1);

#[test]
fn a_callbacks_error_is_counted_and_told_and_nothing_stops() {
    let _dog = watchdog("errors", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, log) = executor(&ctx);
    let mut n = 0;
    exec.worker("w")
        .timer(MS, move |_| {
            n += 1;
            if n % 2 == 0 {
                Err(format!("even {n}"))
            } else {
                Ok(())
            }
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(
        || running.stats("w/timer:0").unwrap().errors >= 5
    ));
    let report = running.stop();
    let handle = report.handle("w/timer:0").unwrap();
    assert_eq!(handle.stats.errors, handle.stats.executed / 2);
    assert!(handle.last_error.as_ref().unwrap().starts_with("even "));
    assert!(log.has("w/timer:0: callback failed (1 times): even 2"));
    assert!(!log.has("(3 times)"), "told too often: {:?}", log.lines());
}

#[test]
fn a_panic_stops_its_handle_discards_its_samples_and_leaves_the_rest_alone() {
    let _dog = watchdog("panic", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let (mut exec, log) = executor(&ctx);
    exec.worker("w")
        .subscribe(&node, "t", Qos::reliable().keep_all(1), |m: &Int32, _| {
            assert_ne!(m.data, 2, "two is not allowed");
        })
        .unwrap()
        .subscribe(&node, "t", Qos::reliable(), |_: &Int32, _| ())
        .unwrap();
    let running = exec.start().unwrap();
    for n in 1..=9 {
        out.publish(&Int32 { data: n }).unwrap();
        let seen = u64::try_from(n).unwrap();
        assert!(eventually(|| running
            .stats("/n/sub:/t#2")
            .unwrap()
            .executed
            == seen));
    }
    assert!(eventually(
        || running.stats("/n/sub:/t").unwrap().discarded == 7
    ));
    let report = running.stop();
    let handle = report.handle("/n/sub:/t").unwrap();
    assert!(handle.stats.panicked);
    assert_eq!((handle.stats.received, handle.stats.executed), (9, 1));
    assert!(
        handle
            .last_error
            .as_ref()
            .unwrap()
            .contains("two is not allowed")
    );
    assert!(log.has("/n/sub:/t: callback panicked"));
    assert!(report.stuck.is_empty());
}

#[test]
fn a_callback_stops_the_executor_that_runs_it() {
    let _dog = watchdog("stop from a callback", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.worker("w")
        .timer(Every::period(MS).first_after(Duration::ZERO), |cx| {
            assert!(!cx.is_stopping());
            cx.stop();
            assert!(cx.is_stopping());
        })
        .unwrap();
    let report = exec.spin().unwrap();
    assert_eq!(report.handle("w/timer:0").unwrap().stats.executed, 1);
    assert!(report.stuck.is_empty());
}

#[test]
fn a_stop_works_from_another_thread_and_before_the_start() {
    let _dog = watchdog("stop from elsewhere", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.stop_grace(LIMIT); // others may have the CPUs for a while
    exec.worker("w")
        .timer(Duration::from_secs(3600), |_| ())
        .unwrap();
    let stop = exec.stop_handle();
    let other = std::thread::spawn(move || {
        std::thread::sleep(20 * MS);
        stop.stop();
    });
    assert!(exec.spin().unwrap().stuck.is_empty());
    other.join().unwrap();

    let (mut exec, _) = executor(&ctx);
    exec.worker("w")
        .timer(Every::period(MS).first_after(Duration::ZERO), |_| ())
        .unwrap();
    exec.stop_handle().stop();
    let report = exec.spin().unwrap();
    assert_eq!(report.handle("w/timer:0").unwrap().stats.executed, 0);
}

/// D9: the paper's executor cancelled its threads without joining them.
#[test]
fn a_thousand_shutdowns_under_traffic() {
    let _dog = watchdog("a thousand shutdowns", 3 * LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let done = Arc::new(AtomicBool::new(false));
    let traffic = {
        let (out, done) = (out.clone(), Arc::clone(&done));
        std::thread::spawn(move || {
            let mut n = 0;
            while !done.load(Ordering::Relaxed) {
                out.publish(&Int32 { data: n }).unwrap();
                n = n.wrapping_add(1);
                std::thread::yield_now();
            }
        })
    };
    // A thousand rounds, each of which starts and joins three threads beside traffic that never
    // rests; on a machine that others load, as many as a minute has, a hundred at least.
    let (mut executed, mut rounds, end) = (0, 0, Instant::now() + LIMIT);
    while rounds < 1000 && (rounds < 100 || Instant::now() < end) {
        let (mut exec, _) = executor(&ctx);
        exec.stop_grace(LIMIT);
        exec.worker("a")
            .timer(Every::period(MS / 20).first_after(Duration::ZERO), |_| ())
            .unwrap();
        let running = exec.start().unwrap();
        // At once; while the threads find their way; in the middle of work.
        match rounds % 3 {
            0 => {}
            1 => std::thread::yield_now(),
            _ => assert!(eventually(
                || running.stats("a/timer:0").unwrap().executed > 0
            )),
        }
        let report = running.stop();
        assert!(report.stuck.is_empty(), "{report}");
        executed += report.handle("a/timer:0").unwrap().stats.executed;
        rounds += 1;
    }
    // Each with a reader that the traffic fills.
    for _ in 0..20 {
        let (mut exec, _) = executor(&ctx);
        exec.worker("b")
            .subscribe(&node, "t", Qos::reliable(), |_: &Int32, _| ())
            .unwrap();
        let running = exec.start().unwrap();
        assert!(eventually(|| running.report().dispatcher.samples > 0));
        assert!(running.stop().stuck.is_empty());
    }
    done.store(true, Ordering::Relaxed);
    traffic.join().unwrap();
    assert!(executed >= rounds / 3);
}

#[test]
fn dropping_a_running_executor_stops_and_joins_it() {
    let _dog = watchdog("drop", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let inside = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&inside);
    exec.worker("w")
        .timer(MS, move |_| {
            flag.store(true, Ordering::SeqCst);
            std::thread::sleep(20 * MS);
            flag.store(false, Ordering::SeqCst);
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| inside.load(Ordering::SeqCst)));
    drop(running);
    assert!(
        !inside.load(Ordering::SeqCst),
        "a callback was still running"
    );
    let (exec, _) = executor(&ctx);
    drop(exec.start().unwrap()); // the context is free again
}

#[test]
fn a_callback_that_never_returns_is_reported_as_stuck_and_left_behind() {
    let _dog = watchdog("stuck", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, log) = executor(&ctx);
    let gate = Gate::closed();
    let pass = gate.clone();
    exec.worker("loops")
        .timer(MS, move |_| pass.pass())
        .unwrap();
    exec.worker("fine").timer(MS, |_| ()).unwrap();
    let running = exec.start().unwrap();
    gate.arrived();
    assert!(eventually(|| running
        .stats("fine/timer:0")
        .unwrap()
        .executed
        > 0));
    let before = Instant::now();
    let report = running.stop();
    let took = before.elapsed();
    assert_eq!(report.stuck, ["loops"]);
    assert!(log.has("loops has not ended in time"));
    assert!(took >= Duration::from_millis(120), "no grace: {took:?}");
    assert!(took < LIMIT / 2, "{took:?}");
    assert!(report.handle("fine/timer:0").unwrap().stats.executed > 0);
    gate.open(); // lets the thread end
}

#[test]
fn one_context_is_spun_by_one_executor_at_a_time() {
    let _dog = watchdog("context busy", LIMIT);
    let ctx = Context::in_process();
    let (mut one, _) = executor(&ctx);
    one.worker("w").timer(MS, |_| ()).unwrap();
    let running = one.start().unwrap();
    let (two, _) = executor(&ctx);
    assert_eq!(two.start().unwrap_err(), Error::ContextBusy);
    running.stop();
    let (three, _) = executor(&ctx);
    three.start().unwrap().stop();
}

/// One in this process, and one over RTPS that has room for 20 endpoints.
fn contexts() -> [Context; 2] {
    let config = RtpsConfig {
        domain: domain(),
        range: DiscoveryRange::Localhost,
        interfaces: vec![std::net::Ipv4Addr::LOCALHOST],
        own_endpoints: 20,
        ..RtpsConfig::default()
    };
    [
        Context::in_process(),
        Context::new(Rtps::open(&config).unwrap()),
    ]
}

/// Executors come and go on one context, with threads and without. Each takes its subscriptions and
/// services with it: a publisher to one that kept all has room, and the graph knows none.
#[test]
fn an_executor_that_ends_takes_its_readers_with_it() {
    let _dog = watchdog("executors one after another", LIMIT);
    for ctx in contexts() {
        let node = ctx.node("n").unwrap();
        let keeps_all = Qos::reliable().keep_all(2);
        let out = node.publisher::<Int32>("t", keeps_all).unwrap();
        let heard = Arc::new(AtomicU64::new(0));
        for number in 0..50 {
            let (mut exec, _) = executor(&ctx);
            let count = Arc::clone(&heard);
            let client = node.client::<Square>("s", Qos::reliable(), LIMIT).unwrap();
            exec.worker("w")
                .subscribe(&node, "t", keeps_all, move |_: &Int32, _| {
                    count.fetch_add(1, Ordering::Relaxed);
                })
                .unwrap()
                .serve::<Square, _>(&node, "s", Qos::reliable(), |_, _, _| ())
                .unwrap()
                .replies::<Square, _, _>(&client, |_, _| ())
                .unwrap();
            let service = || {
                let graph = node.graph().unwrap();
                graph
                    .service("/s")
                    .map_or((0, 0), |s| (s.servers, s.clients))
            };
            assert_eq!(service(), (1, 1), "{number}");
            assert_eq!(out.subscriptions(), Some(1), "{number}");
            let end: Box<dyn FnOnce()> = if number % 2 == 0 {
                let running = exec.start().unwrap();
                Box::new(move || {
                    if number % 4 == 0 {
                        // On its way to the dispatcher as the executor ends.
                        let removed = running.handle().remove("/n/sub:/t", Removal::Detach);
                        removed.unwrap();
                    }
                    drop(running.stop());
                })
            } else {
                let local = exec.local().unwrap();
                Box::new(move || drop(local))
            };
            out.publish(&Int32 { data: number }).unwrap();
            end();
            assert_eq!(out.subscriptions(), Some(0), "{number}");
            assert_eq!(service().0, 0, "{number}");
            drop(client);
            assert_eq!(service(), (0, 0), "{number}");
            (0..3).for_each(|_| out.publish(&Int32 { data: number }).unwrap());
        }
    }
}

/// Executors that are described and dropped, or refused as they start, leave nothing, either:
/// whoever tries again after a refusal has one subscription, and no publisher waits for the other.
#[test]
fn an_executor_that_does_not_start_takes_its_readers_with_it() {
    let _dog = watchdog("executors that do not start", LIMIT);
    for ctx in contexts() {
        let node = ctx.node("n").unwrap();
        let keeps_all = Qos::reliable().keep_all(2);
        let out = node.publisher::<Int32>("t", keeps_all).unwrap();
        for number in 0..60 {
            let (mut exec, _) = executor(&ctx);
            exec.worker("w")
                .subscribe(&node, "t", keeps_all, |_: &Int32, _| ())
                .unwrap()
                .serve::<Square, _>(&node, "s", Qos::reliable(), |_, _, _| ())
                .unwrap();
            assert_eq!(out.subscriptions(), Some(1), "{number}");
            match number % 3 {
                0 => drop(exec),
                1 => {
                    exec.worker("idle");
                    exec.start().unwrap_err();
                }
                _ => {
                    // Known only when its thread is made.
                    exec.worker("elsewhere")
                        .cpu(4000)
                        .timer(MS, |_| ())
                        .unwrap();
                    let error = exec.start().unwrap_err();
                    assert!(matches!(error, Error::Thread { .. }), "{error:?}");
                }
            }
            assert_eq!(out.subscriptions(), Some(0), "{number}");
            let servers = node.graph().unwrap().service("/s").map_or(0, |s| s.servers);
            assert_eq!(servers, 0, "{number}");
            (0..3).for_each(|_| out.publish(&Int32 { data: number }).unwrap());
        }
    }
}

#[test]
fn timers_release_on_their_grid_whatever_the_callback_does() {
    let _dog = watchdog("timers", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let dues = Arc::new(Mutex::new(Vec::new()));
    let record = Arc::clone(&dues);
    exec.worker("skip")
        .timer(Every::period(5 * MS).first_after(2 * MS), move |cx| {
            assert!(cx.started() >= cx.due());
            record.lock().unwrap().push((cx.due(), cx.skipped()));
            std::thread::sleep(12 * MS);
        })
        .unwrap();
    let caught_up = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&caught_up);
    exec.worker("catch up")
        .timer(Every::period(5 * MS).overrun(Overrun::CatchUp), move |_| {
            if count.fetch_add(1, Ordering::Relaxed) == 0 {
                std::thread::sleep(100 * MS);
            }
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| dues.lock().unwrap().len() >= 10));
    let period = 5_000_000;
    let is_level = || caught_up.load(Ordering::Relaxed) + 2 >= running.report().elapsed / period;
    assert!(eventually(is_level), "it never catches up");
    let report = running.stop();
    let dues = dues.lock().unwrap();
    for pair in dues.windows(2) {
        let step = pair[1].0 - pair[0].0;
        assert_eq!(step, (pair[1].1 + 1) * period, "off the grid");
        assert!(step >= 2 * period, "12 ms of callback fit into one period");
    }
    let skip = report.handle("skip/timer:0").unwrap().stats;
    assert_eq!(skip.skipped, dues.iter().map(|d| d.1).sum());
    assert_eq!(skip.deadline_misses, skip.executed);
    assert!(skip.worst_lateness > 0);
    let catch_up = report.handle("catch up/timer:0").unwrap().stats;
    assert_eq!(catch_up.skipped, 0);
}

/// Each column ends or begins where its head does, with short and with long names.
#[test]
fn the_tables_of_a_report_line_up_with_long_names() {
    let _dog = watchdog("tables", LIMIT);
    let ctx = Context::in_process();
    let node = ctx
        .node("a/robot/with/a/name/beyond/thirty/two/characters")
        .unwrap();
    let (mut exec, _) = executor(&ctx);
    let callback = |_: &Int32, _: &replenish::CallbackContext<'_>| ();
    exec.worker("short")
        .subscribe(&node, "t", Qos::reliable(), callback)
        .unwrap();
    exec.worker("much_longer_than_sixteen")
        .timer(MS, |_| ())
        .unwrap();
    let text = exec.start().unwrap().stop().to_string();
    let lines: Vec<&str> = text.lines().collect();
    let at = |head: &str| lines.iter().position(|l| l.starts_with(head)).unwrap();
    let (threads, handles) = (at("thread "), at("handle "));
    let ends = |line: usize| lines[line].chars().count();
    assert_eq!(handles - threads, 4, "{text}");
    assert_eq!(lines.len() - handles, 3, "{text}");
    for line in threads..handles {
        assert_eq!(ends(line), ends(threads), "{text}");
    }
    let requested = lines[threads].find("requested").unwrap();
    assert!(
        lines[threads + 3][requested..].starts_with("OTHER"),
        "{text}"
    );
    for line in handles..lines.len() {
        assert_eq!(ends(line), ends(handles), "{text}");
    }
}

#[test]
fn a_report_has_what_was_asked_for_and_one_line_for_services_without_a_request() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let mut exec = Executor::new(&ctx);
    exec.no_ledger();
    let guarantee = Guarantee::at(100.0).taking(MS).deadline(5 * MS);
    let parameters = node.parameters(ParameterOptions::new()).unwrap();
    exec.worker("control")
        .guarantee(guarantee)
        .timer(10 * MS, |cx| {
            cx.stop();
        })
        .unwrap();
    exec.worker("services").parameters(&parameters).unwrap();
    let text = exec.spin().unwrap().to_string();
    let line = |head: &str| text.lines().find(|l| l.starts_with(head)).unwrap_or("");
    let added = line("control: ");
    assert!(
        added.starts_with("control: 1 ms for each callback, and "),
        "{text}"
    );
    assert!(added.ends_with(" us for switching and enforcing"), "{text}");
    assert_eq!(
        line("no request"),
        "no request: 6 services of services",
        "{text}"
    );
    let heads: Vec<&str> = line("handle ")
        .split("  ")
        .filter(|h| !h.is_empty())
        .collect();
    let names = [
        "handle", "received", "executed", "not run", "errors", "late",
    ];
    assert_eq!(
        heads.iter().map(|h| h.trim()).take(6).collect::<Vec<_>>(),
        names
    );
    assert!(!text.contains("/srv:"), "{text}");
}
