//! A change of the process's user while budgets are enforced.
//!
//! ```text
//!   caller:  setuid ── signals every thread ─────────── waits for all ──────────► returns
//!   helper:            for each that does not get the CPU: FIFO 98 ─ its own again
//! ```
//!
//! Without help `setuid` waits for a thread that is low beside others that always want the CPU.
//! Only the thread's enforcer would raise it, and that has another user by then and may not.

use super::enforced_thread::EnforcedThread;
use super::state::EnforcerState;
use crate::backend::change_of_user::{self, PolicyBefore};
use crate::backend::clock;
use crate::backend::sched::{SchedClass, set_priority};
use crate::backend::thread::spawn;
use crate::backend::tid::current_tid;
use crate::{Arc, Level, Low, MAX_PRIORITY, Nanos, Policy, ThreadSpec, Tid};
use core::sync::atomic::{AtomicBool, Ordering};
use sporadic::BudgetServer;
use std::sync::{Mutex, PoisonError, Weak};

/// Time between two looks at the threads, in nanoseconds.
const PAUSE: Nanos = 1_000_000;
/// The longest time that a thread has the highest priority, in nanoseconds.
const LONGEST: Nanos = 2_000_000;

/// The enforcers of this process.
static ENFORCERS: Mutex<Vec<Weak<EnforcerState>>> = Mutex::new(Vec::new());

/// Notes an enforcer that started. Set-up only.
pub(super) fn note(state: &Arc<EnforcerState>) {
    let mut all = ENFORCERS.lock().unwrap_or_else(PoisonError::into_inner);
    all.retain(|known| known.strong_count() > 0);
    all.push(Arc::downgrade(state));
}

/// Runs `change`, in which the program gives up its user or its groups (`setuid`, `setgid`,
/// `setgroups`), while executors run: the C library makes such a call in every thread, and waits
/// for all of them.
///
/// Each thread gets the CPU for its part, within some milliseconds, at FIFO 98 and for 2 ms at
/// most, whatever its budget says; the calling thread has FIFO 99 for the whole of `change`.
/// Budgets are held meanwhile. The hard limit `RLIMIT_RTPRIO` becomes 99 before, where the program
/// may set it (`CAP_SYS_RESOURCE`): with less its enforcers can raise no worker afterwards. Make
/// all such calls in one `change`. Without real-time priority this is the call of `change` alone.
pub fn change_user<T>(change: impl FnOnce() -> T) -> T {
    change_of_user::keep_limit();
    urgently(|| {
        let over = Over(Arc::new(AtomicBool::new(false)));
        let theirs = Arc::clone(&over.0);
        let priority = MAX_PRIORITY;
        let spec = ThreadSpec::new("change-user").policy(Policy::Fifo { priority }); // `spawn` checks
        let helper = spawn(spec, move || help(&theirs));
        let result = change();
        drop(over);
        if let Ok(helper) = helper {
            helper.join().ok(); // nothing in it panics
        }
        result
    })
}

/// Runs `change` on the calling thread, at FIFO 99; the thread waits for the others. A thread that
/// it starts begins with that priority, so it gets to its first instruction.
fn urgently<T>(change: impl FnOnce() -> T) -> T {
    let me = current_tid();
    let before = PolicyBefore::of(me);
    let raised = before.filter(|_| set_priority(me, SchedClass::Fifo(MAX_PRIORITY)).is_ok());
    let _raised = raised.map(|before| Raised(me, before));
    change()
}

/// Gives a thread back what it had, also when the change panics.
struct Raised(Tid, PolicyBefore);

impl Drop for Raised {
    fn drop(&mut self) {
        self.1.restore(self.0).ok(); // nobody is refused to lower itself
    }
}

/// Ends the helper, also when the change panics.
struct Over(Arc<AtomicBool>);

impl Drop for Over {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

fn help(over: &AtomicBool) {
    change_of_user::keep_right();
    let me = current_tid();
    while !over.load(Ordering::Acquire) {
        let pending = |tid: &Tid| *tid != me && change_of_user::is_pending(*tid);
        for tid in change_of_user::threads().filter(pending) {
            lift(tid);
        }
        clock::sleep_until(clock::monotonic().saturating_add(PAUSE));
    }
}

/// Gives the thread the CPU until it has changed.
fn lift(tid: Tid) {
    let enforcers = {
        let all = ENFORCERS.lock().unwrap_or_else(PoisonError::into_inner);
        all.iter().filter_map(Weak::upgrade).collect::<Vec<_>>()
    };
    let enforcer = enforcers.iter().find(|state| state.lend(tid));
    let before = PolicyBefore::of(tid);
    if enforcer.is_none() && before.is_none() {
        return;
    }
    // Below the enforcer and the helper: it may want the CPU for longer.
    if change_of_user::give(tid, SchedClass::Fifo(MAX_PRIORITY - 1)).is_ok() {
        let end = clock::monotonic().saturating_add(LONGEST);
        while change_of_user::is_pending(tid) && clock::monotonic() < end {
            clock::sleep_until(clock::monotonic().saturating_add(PAUSE / 20));
        }
    }
    match (enforcer, before) {
        (Some(state), _) => state.take_back(tid),
        (None, Some(before)) => before.restore(tid).unwrap_or_default(), // it has ended
        (None, None) => {}
    }
}

impl EnforcerState {
    /// Keeps the watchdog away from this worker's priority for now. Whether it is one of this
    /// enforcer's.
    fn lend(&self, tid: Tid) -> bool {
        let mut threads = self.threads.lock();
        let found = enrolled(&mut threads.enrolled, tid);
        if let Some(thread) = found {
            thread.supervised.give(None);
            return true;
        }
        false
    }

    /// The worker gets the priority of its level, unless the enforcer has given it one meanwhile.
    fn take_back(&self, tid: Tid) {
        let mut threads = self.threads.lock();
        let Some(thread) = enrolled(&mut threads.enrolled, tid) else {
            return;
        };
        if thread.supervised.view.given().is_some() {
            return;
        }
        let params = thread.reservation.server().params();
        let priority = match (thread.reservation.level(), params.low()) {
            (Level::High, _) => params.priority(),
            (Level::Low, Low::Background(low)) => low,
            (Level::Low, Low::Suspend) => 0,
        };
        let class = match priority {
            0 => SchedClass::Other,
            priority => SchedClass::Fifo(priority),
        };
        if change_of_user::give(tid, class).is_ok() {
            thread.supervised.give(Some(priority));
        }
    }
}

fn enrolled(threads: &mut [EnforcedThread], tid: Tid) -> Option<&mut EnforcedThread> {
    threads
        .iter_mut()
        .find(|thread| thread.live && thread.tid == tid)
}
