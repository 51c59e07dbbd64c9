//! A program in the middle of `setuid`: the C library changes thread by thread, all but the
//! worker's have another user already, and the kernel refuses the enforcer every change of the
//! worker's priority. Each trial runs this very program again, as a child that does so.
#![expect(unsafe_code, reason = "setuid, and a worker that puts it off")]

use crate::common::{MS, become_fifo, burn, cpu};
use replenish_os::{Enforcer, EnforcerConfig, Meter, PiMutex, Tid, clock, current_tid, granted};
use replenish_testkit::harness::{Trial, rt_trial};
use replenish_testkit::progress::eventually;
use replenish_testkit::watchdog::watchdog;
use sporadic::{Kind, Low, Params};
use std::os::unix::fs::MetadataExt as _;
use std::process::Command;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

const CHILD: &str = "REPLENISH_REFUSED_CHILD";
const NOBODY: libc::uid_t = 65534;
/// The GNU C library's own signal, which it names nowhere.
const SIGSETXID: i32 = 33;
/// The worker's budget and period.
const BUDGET: u64 = 5 * MS;
const PERIOD: u64 = 50 * MS;
/// Its section, in the trial that has one.
const SECTION: u64 = 2 * BUDGET;

/// Whether this process is the second run.
pub(crate) fn is_child() -> bool {
    std::env::var_os(CHILD).is_some()
}

pub(crate) fn child() -> ! {
    let _dog = watchdog("the refused run", Duration::from_secs(120));
    match std::env::var(CHILD).as_deref() {
        Ok("background") => lowers_itself(),
        Ok("suspended") => stops_itself(),
        _ => inherits(),
    }
    std::process::exit(0)
}

fn again(run: &str) {
    let mut command = Command::new(std::env::current_exe().unwrap());
    let output = command.env(CHILD, run).output().unwrap();
    let text = String::from_utf8_lossy(&output.stdout);
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}{errors}");
    println!("{text}");
}

pub(crate) fn trials() -> Vec<Trial> {
    let root = std::fs::metadata("/proc/self").is_ok_and(|m| m.uid() == 0);
    let gnu = cfg!(target_env = "gnu");
    let why =
        (!root || !gnu).then_some("needs root and the GNU C library, which changes by signal");
    vec![
        rt_trial(
            "a_worker_that_its_enforcer_may_not_lower_lowers_itself",
            || {
                again("background");
            },
        )
        .skipped_if(why),
        rt_trial(
            "a_worker_that_its_enforcer_may_not_lower_stops_itself",
            || {
                again("suspended");
            },
        )
        .skipped_if(why),
        rt_trial(
            "a_worker_that_is_not_raised_inherits_no_more_than_its_budget",
            || {
                again("inherits");
            },
        )
        .skipped_if(why),
    ]
}

/// Blocks the signal by which the GNU C library changes a thread's user, or lets it through: the
/// library's own calls leave it alone.
fn block_change_of_user(blocked: bool) {
    let how = if blocked {
        libc::SIG_BLOCK
    } else {
        libc::SIG_UNBLOCK
    };
    let set: u64 = 1 << (SIGSETXID - 1);
    // SAFETY: the set lives across the call, and has the size that the kernel wants.
    let rc = unsafe {
        let old = std::ptr::null_mut::<u64>();
        libc::syscall(libc::SYS_rt_sigprocmask, how, &raw const set, old, 8)
    };
    assert_eq!(rc, 0);
}

/// The user of a thread of this process.
fn user_of(tid: i32) -> Option<u32> {
    let status = std::fs::read_to_string(format!("/proc/self/task/{tid}/status")).ok()?;
    let line = status.lines().find_map(|l| l.strip_prefix("Uid:"))?;
    line.split_whitespace().next()?.parse().ok()
}

/// Number of this process's threads whose user is root.
fn roots() -> usize {
    let tasks = std::fs::read_dir("/proc/self/task").unwrap().flatten();
    let tids = tasks.filter_map(|t| t.file_name().to_str()?.parse().ok());
    tids.filter(|tid| user_of(*tid) == Some(0)).count()
}

/// A worker of root that runs `work` in one callback, and its enforcer, which runs as the user
/// `nobody`.
struct Rig {
    worker: JoinHandle<()>,
    changes: JoinHandle<()>,
    meter: Meter,
    tid: Tid,
    enforcer: Arc<Enforcer>,
}

fn rig(low: Low, work: impl FnOnce() + Send + 'static) -> Rig {
    let enforcer = Enforcer::start(EnforcerConfig::on_cpu(cpu())).unwrap();
    let (tell, told) = mpsc::channel();
    let (begin, begins) = mpsc::channel::<()>();
    let theirs = Arc::clone(&enforcer);
    let worker = std::thread::spawn(move || {
        block_change_of_user(true);
        become_fifo(cpu(), 60);
        let params = Params::new(60, low, BUDGET, PERIOD, 16).unwrap();
        let mut account = theirs.enroll(&params, Kind::Corrected).unwrap();
        tell.send((account.meter(), current_tid())).unwrap();
        begins.recv().unwrap();
        account.activate(clock::monotonic());
        account.callback_begin().unwrap();
        work();
        account.callback_end();
        account.block();
        block_change_of_user(false);
    });
    let (meter, tid) = told.recv().unwrap();
    // It waits for the worker.
    let changes = std::thread::spawn(|| {
        // SAFETY: a plain number; the C library changes all threads of the process.
        assert_eq!(unsafe { libc::setuid(NOBODY) }, 0);
    });
    // The thread that asks for it changes itself last, and that is always allowed.
    assert!(eventually(|| roots() <= 2));
    begin.send(()).unwrap();
    Rig {
        worker,
        changes,
        meter,
        tid,
        enforcer,
    }
}

