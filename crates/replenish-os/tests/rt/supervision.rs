//! The watchdog: an enforcer that fails, workers that leave their policy, privileges that go away.
#![expect(
    unsafe_code,
    reason = "a child gives up its user for all threads, a worker changes its own policy"
)]

use crate::common::{MS, become_fifo, burn, cpu};
use replenish_os::{
    Account, CpuSet, Enforcer, EnforcerConfig, Fault, Policy, SchedClass, ThreadSpec, Tid, Usage,
    affinity, clock, current_tid, granted, set_affinity, set_priority, spawn,
};
use replenish_testkit::harness::{Trial, rt_trial};
use replenish_testkit::progress::eventually;
use replenish_testkit::watchdog::watchdog;
use sporadic::{Kind, Low, Params};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::time::Duration;

const CHILD: &str = "REPLENISH_DROPPING_CHILD";

type Faults = Arc<Mutex<Vec<Fault>>>;

/// An enforcer, and what it reports.
fn enforcer() -> (Arc<Enforcer>, Faults) {
    let enforcer = Enforcer::start(EnforcerConfig::on_cpu(cpu())).unwrap();
    let faults = Faults::default();
    let told = Arc::clone(&faults);
    enforcer.on_fault(move |fault| told.lock().unwrap().push(*fault));
    assert!(enforcer.watchdog_refused().is_none());
    (enforcer, faults)
}

/// Enrolls the calling thread with `budget` per `period`, in ms.
fn enroll(enforcer: &Enforcer, budget: u64, period: u64, low: u8) -> Account {
    become_fifo(cpu(), 60);
    let params = Params::new(60, Low::Background(low), budget * MS, period * MS, 16).unwrap();
    enforcer.enroll(&params, Kind::Corrected).unwrap()
}

fn wait_for(faults: &Faults, good: impl Fn(&Fault) -> bool) {
    let came = || faults.lock().unwrap().iter().any(&good);
    assert!(eventually(came), "{:?}", faults.lock().unwrap());
}

/// A callback takes another policy for itself, and the CPU for 400 ms with a budget of 10 per 100.
/// Returns its thread, the faults that the watchdog reported, and their number by the counters.
fn a_worker_that_leaves_its_policy_is_put_back(leave: fn()) -> (Tid, Faults, u64) {
    let _dog = watchdog("leaves its policy", Duration::from_secs(120));
    let (enforcer, faults) = enforcer();
    let worker = std::thread::spawn(move || {
        let mut account = enroll(&enforcer, 10, 100, 6);
        let meter = account.meter();
        account.activate(clock::monotonic());
        account.callback_begin().unwrap();
        leave();
        burn(400 * MS);
        account.callback_end();
        account.block();
        let usage = meter.usage();
        (usage, enforcer.stats(), current_tid())
    });
    let (usage, stats, tid) = worker.join().unwrap();
    println!("{usage:?} {stats:?}");
    // One period at the worst, until the watchdog looks; it pays for that with what comes later.
    assert!(
        usage.exhaustions >= 1 && usage.cpu_high <= 250 * MS,
        "{usage:?}"
    );
    (tid, faults, stats.faults)
}

fn a_worker_without_budget_that_raises_itself_pays_for_it() {
    raises_itself(|_| ());
}

/// Each reading of its account, and the end of each callback is one, took what came before it for
/// low time.
fn a_worker_that_raises_itself_pays_whoever_reads_its_account() {
    raises_itself(|account| assert!(account.meter().usage().low));
}

