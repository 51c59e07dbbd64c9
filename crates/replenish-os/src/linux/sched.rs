//! Changing the scheduling class and priority of threads, with their place in the queue.
//!
//! Linux moves a thread whose priority changes like this (`__sched_setscheduler`): *raised*, it
//! goes to the tail of its new list; *lowered*, to the head; unchanged, it stays. POSIX wants a
//! thread whose budget is exhausted at the tail, hence [`demote_to_tail`].
#![expect(
    unsafe_code,
    reason = "sched_setparam, sched_setscheduler, sched_yield"
)]

use super::sched_attr;
use super::sys;
use super::tid::current_tid;
use crate::Tid;
use sporadic::Level;
use std::io;

/// A scheduling class with its priority, 1 (lowest) to 99.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum SchedClass {
    /// `SCHED_OTHER`: the fair class, nice 0.
    Other,
    /// `SCHED_FIFO` at this priority.
    Fifo(u8),
    /// `SCHED_RR` at this priority.
    RoundRobin(u8),
    /// `SCHED_IDLE`: when no other thread wants the CPU.
    Idle,
}

impl SchedClass {
    /// The class of a priority, 0 for the fair class.
    pub(crate) const fn of(priority: u8) -> Self {
        match priority {
            0 => Self::Other,
            priority => Self::Fifo(priority),
        }
    }
}

/// Puts thread `tid` into `class`. Its reset-on-fork flag stays as it is.
///
/// # Errors
/// `EINVAL` for a priority outside `1..=99`, `EPERM` without the privilege, `ESRCH` if the
/// thread has ended.
pub fn set_priority(tid: Tid, class: SchedClass) -> io::Result<()> {
    set_policy(tid, class, false)
}

/// The same; `resets`: the flag is set.
pub(crate) fn set_policy(tid: Tid, class: SchedClass, resets: bool) -> io::Result<()> {
    #[cfg(test)]
    if let Some(answer) = pretended::set(class) {
        return answer;
    }
    set_scheduler(tid, class, resets || reset_on_fork(tid)?)
}

/// Raises thread `tid` to FIFO priority `hi`, at the tail of that priority's list, as POSIX wants
/// it for a replenishment. One system call; the reset-on-fork flag is kept.
///
/// # Errors
/// As [`set_priority`].
pub fn promote(tid: Tid, hi: u8) -> io::Result<()> {
    #[cfg(test)]
    if let Some(answer) = pretended::set(SchedClass::Fifo(hi)) {
        return answer;
    }
    match set_param(tid, hi) {
        // The thread is not in a real-time class any more (its class was changed): set the class
        // too.
        Err(e) if e.raw_os_error() == Some(libc::EINVAL) => set_priority(tid, SchedClass::Fifo(hi)),
        done => done,
    }
}

/// Lowers FIFO thread `tid` to priority `lo` and puts it at the *tail* of that priority's list.
///
/// From above, that takes two steps: below `lo` and up again, because a lowered thread lands at
/// the head and a raised one at the tail (`lo` = 1 goes through `SCHED_OTHER`, where the kernel's
/// fair server may let the thread run before its caller goes on). Between the two steps the thread
/// can be preempted by everything at `lo`; a caller above it on the same CPU does not let that
/// happen. A thread that demotes *itself* is lowered once and
/// then yields, which has the same effect without the dip. The reset-on-fork flag is kept. `lo` = 0
/// is the time-sharing class, where there is no such order.
///
/// # Errors
/// As [`set_priority`]; if the second step fails, the thread is left below `lo`.
pub fn demote_to_tail(tid: Tid, lo: u8) -> io::Result<()> {
    #[cfg(test)]
    if let Some(answer) = pretended::set(SchedClass::Fifo(lo)) {
        return answer;
    }
    if lo == 0 {
        return set_priority(tid, SchedClass::Other);
    }
    if tid == current_tid() {
        promote(tid, lo)?;
        // SAFETY: sched_yield has no arguments and touches no memory.
        unsafe { libc::sched_yield() };
        return Ok(());
    }
    if lo > 1 {
        promote(tid, lo - 1)?;
        set_param(tid, lo)
    } else {
        let reset = reset_on_fork(tid)?;
        set_scheduler(tid, SchedClass::Other, reset)?;
        set_scheduler(tid, SchedClass::Fifo(lo), reset)
    }
}

/// The priority of FIFO thread `tid` without inheritance, 0 in the time-sharing class; `None` in
/// any other class.
///
/// # Errors
/// `ESRCH` if the thread has ended.
pub(crate) fn base_priority(tid: Tid) -> io::Result<Option<u8>> {
    base_policy(tid).map(|(priority, _)| priority)
}

/// The same, and whether the thread has the reset-on-fork flag.
///
/// # Errors
/// `ESRCH` if the thread has ended.
pub(crate) fn base_policy(tid: Tid) -> io::Result<(Option<u8>, bool)> {
    #[cfg(test)]
    if let Some(priority) = pretended::priority() {
        return Ok((Some(priority), true));
    }
    let attr = sched_attr::get(tid)?;
    let class = i32::try_from(attr.sched_policy).unwrap_or(-1);
    let priority = match class {
        libc::SCHED_FIFO => u8::try_from(attr.sched_priority).ok(),
        libc::SCHED_OTHER => Some(0),
        _ => None,
    };
    Ok((priority, attr.sched_flags & RESET_ON_FORK != 0))
}

