//! The flaws D1 to D13 of the executor behind the RTAS paper ("budget-based real-time executor for
//! micro-ROS", branch `feature/rbs-nuttx` of micro-ROS/rclc): one test each, that fails where the
//! flaw is and passes here. Each says what the original did.

use crate::common::scripted::Scripted;
use crate::common::{Gate, burn, cpu, eventually, executor, settles};
use replenish::middleware::InProcessBus;
use replenish::msg::Service;
use replenish::msg::std_msgs::{Int32, UInt8MultiArray};
use replenish::{
    Budget, Client, Context, Error, Every, GuardCondition, Params, Policy, Qos, Semantics, Trigger,
};
use replenish_os::{ThreadSpec, clock, spawn};
use replenish_testkit::harness::{Trial, rt_trial, trial};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

const LIMIT: Duration = Duration::from_secs(120);
const MS: Duration = Duration::from_millis(1);

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial("d01_publishers_never_wait_for_the_dispatchers_wait", d01),
        rt_trial("d02_a_background_worker_in_the_session_lock_inherits", d02),
        trial("d03_a_worker_that_has_room_again_is_served_at_once", d03),
        trial("d04_a_busy_worker_does_not_make_the_dispatcher_spin", d04),
        trial("d05_one_worker_runs_every_kind_of_handle_and_let", d05),
        rt_trial("d06_the_kernel_confirms_policy_and_priority", d06),
        trial("d07_every_loss_and_every_late_callback_is_counted", d07),
        rt_trial("d08_workers_are_woken_in_priority_order", d08),
        trial("d09_a_stop_joins_and_frees_and_nothing_runs_on", d09),
        trial("d10_every_error_is_told_not_only_the_last", d10),
        trial("d11_parameters_are_copied_and_stacks_are_as_asked", d11),
        rt_trial("d12_time_blocked_in_a_callback_is_not_charged", d12),
        rt_trial("d13_a_flood_does_not_outrun_the_dispatchers_budget", d13),
    ]
}

fn fifo(priority: u8) -> Policy {
    Policy::fifo(priority).unwrap()
}

fn int(data: i32) -> Int32 {
    Int32 { data }
}

/// D1: the original held its middleware mutex while it waited for data, up to the whole timeout:
/// every publisher waited as long. Here the dispatcher waits without a timeout, and nothing ever
/// arrives: a lock held across that would hang this test.
fn d01() {
    let _dog = watchdog("d01", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("out", Qos::reliable()).unwrap();
    let (mut exec, _) = executor(&ctx);
    let sent = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&sent);
    exec.worker("w")
        .timer(Every::period(MS).first_after(Duration::ZERO), move |_| {
            out.publish(&int(1))?;
            count.fetch_add(1, Ordering::Relaxed);
            Ok::<(), replenish::PublishError>(())
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| sent.load(Ordering::Relaxed) >= 10));
    let report = running.stop();
    assert!(report.dispatcher.rounds <= 2, "{:?}", report.dispatcher);
}

/// A reader that keeps all, in one slot: the callback has a message, the slot has one, one waits in
/// the middleware. The executor sleeps meanwhile.
fn three_for_one_slot() {
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let (mut exec, _) = executor(&ctx);
    let gate = Gate::closed();
    let pass = gate.clone();
    let qos = Qos::reliable().keep_all(1);
    exec.worker("w")
        .subscribe(&node, "t", qos, move |_: &Int32, _| pass.pass())
        .unwrap();
    let running = exec.start().unwrap();
    let stats = || running.stats("/n/sub:/t").unwrap();
    out.publish(&int(1)).unwrap();
    gate.arrived();
    out.publish(&int(2)).unwrap();
    assert!(eventually(|| stats().waiting == 1));
    out.publish(&int(3)).unwrap();
    let rounds = || running.report().dispatcher.rounds;
    assert!(settles(rounds), "the executor spins");
    gate.open();
    assert!(eventually(|| stats().executed == 3));
    assert_eq!(stats().dropped, 0);
}

