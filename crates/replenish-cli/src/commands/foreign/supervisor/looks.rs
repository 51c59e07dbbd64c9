//! The rounds of a supervisor over its programs, and their end.

use super::state::{Process, Root, Supervisor};
use crate::commands::foreign::control::Program;
use crate::commands::foreign::give_back::settle;
use crate::commands::foreign::report::Report;
use crate::outcome::Failure;
use replenish_os::Tid;
use replenish_os::foreign::{ForeignThread, ThreadUsage, family, start_of, tasks};

/// Processes are looked for at every so many looks.
const FAMILY: u64 = 5;

impl Supervisor {
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
