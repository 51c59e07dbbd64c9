//! Budgets held on real threads: shares by the CPU clocks, in windows that stay clear of the
//! kernel's real-time throttle, a window repeated when the machine stood still.

use crate::common::{cpu, pin};
use replenish_os::{
    Account, Enforcement, Enforcer, EnforcerConfig, Meter, SchedClass, clock, current_tid, granted,
    set_priority,
};
use replenish_testkit::harness::{Trial, rt_trial, trial};
use replenish_testkit::watchdog::watchdog;
use replenish_testkit::witness::Witness;
use sporadic::{Kind, Low, Params};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

const MS: u64 = 1_000_000;

/// Disturbed windows take a while.
const LIMIT: Duration = Duration::from_secs(300);

/// Between these times a load runs; outside it waits.
#[derive(Default)]
struct Window {
    start: AtomicU64,
    end: AtomicU64,
}

struct Load {
    meter: Meter,
    quit: Arc<AtomicBool>,
    thread: JoinHandle<()>,
}

/// A worker's load inside the window: `run` of CPU time per round, then `pause` asleep.
#[derive(Clone, Copy)]
struct Shape {
    run: u64,
    pause: u64,
    /// The pause is a wait for work, not a sleep inside the callback.
    waits: bool,
}

const SPIN: Shape = Shape {
    run: MS,
    pause: 0,
    waits: false,
};

fn load(
    window: &Arc<Window>,
    priority: u8,
    shape: Shape,
    enroll: impl FnOnce() -> Account + Send + 'static,
) -> Load {
    let quit = Arc::new(AtomicBool::new(false));
    let (window, stop) = (Arc::clone(window), Arc::clone(&quit));
    let (tx, rx) = mpsc::channel();
    let thread = std::thread::spawn(move || {
        pin(cpu());
        set_priority(current_tid(), SchedClass::Fifo(priority)).unwrap();
        let mut account = enroll();
        tx.send(account.meter()).unwrap();
        while !stop.load(Ordering::Relaxed) {
            let start = window.start.load(Ordering::SeqCst);
            let end = window.end.load(Ordering::SeqCst);
            let now = clock::monotonic();
            if now >= end {
                clock::sleep_until(now + MS);
                continue;
            }
            clock::sleep_until(start);
            account.activate(start);
            while clock::monotonic() < end && account.callback_begin().is_ok() {
                burn(shape.run, end);
                let pause = || {
                    let until = (clock::monotonic() + shape.pause).min(end);
                    clock::sleep_until(until);
                    until
                };
                if shape.pause > 0 && !shape.waits {
                    pause();
                }
                account.callback_end();
                if shape.waits {
                    account.block();
                    account.activate(pause());
                }
            }
            account.block();
        }
    });
    Load {
        meter: rx.recv().unwrap(),
        quit,
        thread,
    }
}

/// Consumes CPU time of this thread, until `end` at the latest.
fn burn(amount: u64, end: u64) {
    let from = clock::thread_cpu();
    while clock::thread_cpu() - from < amount && clock::monotonic() < end {}
}

/// Runs one window and returns per load `(high, low)` CPU time in it, or `None` if the machine
/// stood still meanwhile.
fn measure(
    window: &Window,
    loads: &[Load],
    witness: &Witness,
    length: u64,
) -> Option<Vec<(u64, u64)>> {
    // Above the loads' priorities, so that lateness here is the machine's, not the scheduler's.
    set_priority(current_tid(), SchedClass::Fifo(97)).unwrap();
    let still = witness.settled();
    let start = clock::monotonic() + 20 * MS;
    let end = start + length;
    let before: Vec<_> = loads.iter().map(|l| l.meter.usage()).collect();
    window.end.store(end, Ordering::SeqCst);
    window.start.store(start, Ordering::SeqCst);
    let mut late = 0;
    let mut tick = start;
    while tick < end {
        tick += 5 * MS;
        clock::sleep_until(tick);
        late = late.max(clock::monotonic() - tick);
    }
    clock::sleep_until(end + 2 * MS);
    let after: Vec<_> = loads.iter().map(|l| l.meter.usage()).collect();
    clock::sleep_until(end + 110 * MS);
    let used = before.iter().zip(&after);
    let used = used
        .map(|(b, a)| (a.cpu_high - b.cpu_high, a.cpu_low - b.cpu_low))
        .collect();
    (late < 2 * MS && witness.settled() == still).then_some(used)
}

