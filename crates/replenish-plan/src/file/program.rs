//! Programs that the file does not describe from inside: budgets for their threads by name, which
//! `replenish run` and `replenish adopt` give.
//!
//! To the planner each of these budgets is a worker, beside those of executors.

use super::parse::{Found, Parser};
use super::schema;
use crate::{Machine, Requirement, Worker};
use sporadic::Policy;
use std::ops::Range;

/// More programs of a file, and more budgets of one program, are refused.
const MOST: usize = 64;
/// The longest pattern, in bytes.
const LONGEST: usize = 200;

/// One program.
#[derive(Debug, Clone, PartialEq)]
pub struct Program {
    /// Its name in plans, in the ledger and for `--program`.
    pub name: String,
    /// The pattern of its process: of the name, or of the command line.
    pub pattern: String,
    /// The CPU of its budgets.
    pub cpu: Option<usize>,
    /// Its budgets; a thread gets the first one whose pattern fits.
    pub threads: Vec<ProgramThread>,
    pub(super) place: Range<usize>,
}

/// One budget of a program, for all threads of a name.
#[derive(Debug, Clone, PartialEq)]
pub struct ProgramThread {
    /// The pattern of the threads' names.
    pub pattern: String,
    /// A guarantee, whose priority the planner chooses, or a sporadic policy.
    pub scheduling: Requirement,
}

impl Program {
    /// Its budgets as workers on `cpu`, in their order.
    pub fn workers(&self, cpu: usize) -> impl Iterator<Item = Worker> {
        self.threads.iter().map(move |thread| Worker {
            scheduling: thread.scheduling.clone(),
            cpu: Some(cpu),
            ..Worker::with_policy(format!("{} {}", self.name, thread.pattern), Policy::Other)
        })
    }

    /// The CPU of its budgets among `cpus`: the last one where the file does not say.
    #[must_use]
    pub fn place(&self, cpus: &[usize]) -> usize {
        let last = cpus.iter().max().copied();
        self.cpu.or(last).unwrap_or(0)
    }
}

impl Parser<'_> {
    pub(super) fn programs(
        &self,
        written: &[schema::Program],
        machine: &Machine,
    ) -> Found<Vec<Program>> {
        if let Some(one) = written.get(MOST) {
            return self.wrong(&one.name, format!("allowed up to {MOST} programs"));
        }
        let mut programs: Vec<Program> = Vec::with_capacity(written.len());
        for one in written {
            self.name(&one.name)?;
            let name = one.name.get_ref().clone();
            if programs.iter().any(|other| other.name == name) {
                return self.wrong(&one.name, format!("there is a program {name:?} already"));
            }
            let mut threads: Vec<ProgramThread> = Vec::with_capacity(one.thread.len());
            for thread in &one.thread {
                let next = self.thread(thread, machine)?;
                if threads.iter().any(|other| other.pattern == next.pattern) {
                    return self.wrong(&thread.pattern, "each pattern of a program once");
                }
                threads.push(next);
            }
            if !(1..=MOST).contains(&threads.len()) {
                let allowed = format!("a program needs 1 to {MOST} [[program.thread]]");
                return self.wrong(&one.name, allowed);
            }
            programs.push(Program {
                name,
                pattern: self.pattern(&one.pattern)?,
                cpu: self.cpu(one.cpu.as_ref(), machine)?,
                threads,
                place: one.name.span(),
            });
        }
        Ok(programs)
    }

    fn thread(&self, written: &schema::ProgramThread, machine: &Machine) -> Found<ProgramThread> {
        let scheduling = match (&written.guarantee, &written.policy) {
            (Some(guarantee), None) => Requirement::Guarantee(self.guarantee(guarantee)?),
            (None, Some(at)) => match self.policy(at, machine)? {
                policy @ Policy::Sporadic(_) => Requirement::Policy(policy),
                _ => {
                    let allowed = "threads of a program get a policy of kind \"sporadic\"";
                    return self.wrong(at, allowed);
                }
            },
            _ => {
                let allowed = "threads of a program get either a guarantee or a policy";
                return self.wrong(&written.pattern, allowed);
            }
        };
        Ok(ProgramThread {
            pattern: self.pattern(&written.pattern)?,
            scheduling,
        })
    }

    fn pattern(&self, written: &toml::Spanned<String>) -> Found<String> {
        let pattern = written.get_ref();
        if pattern.is_empty() || pattern.len() > LONGEST || pattern.contains(char::is_control) {
            let allowed = format!("a pattern has 1 to {LONGEST} bytes without control characters");
            return self.wrong(written, allowed);
        }
        Ok(pattern.clone())
    }
}
