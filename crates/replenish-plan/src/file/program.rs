//! Programs that the file does not describe from inside: budgets for their threads by name, which
//! `replenish run` and `replenish adopt` give.
//!
//! To the planner each of these budgets is a worker, beside those of executors.

use crate::{Requirement, Worker};
use sporadic::Policy;
use std::ops::Range;

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
