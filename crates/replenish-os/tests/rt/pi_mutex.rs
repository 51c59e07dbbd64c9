//! The lock excludes, hands over, refuses to hang, and inherits priority.

use crate::common::{MS, become_fifo, burn, cpu};
use replenish_os::{PiMutex, clock};
use replenish_testkit::harness::{Trial, rt_trial, trial};
use replenish_testkit::watchdog::watchdog;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::time::Duration;

pub(crate) fn trials() -> Vec<Trial> {
    vec![
        trial("excludes_under_contention", excludes),
        trial("try_lock_never_waits", || {
            let mutex = PiMutex::new(1);
            let held = mutex.lock();
            assert!(mutex.try_lock().is_none());
            assert!(format!("{mutex:?}").contains("locked"));
            drop(held);
            assert_eq!(mutex.try_lock().map(|g| *g), Some(1));
            assert_eq!(mutex.into_inner(), 1);
        }),
        trial("a_limited_wait_ends_in_time_or_with_the_lock", || {
            let _dog = watchdog("a limited wait", Duration::from_secs(20));
            let mutex = Arc::new(PiMutex::new(1));
            let held = mutex.lock();
            let theirs = Arc::clone(&mutex);
            let (waited, has_waited) = mpsc::channel();
            let waiter = std::thread::spawn(move || {
                let limit = clock::monotonic() + 3_000_000;
                let none = theirs.lock_until(limit).is_none();
                let late = clock::monotonic() >= limit;
                waited.send(()).unwrap();
                let there = theirs.lock_until(clock::monotonic() + 20_000_000_000);
                (none, late, there.map(|g| *g))
            });
            has_waited.recv().unwrap();
            std::thread::sleep(Duration::from_millis(20));
            drop(held);
            assert_eq!(waiter.join().unwrap(), (true, true, Some(1)));
            assert!(mutex.try_lock().is_some(), "nothing is left behind");
        }),
        // A small kernel's lock is ours, and has no watchdog.
        #[cfg(not(nuttx_host))]
        rt_trial(
            "try_lock_takes_what_a_less_urgent_thread_was_handed_and_has_no_cpu_for",
            || std::thread::spawn(less_urgent).join().unwrap(),
        ),
        trial("a_panic_inside_unlocks_without_poison", || {
            let mutex = PiMutex::new(0);
            let unwound = catch_unwind(AssertUnwindSafe(|| {
                let mut held = mutex.lock();
                *held = 7;
                panic!("with the lock held");
            }));
            assert!(unwound.is_err());
            assert_eq!(*mutex.lock(), 7);
        }),
        trial("locking_twice_panics_instead_of_hanging", || {
            let _dog = watchdog("locking twice", Duration::from_secs(20));
            let mutex = PiMutex::new(());
            let _held = mutex.lock();
            assert!(catch_unwind(AssertUnwindSafe(|| drop(mutex.lock()))).is_err());
        }),
        trial(
            "a_guard_leaked_by_a_dead_thread_panics_instead_of_hanging",
            || {
                let _dog = watchdog("a dead owner", Duration::from_secs(20));
                let mutex = Arc::new(PiMutex::new(()));
                let theirs = Arc::clone(&mutex);
                std::thread::spawn(move || std::mem::forget(theirs.lock()))
                    .join()
                    .unwrap();
                assert!(catch_unwind(AssertUnwindSafe(|| drop(mutex.lock()))).is_err());
            },
        ),
        rt_trial("a_waiter_lends_its_priority_to_the_owner", || {
            let mutex = PiMutex::new(());
            assert!(high_overtakes_middle(move |f| {
                let _guard = mutex.lock();
                f();
            }));
        }),
        rt_trial("control_a_plain_mutex_inverts_priorities", || {
            let mutex = std::sync::Mutex::new(());
            assert!(!high_overtakes_middle(move |f| {
                let _guard = mutex.lock().unwrap();
                f();
            }));
        }),
    ]
}