/// D3: the executor did not learn that a worker had become ready; a message that had come meanwhile
/// was noticed when the wait timed out. Here the wait has no timeout: only the worker ends it.
fn d03() {
    let _dog = watchdog("d03", LIMIT);
    three_for_one_slot();
}

/// D4: busy workers' subscriptions stayed in the wait set: where data is level-triggered the
/// executor span at the highest priority, above the workers that it waited for.
fn d04() {
    let _dog = watchdog("d04", LIMIT);
    three_for_one_slot();
}

/// Doubles a number.
struct Double;

impl Service for Double {
    type Request = Int32;
    type Response = Int32;
    const TYPE_NAME: &'static str = "test_msgs/srv/Double";
}

/// D5: the original ran subscriptions only, and those behind the first handle of another kind not
/// at all; no timers, services, clients, triggers, Logical Execution Time. Here one worker has a
/// handle of each kind, the subscription last, a custom trigger and LET.
fn d05() {
    let _dog = watchdog("d05", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let client: Client<Double> = node.client("double", Qos::reliable(), LIMIT).unwrap();
    let guard = GuardCondition::new();
    let (mut exec, _) = executor(&ctx);
    let (ask, wake) = (client.clone(), guard.clone());
    let answers = Arc::new(Mutex::new(Vec::new()));
    let note = Arc::clone(&answers);
    let rounds = Arc::new(AtomicU64::new(0)); // that the trigger let begin
    let seen = [(); 2].map(|()| Arc::new(AtomicU64::new(0)));
    let [begun, in_timer, in_guard] = [(); 3].map(|()| Arc::clone(&rounds));
    let [at_timer, at_guard] = seen.clone();
    exec.worker("w")
        .semantics(Semantics::LogicalExecutionTime)
        .trigger(Trigger::custom(move |handles| {
            begun.fetch_add(1, Ordering::SeqCst);
            handles.ready() > 0
        }))
        .timer(Every::once(MS), move |_| {
            at_timer.store(in_timer.load(Ordering::SeqCst), Ordering::SeqCst);
            ask.call(&int(21)).unwrap();
            wake.trigger();
            out.publish(&int(1)).unwrap();
        })
        .unwrap()
        .guard(&guard, move |_| {
            at_guard.store(in_guard.load(Ordering::SeqCst), Ordering::SeqCst);
        })
        .unwrap()
        .serve::<Double, _>(&node, "double", Qos::reliable(), |request, response, _| {
            response.data = 2 * request.data;
        })
        .unwrap()
        .replies::<Double, _, _>(&client, move |reply, _| {
            note.lock().unwrap().push(reply.unwrap().data);
        })
        .unwrap()
        .subscribe(&node, "t", Qos::reliable(), |_: &Int32, _| ())
        .unwrap();
    let running = exec.start().unwrap();
    let all = || {
        running
            .report()
            .handles
            .iter()
            .all(|h| h.stats.executed == 1)
    };
    assert!(eventually(all), "{}", running.report());
    assert_eq!(*answers.lock().unwrap(), [42]);
    assert_eq!(running.report().handles.len(), 5);
    // The timer's trigger is not seen before the next round, though the guard is behind it.
    let [timer, guard] = seen.map(|round| round.load(Ordering::SeqCst));
    assert!(timer < guard, "one round: {timer}");
}

/// D6: without `PTHREAD_EXPLICIT_SCHED` Linux ignored the policies in silence, and every worker had
/// that of the thread that made it. Here they are made by a thread of another policy.
fn d06() {
    let _dog = watchdog("d06", LIMIT);
    let spec = ThreadSpec::new("parent").policy(fifo(3));
    let granted = spawn(spec, || {
        let ctx = Context::in_process();
        let (mut exec, _) = executor(&ctx);
        exec.dispatcher(fifo(44));
        for (name, policy) in [("high", fifo(42)), ("low", Policy::Other)] {
            let worker = exec.worker(name).policy(policy);
            worker.timer(MS, |_| ()).unwrap();
        }
        let report = exec.start().unwrap().stop();
        let of = |name: &str| report.thread(name).unwrap().granted.clone();
        ["high", "low", "dispatcher"].map(of)
    });
    let granted = granted.unwrap().join().unwrap();
    assert!(granted[0].starts_with("FIFO 42"), "{granted:?}");
    assert!(granted[1].starts_with("OTHER"), "{granted:?}");
    assert!(granted[2].starts_with("FIFO 44"), "{granted:?}");
}

/// D7: one slot, no queue, no counters: what was lost or late was lost or late unseen.
fn d07() {
    let _dog = watchdog("d07", LIMIT);
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let out = node.publisher::<Int32>("t", Qos::reliable()).unwrap();
    let (mut exec, _) = executor(&ctx);
    let gate = Gate::closed();
    let pass = gate.clone();
    let handling = replenish::HandleOptions::new().deadline(MS, replenish::OnMiss::Count);
    exec.worker("w")
        .subscribe(
            &node,
            "t",
            Qos::reliable().keep_last(1),
            move |_: &Int32, _| pass.pass(),
        )
        .unwrap()
        .options(handling);
    let running = exec.start().unwrap();
    let stats = || running.stats("/n/sub:/t").unwrap();
    for data in 0..5 {
        out.publish(&int(data)).unwrap();
        gate.arrived();
        let n = u64::try_from(data).unwrap() + 1;
        assert!(eventually(|| stats().received == n));
    }
    assert_eq!((stats().dropped, stats().waiting), (3, 1));
    std::thread::sleep(2 * MS);
    gate.open();
    assert!(eventually(|| stats().executed == 2));
    let stats = running.stop().handle("/n/sub:/t").unwrap().stats;
    assert_eq!(stats.received, stats.executed + stats.dropped);
    assert_eq!(stats.deadline_misses, 2);
    assert!(stats.worst_lateness > 0);
}

/// D9: shutdown cancelled threads without joining them and freed what they still used. Here each
/// callback shares a counter with the test: after the stop no callback holds or moves it.
fn d09() {
    let _dog = watchdog("d09", LIMIT);
    let ctx = Context::in_process();
    for _ in 0..50 {
        let (mut exec, _) = executor(&ctx);
        exec.stop_grace(30_000 * MS);
        let used = Arc::new(AtomicU64::new(0));
        for name in ["a", "b", "c"] {
            let count = Arc::clone(&used);
            let at_once = Every::period(MS / 10).first_after(Duration::ZERO);
            exec.worker(name)
                .timer(at_once, move |_| {
                    count.fetch_add(1, Ordering::Relaxed);
                })
                .unwrap();
        }
        let running = exec.start().unwrap();
        assert!(eventually(|| used.load(Ordering::Relaxed) > 0));
        assert!(running.stop().stuck.is_empty());
        let after = used.load(Ordering::Relaxed);
        assert_eq!(Arc::strong_count(&used), 1, "callbacks are still there");
        assert_eq!(used.load(Ordering::Relaxed), after);
    }
}

/// D10: results overwrote each other; the last one was returned, whatever went wrong before it.
fn d10() {
    let _dog = watchdog("d10", LIMIT);
    let ctx = Context::in_process();
    let (mut twice, _) = executor(&ctx);
    for _ in 0..2 {
        twice.worker("w").timer(MS, |_| ()).unwrap();
    }
    twice.worker("fine").timer(MS, |_| ()).unwrap();
    let refused = twice.start().map(drop).unwrap_err();
    assert_eq!(refused, Error::DuplicateWorker("w".into()));

    let (mut exec, log) = executor(&ctx);
    let gates = [(); 2].map(|()| Gate::closed());
    for (name, gate) in ["first", "second"].into_iter().zip(gates.clone()) {
        let stays = move |_: &replenish::CallbackContext<'_>| gate.pass();
        exec.worker(name).timer(MS, stays).unwrap();
    }
    exec.worker("fails").timer(MS, |_| Err("no")).unwrap();
    exec.worker("last").timer(MS, |_| ()).unwrap();
    let running = exec.start().unwrap();
    gates.iter().for_each(Gate::arrived);
    let failed = || running.stats("fails/timer:0").unwrap().errors > 0;
    assert!(eventually(failed));
    let report = running.stop();
    assert_eq!(report.stuck, ["first", "second"]);
    let failing = report.handle("fails/timer:0").unwrap();
    assert_eq!(failing.last_error.as_deref(), Some("no"));
    assert_eq!(failing.stats.errors, failing.stats.executed);
    for told in ["first has not", "second has not", "fails/timer:0: callback"] {
        assert!(log.has(told), "{told}: {:?}", log.lines());
    }
    gates.iter().for_each(Gate::open);
}

/// Uses `kib` KiB of stack.
fn use_stack(kib: usize) -> u8 {
    let block = std::hint::black_box([1_u8; 1024]);
    match kib {
        0 => block[0],
        _ => std::hint::black_box(use_stack(kib - 1)).wrapping_add(block[1023]),
    }
}

/// D11: a pointer to the caller's scheduling parameters was kept after they were gone, and stacks
/// were of whatever size the system gave. Here the same variable gives two workers their
/// parameters, one after another, and is something else and then gone before they start: each has
/// what it was given. A callback uses twice the default stack of 1 MiB, because 8 MiB were asked
/// for.
fn d11() {
    let _dog = watchdog("d11", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    let done = Arc::new(AtomicU64::new(0));
    {
        let mut policy = Policy::Other;
        for (name, budget) in [("a", 2_000_000), ("b", 3_000_000)] {
            let name = String::from(name);
            let params = Params::new(2, replenish::Low::Background(1), budget, 90_000_000, 3);
            policy = Policy::sporadic(params.unwrap()).unwrap();
            let count = Arc::clone(&done);
            exec.worker(&name)
                .policy(*std::hint::black_box(&policy))
                .stack_size(8 << 20)
                .timer(Every::once(Duration::ZERO), move |_| {
                    assert!(use_stack(2048) > 0);
                    count.fetch_add(1, Ordering::Relaxed);
                })
                .unwrap();
        }
        std::hint::black_box(&mut policy).clone_from(&Policy::Other);
    }
    let running = exec.start().unwrap();
    assert!(eventually(|| done.load(Ordering::Relaxed) == 2));
    let report = running.stop();
    let requested = ["a", "b"].map(|name| report.thread(name).unwrap().requested.clone());
    let asked = ["2 ms", "3 ms"].map(|budget| format!("SPORADIC 2/1 ({budget} every 90 ms)"));
    assert_eq!(requested, asked);
}

/// D2: a worker without budget (background priority) spends its time inside the session lock,
/// publishing 4 kB to 500 readers. A hog of middle priority keeps it from running, again and again;
/// meanwhile a message for the high worker comes in. Without inheritance its publisher, and then
/// the dispatcher, wait for the lock until the hog pauses; with it the message overtakes the hog.
fn d02() {
    const ROUNDS: i32 = 20;
    let _dog = watchdog("d02", LIMIT);
    let cpu = cpu();
    let bus = InProcessBus::new();
    let (ctx, outside) = (
        Context::new(bus.participant()),
        Context::new(bus.participant()),
    );
    let node = ctx.node("n").unwrap();
    let qos = Qos::best_effort().keep_last(1);
    let mut unread = Vec::new();
    for _ in 0..5 {
        let other = Context::new(bus.participant());
        let node = other.node("crowd").unwrap();
        let (mut exec, _) = executor(&other);
        let mut crowd = exec.worker("crowd");
        for _ in 0..100 {
            crowd = crowd
                .subscribe(&node, "bulk", qos, |_: &UInt8MultiArray, _| ())
                .unwrap();
        }
        unread.push(exec); // never started: nobody empties these queues
    }
    let bulk = node.publisher::<UInt8MultiArray>("bulk", qos).unwrap();
    let call = outside
        .node("o")
        .unwrap()
        .publisher::<Int32>("call", qos)
        .unwrap();

    let (mut exec, _) = executor(&ctx);
    exec.stop_grace(30_000 * MS)
        .dispatcher(fifo(90))
        .dispatcher_cpu(cpu);
    let heard = Arc::new(AtomicU64::new(0));
    let count = Arc::clone(&heard);
    exec.worker("high")
        .policy(fifo(80))
        .cpu(cpu)
        .subscribe(&node, "call", qos, move |_: &Int32, _| {
            count.fetch_add(1, Ordering::SeqCst);
        })
        .unwrap();
    let mut payload = UInt8MultiArray::default();
    payload.data.resize(4096, 1).unwrap();
    exec.worker("background")
        .policy(fifo(60))
        .budget(Budget::of(MS).every(10_000 * MS))
        .cpu(cpu)
        .timer(Every::period(MS).first_after(Duration::ZERO), move |cx| {
            while !cx.is_stopping() {
                bulk.publish(&payload).unwrap();
            }
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(|| running.usage("background").unwrap().low));

    for round in 1..=ROUNDS {
        let before = heard.load(Ordering::SeqCst);
        let hogging = Arc::new(AtomicBool::new(false));
        // Above everything, so that it calls while the hog runs, however busy the machine is.
        let caller = {
            let (call, hogging) = (call.clone(), Arc::clone(&hogging));
            let spec = ThreadSpec::new("caller").policy(fifo(95));
            spawn(spec, move || {
                while !hogging.load(Ordering::SeqCst) {
                    std::thread::sleep(MS / 10);
                }
                call.publish(&Int32 { data: round })
            })
        };
        let hog = {
            let (hogging, heard) = (Arc::clone(&hogging), Arc::clone(&heard));
            let spec = ThreadSpec::new("hog").policy(fifo(50)).cpu(cpu);
            spawn(spec, move || {
                hogging.store(true, Ordering::SeqCst);
                let end = clock::thread_cpu() + 900_000_000;
                while clock::thread_cpu() < end && heard.load(Ordering::SeqCst) == before {}
                heard.load(Ordering::SeqCst) > before
            })
        };
        let overtaken = hog.unwrap().join().unwrap();
        caller.unwrap().join().unwrap().unwrap();
        assert!(
            overtaken,
            "round {round}: the message waited until the hog was over"
        );
        std::thread::sleep(5 * MS); // the background worker gets into its lock again
    }
    assert!(running.stop().stuck.is_empty());
}

/// D8: in one batch the sample for the low worker comes first; the high worker runs first. The
/// dispatcher is below both here, so that the order of its wake-ups is what decides.
fn d08() {
    let _dog = watchdog("d08", LIMIT);
    let cpu = cpu();
    let mw = Scripted::default();
    let ctx = Context::new(mw.clone());
    let node = ctx.node("n").unwrap();
    let (mut exec, _) = executor(&ctx);
    exec.dispatcher(fifo(10)).dispatcher_cpu(cpu);
    let order = Arc::new(Mutex::new(Vec::new()));
    for (name, priority) in [("low", 50), ("middle", 55), ("high", 60)] {
        let order = Arc::clone(&order);
        exec.worker(name)
            .policy(fifo(priority))
            .cpu(cpu)
            .subscribe(&node, name, Qos::reliable(), move |_: &Int32, _| {
                order.lock().unwrap().push(name);
                burn(1);
            })
            .unwrap();
    }
    let running = exec.start().unwrap();
    let one = 1_i32.to_le_bytes();
    for round in 1..=20 {
        mw.put_all(&[(0, &one), (1, &one), (2, &one)]);
        assert!(eventually(|| order.lock().unwrap().len() == 3 * round));
    }
    running.stop();
    for three in order.lock().unwrap().chunks(3) {
        assert_eq!(three, ["high", "middle", "low"]);
    }
}

/// D12: the paper's kernel charged wall time. 60 ms of sleep cost nothing here; charged, they would
/// exhaust the budget.
fn d12() {
    let _dog = watchdog("d12", LIMIT);
    let ctx = Context::in_process();
    let (mut exec, _) = executor(&ctx);
    exec.worker("w")
        .budget(Budget::of(40 * MS).every(3_600_000 * MS))
        .cpu(cpu())
        .timer(Every::once(MS), |_| {
            burn(1);
            std::thread::sleep(60 * MS);
            burn(1);
        })
        .unwrap();
    let running = exec.start().unwrap();
    assert!(eventually(
        || running.stats("w/timer:0").unwrap().executed == 1
    ));
    let report = running.stop();
    let stats = report.handle("w/timer:0").unwrap().stats;
    assert_eq!(
        (stats.exhaustions, stats.cpu_background),
        (0, 0),
        "{report}"
    );
    assert!(
        (2_000_000..40_000_000).contains(&stats.cpu_high),
        "{report}"
    );
}

/// D13: a best-effort topic is flooded from the other CPU. The dispatcher, above all others, has a
/// budget of a tenth; a worker that always has work keeps the rest of the CPU.
fn d13() {
    let _dog = watchdog("d13", LIMIT);
    let cpu = cpu();
    let ctx = Context::in_process();
    let node = ctx.node("n").unwrap();
    let qos = Qos::best_effort().keep_last(1);
    let out = node.publisher::<Int32>("t", qos).unwrap();
    let (mut exec, _) = executor(&ctx);
    let params = Params::new(
        90,
        replenish::Low::Background(6),
        4_000_000,
        40_000_000,
        100,
    );
    exec.dispatcher(Policy::sporadic(params.unwrap()).unwrap())
        .dispatcher_cpu(cpu);
    exec.worker("works")
        .policy(fifo(50))
        .cpu(cpu)
        .timer(Every::period(MS).first_after(Duration::ZERO), |_| burn(1))
        .unwrap();
    exec.worker("flooded")
        .policy(fifo(5))
        .cpu(cpu)
        .subscribe(&node, "t", qos, |_: &Int32, _| ())
        .unwrap();
    let running = exec.start().unwrap();
    let done = Arc::new(AtomicBool::new(false));
    let flood = {
        let done = Arc::clone(&done);
        std::thread::spawn(move || {
            while !done.load(Ordering::Relaxed) {
                out.publish(&Int32 { data: 1 }).unwrap();
            }
        })
    };
    let usage = |name| running.usage(name).unwrap();
    let floods = |since| eventually(|| usage("dispatcher").exhaustions > since);
    assert!(floods(0), "no flood: {}", running.report());
    let (start, before) = (clock::monotonic(), [usage("works"), usage("dispatcher")]);
    std::thread::sleep(320 * MS);
    assert!(
        floods(before[1].exhaustions),
        "no flood: {}",
        running.report()
    );
    let after = [usage("works"), usage("dispatcher")];
    let end = clock::monotonic();
    done.store(true, Ordering::Relaxed);
    flood.join().unwrap();
    let report = running.stop();
    let dispatcher = after[1].cpu_high - before[1].cpu_high;
    let periods = (end - start) / 40_000_000 + 2;
    assert!(
        dispatcher <= periods * 4_000_000,
        "{dispatcher} ns: {report}"
    );
    let works = after[0].cpu_high - before[0].cpu_high;
    assert!(
        works >= 4 * dispatcher,
        "{works} ns beside {dispatcher}: {report}"
    );
}
