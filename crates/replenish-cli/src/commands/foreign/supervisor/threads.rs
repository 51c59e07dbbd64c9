//! Threads of a program: met, renamed, put under their budgets, and where they are stopped.

use super::state::{Known, Process, Supervisor};
use crate::commands::foreign::cgroup::Cgroup;
use crate::commands::foreign::give_back::settle;
use crate::outcome::Failure;
use crate::time::{Nanos, SEC};
use replenish_os::foreign::{ForeignThread, Original, name, tasks};
use replenish_os::{Tid, clock};

/// The names of old threads are asked at every so many looks.
const NAMES: u64 = 50;
/// A thread gets its name soon after its beginning.
const YOUNG: Nanos = SEC;

impl Supervisor {
    /// Looks at the threads of a process. `first` is what the first thread of its program had, for
    /// those that were born under budgets; `None` when the program is adopted, and then a refusal
    /// is an error.
    pub(super) fn look_at(
        &mut self,
        pid: Tid,
        root: Tid,
        first: Option<Original>,
    ) -> Result<(), Failure> {
        if !self.processes.contains_key(&pid) {
            let Ok(thread) = ForeignThread::open(pid) else {
                return Ok(()); // it has ended
            };
            let own = self.original(&thread, first.as_ref());
            self.guardian.process(pid, thread.start(), &own)?;
            self.confine(pid, root)?;
            self.processes.insert(pid, Process { root, first: own });
        }
        let now = clock::monotonic();
        for tid in tasks(pid).unwrap_or_default() {
            let Some(known) = self.threads.get_mut(&tid) else {
                self.meet(tid, first.as_ref(), now)?;
                continue;
            };
            known.seen = self.looks;
            let young = now.saturating_sub(known.since) < YOUNG;
            if (young || self.looks.is_multiple_of(NAMES))
                && let Some(name) = name(tid)
                && name != known.name
            {
                self.rename(tid, name)?;
            }
        }
        Ok(())
    }

    /// Moves a process to where its threads are stopped without budget.
    fn confine(&mut self, pid: Tid, root: Tid) -> Result<(), Failure> {
        let Some(cgroup) = &mut self.cgroup else {
            return Ok(());
        };
        let born_there = pid != root && cgroup.has(pid);
        let first = cgroup.homes.homes.get(&root).filter(|_| born_there);
        let home = match first.cloned() {
            Some(home) => home,
            None => Cgroup::home(pid)?,
        };
        self.guardian.home(pid, &home)?;
        cgroup.take(pid, home)
    }

    /// Puts the threads of a process where they are stopped again: the guardian has sent it back
    /// while this process stood still, or somebody has moved it.
    pub(super) fn confine_again(&self, pid: Tid) -> Result<(), Failure> {
        let Some(cgroup) = self.cgroup.as_ref().filter(|cgroup| !cgroup.has(pid)) else {
            return Ok(());
        };
        cgroup.enter(pid)?;
        for tid in tasks(pid).unwrap_or_default() {
            let rule = self.threads.get(&tid).and_then(|known| known.rule);
            cgroup.put(tid, rule.filter(|rule| self.budgets.suspends(*rule)))?;
        }
        Ok(())
    }

    /// A thread that was not there at the last look.
    fn meet(&mut self, tid: Tid, first: Option<&Original>, now: Nanos) -> Result<(), Failure> {
        let thread = match ForeignThread::open(tid) {
            Ok(thread) => thread,
            Err(e) if e.is_gone() => return Ok(()),
            Err(e) if first.is_none() => return Err(Failure::refused(e)),
            Err(e) => {
                self.figures.note(e.to_string());
                return Ok(());
            }
        };
        let original = self.original(&thread, first);
        let rule = self.budgets.rule(tid, thread.name());
        let known = Known {
            name: thread.name().to_string(),
            since: now,
            rule,
            original,
            seen: self.looks,
        };
        self.threads.insert(tid, known);
        match rule {
            Some(rule) => match self.enroll(rule, thread.with_original(original)) {
                Err(Failure::Refused(why)) if first.is_some() => {
                    self.figures.note(why);
                    Ok(())
                }
                enrolled => enrolled,
            },
            None => {
                if let Some(cgroup) = &self.cgroup {
                    cgroup.put(tid, None)?; // it may have been born where its creator is stopped
                }
                if let Some(first) = first {
                    settle(tid, self.cpu(), first);
                }
                self.guardian.leave_alone(tid, thread.start())
            }
        }
    }

    fn enroll(&mut self, rule: usize, thread: ForeignThread) -> Result<(), Failure> {
        let tid = thread.tid();
        self.guardian.hold(tid, thread.start(), thread.original())?;
        if let Some(cgroup) = &self.cgroup {
            cgroup.put(tid, Some(rule).filter(|rule| self.budgets.suspends(*rule)))?;
        }
        let enrolled = self.budgets.enroll(rule, thread);
        if !matches!(enrolled, Ok(true)) {
            self.guardian.forget(tid)?;
        }
        enrolled.map(|_| ())
    }

    /// A thread has another name: perhaps another rule is about it.
    fn rename(&mut self, tid: Tid, name: String) -> Result<(), Failure> {
        let rule = self.budgets.rule(tid, &name);
        let Some(known) = self.threads.get_mut(&tid) else {
            return Ok(());
        };
        known.name = name;
        let before = std::mem::replace(&mut known.rule, rule);
        let original = known.original;
        if before == rule {
            return Ok(());
        }
        if let Some(usage) = self.budgets.enforcer.release(tid) {
            self.guardian.forget(tid)?;
            self.figures.keep(usage, &self.budgets);
        }
        let Ok(thread) = ForeignThread::open(tid) else {
            return Ok(()); // it has ended
        };
        let Some(rule) = rule else {
            if let Some(cgroup) = &self.cgroup {
                cgroup.put(tid, None)?;
            }
            return self.guardian.leave_alone(tid, thread.start());
        };
        match self.enroll(rule, thread.with_original(original)) {
            Err(Failure::Refused(why)) => {
                self.figures.note(why);
                Ok(())
            }
            enrolled => enrolled,
        }
    }
}
