//! Looks for the threads of programs, gives them their budgets, and takes the budgets away again.
//!
//! ```text
//!   adopt(pid) ─► look(), every 20 ms ─► … ─► finish(): everybody has what he had
//!                  │ a new thread: what it had to the guardian, then its budget
//!                  │ a new name: another budget, if another rule fits
//!                  │ an end: its figures are kept by name
//!                  └ another policy or CPU: changed back
//! ```

use super::budgets::Budgets;
use super::control::{Control, Program};
use super::figures::Figures;
use super::give_back::settle;
use super::guardian::Guardian;
use super::options::Options;
use super::report::Report;
use crate::outcome::Failure;
use crate::time::{Nanos, SEC};
use replenish_os::foreign::{ForeignThread, Original, ThreadUsage, family, name, start_of, tasks};
use replenish_os::{SchedClass, Tid, affinity, clock, current_tid, privilege};
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
    control: Control,
    figures: Figures,
    roots: BTreeMap<Tid, Root>,
    processes: BTreeMap<Tid, Process>,
    threads: BTreeMap<Tid, Known>,
    looks: u64,
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
    /// Starts the enforcer and the guardian.
    pub(crate) fn start(options: &Options) -> Result<Self, Failure> {
        let rules = options.rules()?;
        if options.background.0 == SchedClass::Idle && !privilege::probe().cap_sys_nice {
            return Err(Failure::refused(
                "a thread comes back from `--background idle` only by CAP_SYS_NICE, which this \
                 process has not: give --background other, or the capability (replenish doctor)",
            ));
        }
        let allowed = affinity(current_tid()).map_err(Failure::refused)?;
        let cpu = options.cpu.or_else(|| allowed.iter().last()).unwrap_or(0);
        Ok(Self {
            budgets: Budgets::start(options, rules, cpu)?,
            guardian: Guardian::start(cpu)?,
            control: Control::start()?,
            figures: Figures::start(),
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
        self.guardian.dismiss();
        Ok(report)
    }
}