impl Rig {
    fn end(self) {
        self.worker.join().unwrap();
        self.changes.join().unwrap();
        self.enforcer.stop();
    }
}

/// It went on at its high priority, and used all of the CPU. Each refusal was tried again an eighth
/// of a period later.
fn lowers_itself() {
    let stop = Arc::new(AtomicBool::new(false));
    let until = Arc::clone(&stop);
    let rig = rig(
        Low::Background(2),
        move || {
            while !until.load(Ordering::Relaxed) {}
        },
    );
    // The enforcer may not raise the worker again either: the worker is low, with a budget.
    let waits = || {
        let usage = rig.meter.usage();
        usage.low && usage.available > 0
    };
    assert!(eventually(waits), "{:?}", rig.meter.usage());
    assert!(rig.enforcer.stats().refused >= 1);
    assert_eq!(granted(rig.tid).unwrap().priority, 2);
    let high = rig.meter.usage().cpu_high;
    assert!(eventually(|| rig.meter.usage().cpu_low > 5 * PERIOD));
    let usage = rig.meter.usage();
    println!("{usage:?} {:?}", rig.enforcer.stats());
    assert_eq!(usage.cpu_high, high, "it never runs high again");
    assert!((BUDGET / 2..2 * BUDGET).contains(&high), "{usage:?}");
    assert_eq!(usage.exhaustions, 1);
    stop.store(true, Ordering::Relaxed);
    rig.end();
}

/// It stops where it is, and leaves its priority. It goes on in the time-sharing class.
fn stops_itself() {
    let done = Arc::new(AtomicU64::new(0));
    let theirs = Arc::clone(&done);
    let rig = rig(Low::Suspend, move || {
        for _ in 0..20 {
            burn(MS);
            theirs.fetch_add(1, Ordering::Relaxed);
        }
    });
    assert!(eventually(|| rig.meter.usage().low));
    assert!(eventually(|| granted(rig.tid).unwrap().priority == 0));
    let usage = rig.meter.usage();
    assert!(
        (BUDGET / 2..2 * BUDGET).contains(&usage.cpu_high),
        "{usage:?}"
    );
    assert!(rig.enforcer.stats().refused >= 1);
    assert!(
        eventually(|| done.load(Ordering::Relaxed) == 20),
        "it stands still"
    );
    println!("{:?} {:?}", rig.meter.usage(), rig.enforcer.stats());
    assert_eq!(rig.meter.usage().cpu_high, usage.cpu_high);
    rig.end();
}

/// Its sections are longer than its budget, and a thread above waits for each: it stops at the end
/// of one until that is paid for. A refused raise took away that limit: torture, seed 18, 204 ms
/// where 6.5 are allowed.
fn inherits() {
    let (stop, mutex) = (Arc::new(AtomicBool::new(false)), Arc::new(PiMutex::new(())));
    let (there, has_waited) = mpsc::channel();
    let (until, theirs) = (Arc::clone(&stop), Arc::clone(&mutex));
    let waiter = std::thread::spawn(move || {
        become_fifo(cpu(), 80);
        while !until.load(Ordering::Relaxed) {
            drop(theirs.lock());
            there.send(()).unwrap();
            clock::sleep_until(clock::monotonic() + MS / 10);
        }
    });
    let until = Arc::clone(&stop);
    let rig = rig(Low::Background(1), move || {
        while !until.load(Ordering::Relaxed) {
            let guard = mutex.lock();
            let end = clock::thread_cpu() + SECTION;
            while clock::thread_cpu() < end && !until.load(Ordering::Relaxed) {}
            drop(guard);
        }
    });
    assert!(eventually(|| rig.meter.usage().low));
    assert!(eventually(|| rig.enforcer.stats().refused >= 2));
    let used = || {
        let usage = rig.meter.usage();
        usage.cpu_high + usage.cpu_low
    };
    let (from, before) = (clock::monotonic(), used());
    clock::sleep_until(from + 24 * PERIOD);
    let (took, span) = (used() - before, clock::monotonic() - from);
    println!("{took} ns of {span}, {:?}", rig.enforcer.stats());
    // The worker's CPU time while no thread waits is free: a tenth of a millisecond in each
    // section.
    let most = span / PERIOD * BUDGET + 2 * BUDGET + 2 * SECTION + span / 50;
    let waits = has_waited.try_iter().count();
    stop.store(true, Ordering::Relaxed);
    assert!(took <= most, "{took} of {most}, {waits} waits");
    assert!(took >= 4 * BUDGET && waits > 4, "{took}, {waits} waits");
    waiter.join().unwrap();
    rig.end();
}