/// Without budget it raises itself, as old code does at the top of each callback: it was put back,
/// and what it had was free.
fn raises_itself(read: impl Fn(&Account) + Send + 'static) {
    let _dog = watchdog("raises itself without budget", Duration::from_secs(120));
    let (enforcer, _) = enforcer();
    let worker = std::thread::spawn(move || {
        let mut account = enroll(&enforcer, 10, 1000, 6);
        let begin = clock::monotonic();
        account.activate(begin);
        account.callback_begin().unwrap();
        burn(12 * MS);
        assert!(account.meter().usage().low);
        set_priority(current_tid(), SchedClass::Fifo(98)).unwrap();
        let from = clock::thread_cpu();
        let priority = || granted(current_tid()).unwrap().priority;
        while priority() == 98 {
            burn(MS / 10);
            read(&account);
        }
        let took = clock::thread_cpu() - from;
        while priority() != 60 {
            clock::sleep_until(clock::monotonic() + MS);
        }
        (took, clock::monotonic() - begin)
    });
    let (took, back) = worker.join().unwrap();
    println!("{took} ns at 98, funded again after {back} ns");
    // Two budgets or more: it is funded again a period for each later.
    assert!(back >= took / (10 * MS) * 1000 * MS, "{took} {back}");
}

/// It gives itself its own priority, which drops the flag that keeps its threads out of the
/// real-time classes.
fn a_worker_that_drops_its_reset_on_fork_has_it_back() {
    let _dog = watchdog("drops reset-on-fork", Duration::from_secs(120));
    let (enforcer, faults) = enforcer();
    let (tell, told) = mpsc::channel();
    let spec = ThreadSpec::new("w")
        .policy(Policy::fifo(60).unwrap())
        .cpu(cpu());
    let worker = spawn(spec, move || {
        let params = Params::new(60, Low::Background(6), 10 * MS, 100 * MS, 16).unwrap();
        let mut account = enforcer.enroll(&params, Kind::Corrected).unwrap();
        account.activate(clock::monotonic());
        let param = libc::sched_param { sched_priority: 60 };
        // SAFETY: it has no arguments.
        let own = unsafe { libc::pthread_self() };
        // SAFETY: `param` lives across the call.
        let set = unsafe { libc::pthread_setschedparam(own, libc::SCHED_FIFO, &raw const param) };
        assert_eq!(set, 0);
        tell.send(current_tid()).unwrap();
        std::thread::sleep(Duration::from_millis(300));
        assert!(granted(current_tid()).unwrap().reset_on_fork);
    });
    let thread = told.recv().unwrap();
    wait_for(&faults, |fault| *fault == Fault::ForeignPolicy { thread });
    assert!(worker.unwrap().join().is_ok());
}

/// On b209253 a callback that made itself FIFO 99 had the CPU for as long as it liked: 400 ms, and
/// no exhaustion. The enforcer has the same priority and has to wait.
fn a_worker_that_raises_itself_is_put_back() {
    let (tid, faults, counted) = a_worker_that_leaves_its_policy_is_put_back(|| {
        set_priority(current_tid(), SchedClass::Fifo(99)).unwrap();
    });
    wait_for(&faults, |fault| {
        *fault == Fault::ForeignPolicy { thread: tid }
    });
    assert!(counted >= 1);
}

/// A reservation of the kernel's own comes before the enforcer on whichever CPU. If it runs on
/// another one, the enforcer lowers it in time, and the watchdog may find nothing.
fn a_worker_that_makes_itself_a_deadline_thread_is_put_back() {
    a_worker_that_leaves_its_policy_is_put_back(|| {
        // The kernel refuses such a policy to pinned threads.
        set_affinity(current_tid(), &CpuSet::parse("0-1").unwrap()).unwrap();
        // SAFETY: all numbers may be 0.
        let mut attributes: libc::sched_attr = unsafe { std::mem::zeroed() };
        attributes.size = size_of::<libc::sched_attr>().try_into().unwrap();
        attributes.sched_policy = libc::SCHED_DEADLINE.try_into().unwrap();
        attributes.sched_runtime = 80 * MS;
        attributes.sched_deadline = 100 * MS;
        attributes.sched_period = 100 * MS;
        // SAFETY: the kernel reads `size` bytes during the call, of this thread's own policy.
        let done = unsafe { libc::syscall(libc::SYS_sched_setattr, 0, &raw const attributes, 0) };
        assert_eq!(done, 0, "{}", std::io::Error::last_os_error());
    });
}

