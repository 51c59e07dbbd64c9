//! The thread that looks after every enforcer of this process: the supervision of the supervisors.
//!
//! ```text
//!   watch(look) ──► looks ◄── Watch dropped          the last one: the thread ends
//!                     │ every 10 to 100 ms, as the looks ask for
//!   watchdog ─────────┴─► look(), look(), …          SCHED_DEADLINE, otherwise FIFO 99
//! ```
//!
//! It runs under `SCHED_DEADLINE` where the kernel allows that: then no thread of any FIFO priority
//! keeps it waiting, on whichever CPU it is. Its reservation is 0.5 ms in 10 ms; a look takes some
//! 20 µs.
//!
//! A second thread, which starts with it, tells the user: no thread can start in the middle of
//! `setuid`, and there is much to tell then.

use super::clock;
use super::sched_attr;
use super::spawn_error::SpawnError;
use super::thread::{Thread, spawn};
use super::tid::current_tid;
use crate::notify::Notify;
use crate::pi_mutex::PiMutex;
use crate::{MAX_PRIORITY, Nanos, Policy, ThreadSpec};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

/// The shortest time between two looks, in nanoseconds.
pub(crate) const SHORTEST: Nanos = 10_000_000;
/// The longest time between two looks, in nanoseconds.
pub(crate) const LONGEST: Nanos = 100_000_000;

const RUNTIME: Nanos = 500_000;
const STACK: usize = 128 * 1024;
/// Stack of the thread that runs the user's hooks, in bytes.
const TELLER_STACK: usize = 256 * 1024;
/// The most calls of hooks that wait. Further calls are dropped; the counters still have them.
const WAITING: usize = 64;

/// Looks once, and says after how long to look again.
type Look = dyn Fn() -> Nanos + Send + Sync;

struct Watchdog {
    looks: Vec<(u64, Arc<Look>)>,
    given: u64,
    thread: Option<Thread<()>>,
}

static WATCHDOG: PiMutex<Watchdog> = PiMutex::new(Watchdog {
    looks: Vec::new(),
    given: 0,
    thread: None,
});

/// A call of the user's hook.
type Call = Box<dyn FnOnce() + Send>;

/// The way to the thread that calls; it ends with the watchdog.
static CALLS: Mutex<Option<SyncSender<Call>>> = Mutex::new(None);

static BELL: LazyLock<Notify> = LazyLock::new(Notify::new);

/// A place among the looks; given up when it is dropped. No look of it runs after that.
#[derive(Debug)]
pub(crate) struct Watch(u64);

/// Has `look` called from now on. Set-up only.
///
/// # Errors
/// [`SpawnError`] where the watchdog's thread cannot be started with real-time priority.
pub(crate) fn watch(look: Arc<Look>) -> Result<Watch, SpawnError> {
    let mut watchdog = WATCHDOG.lock();
    if watchdog.thread.is_none() {
        let priority = MAX_PRIORITY;
        let spec = ThreadSpec::new("watchdog").policy(Policy::Fifo { priority }); // `spawn` checks
        watchdog.thread = Some(spawn(spec.stack_size(STACK), run)?);
        start_teller();
    }
    watchdog.given += 1;
    let id = watchdog.given;
    watchdog.looks.push((id, look));
    drop(watchdog);
    BELL.set();
    Ok(Watch(id))
}

/// Ends the pause before the next look.
pub(crate) fn look_soon() {
    BELL.set();
}

/// Calls the hook on a thread without real-time priority, soon.
pub(crate) fn call(call: impl FnOnce() + Send + 'static) {
    let calls = CALLS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(calls) = &*calls {
        calls.try_send(Box::new(call)).ok();
    }
}

/// Starts the thread that calls hooks. Without it no hook hears of a fault; the counters still do.
fn start_teller() {
    let (calls, waiting) = sync_channel::<Call>(WAITING);
    let tell = move || {
        for call in waiting {
            catch_unwind(AssertUnwindSafe(call)).ok(); // the hook's own, and told by its message
        }
    };
    let spec = ThreadSpec::new("faults").stack_size(TELLER_STACK);
    if spawn(spec, tell).is_ok() {
        *CALLS.lock().unwrap_or_else(PoisonError::into_inner) = Some(calls);
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        let mut watchdog = WATCHDOG.lock();
        watchdog.looks.retain(|(id, _)| *id != self.0);
        drop(watchdog);
        BELL.set();
    }
}

fn run() {
    let mut attr = sched_attr::empty();
    attr.sched_policy = libc::SCHED_DEADLINE.cast_unsigned();
    attr.sched_flags = libc::SCHED_FLAG_RESET_ON_FORK.cast_unsigned().into();
    (attr.sched_runtime, attr.sched_deadline, attr.sched_period) = (RUNTIME, SHORTEST, SHORTEST);
    // Refused to a thread that is pinned, for instance: it keeps its FIFO priority.
    sched_attr::set(current_tid(), &attr).ok();
    loop {
        let mut pause = LONGEST;
        {
            let mut watchdog = WATCHDOG.lock();
            if watchdog.looks.is_empty() {
                watchdog.thread = None;
                // The teller makes the calls that it has, and ends.
                *CALLS.lock().unwrap_or_else(PoisonError::into_inner) = None;
                return;
            }
            for (_, look) in &watchdog.looks {
                pause = pause.min(look());
            }
        }
        BELL.wait_until(clock::monotonic().saturating_add(pause.max(SHORTEST)));
    }
}
