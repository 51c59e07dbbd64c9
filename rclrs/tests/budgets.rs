//! Genuine rclrs over this runtime: threads, budgets, spins, and Figure 3 beside stock rclrs.
#![allow(
    missing_docs,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "tests may panic"
)]

mod figure;

use rclrs::*;
use replenish_os::clock::thread_cpu;
use replenish_os::{Tid, current_tid};
use replenish_rclrs::{Budget, SchedClass, Why, reports, runtime, worker};
use replenish_testkit::harness::{Trial, rt_trial, run_in_turn};
use std::collections::BTreeSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

const fn ms(count: u64) -> Duration {
    Duration::from_millis(count)
}

fn budget(amount: u64, period: u64) -> Budget {
    Budget::of(ms(amount)).every(ms(period))
}

fn executor() -> Executor {
    Context::default().create_executor(runtime().unwrap())
}

fn spin(executor: &mut Executor, time: Duration) {
    let options = SpinOptions::new().timeout(time);
    executor.spin(options).timeout_ok().first_error().unwrap();
}

fn burn(time: Duration) {
    let begin = thread_cpu();
    while u128::from(thread_cpu() - begin) < time.as_nanos() {}
}

/// One thread for each worker, the same in every spin, and none for the call of a spin.
fn threads() {
    let mut executor = executor();
    let node = executor.create_node("threads").unwrap();
    let seen = [(); 2].map(|()| Arc::new(Mutex::new(BTreeSet::<Tid>::new())));
    let mut timers = Vec::new();
    for (name, seen) in ["one", "two"].into_iter().zip(&seen) {
        let each = node.create_worker(worker(name, ()).admit().unwrap());
        let seen = Arc::clone(seen);
        let note = move || {
            seen.lock().unwrap().insert(current_tid());
        };
        timers.push(each.create_timer_repeating(ms(2), note).unwrap());
    }
    for _ in 0..3 {
        spin(&mut executor, ms(300));
    }
    let [one, two] = seen.map(|seen| seen.lock().unwrap().clone());
    assert_eq!((one.len(), two.len()), (1, 1), "{one:?} {two:?}");
    assert_ne!(one, two);
    assert!(!one.contains(&current_tid()) && !two.contains(&current_tid()));
    let task = format!("/proc/self/task/{}/comm", one.first().unwrap().get());
    assert_eq!(std::fs::read_to_string(task).unwrap().trim(), "one");
}

/// At its priority a worker gets its budget and no more, beside one that would take the whole CPU;
/// both have work without a pause. All budgets have ended with the executor.
fn holds() {
    let cpu = replenish_os::affinity(current_tid()).unwrap();
    let cpu = cpu.iter().last().unwrap();
    // All threads of the executor on one CPU: what is left is the other worker's.
    replenish_os::set_affinity(current_tid(), &replenish_os::CpuSet::one(cpu)).unwrap();
    for _ in 0..10 {
        let mut executor = executor();
        let node = executor.create_node("holds").unwrap();
        let high = worker("high", ()).budget(budget(30, 100)).cpu(cpu);
        let high = high.background(SchedClass::Idle).admit().unwrap();
        let high = node.create_worker(high);
        let low = node.create_worker(());
        let work = || burn(ms(10));
        let _high = high.create_timer_repeating(ms(10), work).unwrap();
        let _low = low.create_timer_repeating(ms(10), work).unwrap();
        let begin = Instant::now();
        spin(&mut executor, ms(2000));
        let elapsed = u64::try_from(begin.elapsed().as_nanos()).unwrap();
        let all = reports();
        let [report] = all.as_slice() else {
            panic!("{all:?}");
        };
        eprintln!("{elapsed} ns: {report:?}");
        let periods = elapsed / report.period;
        let most = (periods + 1) * report.amount + 1_000_000;
        assert!(report.usage.high <= most, "{report:?}");
        assert!(report.usage.exhaustions > 0, "{report:?}");
        let enough = report.usage.high >= periods * report.amount * 9 / 10;
        drop((high, _high, low, _low, node, executor));
        assert_eq!(reports().len(), 0);
        if enough {
            return;
        }
    }
    panic!("no run in ten got its budget");
}