/// The watchdog stands in for an enforcer that cannot run. On b209253 the workers had the CPU until
/// the enforcer could run. The watchdog is on another CPU here, where nothing keeps it from
/// running.
fn a_silent_enforcer_is_stood_in_for(low: Low) -> (Vec<Fault>, Usage) {
    let (enforcer, faults) = enforcer();
    let (tell, told) = mpsc::channel();
    let hogged = Arc::new(AtomicBool::new(false));
    let (theirs, begin) = (Arc::clone(&enforcer), Arc::clone(&hogged));
    let worker = std::thread::spawn(move || {
        become_fifo(cpu(), 60);
        let params = Params::new(60, low, 10 * MS, 50 * MS, 16).unwrap();
        let mut account = theirs.enroll(&params, Kind::Corrected).unwrap();
        let meter = account.meter();
        account.activate(clock::monotonic());
        account.callback_begin().unwrap();
        tell.send(current_tid()).unwrap();
        while !begin.load(Ordering::SeqCst) {
            clock::sleep_until(clock::monotonic() + MS);
        }
        burn(150 * MS);
        account.callback_end();
        account.block();
        meter.usage()
    });
    let tid = told.recv().unwrap();
    set_affinity(tid, &CpuSet::parse("0-1").unwrap()).unwrap();
    // At the enforcer's own priority on its CPU.
    let hog = std::thread::spawn(move || {
        become_fifo(cpu(), 99);
        hogged.store(true, Ordering::SeqCst);
        burn(300 * MS);
    });
    let usage = worker.join().unwrap();
    hog.join().unwrap();
    wait_for(&faults, |fault| matches!(fault, Fault::Silent { .. }));
    enforcer.stop();
    let faults = faults.lock().unwrap().clone();
    (faults, usage)
}

fn a_silent_enforcer_is_reported_and_its_worker_lowered() {
    let _dog = watchdog("a silent enforcer", Duration::from_secs(120));
    let (faults, usage) = a_silent_enforcer_is_stood_in_for(Low::Background(6));
    println!("{faults:?} {usage:?}");
    assert!(usage.exhaustions >= 1, "{usage:?}");
}

/// The watchdog stops a thread as the enforcer does, from whichever CPU, and raises it again.
fn a_silent_enforcers_worker_is_suspended_by_the_watchdog() {
    let _dog = watchdog("suspended by the watchdog", Duration::from_secs(120));
    let (faults, usage) = a_silent_enforcer_is_stood_in_for(Low::Suspend);
    println!("{faults:?} {usage:?}");
    assert!(
        usage.exhaustions >= 1 && usage.replenishments >= 1,
        "{usage:?}"
    );
    assert!(usage.cpu_low < 5 * MS, "{usage:?}");
}

/// The enforcer of `cpu()`, by its name.
fn enforcers_thread() -> Tid {
    let name = format!("enforcer/{}", cpu());
    let tasks = std::fs::read_dir("/proc/self/task").unwrap();
    let mut tids = tasks.flatten().filter_map(|task| {
        let comm = std::fs::read_to_string(task.path().join("comm")).ok()?;
        let tid = task.file_name().to_str()?.parse().ok()?;
        (comm.trim() == name).then(|| Tid::new(tid)).flatten()
    });
    tids.next().expect("no enforcer")
}

/// The watchdog restores an enforcer's priority. On b209253 the loss went unnoticed.
fn an_enforcer_that_lost_its_priority_gets_it_back() {
    let _dog = watchdog("lost its priority", Duration::from_secs(120));
    let (enforcer, faults) = enforcer();
    let tid = enforcers_thread();
    set_priority(tid, SchedClass::Other).unwrap();
    set_affinity(tid, &CpuSet::parse("0-1").unwrap()).unwrap();
    wait_for(&faults, |fault| *fault == Fault::Displaced);
    assert!(eventually(|| granted(tid).unwrap().priority == 99));
    assert!(eventually(|| affinity(tid).unwrap() == CpuSet::one(cpu())));
    enforcer.stop();
}

/// Whether this process is the one that gives up its privileges.
pub(crate) fn is_child() -> bool {
    std::env::var_os(CHILD).is_some()
}

