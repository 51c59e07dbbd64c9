//! The trials of `nuttx.rs`.

use crate::common::{MS, become_fifo, burn};
use replenish_os::clock::{self, ThreadCpuClock};
use replenish_os::{
    Enforcer, EnforcerConfig, GrantedPolicy, Low, Notify, Params, PiMutex, Policy, SchedClass,
    SpawnError, ThreadSpec, WakeFd, current_tid, demote_to_tail, granted, nuttx, promote,
    set_priority, spawn,
};
use replenish_testkit::harness::{Trial, rt_trial, trial};
use replenish_testkit::watchdog::watchdog;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial("the_shim_fits_and_says_what_it_found", || {
            let facts = nuttx::check().unwrap();
            let usize_bytes = u32::try_from(size_of::<usize>()).unwrap();
            assert!(
                facts.attr_bytes > usize_bytes && facts.param_bytes >= 4,
                "{facts}"
            );
            assert!(facts.resolution <= 1_000_000);
        }),
        trial("numbers_and_slots_are_used_again", slots_are_used_again),
        trial("a_spawned_thread_ends_and_can_be_waited_for", ends),
        trial("foreign_threads_come_and_go", foreign_threads),
        trial("impossible_requests_are_refused_by_name", refusals),
        trial("a_wake_up_ends_a_wait_and_is_consumed", wakes),
        rt_trial("policies_are_in_force_and_read_back", policies),
        rt_trial("a_change_before_the_first_run_counts", early_change),
        rt_trial("inheritance_goes_through_a_chain_of_locks", chain),
        rt_trial("lowering_an_owner_does_not_take_its_boost", lowered_owner),
        rt_trial("suspension_is_refused_at_enrolment", || {
            let enforcer = Enforcer::start(EnforcerConfig::on_cpu(0)).unwrap();
            let params = Params::new(60, Low::Suspend, MS, 10 * MS, 4).unwrap();
            let refused = enforcer.enroll(&params, replenish_kind()).unwrap_err();
            assert!(
                refused.to_string().contains("background priority"),
                "{refused}"
            );
        }),
    ]
}

fn replenish_kind() -> sporadic::Kind {
    sporadic::Kind::Corrected
}

/// A hundred threads one after the other do not take a hundred slots.
fn slots_are_used_again() {
    let ids: BTreeSet<_> = (0..100)
        .map(|_| {
            let thread = spawn(ThreadSpec::new("short"), current_tid).unwrap();
            let tid = thread.join().unwrap();
            let patience = clock::monotonic() + 2_000 * MS;
            while ThreadCpuClock::of(tid).read().is_some() && clock::monotonic() < patience {
                std::thread::yield_now();
            }
            tid.get()
        })
        .collect();
    assert!(ids.len() < 20, "{ids:?}");
}

fn ends() {
    let release = Arc::new(Notify::new());
    let theirs = Arc::clone(&release);
    let thread = spawn(ThreadSpec::new("waits"), move || {
        theirs.wait();
        7
    });
    let thread = thread.unwrap();
    assert!(!thread.is_finished());
    let deadline = clock::monotonic() + 5 * MS;
    let thread = thread.join_until(deadline).unwrap_err();
    assert!(clock::monotonic() >= deadline);
    release.set();
    let patience = clock::monotonic() + 10_000 * MS;
    assert_eq!(thread.join_until(patience).unwrap().unwrap(), 7);
}

fn foreign_threads() {
    let mine = current_tid();
    let ids: Vec<_> = (0..50)
        .map(|_| std::thread::spawn(current_tid).join().unwrap())
        .collect();
    assert!(ids.iter().all(|&id| id != mine));
    let different: BTreeSet<_> = ids.iter().map(|id| id.get()).collect();
    assert!(different.len() < 10, "{different:?}");
    assert_eq!(current_tid(), mine);
}

fn refusals() {
    let refused = |spec| spawn(spec, || ()).map(drop).unwrap_err();
    let spec = ThreadSpec::new("x").policy(Policy::Fifo { priority: 0 });
    assert_eq!(
        refused(spec).to_string(),
        "priority 0 is out of range: allowed 1 to 99"
    );
    assert!(matches!(
        refused(ThreadSpec::new("nul\0byte")),
        SpawnError::Name
    ));
    let error = refused(ThreadSpec::new("x").cpu(1)).to_string();
    assert!(error.contains("allowed 0"), "{error}");
    let policy = Policy::deadline(MS, 10 * MS, 10 * MS).unwrap();
    let error = refused(ThreadSpec::new("x").policy(policy)).to_string();
    assert!(error.contains("NuttX has FIFO"), "{error}");
    assert!(promote(current_tid(), 100).is_err());
}

fn wakes() {
    let _dog = watchdog("a wake-up", Duration::from_secs(20));
    let wake = Arc::new(WakeFd::new().unwrap());
    assert!(!wake.wait_until(Some(clock::monotonic() + 2 * MS)));
    let theirs = Arc::clone(&wake);
    let waker = std::thread::spawn(move || {
        clock::sleep_until(clock::monotonic() + 5 * MS);
        theirs.wake();
    });
    assert!(wake.wait_until(None));
    assert!(!wake.clear());
    waker.join().unwrap();
}