/// Repeats a window until one was not disturbed and `good` accepts it. Ten undisturbed ones that it
/// does not accept fail, and so do sixty disturbed ones.
fn window_until(
    window: &Window,
    loads: &[Load],
    good: impl Fn(&[(u64, u64)]) -> bool,
) -> Vec<(u64, u64)> {
    let witness = Witness::start();
    let (mut refused, mut disturbed) = (Vec::new(), 0);
    while refused.len() < 10 && disturbed < 60 {
        match measure(window, loads, &witness, 400 * MS) {
            Some(used) if good(&used) => return used,
            Some(used) => {
                eprintln!("window repeated: {used:?}");
                refused.push(used);
            }
            None => disturbed += 1,
        }
    }
    panic!("no undisturbed window held the budgets; {disturbed} were disturbed: {refused:?}");
}

fn finish(loads: Vec<Load>) {
    for l in &loads {
        l.quit.store(true, Ordering::Relaxed);
        l.meter.cancel();
    }
    for l in loads {
        l.thread.join().unwrap();
    }
}

fn enforcer() -> Arc<Enforcer> {
    Enforcer::start(EnforcerConfig::on_cpu(cpu())).unwrap()
}

/// A load with a budget of `budget` ms per 100 ms.
fn budgeted(
    window: &Arc<Window>,
    enforcer: &Arc<Enforcer>,
    (priority, low): (u8, Low),
    budget: u64,
    shape: Shape,
    kind: Kind,
) -> Load {
    let params = Params::new(priority, low, budget * MS, 100 * MS, 100).unwrap();
    let enforcer = Arc::clone(enforcer);
    load(window, priority, shape, move || {
        enforcer.enroll(&params, kind).unwrap()
    })
}

fn near(value: u64, theory: u64, tolerance: u64) -> bool {
    value.abs_diff(theory) <= tolerance
}

fn shares_follow_budgets(kind: Kind) {
    let _dog = watchdog("shares", LIMIT);
    for budget in [10, 37, 90] {
        let enforcer = enforcer();
        let window = Arc::new(Window::default());
        let loads = vec![
            budgeted(
                &window,
                &enforcer,
                (60, Low::Background(6)),
                budget,
                SPIN,
                kind,
            ),
            load(&window, 50, SPIN, Account::unbudgeted),
        ];
        let theory = 4 * budget * MS;
        let used = window_until(&window, &loads, |u| {
            let rest = 400 * MS - theory;
            // The other thread got the rest: lowering made room. The witnesses use up to 1 % of the
            // CPU, which is a tenth of the rest at the largest budget.
            let least = rest * 97 / 100 - 4 * MS;
            near(u[0].0, theory, theory * 3 / 1000) && u[1].0 >= least && u[0].1 < MS
        });
        println!(
            "B={budget}: {used:?} {:?} {:?}",
            enforcer.stats(),
            loads[0].meter.overruns()
        );
        finish(loads);
    }
}

fn four_budgets_at_once() {
    let _dog = watchdog("four budgets", LIMIT);
    let enforcer = enforcer();
    let window = Arc::new(Window::default());
    let budgets = [10, 25, 15, 30];
    let mut loads: Vec<_> = budgets
        .iter()
        .zip(60..)
        .map(|(b, p)| {
            budgeted(
                &window,
                &enforcer,
                (p, Low::Background(6)),
                *b,
                SPIN,
                Kind::Corrected,
            )
        })
        .collect();
    loads.push(load(&window, 50, SPIN, Account::unbudgeted));
    let used = window_until(&window, &loads, |u| {
        budgets
            .iter()
            .zip(u)
            .all(|(b, u)| near(u.0, 4 * b * MS, 4 * b * MS / 100))
    });
    println!("{used:?} {:?}", enforcer.stats());
    finish(loads);
}

