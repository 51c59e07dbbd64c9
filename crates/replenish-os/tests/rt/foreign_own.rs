//! Budgets for threads of this process that the executor does not know.

use crate::common::{MS, burn, cpu, pin};

use replenish_os::foreign::{Enforcer, ForeignError, ForeignThread, Original};
use replenish_os::{EnforcerConfig, SchedClass, Tid, clock, current_tid, set_priority};
use replenish_testkit::harness::{Trial, rt_trial};
use replenish_testkit::progress::reaches;
use sporadic::{Budget, Kind, Low, Params};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;

/// A thread that works until it is dropped, at `class`.
struct Busy {
    tid: Tid,
    stop: Arc<AtomicBool>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Busy {
    fn start(class: SchedClass) -> Self {
        let (stop, (tell, told)) = (Arc::new(AtomicBool::new(false)), mpsc::channel());
        let theirs = Arc::clone(&stop);
        let thread = std::thread::spawn(move || {
            set_priority(current_tid(), class).unwrap();
            tell.send(current_tid()).unwrap();
            while !theirs.load(Ordering::Relaxed) {
                burn(MS / 10);
                if class != SchedClass::Other {
                    std::thread::sleep(Duration::from_millis(1));
                }
            }
        });
        Self {
            tid: told.recv().unwrap(),
            stop,
            thread: Some(thread),
        }
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

fn budget(amount: u64, period: u64) -> Budget {
    Budget::of(Duration::from_millis(amount)).every(Duration::from_millis(period))
}

fn its_time_stays_within_the_budget() {
    let (busy, enforcer) = (
        Busy::start(SchedClass::Other),
        Enforcer::start(EnforcerConfig::on_cpu(cpu())).unwrap(),
    );
    let had = Original::of(busy.tid).unwrap();
    let id = enforcer
        .budget(60, budget(10, 50), SchedClass::Other)
        .unwrap();
    let from = clock::monotonic();
    let thread = ForeignThread::open_own(busy.tid).unwrap();
    enforcer.enroll(id, thread).unwrap();
    let used = || enforcer.usage(id).unwrap().high;
    std::thread::sleep(Duration::from_millis(500));
    assert!(reaches(0.18, Duration::from_millis(500), used));
    let usage = enforcer.usage(id).unwrap();
    let elapsed = clock::monotonic() - from;
    let most = (elapsed / (50 * MS) + 1) * 10 * MS + MS / 2;
    eprintln!("{usage:?} in {elapsed} ns");
    assert!(usage.high <= most, "{usage:?} in {elapsed} ns");
    enforcer.retire(id);
    assert_eq!(enforcer.threads(), []);
    assert_eq!(Original::of(busy.tid).unwrap(), had);
}

/// An ordinary thread that enrolls another one on its own CPU gets no further once that is raised.
/// The enforcer must be armed by then.
fn the_enforcer_is_armed_before_a_thread_is_raised() {
    let busy = Busy::start(SchedClass::Other);
    let (tid, enforcer) = (
        busy.tid,
        Arc::new(Enforcer::start(EnforcerConfig::on_cpu(cpu())).unwrap()),
    );
    let id = enforcer
        .budget(60, budget(10, 50), SchedClass::Other)
        .unwrap();
    let theirs = Arc::clone(&enforcer);
    let enrolling = std::thread::spawn(move || {
        pin(cpu());
        let thread = ForeignThread::open_own(tid).unwrap();
        theirs.enroll(id, thread).unwrap();
        theirs.usage(id).unwrap()
    });
    let usage = enrolling.join().unwrap();
    eprintln!("{usage:?}");
    // It got on when the budget was used up: once, or a few times where others want the CPU.
    assert!(
        usage.high <= (usage.exhaustions + 1) * 10 * MS + MS,
        "{usage:?}"
    );
}

/// A program may make and end budgets for as long as it runs.
fn the_place_of_an_ended_budget_is_free() {
    let enforcer = Enforcer::start(EnforcerConfig::on_cpu(cpu())).unwrap();
    let new = || enforcer.budget(60, budget(1, 100), SchedClass::Idle);
    let mut all: Vec<_> = (0..64).map(|_| new().unwrap()).collect();
    assert!(matches!(new(), Err(ForeignError::Full { .. })));
    for _ in 0..100 {
        enforcer.retire(all.remove(7));
        all.push(new().unwrap());
    }
    all.sort();
    all.dedup();
    assert_eq!(all.len(), 64);
}

/// Such a thread could keep the enforcer from its CPU.
fn a_thread_above_the_enforcer_is_left_alone() {
    let busy = Busy::start(SchedClass::Fifo(50));
    let had = Original::of(busy.tid).unwrap();
    let config = EnforcerConfig {
        priority: 50,
        ..EnforcerConfig::on_cpu(cpu())
    };
    let enforcer = Enforcer::start(config).unwrap();
    let id = enforcer
        .budget(49, budget(1, 100), SchedClass::Idle)
        .unwrap();
    let thread = ForeignThread::open_own(busy.tid).unwrap();
    let refused = enforcer.enroll(id, thread).unwrap_err();
    assert!(
        matches!(refused, ForeignError::Above { priority: 50, .. }),
        "{refused}"
    );
    assert_eq!(Original::of(busy.tid).unwrap(), had);
}

/// A suspended worker without budget is in the time-sharing class, and was taken for any other
/// thread: two enforcers set its priority in turn.
fn a_worker_of_an_executor_is_nobody_elses() {
    let executors = replenish_os::Enforcer::start(EnforcerConfig::on_cpu(cpu())).unwrap();
    let (tell, told) = mpsc::channel();
    let (end, ends) = mpsc::channel::<()>();
    let worker = std::thread::spawn(move || {
        crate::common::become_fifo(cpu(), 60);
        let params = Params::new(60, Low::Suspend, MS, 100 * MS, 16).unwrap();
        let account = executors.enroll(&params, Kind::Corrected).unwrap();
        tell.send(current_tid()).unwrap();
        ends.recv().ok();
        drop(account);
    });
    let refused = ForeignThread::open_own(told.recv().unwrap()).unwrap_err();
    assert!(matches!(refused, ForeignError::Worker { .. }), "{refused}");
    drop(end);
    worker.join().unwrap();
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        rt_trial(
            "a_worker_of_an_executor_is_nobody_elses",
            a_worker_of_an_executor_is_nobody_elses,
        ),
        rt_trial(
            "its_time_stays_within_the_budget",
            its_time_stays_within_the_budget,
        ),
        rt_trial(
            "the_enforcer_is_armed_before_a_thread_is_raised",
            the_enforcer_is_armed_before_a_thread_is_raised,
        ),
        rt_trial(
            "the_place_of_an_ended_budget_is_free",
            the_place_of_an_ended_budget_is_free,
        ),
        rt_trial(
            "a_thread_above_the_enforcer_is_left_alone",
            a_thread_above_the_enforcer_is_left_alone,
        ),
    ]
}
