//! A worker that is not pinned, and is moved from one CPU to another from outside while it runs:
//! its share, its bound and its account stay what they are.

use crate::common::{MS, burn, cpu};
use replenish_os::{
    CpuSet, Enforcer, EnforcerConfig, SchedClass, affinity, clock, current_tid, set_affinity,
    set_priority,
};
use replenish_testkit::harness::{Trial, rt_trial};
use replenish_testkit::watchdog::watchdog;
use sporadic::{Kind, Low, Params};
use std::sync::{Arc, mpsc};
use std::time::Duration;

const BUDGET: u64 = 10 * MS;
const PERIOD: u64 = 50 * MS;
const PERIODS: u64 = 20;
/// From one move to the next.
const STAY: u64 = 3 * MS;

pub(crate) fn trials() -> Vec<Trial> {
    let one = affinity(current_tid()).is_ok_and(|cpus| cpus.iter().count() < 2);
    let why = one.then_some("this needs two CPUs");
    let moved = |name, low| rt_trial(name, move || moved(low)).skipped_if(why);
    vec![
        moved("a_worker_that_is_moved_keeps_its_share", Low::Background(1)),
        moved(
            "a_suspended_worker_that_is_moved_keeps_its_share",
            Low::Suspend,
        ),
    ]
}

fn moved(low: Low) {
    let _dog = watchdog("migration", Duration::from_secs(60));
    let cpus: Vec<usize> = affinity(current_tid()).unwrap().iter().collect();
    let (first, last) = (cpus[0], cpu());
    let enforcer = Enforcer::start(EnforcerConfig::unpinned()).unwrap();
    let (tell, told) = mpsc::channel();
    let (begin, begins) = mpsc::channel::<u64>();
    let theirs = Arc::clone(&enforcer);
    let worker = std::thread::spawn(move || {
        set_priority(current_tid(), SchedClass::Fifo(60)).unwrap();
        let params = Params::new(60, low, BUDGET, PERIOD, 16).unwrap();
        let mut account = theirs.enroll(&params, Kind::Corrected).unwrap();
        tell.send((account.meter(), current_tid())).unwrap();
        let end = begins.recv().unwrap();
        let (from, before) = (clock::thread_cpu(), account.meter().usage());
        account.activate(clock::monotonic());
        account.callback_begin().unwrap();
        let mut seen = [0_u64; 2];
        while clock::monotonic() < end {
            burn(MS / 10);
            let here = affinity(current_tid()).unwrap().iter().next();
            seen[usize::from(here != Some(first))] += 1;
        }
        account.callback_end();
        account.block();
        let (used, after) = (clock::thread_cpu() - from, account.meter().usage());
        let high = after.cpu_high - before.cpu_high;
        (used, high, after.cpu_low - before.cpu_low, seen)
    });
    let (meter, tid) = told.recv().unwrap();
    set_priority(current_tid(), SchedClass::Fifo(70)).unwrap();
    let from = clock::monotonic();
    let end = from + PERIODS * PERIOD;
    begin.send(end).unwrap();
    let mut to = 0;
    while clock::monotonic() < end {
        set_affinity(tid, &CpuSet::one([first, last][to])).unwrap();
        to = 1 - to;
        clock::sleep_until(clock::monotonic() + STAY);
    }
    // Stopped without budget it would stand still.
    meter.cancel();
    set_priority(current_tid(), SchedClass::Other).unwrap();
    let (used, high, low_time, seen) = worker.join().unwrap();
    let span = clock::monotonic() - from;
    println!(
        "{high} high and {low_time} low of {used} in {span} ns, {seen:?} {:?}",
        enforcer.stats()
    );
    enforcer.stop();
    assert!(seen.iter().all(|n| *n > 10), "it was on both: {seen:?}");
    // Its way out of the wait, and into it, are not between the two readings of its clock.
    assert!(
        (high + low_time).abs_diff(used) <= MS / 2,
        "{high} + {low_time} of {used}"
    );
    let due = span * BUDGET / PERIOD;
    assert!(high <= due + 2 * BUDGET, "{high} of {due}");
    assert!(high + 2 * BUDGET >= due, "{high} of {due}");
}