fn background_time_is_free_and_counted() {
    let _dog = watchdog("background", LIMIT);
    let enforcer = enforcer();
    let window = Arc::new(Window::default());
    let prio = (60, Low::Background(40));
    let loads = vec![budgeted(
        &window,
        &enforcer,
        prio,
        30,
        SPIN,
        Kind::Corrected,
    )];
    // Alone on the CPU: the budget at high priority, everything else in the background.
    window_until(&window, &loads, |u| {
        near(u[0].0, 120 * MS, MS) && near(u[0].0 + u[0].1, 400 * MS, 8 * MS)
    });
    finish(loads);
}

#[cfg(not(nuttx_host))]
fn suspend_stops_the_thread() {
    let _dog = watchdog("suspend", LIMIT);
    let enforcer = enforcer();
    let window = Arc::new(Window::default());
    let prio = (60, Low::Suspend);
    let loads = vec![budgeted(
        &window,
        &enforcer,
        prio,
        20,
        SPIN,
        Kind::Corrected,
    )];
    // Alone on an idle CPU it still gets its budget and not more.
    window_until(&window, &loads, |u| {
        near(u[0].0, 80 * MS, MS) && u[0].1 < MS
    });
    finish(loads);
}

/// 4 ms of work and 16 ms of sleep inside the callback, over and over: 20 % of the CPU within a
/// budget of 30 % must never be lowered, and the blocking must have been seen.
fn sleeping_inside_a_callback_is_seen() {
    let _dog = watchdog("blocking", LIMIT);
    let enforcer = enforcer();
    let window = Arc::new(Window::default());
    let shape = Shape {
        run: 4 * MS,
        pause: 16 * MS,
        waits: false,
    };
    let prio = (60, Low::Background(6));
    let loads = vec![
        budgeted(&window, &enforcer, prio, 30, shape, Kind::Corrected),
        load(&window, 50, SPIN, Account::unbudgeted),
    ];
    window_until(&window, &loads, |u| {
        near(u[0].0, 80 * MS, 6 * MS) && u[0].1 < MS
    });
    let (usage, sees) = (loads[0].meter.usage(), loads[0].meter.sees_blocking());
    println!("{usage:?} {:?}", enforcer.stats());
    // Without records the number is not known.
    assert!(usage.blocked_inside >= 15 || !sees);
    finish(loads);
}

/// A callback that never blocks while a thread on another CPU reads its account, which another
/// thread preempts now and then with the enforcer's lock in its hands. On b209253 each wait for
/// that lock counted as a block, and the budget came back in pieces.
#[cfg(not(nuttx_host))]
fn waiting_for_the_enforcers_lock_is_no_blocking() {
    let _dog = watchdog("lock waits", LIMIT);
    for switch_log in [true, false] {
        let config = EnforcerConfig {
            switch_log,
            ..EnforcerConfig::unpinned()
        };
        let enforcer = Enforcer::start(config).unwrap();
        let stop = Arc::new(AtomicBool::new(false));
        let (tx, rx) = mpsc::channel::<Meter>();
        let reader = std::thread::spawn({
            let stop = Arc::clone(&stop);
            move || {
                let meter = rx.recv().unwrap();
                pin(0);
                set_priority(current_tid(), SchedClass::Fifo(59)).unwrap();
                while !stop.load(Ordering::Relaxed) {
                    std::hint::black_box(meter.usage());
                }
            }
        });
        let preempting = std::thread::spawn({
            let stop = Arc::clone(&stop);
            move || {
                pin(0);
                set_priority(current_tid(), SchedClass::Fifo(70)).unwrap();
                while !stop.load(Ordering::Relaxed) {
                    clock::sleep_until(clock::monotonic() + 150_000);
                    burn(50_000, u64::MAX);
                }
            }
        });
        let worker = std::thread::spawn(move || {
            pin(cpu());
            set_priority(current_tid(), SchedClass::Fifo(60)).unwrap();
            // More than it will use: there is nothing to be replenished, and no check to speak of.
            let params = Params::new(60, Low::Background(6), 2000 * MS, 4000 * MS, 100).unwrap();
            let mut account = enforcer.enroll(&params, Kind::Corrected).unwrap();
            let meter = account.meter();
            tx.send(account.meter()).unwrap();
            account.activate(clock::monotonic());
            account.callback_begin().unwrap();
            let before = replenish_os::voluntary_switches();
            let end = clock::monotonic() + 300 * MS;
            while clock::monotonic() < end {
                std::hint::black_box(meter.usage());
            }
            let waits = replenish_os::voluntary_switches() - before;
            account.callback_end();
            account.block();
            (meter.usage(), waits)
        });
        let (usage, waits) = worker.join().unwrap();
        stop.store(true, Ordering::Relaxed);
        reader.join().unwrap();
        preempting.join().unwrap();
        println!("records {switch_log}: waited {waits} times, {usage:?}");
        assert_eq!(usage.blocked_inside, 0, "{usage:?} after {waits} waits");
    }
}

