//! An enrolled thread: how it is raised and lowered, and what it has used at each level.

use super::thread::ForeignThread;
use super::usage::{BudgetId, Figures};
use crate::linux::affinity::{CpuSet, affinity, set_affinity};
use crate::linux::context_switches::{ContextSwitchLog, SwitchDirection};
use crate::linux::sched::{SchedClass, demote_to_tail, set_scheduler};
use crate::linux::sched_attr;
use crate::{Level, Nanos, Tid};
use std::io;

/// The two classes of a budget's threads.
#[derive(Clone, Copy, Debug)]
pub(super) struct Classes {
    pub(super) priority: u8,
    pub(super) background: SchedClass,
}

impl Classes {
    fn at(self, level: Level) -> SchedClass {
        match level {
            Level::High => SchedClass::Fifo(self.priority),
            Level::Low => self.background,
        }
    }
}

/// The largest delay of a running thread's CPU time: a timer tick (100 Hz), in nanoseconds.
const TICK: Nanos = 10_000_000;

/// One enrolled thread.
#[derive(Debug)]
pub(super) struct Member {
    pub(super) thread: ForeignThread,
    pub(super) log: Option<ContextSwitchLog>,
    pub(super) high: Nanos,
    pub(super) background: Nanos,
    /// CPU time at the high level by which threads take turns, never far behind the others.
    pub(super) served: Nanos,
    /// The thread has ended.
    pub(super) ended: bool,
    /// The thread waits for something, by its last record.
    pub(super) blocked: bool,
    /// The thread does not run, by its last record, or because it waited when it was enrolled.
    off_cpu: bool,
    /// CPU time when its record began.
    begin: Nanos,
    /// CPU time at the last reading.
    mark: Nanos,
    /// CPU time that may still be behind the wall clock.
    behind: Nanos,
}

impl Member {
    /// Set-up: allocates, and looks around in `/proc`.
    pub(super) fn new(thread: ForeignThread, log: Option<ContextSwitchLog>) -> Self {
        let begin = thread.cpu().unwrap_or(0);
        let mut member = Self {
            begin,
            mark: begin,
            behind: 0,
            thread,
            log,
            high: 0,
            background: 0,
            served: 0,
            ended: false,
            blocked: false,
            off_cpu: false,
        };
        // Records from here on change what is seen now.
        if let Some(log) = &mut member.log {
            log.drain(&mut |_| {});
        }
        member.blocked = member.thread.is_blocked();
        member.off_cpu = member.blocked;
        member
    }

    /// Whether nothing can have changed since the last reading: saves a system call.
    pub(super) fn has_not_run(&self) -> bool {
        self.off_cpu && self.log.as_ref().is_some_and(ContextSwitchLog::is_empty)
    }

    /// Its figures, a copy that takes no memory.
    pub(super) fn figures(&self, budget: BudgetId) -> Figures {
        Figures {
            name: self.thread.shared_name(),
            pid: self.thread.pid(),
            tid: self.thread.tid(),
            budget,
            high: self.high,
            background: self.background,
        }
    }

    /// CPU time since the last reading, `elapsed` ns ago.
    ///
    /// No more than the time that has passed, but for a tick. More is no CPU time of this thread: a
    /// thread that calls `exec` takes another one's number, and brings along the time that it had
    /// used before.
    pub(super) fn used(&mut self, elapsed: Nanos) -> Nanos {
        let most = self.behind.saturating_add(elapsed);
        let cpu = if self.has_not_run() {
            self.mark
        } else {
            self.thread.cpu().unwrap_or_else(|| {
                self.ended = true;
                let counted = self.log.as_ref().and_then(ContextSwitchLog::cpu);
                // Unknown, it may have had the CPU all the time.
                counted.map_or(self.mark + elapsed, |count| self.begin + count)
            })
        };
        let used = cpu.saturating_sub(self.mark).min(most);
        self.mark = self.mark.max(cpu);
        self.behind = (most - used).min(TICK);
        used
    }

    /// A record of it.
    pub(super) fn switched(&mut self, kind: SwitchDirection) {
        match kind {
            SwitchDirection::Out { preempted } => {
                self.off_cpu = true;
                self.blocked = !preempted;
            }
            SwitchDirection::In => {
                self.off_cpu = false;
                self.blocked = false;
            }
        }
    }

    /// Records of it are missing.
    pub(super) fn lost(&mut self) {
        self.off_cpu = false;
        self.blocked = false;
    }

    /// Whether it has ended, asked anew.
    pub(super) fn is_gone(&self, zombies: &[Tid]) -> bool {
        self.ended || zombies.contains(&self.thread.tid()) || self.thread.cpu().is_none()
    }

    pub(super) fn charge(&mut self, used: Nanos, level: Level) {
        match level {
            Level::High => {
                self.high += used;
                self.served += used;
            }
            Level::Low => self.background += used,
        }
    }

    /// Gives it the level. Threads that it starts begin in the time-sharing class, so that none
    /// runs at the priority without a budget.
    pub(super) fn give(&mut self, level: Level, classes: Classes) -> io::Result<()> {
        let tid = self.thread.tid();
        let given = match classes.at(level) {
            SchedClass::Fifo(low) if level == Level::Low => demote_to_tail(tid, low),
            class => set_scheduler(tid, class, true),
        };
        match given {
            Err(e) if e.raw_os_error() == Some(libc::ESRCH) => {
                self.ended = true;
                Ok(())
            }
            given => given,
        }
    }

    /// Whether it has other scheduling than it was given; then it gets that again.
    pub(super) fn is_displaced(&mut self, level: Level, classes: Classes, cpu: usize) -> bool {
        let tid = self.thread.tid();
        let place = CpuSet::one(cpu);
        let moved = affinity(tid).is_ok_and(|has| has != place);
        if moved {
            set_affinity(tid, &place).ok(); // tried again at the next look
        }
        let changed = sched_attr::get(tid).is_ok_and(|attr| {
            let (policy, priority) = number_of(classes.at(level));
            let reset = u64::from(libc::SCHED_FLAG_RESET_ON_FORK.cast_unsigned());
            i32::try_from(attr.sched_policy) != Ok(policy)
                || attr.sched_priority != priority
                || attr.sched_flags & reset == 0
        });
        if changed {
            // A demotion keeps the flag that it finds.
            let class = classes.at(level);
            set_scheduler(tid, class, true).ok();
        }
        moved || changed
    }
}

/// The kernel's numbers of a class.
fn number_of(class: SchedClass) -> (libc::c_int, u32) {
    match class {
        SchedClass::Other => (libc::SCHED_OTHER, 0),
        SchedClass::Idle => (libc::SCHED_IDLE, 0),
        SchedClass::Fifo(priority) => (libc::SCHED_FIFO, priority.into()),
        SchedClass::RoundRobin(priority) => (libc::SCHED_RR, priority.into()),
    }
}
