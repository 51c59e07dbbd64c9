//! Threads that a library has started in this process get a budget by their names.

use crate::common::{burn, cpu, eventually};
use replenish::planning::Machine;
use replenish::{AdoptedReport, Budget, Context, Error, Executor, RunningExecutor};
use replenish_os::foreign::Original;
use replenish_os::{SchedClass, Tid, clock, current_tid, set_priority};
use replenish_testkit::harness::{Trial, rt_trial, trial};
use replenish_testkit::progress::reaches;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;

const MS: u64 = 1_000_000;

/// A library's thread: works without a pause until it is dropped.
struct Theirs {
    tid: Tid,
    stop: Arc<AtomicBool>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Theirs {
    fn start(name: &str) -> Self {
        let (stop, (tell, told)) = (Arc::new(AtomicBool::new(false)), mpsc::channel());
        let theirs = Arc::clone(&stop);
        let thread = std::thread::Builder::new().name(name.into());
        let thread = thread.spawn(move || {
            tell.send(current_tid()).unwrap();
            while !theirs.load(Ordering::Relaxed) {
                burn(1);
            }
        });
        Self {
            tid: told.recv().unwrap(),
            stop,
            thread: Some(thread.unwrap()),
        }
    }

    fn has(&self) -> Original {
        Original::of(self.tid).unwrap()
    }
}

impl Drop for Theirs {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().unwrap().join().unwrap();
    }
}

fn budget(amount: u64, period: u64) -> Budget {
    Budget::of(Duration::from_millis(amount)).every(Duration::from_millis(period))
}

fn executor() -> Executor {
    let mut exec = Executor::new(&Context::in_process());
    exec.no_ledger().machine(Machine::on_cpus(vec![cpu()]));
    let worker = exec.worker("own");
    worker.timer(Duration::from_millis(50), |_| {}).unwrap();
    exec
}

fn of(running: &RunningExecutor, pattern: &str) -> AdoptedReport {
    let rows = running.report().admission.adopted;
    rows.into_iter().find(|row| row.pattern == pattern).unwrap()
}

/// Two threads share the budget, the second found while the executor runs; others are left alone,
/// and in the end every thread has what it had.
fn they_share_a_budget() {
    let (first, other, urgent) = (
        Theirs::start("dds.udp.7412"),
        Theirs::start("shm"),
        Theirs::start("dds.urgent"),
    );
    set_priority(urgent.tid, SchedClass::Fifo(1)).unwrap();
    let had = [&first, &other, &urgent].map(Theirs::has);
    let mut exec = executor();
    exec.adopt("dds.*", budget(10, 50));
    exec.adopt("nobody*", budget(1, 100));
    let from = clock::monotonic();
    let running = exec.start().unwrap();
    // Before the first callback.
    assert_eq!(
        of(&running, "dds.*").threads,
        [("dds.udp.7412".to_owned(), first.tid)]
    );
    // Like all of them before they are adopted; this one may be at any moment.
    let second = Theirs::start("dds.shm");
    assert!(eventually(|| of(&running, "dds.*").adopted == 2));
    // A fifth of the CPU over some five periods in a row, and no more in all.
    let used = || of(&running, "dds.*").cpu_high;
    assert!(reaches(0.18, Duration::from_millis(250), used));
    assert!(eventually(|| of(&running, "dds.*").exhaustions >= 10));
    let row = of(&running, "dds.*");
    let elapsed = clock::monotonic() - from;
    eprintln!("{row:?} in {elapsed} ns");
    let most = (elapsed / (50 * MS) + 1) * 10 * MS + MS;
    assert!(row.cpu_high <= most, "{row:?} in {elapsed} ns");
    assert_eq!((row.cpu, row.refused), (cpu(), None));
    assert_eq!(of(&running, "nobody*").adopted, 0);
    assert_eq!([&other, &urgent].map(Theirs::has), had[1..]);
    drop(second);
    assert!(eventually(|| of(&running, "dds.*").threads.len() == 1));
    let third = Theirs::start("dds.shm");
    assert!(eventually(|| of(&running, "dds.*").adopted == 3));
    let report = running.stop();
    assert_eq!(report.admission.adopted.len(), 2);
    assert!(report.fallbacks.is_empty(), "{:?}", report.fallbacks);
    assert_eq!([&first, &other, &urgent].map(Theirs::has), had);
    assert_eq!(third.has(), had[1], "an ordinary thread again");
}

/// The plan counts the budget: a worker that would fit without it is refused.
fn it_is_admitted_like_a_guarantee() {
    let mut exec = executor();
    exec.adopt("dds.*", budget(60, 100));
    let asked = exec.worker("greedy").budget(budget(50, 100));
    asked.timer(Duration::from_millis(50), |_| {}).unwrap();
    let refused = exec.start().unwrap_err();
    assert!(matches!(refused, Error::NotAdmitted { .. }), "{refused}");
    let mut exec = executor();
    exec.adopt("dds.*", budget(99, 100));
    let refused = exec.start().unwrap_err().to_string();
    assert!(refused.contains("adopt dds.*"), "{refused}");
}

fn wrong_requests_are_named() {
    let refused = |change: fn(&mut Executor), said: &str| {
        let mut exec = executor();
        change(&mut exec);
        let text = exec.start().unwrap_err().to_string();
        assert!(text.contains(said), "{said:?} in {text:?}");
    };
    refused(|e| adopt(e, "", budget(1, 10)), "1 to 64 bytes");
    refused(
        |e| adopt(e, &"a".repeat(65), budget(1, 10)),
        "1 to 64 bytes",
    );
    let twice = |e: &mut Executor| {
        adopt(e, "a", budget(1, 10));
        adopt(e, "a", budget(1, 10));
    };
    refused(twice, "each pattern once");
    refused(|e| adopt(e, "a", budget(11, 10)), "adopt \"a\": budget");
    refused(|e| adopt(e, "a", budget(1, 10).suspend()), "background");
}

fn adopt(exec: &mut Executor, pattern: &str, budget: Budget) {
    exec.adopt(pattern, budget);
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        rt_trial("they_share_a_budget", they_share_a_budget),
        trial(
            "it_is_admitted_like_a_guarantee",
            it_is_admitted_like_a_guarantee,
        ),
        trial("wrong_requests_are_named", wrong_requests_are_named),
    ]
}