/// Callbacks that end just when the budget does, each followed by a short wait, beside a thread
/// that takes every chance: the thread that lowers the worker must not need the worker to raise it
/// again.
fn budgets_that_end_with_the_callback_come_back() {
    let _dog = watchdog("ends with callback", LIMIT);
    let enforcer = enforcer();
    let window = Arc::new(Window::default());
    let shape = Shape {
        run: 5 * MS - 10_000,
        pause: 50_000,
        waits: true,
    };
    let prio = (60, Low::Background(6));
    let loads = vec![
        budgeted(&window, &enforcer, prio, 40, shape, Kind::Corrected),
        load(&window, 50, SPIN, Account::unbudgeted),
    ];
    for _ in 0..5 {
        window_until(&window, &loads, |u| near(u[0].0, 160 * MS, 5 * MS));
    }
    finish(loads);
}

/// A worker whose last callback used its budget up sleeps at its background priority, or is stopped
/// until its budget is back: its next wake-up is not at the high priority without budget.
#[cfg(not(nuttx_host))]
fn a_worker_that_waits_without_budget_is_low() {
    let _dog = watchdog("waits low", LIMIT);
    let rounds = rounds_without_budget(Low::Background(6));
    assert!(rounds.iter().any(|&(asleep, ..)| asleep == 6));
    rounds_without_budget(Low::Suspend);
}

/// For each round the priority after a sleep of 20 ms, the budget then, and the priority 40 ms
/// later.
#[cfg(not(nuttx_host))]
fn rounds_without_budget(low: Low) -> Vec<(u8, u64, u8)> {
    let enforcer = enforcer();
    let params = Params::new(60, low, 5 * MS, 50 * MS, 16).unwrap();
    let worker = std::thread::spawn(move || {
        pin(cpu());
        set_priority(current_tid(), SchedClass::Fifo(60)).unwrap();
        let mut account = enforcer.enroll(&params, Kind::Corrected).unwrap();
        let sleep = |time| {
            clock::sleep_until(clock::monotonic() + time);
            granted(current_tid()).unwrap().priority
        };
        let rounds = (0..20).map(|_| {
            account.activate(clock::monotonic());
            let left = account.meter().usage().available;
            account.callback_begin().unwrap();
            burn(left.saturating_sub(22_000), u64::MAX); // the rest is not worth a check
            account.callback_end();
            account.block();
            let asleep = sleep(20 * MS);
            (asleep, account.meter().usage().available, sleep(40 * MS))
        });
        rounds.collect()
    });
    let rounds: Vec<_> = worker.join().unwrap();
    // Budget that came back meanwhile had been used on the way to the wait before.
    let holds = |&(asleep, available, later): &_| later == 60 && (asleep < 60 || available > 0);
    assert!(rounds.iter().all(holds), "{rounds:?}");
    rounds
}

