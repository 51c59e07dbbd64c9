//! Looks for the threads of programs, gives them their budgets, and takes the budgets away again.
//!
//! ```text
//!   adopt(pid) ─► look(), every 20 ms ─► … ─► finish(): everybody has what he had
//!                  │ a new thread: what it had to the guardian, then its budget
//!                  │ a new name: another budget, if another rule fits
//!                  │ an end: its figures are kept by name
//!                  └ another policy or CPU: changed back
//! ```

use super::control::{Control, Program};
use super::give_back::settle;
use super::guardian::Guardian;
use super::options::Options;
use super::report::{Report, Share, ThreadRow};
use super::rules::{Background, Rule};
use crate::outcome::Failure;
use crate::time::{MS, Nanos, SEC};
use replenish_os::foreign::{
    BudgetId, Enforcer, ForeignThread, Original, ThreadUsage, family, name, start_of, tasks,
};
use replenish_os::{EnforcerConfig, SchedClass, SpawnError, Tid};
use replenish_os::{affinity, clock, current_tid, privilege};
use sporadic::Budget;
use std::collections::BTreeMap;
use std::time::Duration;

/// Between two looks.
pub(crate) const PAUSE: Duration = Duration::from_millis(20);
/// Every so many looks processes are looked for, and the names of old threads.
const FAMILY: u64 = 5;
const NAMES: u64 = 50;
/// A thread gets its name soon after its beginning.
const YOUNG: Nanos = SEC;
/// Names of threads that have ended; more share one row.
const MOST_NAMES: usize = 256;
/// Notes that are kept.
const MOST_NOTES: usize = 16;
/// Threads that share one budget at most.
const CAPACITY: usize = 512;
/// The longest distance between two looks of the enforcer at a thread that does not run.
const LONGEST_CHECK: Nanos = 5 * MS;

/// Budgets, and the programs that have them.
#[derive(Debug)]
pub(crate) struct Supervisor {
    enforcer: Enforcer,
    guardian: Guardian,
    control: Control,
    terms: Vec<Terms>,
    background: Background,
    roots: BTreeMap<Tid, Root>,
    processes: BTreeMap<Tid, Process>,
    threads: BTreeMap<Tid, Known>,
    ended: BTreeMap<(String, BudgetId), ThreadRow>,
    notes: Vec<String>,
    displaced: u64,
    looks: u64,
    began: Nanos,
}

/// A rule with its budget.
#[derive(Debug)]
struct Terms {
    rule: Rule,
    id: BudgetId,
    priority: u8,
    /// When its first thread came.
    began: Option<Nanos>,
}

#[derive(Debug)]
struct Root {
    start: u64,
    name: String,
}