/// A budget that does not fit, and values out of their range, are refused before a worker is made.
fn refused() {
    let greedy = worker("greedy", ()).budget(budget(99, 100)).admit();
    let failure = greedy.unwrap_err();
    assert_eq!(failure.why, Why::Refused);
    assert!(failure.text.contains("does not fit"), "{failure}");
    for name in ["", "a name of more than thirty-one bytes", "a\nb"] {
        let failure = worker(name, ()).admit().unwrap_err();
        assert_eq!(failure.why, Why::Invalid);
        assert!(failure.text.contains("1 to 31 bytes"), "{failure}");
    }
    let none = worker("none", ()).budget(budget(0, 100)).admit();
    assert_eq!(none.unwrap_err().why, Why::Invalid);
    let stops = worker("stops", ()).budget(budget(1, 100).suspend()).admit();
    assert_eq!(stops.unwrap_err().why, Why::Unsupported);
    assert_eq!(reports().len(), 0);
}

/// A panic of a callback ends the spin, also of the other workers, and goes on in `spin`.
fn panics() {
    let mut executor = executor();
    let node = executor.create_node("panics").unwrap();
    let (falls, stays) = (node.create_worker(()), node.create_worker(()));
    let fall = || panic!("on purpose");
    let _fall = falls.create_timer_oneshot(ms(20), fall).unwrap();
    let _stay = stays.create_timer_repeating(ms(1), || {}).unwrap();
    let all = SpinOptions::new().timeout(Duration::from_secs(60));
    let begin = Instant::now();
    let ended = catch_unwind(AssertUnwindSafe(|| executor.spin(all)));
    let text = ended.unwrap_err();
    assert_eq!(text.downcast_ref(), Some(&"on purpose"));
    assert!(begin.elapsed() < Duration::from_secs(30));
    // The others can go on.
    spin(&mut executor, ms(50));
}

/// Promises, tasks of a worker, async tasks, a worker that comes while the executor spins, a halt.
fn spins() {
    let mut executor = executor();
    let node = executor.create_node("spins").unwrap();
    let counting = node.create_worker(worker("counting", 0_u64).admit().unwrap());
    let answer = counting.run(|count| {
        **count += 41;
        **count + 1
    });
    let (mut answer, notice) = executor.commands().create_notice(answer);
    let until = SpinOptions::new().until_promise_resolved(notice);
    let errors = executor.spin(until.timeout(Duration::from_secs(30)));
    errors.first_error().unwrap();
    assert_eq!(answer.try_recv().unwrap(), Some(42));

    let (later, came) = (Arc::clone(&node), Arc::new(AtomicU64::new(0)));
    let kept = Arc::new(Mutex::new(Vec::new()));
    let (count, keep) = (Arc::clone(&came), Arc::clone(&kept));
    let commands = Arc::clone(executor.commands());
    let _begin = node.create_timer_oneshot(ms(20), move || {
        let new = later.create_worker(worker("later", ()).admit().unwrap());
        let (count, commands) = (Arc::clone(&count), Arc::clone(&commands));
        let timer = new.create_timer_repeating(ms(1), move || {
            if count.fetch_add(1, Relaxed) == 5 {
                commands.halt_spinning();
            }
        });
        keep.lock().unwrap().push(timer.unwrap());
    });
    let errors = executor.spin(SpinOptions::new().timeout(Duration::from_secs(30)));
    errors.first_error().unwrap(); // no timeout
    assert!(came.load(Relaxed) >= 6);
    assert_eq!(kept.lock().unwrap().len(), 1);

    // Without waiting: nothing is due.
    let begin = Instant::now();
    let once = executor.spin(SpinOptions::spin_once().timeout(Duration::ZERO));
    once.timeout_ok().first_error().unwrap();
    assert!(begin.elapsed() < Duration::from_secs(10));

    let async_spin = executor.spin_async(SpinOptions::new().timeout(ms(50)));
    let (executor, errors) = futures::executor::block_on(async_spin);
    errors.timeout_ok().first_error().unwrap();
    drop(executor);
}

fn main() {
    let trials: Vec<Trial> = vec![
        rt_trial("a_worker_keeps_its_thread", threads),
        rt_trial("a_worker_gets_its_budget_and_no_more", holds),
        rt_trial("budgets_that_do_not_fit_are_refused", refused),
        rt_trial("a_panic_ends_the_spin", panics),
        rt_trial("spins_end_as_with_rclrs", spins),
    ];
    run_in_turn([("rclrs", trials), ("figure", figure::trials())]);
}
