//! Looks for the threads of programs, gives them their budgets, and takes the budgets away again.
//!
//! ```text
//!   adopt(pid) ─► look(), every 20 ms ─► … ─► finish(): everybody has what he had
//!                  │ a new thread: what it had to the guardian, then its budget
//!                  │ a new name: another budget, if another rule fits
//!                  │ an end: its figures are kept by name
//!                  └ another policy or CPU: changed back
//! ```

use super::admission::admit;
use super::budgets::Budgets;
use super::cgroup::Cgroup;
use super::control::{Control, Program};
use super::figures::Figures;
use super::give_back::settle;
use super::guardian::Guardian;
use super::report::Report;
use super::rules::{Background, Terms};
use super::selection::Selection;
use crate::outcome::Failure;
use crate::time::{Nanos, SEC};
use replenish_os::foreign::{ForeignThread, Original, ThreadUsage, family, name, start_of, tasks};
use replenish_os::{SchedClass, Tid, clock, privilege};
use replenish_plan::ledger::Reservation;
use std::collections::BTreeMap;
use std::time::Duration;

/// Between two looks.
pub(crate) const PAUSE: Duration = Duration::from_millis(20);
/// Every so many looks processes are looked for, and the names of old threads.
const FAMILY: u64 = 5;
const NAMES: u64 = 50;
/// A thread gets its name soon after its beginning.
const YOUNG: Nanos = SEC;

/// Budgets, and the programs that have them.
#[derive(Debug)]
pub(crate) struct Supervisor {
    budgets: Budgets,
    guardian: Guardian,
    /// Where threads are stopped, if any are to be.
    cgroup: Option<Cgroup>,
    control: Control,
    figures: Figures,
    roots: BTreeMap<Tid, Root>,
    processes: BTreeMap<Tid, Process>,
    threads: BTreeMap<Tid, Known>,
    looks: u64,
    /// Given back last, when the threads have what they had.
    _reservation: Option<Reservation>,
}

#[derive(Debug)]
struct Root {
    start: u64,
    name: String,
}

#[derive(Debug)]
struct Process {
    root: Tid,
    /// The original policy and CPUs of the process's first thread.
    first: Original,
}

#[derive(Debug)]
struct Known {
    name: String,
    since: Nanos,
    rule: Option<usize>,
    original: Original,
    seen: u64,
}

impl Supervisor {
    /// Admits the budgets; starts the enforcer and the guardian.
    pub(crate) fn start(selection: &Selection, usual: Background) -> Result<Self, Failure> {
        let admission = admit(selection, usual)?;
        let idle = |terms: &Terms| terms.background.class() == SchedClass::Idle;
        let suspend = |terms: &Terms| terms.background == Background::Suspend;
        let suspended = admission.terms.iter().any(suspend);
        if admission.terms.iter().any(idle) && !privilege::probe().cap_sys_nice {
            return Err(Failure::refused(
                "a thread comes back from `--background idle` only by CAP_SYS_NICE, which this \
                 process has not: give --background other, or the capability (replenish doctor)",
            ));
        }
        let mut figures = Figures::start();
        admission
            .notes
            .into_iter()
            .for_each(|why| figures.note(why));
        let mut guardian = Guardian::start(admission.cpu)?;
        let cgroup = suspended.then(Cgroup::create).transpose()?;
        let budgets = Budgets::start(admission.terms, admission.cpu)?;
        if let Some(cgroup) = &cgroup {
            guardian.cgroup(&cgroup.homes.base)?;
            budgets.suspend_in(cgroup)?;
        }
        Ok(Self {
            budgets,
            guardian,
            cgroup,
            _reservation: admission.reservation,
            control: Control::start()?,
            figures,
            roots: BTreeMap::new(),
            processes: BTreeMap::new(),
            threads: BTreeMap::new(),
            looks: 0,
        })
    }

    /// The CPU of all budgets.
    pub(crate) fn cpu(&self) -> usize {
        self.budgets.enforcer.cpu()
    }

    /// The guardian's process.
    pub(crate) fn guardian(&self) -> u32 {
        self.guardian.pid()
    }

    /// Takes a process with all that it has started, and has them looked at.
    pub(crate) fn adopt(&mut self, pid: Tid) -> Result<(), Failure> {
        let refused = |e| Failure::refused(format!("process {pid} gets no budget: {e}"));
        let first = ForeignThread::open(pid).map_err(refused)?;
        if first.pid() != pid {
            return Err(Failure::refused(format!(
                "{pid} is a thread of process {}: adopt that, with --thread 'tid:{pid}=…'",
                first.pid()
            )));
        }
        let root = Root {
            start: first.start(),
            name: first.name().to_string(),
        };
        self.roots.insert(pid, root);
        for process in family(pid) {
            let found = self.look_at(process, pid, None);
            if let Err(why) = found {
                self.release(pid)?;
                return Err(why);
            }
        }
        self.tell();
        Ok(())
    }