fn policies() {
    let params = Params::new(60, Low::Background(6), 30 * MS, 100 * MS, 10).unwrap();
    for (policy, class, priority) in [
        (Policy::fifo(50).unwrap(), GrantedPolicy::Fifo, 50),
        (
            Policy::round_robin(40).unwrap(),
            GrantedPolicy::RoundRobin,
            40,
        ),
        (Policy::sporadic(params).unwrap(), GrantedPolicy::Fifo, 60),
        (Policy::Other, GrantedPolicy::Other, 0),
    ] {
        let spec = ThreadSpec::new("rt").policy(policy).stack_size(64 << 10);
        let thread = spawn(spec, || granted(current_tid()).unwrap()).unwrap();
        let seen = thread.join().unwrap();
        assert_eq!((seen.policy, seen.priority), (class, priority));
        assert_eq!(seen.stack_bytes, 64 << 10);
    }
}

/// Its creator is above the new thread on the only CPU, and changes its priority at once.
fn early_change() {
    become_fifo(0, 80);
    let spec = ThreadSpec::new("low").policy(Policy::fifo(10).unwrap());
    let thread = spawn(spec, || granted(current_tid()).unwrap()).unwrap();
    assert_eq!(granted(thread.tid()).unwrap().priority, 10);
    set_priority(thread.tid(), SchedClass::Fifo(20)).unwrap();
    assert_eq!(granted(thread.tid()).unwrap().priority, 20);
    assert_eq!(thread.join().unwrap().priority, 20);
}

/// The priority of a thread at FIFO 30 with a lock, before and while `waiter` waits.
struct Seen {
    alone: u8,
    boosted: u8,
    lowered: u8,
    after: u8,
}

fn lowered_owner() {
    let _dog = watchdog("a lowered owner", Duration::from_secs(20));
    let mutex = Arc::new(PiMutex::new(()));
    let seen = owner_with(&mutex, {
        let mutex = Arc::clone(&mutex);
        move || drop(mutex.lock())
    });
    assert_eq!((seen.alone, seen.boosted, seen.lowered), (30, 70, 70));
    assert_eq!(seen.after, 5, "the boost ends with the lock");
}

/// A at 70 waits for B's lock, B at 40 for the owner's.
fn chain() {
    let _dog = watchdog("a chain of locks", Duration::from_secs(20));
    let [first, second] = [(); 2].map(|()| Arc::new(PiMutex::new(())));
    let holds_second = Arc::new(AtomicBool::new(false));
    let middle = std::thread::spawn({
        let (first, second) = (Arc::clone(&first), Arc::clone(&second));
        let holds = Arc::clone(&holds_second);
        move || {
            become_fifo(0, 40);
            // The owner below has the first lock by then.
            clock::sleep_until(clock::monotonic() + 20 * MS);
            let _second = second.lock();
            holds.store(true, Ordering::SeqCst);
            drop(first.lock());
        }
    });
    let seen = owner_with(&first, {
        let second = Arc::clone(&second);
        let holds = Arc::clone(&holds_second);
        move || {
            while !holds.load(Ordering::SeqCst) {
                clock::sleep_until(clock::monotonic() + MS);
            }
            clock::sleep_until(clock::monotonic() + 2 * MS);
            drop(second.lock());
        }
    });
    middle.join().unwrap();
    assert_eq!((seen.alone, seen.boosted, seen.lowered), (30, 70, 70));
    assert_eq!(seen.after, 5);
}

/// The owner locks `mutex`; `wait` runs at 70 and ends up waiting for it; then another thread
/// lowers the owner to 5, as an enforcer does; at last the owner unlocks.
fn owner_with(mutex: &Arc<PiMutex<()>>, wait: impl FnOnce() + Send + 'static) -> Seen {
    let priority = || granted(current_tid()).unwrap().priority;
    let locked = Arc::new(Notify::new());
    let owner = std::thread::spawn({
        let (mutex, locked) = (Arc::clone(mutex), Arc::clone(&locked));
        move || {
            become_fifo(0, 30);
            let guard = mutex.lock();
            let alone = priority();
            locked.set();
            let end = clock::monotonic() + 5_000 * MS;
            while priority() == 30 && clock::monotonic() < end {
                burn(MS / 10);
            }
            // Alone for a moment with the waiter of the middle, in the case of a chain.
            while priority() < 70 && clock::monotonic() < end {
                burn(MS / 10);
            }
            let boosted = priority();
            demote_to_tail(current_tid(), 5).unwrap();
            let lowered = priority();
            drop(guard);
            Seen {
                alone,
                boosted,
                lowered,
                after: priority(),
            }
        }
    });
    locked.wait();
    let waiter = std::thread::spawn(move || {
        become_fifo(0, 70);
        wait();
    });
    waiter.join().unwrap();
    owner.join().unwrap()
}
