//! Threads that have their name, CPU and policy *before* they run user code.
//!
//! ```text
//!   spawn:   create ──────────── wait ─────────────── set its CPU ─ go ──► return
//!              │                  ▲                          ▲       │
//!   thread:    └─► name, policy ──┴─ report ─── wait ────────┘       └──► user code ──► done
//! ```
//!
//! The creator sets the CPU while the new thread waits, for the sake of busy CPUs: a thread that
//! moved itself there first would still be in the time-sharing class, and a real-time thread of
//! any priority on that CPU could keep it from ever asking for its own. So `spawn` returns soon,
//! even if the new thread will not run for a while.
//!
//! The kernel gives the id of a thread that has ended to another one, perhaps of another program.
//! So the C library says whether a thread has ended: its handle stays valid until the join.
#![expect(unsafe_code, reason = "pthread_getschedparam")]

use super::affinity::{CpuSet, affinity, set_affinity};
use super::clock;
use super::sched::{SchedClass, set_priority, set_scheduler};
use super::sched_attr;
use super::spawn_error::SpawnError;
use super::tid::current_tid;
use crate::Nanos;
use crate::Policy;
use crate::ThreadSpec;
use crate::Tid;
use crate::notify::Notify;
use std::any::Any;
use std::io;
use std::mem::MaybeUninit;
use std::os::unix::thread::JoinHandleExt as _;
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;

/// A running thread. Dropping it lets the thread go on by itself.
#[derive(Debug)]
pub struct Thread<T> {
    tid: Tid,
    done: Arc<Notify>,
    handle: JoinHandle<Option<T>>,
}

impl<T> Thread<T> {
    /// Its kernel id. Not reused before the thread has ended.
    #[must_use]
    pub fn tid(&self) -> Tid {
        self.tid
    }

    /// Whether the thread's function has returned.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.handle.is_finished()
    }

    /// Waits for the thread to end.
    ///
    /// # Errors
    /// The payload of the panic that ended it.
    pub fn join(self) -> std::thread::Result<T> {
        let result = self.handle.join()?;
        // `None` comes only from a thread that could not set itself up; `spawn` joins it itself.
        result.ok_or_else(|| -> Box<dyn Any + Send> { Box::new("the thread never ran") })
    }

    /// Waits for the thread to end, but not longer than until `deadline` on the monotonic clock.
    ///
    /// # Errors
    /// The thread itself if it still runs then.
    pub fn join_until(self, deadline: Nanos) -> Result<std::thread::Result<T>, Self> {
        /// Between the signal and the end the thread runs only the standard library's epilogue, and
        /// what its thread locals do when they are dropped: `join` would wait for that as well.
        const POLL: Nanos = 50_000;
        if !self.done.wait_until(deadline) {
            return Err(self);
        }
        while !self.is_finished() || !self.has_ended() {
            let now = clock::monotonic();
            if now >= deadline {
                self.done.set(); // for a later join_until
                return Err(self);
            }
            clock::sleep_until(deadline.min(now + POLL));
        }
        Ok(self.join())
    }

    /// Puts the thread into the time-sharing class, unless it has ended.
    pub fn lower(&self) {
        if !self.has_ended() {
            set_priority(self.tid, SchedClass::Other).ok();
        }
    }

    /// Whether the kernel knows it no more: its id may be another thread's by now.
    fn has_ended(&self) -> bool {
        let (mut policy, mut param) = (0, MaybeUninit::uninit());
        // The standard library has an integer where libc may have a pointer (musl).
        let thread = self.handle.as_pthread_t() as libc::pthread_t;
        // SAFETY: the handle is neither joined nor detached; both pointers live across the call.
        let rc = unsafe { libc::pthread_getschedparam(thread, &mut policy, param.as_mut_ptr()) };
        rc == libc::ESRCH
    }
}