    /// Looks after everything once; whether there is anything left to look after.
    pub(crate) fn look(&mut self) -> Result<bool, Failure> {
        self.looks += 1;
        self.guardian.beat()?;
        for pid in self.control.releases() {
            self.release(pid)?;
        }
        let found = self.budgets.enforcer.inspect();
        self.figures.displaced += found.displaced;
        for usage in found.ended {
            self.guardian.forget(usage.tid)?;
            self.figures.keep(usage, &self.budgets);
        }
        if self.looks.is_multiple_of(FAMILY) {
            self.look_for_processes()?;
        }
        let known: Vec<_> = self
            .processes
            .iter()
            .map(|(p, of)| (*p, of.root, of.first))
            .collect();
        for (pid, root, first) in known {
            self.look_at(pid, root, Some(first))?;
        }
        let gone = self
            .threads
            .iter()
            .filter(|(_, known)| known.seen != self.looks);
        let gone: Vec<Tid> = gone.map(|(tid, _)| *tid).collect();
        for tid in gone {
            if self
                .threads
                .remove(&tid)
                .is_some_and(|known| known.rule.is_none())
            {
                self.guardian.forget(tid)?;
            }
        }
        if self.looks.is_multiple_of(FAMILY) {
            self.tell();
        }
        Ok(!self.roots.is_empty())
    }

    fn look_for_processes(&mut self) -> Result<(), Failure> {
        let gone = |pid: Tid, root: &Root| match start_of(pid) {
            Some(start) => start != root.start,
            None => tasks(pid).map_or(0, |tasks| tasks.len()) <= 1,
        };
        let ended: Vec<Tid> = self
            .roots
            .iter()
            .filter(|(pid, root)| gone(**pid, root))
            .map(|(pid, _)| *pid)
            .collect();
        for pid in ended {
            self.release(pid)?;
        }
        let roots: Vec<Tid> = self.roots.keys().copied().collect();
        for root in roots {
            let first = self.processes.get(&root).map(|process| process.first);
            for pid in family(root) {
                if !self.processes.contains_key(&pid) {
                    self.look_at(pid, root, first)?;
                }
            }
        }
        let left: Vec<Tid> = self.processes.keys().copied().collect();
        for pid in left {
            self.confine_again(pid)?;
            if tasks(pid).is_err() {
                self.processes.remove(&pid);
                self.guardian.leave(pid)?;
            }
        }
        Ok(())
    }

    /// Looks at the threads of a process. `first` is what the first thread of its program had, for
    /// those that were born under budgets; `None` when the program is adopted, and then a refusal
    /// is an error.
    fn look_at(&mut self, pid: Tid, root: Tid, first: Option<Original>) -> Result<(), Failure> {
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
    fn confine_again(&self, pid: Tid) -> Result<(), Failure> {
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

    fn original(&self, thread: &ForeignThread, first: Option<&Original>) -> Original {
        let has = *thread.original();
        first.map_or(has, |first| has.without_inheritance(self.cpu(), first))
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

    /// Gives a program back what its threads had.
    fn release(&mut self, root: Tid) -> Result<(), Failure> {
        self.roots.remove(&root);
        let of = |process: &Process| process.root == root;
        let processes = self.processes.iter().filter(|(_, process)| of(process));
        let processes: Vec<_> = processes
            .map(|(pid, process)| (*pid, process.first))
            .collect();
        for usage in self.budgets.enforcer.threads() {
            if processes.iter().any(|(pid, _)| *pid == usage.pid)
                && let Some(usage) = self.budgets.enforcer.release(usage.tid)
            {
                self.guardian.forget(usage.tid)?;
                self.figures.keep(usage, &self.budgets);
            }
        }
        for (pid, first) in processes {
            if let Some(cgroup) = &mut self.cgroup {
                cgroup.leave(pid);
            }
            for tid in tasks(pid).unwrap_or_default() {
                match self.threads.remove(&tid) {
                    Some(_) => self.guardian.forget(tid)?,
                    None => settle(tid, self.cpu(), &first),
                }
            }
            self.processes.remove(&pid);
            self.guardian.leave(pid)?;
        }
        self.tell();
        Ok(())
    }

    /// Answers the next `--list`.
    fn tell(&self) {
        let threads = self.budgets.enforcer.threads();
        let budgets = self.budgets.to_string();
        let program = |(pid, root): (&Tid, &Root)| {
            let of = |thread: &&ThreadUsage| {
                let process = self.processes.get(&thread.pid);
                process.is_some_and(|process| process.root == *pid)
            };
            Program {
                supervisor: std::process::id(),
                pid: pid.get(),
                name: root.name.clone(),
                threads: threads.iter().filter(of).count() as u64,
                budgets: budgets.clone(),
            }
        };
        self.control.tell(self.roots.iter().map(program).collect());
    }

    /// The figures up to now.
    pub(crate) fn report(&self) -> Report {
        let name = |tid| {
            let known = self.threads.get(&Tid::new(tid)?)?;
            Some(known.name.as_str())
        };
        self.figures
            .report(&self.budgets, self.guardian.replaced, name)
    }

    /// Gives every thread back what it had; the figures.
    pub(crate) fn finish(mut self) -> Result<Report, Failure> {
        let report = self.report();
        let roots: Vec<Tid> = self.roots.keys().copied().collect();
        for root in roots {
            self.release(root)?;
        }
        self.budgets.enforcer.release_all();
        drop(self.cgroup.take());
        self.guardian.dismiss();
        Ok(report)
    }
}