fn without_privilege_callbacks_wait_for_budget() {
    let _dog = watchdog("deferred", LIMIT);
    let enforcer = Enforcer::deferred();
    assert_eq!(enforcer.enforcement(), Enforcement::Deferred);
    // A tenth of a CPU, which this thread gets on a busy machine, too.
    let params = Params::new(60, Low::Background(6), 5 * MS, 50 * MS, 16).unwrap();
    let mut account = enforcer.enroll(&params, Kind::Corrected).unwrap();
    let (wall, cpu) = (clock::monotonic(), clock::thread_cpu());
    account.activate(wall);
    for _ in 0..8 {
        account.callback_begin().unwrap();
        burn(10 * MS, u64::MAX);
        account.callback_end();
    }
    account.block();
    let (wall, cpu) = (clock::monotonic() - wall, clock::thread_cpu() - cpu);
    // Before the last callback 70 ms were consumed: 14 replenishments of 5 ms and the first 5.
    assert!(
        wall >= 14 * 50 * MS,
        "80 ms of work took only {wall} ns at 5 per 50 ms"
    );
    let usage = account.meter().usage();
    assert!(
        near(usage.cpu_high + usage.cpu_low, cpu, MS),
        "{usage:?} against {cpu}"
    );
    assert!(usage.exhaustions >= 7, "{usage:?}");
}

fn a_cancelled_worker_stops_waiting_for_budget() {
    let _dog = watchdog("cancel", Duration::from_secs(30));
    let enforcer = Enforcer::deferred();
    let params = Params::new(60, Low::Background(6), MS, 3_600_000 * MS, 16).unwrap();
    let mut account = enforcer.enroll(&params, Kind::Corrected).unwrap();
    let meter = account.meter();
    account.activate(clock::monotonic());
    account.callback_begin().unwrap();
    burn(2 * MS, u64::MAX);
    let other = std::thread::spawn(move || {
        std::thread::sleep(Duration::from_millis(50));
        meter.cancel();
    });
    assert!(
        account.callback_begin().is_err(),
        "an hour to go, and yet it went on"
    );
    other.join().unwrap();
}

fn enrolment_is_bounded_and_says_so() {
    let config = EnforcerConfig {
        capacity: 2,
        ..EnforcerConfig::on_cpu(cpu())
    };
    let enforcer = Enforcer::start(config).unwrap();
    let params = |p, n| Params::new(p, Low::Background(6), MS, 10 * MS, n).unwrap();
    let error = |p: Params| {
        enforcer
            .enroll(&p, Kind::Corrected)
            .unwrap_err()
            .to_string()
    };
    let e = error(params(99, 16));
    assert!(e.contains("99"), "{e}");
    let e = error(params(60, 1000));
    assert!(e.contains("max_repl") && e.contains("128"), "{e}");
    let _a = enforcer.enroll(&params(60, 16), Kind::Corrected).unwrap();
    let _b = enforcer.enroll(&params(60, 16), Kind::Corrected).unwrap();
    let e = error(params(60, 16));
    assert!(e.contains("room for 2"), "{e}");
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        rt_trial("shares_follow_budgets", || {
            shares_follow_budgets(Kind::Corrected);
        }),
        rt_trial("shares_follow_budgets_posix", || {
            shares_follow_budgets(Kind::Posix);
        }),
        rt_trial(
            "budgets_that_end_with_the_callback_come_back",
            budgets_that_end_with_the_callback_come_back,
        ),
        #[cfg(not(nuttx_host))]
        rt_trial(
            "a_worker_that_waits_without_budget_is_low",
            a_worker_that_waits_without_budget_is_low,
        ),
        rt_trial("four_budgets_at_once", four_budgets_at_once),
        rt_trial(
            "background_time_is_free_and_counted",
            background_time_is_free_and_counted,
        ),
        #[cfg(not(nuttx_host))]
        rt_trial("suspend_stops_the_thread", suspend_stops_the_thread),
        #[cfg(not(nuttx_host))]
        rt_trial(
            "waiting_for_the_enforcers_lock_is_no_blocking",
            waiting_for_the_enforcers_lock_is_no_blocking,
        ),
        rt_trial(
            "sleeping_inside_a_callback_is_seen",
            sleeping_inside_a_callback_is_seen,
        ),
        trial("without_privilege_callbacks_wait_for_budget", || {
            without_privilege_callbacks_wait_for_budget();
        }),
        trial("a_cancelled_worker_stops_waiting_for_budget", || {
            a_cancelled_worker_stops_waiting_for_budget();
        }),
        rt_trial(
            "enrolment_is_bounded_and_says_so",
            enrolment_is_bounded_and_says_so,
        ),
    ]
}