/// A program that starts as root and goes on as another user.
pub(crate) fn child() -> ! {
    let (enforcer, faults) = enforcer();
    let stop = Arc::new(AtomicBool::new(false));
    let (tell, told) = mpsc::channel();
    let (theirs, until) = (Arc::clone(&enforcer), Arc::clone(&stop));
    let worker = std::thread::spawn(move || {
        let mut account = enroll(&theirs, 5, 50, 1);
        tell.send((account.meter(), current_tid())).unwrap();
        account.activate(clock::monotonic());
        account.callback_begin().unwrap();
        while !until.load(Ordering::Relaxed) {}
        account.callback_end();
        account.block();
    });
    let (meter, tid) = told.recv().unwrap();
    std::thread::sleep(Duration::from_millis(120));
    assert_eq!(enforcer.stats().refused, 0);
    let dropped = clock::monotonic();
    // SAFETY: a plain number; the C library changes all threads of the process.
    assert_eq!(unsafe { libc::setuid(65534) }, 0);
    if replenish_os::privilege::probe()
        .rtprio
        .soft
        .is_none_or(|limit| limit >= 60)
    {
        println!("the limit of priorities was raised at the start: nothing is refused");
        let before = meter.usage().replenishments;
        assert!(eventually(|| meter.usage().replenishments >= before + 4));
        assert_eq!(enforcer.stats().refused, 0);
        stop.store(true, Ordering::Relaxed);
        worker.join().unwrap();
        std::process::exit(0);
    }
    wait_for(&faults, |fault| *fault == Fault::Refused { thread: tid });
    let waits_for_budget = || {
        let usage = meter.usage();
        usage.low && usage.available > 0
    };
    // The account says what is the case: low, with a budget that it does not get.
    assert!(eventually(waits_for_budget), "{:?}", meter.usage());
    let (usage, stats) = (meter.usage(), enforcer.stats());
    println!("{usage:?} {stats:?}");
    assert!(granted(tid).unwrap().priority <= 1);
    // Half a period from one attempt to the next, and while the users differ a check's distance.
    let most = (clock::monotonic() - dropped) / (50 * MS / 2) + 12;
    assert!((1..=most).contains(&stats.refused), "{most} {stats:?}");
    let high = usage.cpu_high;
    std::thread::sleep(Duration::from_millis(120));
    assert_eq!(meter.usage().cpu_high, high, "it never runs high again");
    stop.store(true, Ordering::Relaxed);
    worker.join().unwrap();
    std::process::exit(0)
}

/// On b209253 every raise was refused for ever, no event said so, and the account said "high".
fn a_privilege_that_goes_away_is_reported() {
    let output = Command::new(std::env::current_exe().unwrap())
        .env(CHILD, "1")
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}{errors}");
    println!("{text}");
}

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        rt_trial(
            "a_worker_without_budget_that_raises_itself_pays_for_it",
            a_worker_without_budget_that_raises_itself_pays_for_it,
        ),
        rt_trial(
            "a_worker_that_raises_itself_pays_whoever_reads_its_account",
            a_worker_that_raises_itself_pays_whoever_reads_its_account,
        ),
        rt_trial(
            "a_worker_that_drops_its_reset_on_fork_has_it_back",
            a_worker_that_drops_its_reset_on_fork_has_it_back,
        ),
        rt_trial(
            "a_worker_that_raises_itself_is_put_back",
            a_worker_that_raises_itself_is_put_back,
        ),
        rt_trial(
            "a_worker_that_makes_itself_a_deadline_thread_is_put_back",
            a_worker_that_makes_itself_a_deadline_thread_is_put_back,
        ),
        rt_trial(
            "a_silent_enforcer_is_reported_and_its_worker_lowered",
            a_silent_enforcer_is_reported_and_its_worker_lowered,
        ),
        rt_trial(
            "a_silent_enforcers_worker_is_suspended_by_the_watchdog",
            a_silent_enforcers_worker_is_suspended_by_the_watchdog,
        ),
        rt_trial(
            "an_enforcer_that_lost_its_priority_gets_it_back",
            an_enforcer_that_lost_its_priority_gets_it_back,
        ),
        rt_trial(
            "a_privilege_that_goes_away_is_reported",
            a_privilege_that_goes_away_is_reported,
        ),
    ]
}