fn excludes() {
    let _dog = watchdog("contended locking", Duration::from_secs(60));
    let mutex = Arc::new(PiMutex::new((0_u32, 0_u32)));
    let threads: Vec<_> = (0..4)
        .map(|_| {
            let mutex = Arc::clone(&mutex);
            std::thread::spawn(move || {
                for _ in 0..5_000 {
                    let mut pair = mutex.lock();
                    pair.0 += 1;
                    std::hint::black_box(&mut pair);
                    pair.1 += 1;
                    assert_eq!(pair.0, pair.1);
                }
            })
        })
        .collect();
    for thread in threads {
        thread.join().unwrap();
    }
    assert_eq!(*mutex.lock(), (20_000, 20_000));
}

/// Whether a middle thread that hogs the CPU for 40 ms was still at it when a high one got the
/// lock that a low one holds meanwhile. `lock` runs its argument with the lock held.
///
/// All three share a CPU and each wakes the next, so that every step preempts the one before:
/// low locks, middle starts, high wants the lock, and only then does it matter who runs.
fn high_overtakes_middle(lock: impl Fn(&dyn Fn()) + Send + Sync + 'static) -> bool {
    let _dog = watchdog("priority inversion", Duration::from_secs(20));
    let cpu = cpu();
    let lock = Arc::new(lock);
    let [hog_started, hog_ended] = [(); 2].map(|()| Arc::new(AtomicBool::new(false)));
    let (wake_high, high_woken) = mpsc::channel::<()>();
    let (wake_middle, middle_woken) = mpsc::channel::<()>();
    let (placed, both_placed) = mpsc::channel::<()>();

    let high = std::thread::spawn({
        let (lock, hog_ended) = (Arc::clone(&lock), Arc::clone(&hog_ended));
        let placed = placed.clone();
        move || {
            become_fifo(cpu, 80);
            placed.send(()).unwrap();
            high_woken.recv().unwrap();
            let overtook = AtomicBool::new(false);
            lock(&|| overtook.store(!hog_ended.load(Ordering::SeqCst), Ordering::SeqCst));
            overtook.into_inner()
        }
    });
    let middle = std::thread::spawn({
        let hog_started = Arc::clone(&hog_started);
        move || {
            become_fifo(cpu, 70);
            placed.send(()).unwrap();
            middle_woken.recv().unwrap();
            hog_started.store(true, Ordering::SeqCst);
            wake_high.send(()).unwrap();
            burn(40 * MS);
            hog_ended.store(true, Ordering::SeqCst);
        }
    });
    let low = std::thread::spawn(move || {
        become_fifo(cpu, 30);
        // The two above it on the same CPU go on to their channels before it runs again.
        both_placed.iter().take(2).for_each(drop);
        lock(&|| {
            wake_middle.send(()).unwrap();
            assert!(
                hog_started.load(Ordering::SeqCst),
                "middle did not preempt low"
            );
            burn(2 * MS);
        });
    });
    let overtook = high.join().unwrap();
    low.join().unwrap();
    middle.join().unwrap();
    overtook
}

/// A lock that two threads pass to each other has an owner at each moment, also while the owner has
/// no CPU. A torture found it (seed 68): the enforcer got its lock whenever it waited for it, and
/// the watchdog, which only tries, did not for 10 s.
#[cfg(not(nuttx_host))]
fn less_urgent() {
    let _dog = watchdog("a lock that was handed over", Duration::from_secs(20));
    let cpu = cpu();
    become_fifo(cpu, 80);
    let mutex = Arc::new(PiMutex::new(0));
    let held = mutex.lock();
    let theirs = Arc::clone(&mutex);
    let waiter = std::thread::spawn(move || {
        become_fifo(cpu, 30);
        *theirs.lock() += 1;
    });
    std::thread::sleep(Duration::from_millis(20)); // it waits by then
    drop(held); // it is the owner, and cannot run before this thread waits
    let mut seized = mutex.try_lock().expect("is less urgent");
    assert_eq!(*seized, 0);
    *seized += 1;
    assert!(mutex.try_lock().is_none(), "held");
    drop(seized);
    waiter.join().unwrap();
    assert_eq!(*mutex.lock(), 2);
    assert!(mutex.try_lock().is_some(), "nothing is left behind");
}
