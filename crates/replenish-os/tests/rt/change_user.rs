//! A program that gives up its user while a thread of its own has the CPU for good, and workers
//! below it have no budget. The trial runs this very program again, as a child that does so.
#![expect(unsafe_code, reason = "setuid and setgid")]

use crate::common::{MS, become_fifo, cpu};
use replenish_os::{
    Enforcer, EnforcerConfig, Fault, Meter, Tid, change_user, clock, current_tid, granted,
};
use replenish_testkit::harness::{Trial, rt_trial};
use replenish_testkit::progress::eventually;
use replenish_testkit::watchdog::watchdog;
use sporadic::{Kind, Low, Params};
use std::os::unix::fs::MetadataExt as _;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

const CHILD: &str = "REPLENISH_CHANGE_USER_CHILD";
const NOBODY: libc::uid_t = 65534;
/// A period so long that no worker is raised while the program changes.
const PERIOD: u64 = 4_000 * MS;

pub(crate) fn is_child() -> bool {
    std::env::var_os(CHILD).is_some()
}

pub(crate) fn trials() -> Vec<Trial> {
    let root = std::fs::metadata("/proc/self").is_ok_and(|m| m.uid() == 0);
    vec![
        rt_trial("a_change_that_panics_leaves_no_priority_behind", || {
            let change = || change_user(|| panic!("refused"));
            assert!(std::panic::catch_unwind(change).is_err());
            assert_eq!(granted(current_tid()).unwrap().priority, 0);
        }),
        rt_trial(
            "a_program_that_gives_up_its_user_waits_for_no_budget",
            || {
                let mut command = Command::new(std::env::current_exe().unwrap());
                let output = command.env(CHILD, "1").output().unwrap();
                let text = String::from_utf8_lossy(&output.stdout);
                let errors = String::from_utf8_lossy(&output.stderr);
                assert!(output.status.success(), "{text}{errors}");
                println!("{text}");
            },
        )
        .skipped_if((!root).then_some("needs root")),
    ]
}

/// A worker that always wants the CPU.
fn worker(
    enforcer: &Arc<Enforcer>,
    low: Low,
    stop: &Arc<AtomicBool>,
) -> (JoinHandle<()>, Meter, Tid) {
    let (tell, told) = mpsc::channel();
    let (enforcer, stop) = (Arc::clone(enforcer), Arc::clone(stop));
    let worker = std::thread::spawn(move || {
        become_fifo(cpu(), 60);
        let params = Params::new(60, low, 5 * MS, PERIOD, 16).unwrap();
        let mut account = enforcer.enroll(&params, Kind::Corrected).unwrap();
        tell.send((account.meter(), current_tid())).unwrap();
        account.activate(clock::monotonic());
        account.callback_begin().unwrap();
        while !stop.load(Ordering::Relaxed) {}
        account.callback_end();
        account.block();
    });
    let (meter, tid) = told.recv().unwrap();
    (worker, meter, tid)
}

/// Whether all threads of this process have the user.
fn all_are(user: u32) -> bool {
    let tasks = std::fs::read_dir("/proc/self/task").unwrap().flatten();
    let mut states = tasks.flat_map(|task| std::fs::read_to_string(task.path().join("status")));
    states.all(|status| {
        let line = status.lines().find_map(|l| l.strip_prefix("Uid:"));
        line.and_then(|l| l.split_whitespace().next()) == Some(&user.to_string())
    })
}

/// Without the helper `setuid` returned when the first worker was raised, by the limit that this
/// process has, and otherwise not at all.
pub(crate) fn child() -> ! {
    let _dog = watchdog("a change of user", Duration::from_secs(60));
    let enforcer = Enforcer::start(EnforcerConfig::on_cpu(cpu())).unwrap();
    let faults = Arc::new(Mutex::new(Vec::new()));
    let told = Arc::clone(&faults);
    enforcer.on_fault(move |fault| told.lock().unwrap().push(*fault));
    let stop = Arc::new(AtomicBool::new(false));
    let until = Arc::clone(&stop);
    let background = worker(&enforcer, Low::Background(2), &stop);
    let suspended = worker(&enforcer, Low::Suspend, &stop);
    let hog = std::thread::spawn(move || {
        become_fifo(cpu(), 50);
        while !until.load(Ordering::Relaxed) {}
    });
    let low = || background.1.usage().low && suspended.1.usage().low;
    assert!(eventually(low));
    let (before, used) = (clock::monotonic(), background.1.usage());
    change_user(|| {
        // SAFETY: a plain number; the C library changes all threads of the process.
        assert_eq!(unsafe { libc::setgid(NOBODY) }, 0);
        // SAFETY: as above.
        assert_eq!(unsafe { libc::setuid(NOBODY) }, 0);
    });
    let took = clock::monotonic() - before;
    let after = background.1.usage();
    assert!(all_are(NOBODY));
    assert!(low(), "no budget came back meanwhile: {took} ns");
    // It had its part of the change, and gave the priority back.
    assert_eq!(granted(background.2).unwrap().priority, 2);
    assert_eq!(granted(suspended.2).unwrap().priority, 0);
    assert!(after.cpu_low - used.cpu_low < 10 * MS, "{used:?} {after:?}");
    assert_eq!(after.cpu_high, used.cpu_high);
    let limit = replenish_os::privilege::probe().rtprio.soft;
    if limit.is_none_or(|limit| limit >= 60) {
        // The enforcer raises its workers, as the user `nobody`.
        let raised = |meter: &Meter| meter.usage().replenishments > 0;
        assert!(eventually(|| raised(&background.1) && raised(&suspended.1)));
        assert_eq!(enforcer.stats().refused, 0);
        assert!(faults.lock().unwrap().is_empty());
    } else {
        // It may not, and says so.
        let refused = |thread| faults.lock().unwrap().contains(&Fault::Refused { thread });
        assert!(eventually(|| refused(background.2) && refused(suspended.2)));
    }
    println!(
        "{took} ns, {:?} {:?}",
        enforcer.stats(),
        faults.lock().unwrap()
    );
    stop.store(true, Ordering::Relaxed);
    background.1.cancel();
    suspended.1.cancel();
    for thread in [background.0, suspended.0, hog] {
        thread.join().unwrap();
    }
    enforcer.stop();
    std::process::exit(0)
}