/// Starts a thread that runs `f` once it has all of `spec`, and returns when it has.
///
/// A thread that cannot get what was asked ends without running `f`.
///
/// # Errors
/// [`SpawnError`] says what was asked, what the kernel answered and what would grant it.
pub fn spawn<T, F>(spec: ThreadSpec, f: F) -> Result<Thread<T>, SpawnError>
where
    F: FnOnce() -> T + Send + 'static,
    T: Send + 'static,
{
    let ThreadSpec {
        name,
        policy,
        cpu,
        stack_size,
        reset_on_fork,
    } = spec;
    policy.validate()?;
    if let Policy::KernelSporadic(_) = policy {
        let source = io::ErrorKind::Unsupported.into();
        return Err(SpawnError::policy(policy, source));
    }
    if name.contains('\0') {
        return Err(SpawnError::Name);
    }
    if let (Policy::Deadline { .. }, Some(cpu)) = (policy, cpu) {
        return Err(SpawnError::PinnedDeadline { cpu });
    }
    let mut builder = std::thread::Builder::new().name(name);
    if let Some(bytes) = stack_size {
        builder = builder.stack_size(bytes);
    }
    let done = Arc::new(Notify::new());
    let at_end = SetOnDrop(Arc::clone(&done));
    let (report, outcome) = mpsc::sync_channel(1);
    let (go, wait_for_go) = mpsc::sync_channel::<()>(1);
    let handle = builder
        .spawn(move || {
            let at_end = at_end;
            let tid = current_tid();
            let applied = apply_policy(tid, policy, reset_on_fork);
            let applied = applied.map_err(|source| SpawnError::policy(policy, source));
            // The creator waits for the report; without a go it has given up.
            report.send(applied.map(|()| tid)).ok()?;
            wait_for_go.recv().ok()?;
            let result = f();
            drop(at_end);
            Some(result)
        })
        .map_err(SpawnError::Create)?;
    let ready = outcome.recv().unwrap_or_else(|_| {
        Err(SpawnError::Create(io::Error::other(
            "the new thread ended early",
        )))
    });
    let placed = ready.and_then(|tid| cpu.map_or(Ok(tid), |cpu| place(tid, cpu)));
    match placed {
        Ok(tid) if go.send(()).is_ok() => Ok(Thread { tid, done, handle }),
        Ok(_) => Err(SpawnError::Create(io::Error::other(
            "the new thread ended early",
        ))),
        Err(refused) => {
            drop(go);
            drop(handle.join()); // it has nothing more to say
            Err(refused)
        }
    }
}

/// Pins the waiting thread to its CPU.
fn place(tid: Tid, cpu: usize) -> Result<Tid, SpawnError> {
    let allowed = Box::new(affinity(tid).unwrap_or_default());
    set_affinity(tid, &CpuSet::one(cpu))
        .map(|()| tid)
        .map_err(|source| SpawnError::Cpu {
            cpu,
            allowed,
            source,
        })
}

fn apply_policy(tid: Tid, policy: Policy, reset_on_fork: bool) -> io::Result<()> {
    let mut attr = sched_attr::empty();
    if reset_on_fork {
        attr.sched_flags = flag(libc::SCHED_FLAG_RESET_ON_FORK);
    }
    attr.sched_policy = match policy {
        // The older call: it leaves the nice value alone.
        Policy::Other => return set_scheduler(tid, SchedClass::Other, reset_on_fork),
        Policy::Fifo { .. } | Policy::Sporadic(_) | Policy::KernelSporadic(_) => libc::SCHED_FIFO,
        Policy::RoundRobin { .. } => libc::SCHED_RR,
        Policy::Deadline { .. } => libc::SCHED_DEADLINE,
    }
    .cast_unsigned();
    attr.sched_priority = policy.priority().unwrap_or(0).into();
    if let Policy::Deadline {
        runtime,
        deadline,
        period,
        reclaim,
    } = policy
    {
        (attr.sched_runtime, attr.sched_deadline, attr.sched_period) = (runtime, deadline, period);
        if reclaim {
            attr.sched_flags |= flag(libc::SCHED_FLAG_RECLAIM);
        }
    }
    sched_attr::set(tid, &attr)
}

fn flag(flag: libc::c_int) -> u64 {
    flag.cast_unsigned().into()
}

/// Reports the end of the thread's function, also when it unwinds.
struct SetOnDrop(Arc<Notify>);

impl Drop for SetOnDrop {
    fn drop(&mut self) {
        self.0.set();
    }
}