/// `SCHED_FLAG_RESET_ON_FORK` of `sched_setattr(2)`.
const RESET_ON_FORK: u64 = 1;

/// Whether a thread whose change of priority was refused has the wanted level all the same, `high`
/// being the priority of the high one. One that was lowered in two steps may be below its low
/// priority. One that has ended has any.
pub(crate) fn has_level(tid: Tid, high: u8, level: Level) -> bool {
    real_time_priority(tid).map_or(true, |has| (has >= high.into()) == (level == Level::High))
}

/// The priority of a thread of any class, without inheritance: 0 in those that are not real-time,
/// and above all others with a reservation of the kernel's.
///
/// # Errors
/// `ESRCH` if the thread has ended.
pub(crate) fn real_time_priority(tid: Tid) -> io::Result<u32> {
    #[cfg(test)]
    if let Some(priority) = pretended::priority() {
        return Ok(priority.into());
    }
    let attr = sched_attr::get(tid)?;
    Ok(match i32::try_from(attr.sched_policy).unwrap_or(-1) {
        libc::SCHED_FIFO | libc::SCHED_RR => attr.sched_priority,
        libc::SCHED_DEADLINE => u32::MAX,
        _ => 0,
    })
}

/// Whether the thread has the reset-on-fork flag.
/// `ESRCH` if the thread has ended.
pub(super) fn reset_on_fork(tid: Tid) -> io::Result<bool> {
    // Raw system calls throughout this file: musl's wrappers return ENOSYS.
    // SAFETY: no memory is passed.
    let policy = sys::check(unsafe { libc::syscall(libc::SYS_sched_getscheduler, tid.get()) })?;
    Ok(policy & libc::c_long::from(libc::SCHED_RESET_ON_FORK) != 0)
}

/// Sets class, priority and the reset-on-fork flag; keeps the nice value.
pub(super) fn set_scheduler(tid: Tid, class: SchedClass, reset_on_fork: bool) -> io::Result<()> {
    let (policy, priority) = match class {
        SchedClass::Other => (libc::SCHED_OTHER, 0),
        SchedClass::Fifo(p) => (libc::SCHED_FIFO, p),
        SchedClass::RoundRobin(p) => (libc::SCHED_RR, p),
        SchedClass::Idle => (libc::SCHED_IDLE, 0),
    };
    let flags = if reset_on_fork {
        libc::SCHED_RESET_ON_FORK
    } else {
        0
    };
    let param = param(priority);
    let param = &raw const param;
    // SAFETY: `param` points to a sched_param that lives across the call.
    let rc = unsafe {
        libc::syscall(
            libc::SYS_sched_setscheduler,
            tid.get(),
            policy | flags,
            param,
        )
    };
    sys::check(rc).map(drop)
}

/// Changes the priority within the class; the kernel keeps the policy and the reset flag.
fn set_param(tid: Tid, priority: u8) -> io::Result<()> {
    let param = param(priority);
    let param = &raw const param;
    // SAFETY: `param` points to a sched_param that lives across the call.
    let rc = unsafe { libc::syscall(libc::SYS_sched_setparam, tid.get(), param) };
    sys::check(rc).map(drop)
}

/// The kernel's `struct sched_param` (musl's has more fields; the first is the same).
#[repr(C)]
struct SchedParam {
    priority: libc::c_int,
}

fn param(priority: u8) -> SchedParam {
    SchedParam {
        priority: priority.into(),
    }
}

/// A kernel of one thread, for tests in virtual time: it grants or refuses every change.
#[cfg(test)]
pub(crate) mod pretended {
    use super::SchedClass;
    use std::cell::Cell;
    use std::io;

    /// The thread as this kernel has it.
    #[derive(Clone, Copy, Debug)]
    pub(crate) struct Pretended {
        /// Its FIFO priority, 0 in the time-sharing class.
        pub(crate) priority: u8,
        /// Whether the next change is refused.
        pub(crate) refuses: bool,
    }

    thread_local! {
        static THREAD: Cell<Option<Pretended>> = const { Cell::new(None) };
        static AMID: Cell<Option<u8>> = const { Cell::new(None) };
    }

    /// The next question is answered with this priority: it comes amid a change.
    pub(crate) fn is_amid_a_change(priority: u8) {
        AMID.set(Some(priority));
    }

    /// The priority, if a thread is pretended.
    pub(super) fn priority() -> Option<u8> {
        let thread = THREAD.get()?;
        Some(AMID.take().unwrap_or(thread.priority))
    }

    /// From now on the calling thread's changes of any priority go to this thread.
    pub(crate) fn begin(thread: Pretended) {
        THREAD.set(Some(thread));
    }

    pub(crate) fn get() -> Option<Pretended> {
        THREAD.get()
    }

    /// `None` where the real kernel is asked.
    pub(super) fn set(class: SchedClass) -> Option<io::Result<()>> {
        let thread = THREAD.get()?;
        if thread.refuses {
            return Some(Err(io::Error::from_raw_os_error(libc::EPERM)));
        }
        let priority = match class {
            SchedClass::Fifo(priority) => priority,
            _ => 0,
        };
        THREAD.set(Some(Pretended { priority, ..thread }));
        Some(Ok(()))
    }
}
