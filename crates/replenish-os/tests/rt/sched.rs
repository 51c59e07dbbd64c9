//! Position of a thread in the FIFO list after a change of its priority, seen by who runs next.

use crate::common::{MS, become_fifo, cpu, spin};
use replenish_os::clock::{self, ThreadCpuClock};
use replenish_os::{SchedClass, Tid, current_tid, demote_to_tail, granted, promote, set_priority};
use replenish_testkit::harness::{Trial, rt_trial, trial};
use replenish_testkit::watchdog::watchdog;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial("bad_priorities_are_refused", || {
            for bad in [0, 100, 255] {
                let refused = set_priority(current_tid(), SchedClass::Fifo(bad)).unwrap_err();
                assert_eq!(refused.kind(), std::io::ErrorKind::InvalidInput);
            }
        }),
        rt_trial("plain_lowering_lands_at_the_head", || {
            let first = runs_next(40, |tid| set_priority(tid, SchedClass::Fifo(40)).unwrap());
            assert_eq!(
                first,
                Next::Lowered,
                "Linux changed; demote_to_tail can be one call"
            );
        }),
        rt_trial("demote_to_tail_lands_at_the_tail", || {
            assert_eq!(
                runs_next(40, |tid| demote_to_tail(tid, 40).unwrap()),
                Next::Waiting
            );
        }),
        rt_trial("demote_to_tail_of_priority_1_lands_at_the_tail", || {
            assert_eq!(
                runs_next(1, |tid| demote_to_tail(tid, 1).unwrap()),
                Next::Waiting
            );
        }),
        rt_trial("promotion_lands_at_the_tail", || {
            // Lowered first, behind the other; then raised to the other's level again.
            let first = runs_next(40, |tid| {
                set_priority(tid, SchedClass::Fifo(30)).unwrap();
                promote(tid, 40).unwrap();
            });
            assert_eq!(first, Next::Waiting);
        }),
        rt_trial(
            "a_thread_that_demotes_itself_lets_equals_run_first",
            self_demotion,
        ),
        rt_trial("promote_brings_back_a_thread_that_left_the_class", || {
            let thread = std::thread::spawn(|| {
                become_fifo(cpu(), 20);
                set_priority(current_tid(), SchedClass::Other).unwrap();
                promote(current_tid(), 21).unwrap();
            });
            thread.join().unwrap();
        }),
    ]
}

#[derive(Debug, PartialEq)]
enum Next {
    Lowered,
    Waiting,
}

/// A spins at 60 while B waits in the list of `lo`; `lower` is applied to A by a thread above
/// both. Tells which of them runs then.
fn runs_next(lo: u8, lower: fn(Tid)) -> Next {
    let _dog = watchdog("who runs next", Duration::from_secs(20));
    let cpu = cpu();
    let stop = Arc::new(AtomicBool::new(false));
    let referee = {
        let stop = Arc::clone(&stop);
        std::thread::spawn(move || {
            become_fifo(cpu, 90);
            let (a, a_thread) = spinner(cpu, 60, &stop);
            let (b, b_thread) = spinner(cpu, lo, &stop);
            // A runs, B queues; neither has done so if the machine stands still meanwhile.
            let at = |tid, priority| granted(tid).unwrap().priority == priority;
            while !(at(a, 60) && at(b, lo)) {
                clock::sleep_until(clock::monotonic() + MS);
            }
            let (clock_a, clock_b) = (ThreadCpuClock::of(a), ThreadCpuClock::of(b));
            let read = || (clock_a.read().unwrap(), clock_b.read().unwrap());
            lower(a);
            let before = read();
            let mut after = before;
            while after == before {
                clock::sleep_until(clock::monotonic() + MS);
                after = read();
            }
            stop.store(true, Ordering::Relaxed);
            let ran = (after.0 > before.0, after.1 > before.1);
            (ran, a_thread, b_thread)
        })
    };
    let (ran, a, b) = referee.join().unwrap();
    a.join().unwrap();
    b.join().unwrap();
    match ran {
        (true, false) => Next::Lowered,
        (false, true) => Next::Waiting,
        both => panic!("FIFO threads of one priority took turns: {both:?}"),
    }
}

/// A spinning FIFO thread, started from above so that it does not run before this returns.
fn spinner(cpu: usize, priority: u8, stop: &Arc<AtomicBool>) -> (Tid, JoinHandle<()>) {
    let (give, tid) = mpsc::channel();
    let stop = Arc::clone(stop);
    let thread = std::thread::spawn(move || {
        become_fifo(cpu, 80); // above the other spinner, below the referee
        give.send(current_tid()).unwrap();
        set_priority(current_tid(), SchedClass::Fifo(priority)).unwrap();
        spin(&stop);
    });
    (tid.recv().unwrap(), thread)
}

fn self_demotion() {
    let _dog = watchdog("self-demotion", Duration::from_secs(20));
    let cpu = cpu();
    let (wake, woken) = mpsc::channel::<()>();
    let (arrive, arrived) = mpsc::channel::<()>();
    let other_ran = Arc::new(AtomicBool::new(false));
    let other = std::thread::spawn({
        let other_ran = Arc::clone(&other_ran);
        move || {
            become_fifo(cpu, 40);
            arrive.send(()).unwrap();
            woken.recv().unwrap();
            other_ran.store(true, Ordering::Relaxed);
        }
    });
    let itself = std::thread::spawn(move || {
        arrived.recv().unwrap();
        become_fifo(cpu, 60);
        clock::sleep_until(clock::monotonic() + 5 * MS); // the other waits at its channel
        wake.send(()).unwrap(); // and is runnable now, at 40
        assert!(!other_ran.load(Ordering::Relaxed));
        demote_to_tail(current_tid(), 40).unwrap();
        assert!(other_ran.load(Ordering::Relaxed));
    });
    itself.join().unwrap();
    other.join().unwrap();
}