#[derive(Debug)]
struct Process {
    root: Tid,
    /// What its first thread had.
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
        let background = options.background;
        if background.0 == SchedClass::Idle && !privilege::probe().cap_sys_nice {
            return Err(Failure::refused(
                "a thread comes back from `--background idle` only by CAP_SYS_NICE, which this \
                 process has not: give --background other, or the capability (replenish doctor)",
            ));
        }
        let allowed = affinity(current_tid()).map_err(Failure::refused)?;
        let cpu = options.cpu.or_else(|| allowed.iter().last()).unwrap_or(0);
        let mut config = EnforcerConfig::on_cpu(cpu);
        config.capacity = CAPACITY;
        config.tuning.max_backoff = LONGEST_CHECK;
        let enforcer = Enforcer::start(config).map_err(|e| match e {
            SpawnError::Cpu { .. } => Failure::Usage(format!("--cpu {cpu}: {e}")),
            e => Failure::refused(e),
        })?;
        let mut terms = Vec::new();
        for rule in rules {
            let amount = rule.amount;
            let priority = amount.priority.unwrap_or(options.priority);
            let budget = Budget::of(Duration::from_nanos(amount.amount));
            let budget = budget.every(Duration::from_nanos(amount.period));
            let id = enforcer
                .budget(priority, budget, background.0)
                .map_err(|e| Failure::Usage(format!("--thread {}: {e}", rule.pattern)))?;
            terms.push(Terms {
                rule,
                id,
                priority,
                began: None,
            });
        }
        Ok(Self {
            guardian: Guardian::start(cpu)?,
            control: Control::start()?,
            enforcer,
            terms,
            background,
            roots: BTreeMap::new(),
            processes: BTreeMap::new(),
            threads: BTreeMap::new(),
            ended: BTreeMap::new(),
            notes: Vec::new(),
            displaced: 0,
            looks: 0,
            began: clock::monotonic(),
        })
    }

    /// The CPU of all budgets.
    pub(crate) fn cpu(&self) -> usize {
        self.enforcer.cpu()
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
        let found = self.enforcer.inspect();
        self.displaced += found.displaced;
        for usage in found.ended {
            self.guardian.forget(usage.tid)?;
            self.keep(usage);
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
            Err(e) => return self.note(e.to_string()),
        };
        let original = self.original(&thread, first);
        let rule = self.rule(tid, thread.name());
        let known = Known {
            name: thread.name().to_string(),
            since: now,
            rule,
            original,
            seen: self.looks,
        };
        self.threads.insert(tid, known);
        match rule {
            Some(rule) => {
                let enrolled = self.enroll(rule, thread.with_original(original));
                match enrolled {
                    Err(Failure::Refused(why)) if first.is_some() => self.note(why),
                    enrolled => enrolled,
                }
            }
            None => {
                if let Some(first) = first {
                    settle(tid, self.cpu(), first);
                }
                self.guardian.leave_alone(tid, thread.start())
            }
        }
    }

    fn enroll(&mut self, rule: usize, thread: ForeignThread) -> Result<(), Failure> {
        let Some(terms) = self.terms.get_mut(rule) else {
            return Ok(());
        };
        let tid = thread.tid();
        self.guardian.hold(tid, thread.start(), thread.original())?;
        // Before: this process may be kept waiting between the two, and the share be too high.
        let now = clock::monotonic();
        match self.enforcer.enroll(terms.id, thread) {
            Ok(()) => {
                terms.began.get_or_insert(now);
                Ok(())
            }
            Err(e) => {
                self.guardian.forget(tid)?;
                if e.is_gone() {
                    Ok(())
                } else {
                    Err(Failure::refused(e))
                }
            }
        }
    }

    /// A thread has another name: perhaps another rule is about it.
    fn rename(&mut self, tid: Tid, name: String) -> Result<(), Failure> {
        let rule = self.rule(tid, &name);
        let Some(known) = self.threads.get_mut(&tid) else {
            return Ok(());
        };
        known.name = name;
        let before = std::mem::replace(&mut known.rule, rule);
        let original = known.original;
        if before == rule {
            return Ok(());
        }
        if let Some(usage) = self.enforcer.release(tid) {
            self.guardian.forget(tid)?;
            self.keep(usage);
        }
        let Ok(thread) = ForeignThread::open(tid) else {
            return Ok(()); // it has ended
        };
        let Some(rule) = rule else {
            return self.guardian.leave_alone(tid, thread.start());
        };
        match self.enroll(rule, thread.with_original(original)) {
            Err(Failure::Refused(why)) => self.note(why),
            enrolled => enrolled,
        }
    }

    fn rule(&self, tid: Tid, name: &str) -> Option<usize> {
        self.terms
            .iter()
            .position(|terms| terms.rule.is_about(tid, name))
    }

    /// Gives a program back what its threads had.
    fn release(&mut self, root: Tid) -> Result<(), Failure> {
        self.roots.remove(&root);
        let of = |process: &Process| process.root == root;
        let processes = self.processes.iter().filter(|(_, process)| of(process));
        let processes: Vec<_> = processes
            .map(|(pid, process)| (*pid, process.first))
            .collect();
        for usage in self.enforcer.threads() {
            if processes.iter().any(|(pid, _)| *pid == usage.pid)
                && let Some(usage) = self.enforcer.release(usage.tid)
            {
                self.guardian.forget(usage.tid)?;
                self.keep(usage);
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

    /// The figures of a thread that has ended, or has its budget no more.
    fn keep(&mut self, usage: ThreadUsage) {
        let row = self.row(&usage);
        let known = self.ended.len() < MOST_NAMES;
        let mut key = (usage.name, usage.budget);
        if !known && !self.ended.contains_key(&key) {
            key.0 = "others".into();
        }
        let name = key.0.clone();
        let sum = self.ended.entry(key).or_insert_with(|| ThreadRow {
            name,
            count: 0,
            high_ns: 0,
            background_ns: 0,
            ..row.clone()
        });
        sum.count += 1;
        (sum.pid, sum.tid) = (row.pid, row.tid);
        sum.high_ns += row.high_ns;
        sum.background_ns += row.background_ns;
    }

    fn row(&self, usage: &ThreadUsage) -> ThreadRow {
        let terms = self.terms.iter().find(|terms| terms.id == usage.budget);
        let amount = terms.map(|terms| terms.rule.amount);
        let priority = terms.map_or(0, |terms| terms.priority);
        ThreadRow {
            name: usage.name.clone(),
            pid: usage.pid.get(),
            tid: usage.tid.get(),
            count: 1,
            policy: format!("FIFO {priority}, then {}", self.background),
            budget_ns: amount.map_or(0, |amount| amount.amount),
            period_ns: amount.map_or(0, |amount| amount.period),
            high_ns: usage.high,
            background_ns: usage.background,
            exhaustions: self
                .enforcer
                .usage(usage.budget)
                .map_or(0, |of| of.exhaustions),
        }
    }

    fn note(&mut self, why: String) -> Result<(), Failure> {
        if self.notes.len() < MOST_NOTES && !self.notes.contains(&why) {
            self.notes.push(why);
        }
        Ok(())
    }

    /// Answers the next `--list`.
    fn tell(&self) {
        let threads = self.enforcer.threads();
        let budgets: Vec<_> = self.terms.iter().map(Terms::to_string).collect();
        let budgets = budgets.join(", ");
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
        let now = clock::monotonic();
        let share = |terms: &Terms| {
            let usage = self.enforcer.usage(terms.id)?;
            let elapsed = now.saturating_sub(terms.began?).max(1);
            let percent = |ns: Nanos| ns as f64 * 100.0 / elapsed as f64;
            let amount = terms.rule.amount;
            let allowed = amount.amount as f64 * 100.0 / amount.period as f64;
            Some(Share {
                name: terms.rule.pattern.clone(),
                percent: percent(usage.high),
                error_percent: percent(usage.high) - allowed,
                budget_percent: allowed,
                background_percent: percent(usage.background),
                elapsed_ns: elapsed,
                exhaustions: usage.exhaustions,
                sees_blocking: usage.sees_blocking,
            })
        };
        let shares: Vec<_> = self.terms.iter().filter_map(share).collect();
        let live = self.enforcer.threads();
        let mut threads: Vec<_> = live.iter().map(|usage| self.row(usage)).collect();
        threads.extend(self.ended.values().cloned());
        for row in &mut threads {
            // The names that they have by now.
            if let Some(known) = Tid::new(row.tid).and_then(|tid| self.threads.get(&tid)) {
                row.name.clone_from(&known.name);
            }
        }
        let mut notes = self.notes.clone();
        if shares.iter().any(|share| !share.sees_blocking) {
            notes.push(
                "the kernel's switch records were refused (kernel.perf_event_paranoid): budgets of \
                 threads that wait come back later than they could"
                    .into(),
            );
        }
        let unused = self.terms.iter().filter(|terms| terms.began.is_none());
        notes.extend(unused.map(|terms| format!("no thread fitted '{}'", terms.rule.pattern)));
        let stats = self.enforcer.stats();
        Report {
            elapsed_ns: now.saturating_sub(self.began),
            cpu: self.cpu(),
            enforcer_ns: stats.cpu,
            enforcer_wakes: stats.wakes,
            threads,
            shares,
            displaced: self.displaced,
            guardians_replaced: self.guardian.replaced,
            notes,
        }
    }

    /// Gives every thread back what it had; the figures.
    pub(crate) fn finish(mut self) -> Result<Report, Failure> {
        let report = self.report();
        let roots: Vec<Tid> = self.roots.keys().copied().collect();
        for root in roots {
            self.release(root)?;
        }
        self.enforcer.release_all();
        self.guardian.dismiss();
        Ok(report)
    }
}

impl std::fmt::Display for Terms {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let amount = self.rule.amount;
        let exact = replenish_plan::span::Exact;
        write!(
            f,
            "{}={}/{}@{}",
            self.rule.pattern,
            exact(amount.amount),
            exact(amount.period),
            self.priority
        )
    }
}
