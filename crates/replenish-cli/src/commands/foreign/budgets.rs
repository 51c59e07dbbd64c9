//! The budgets of one enforcer: a rule says which threads share one, and how much it is.

use super::cgroup::Cgroup;
use super::report::{Share, ThreadRow};
use super::rules::{Background, Terms};
use crate::outcome::Failure;
use crate::time::{MS, Nanos};
use replenish_os::foreign::{BudgetId, Enforcer, ForeignThread, ThreadUsage};
use replenish_os::{EnforcerConfig, SpawnError, Tid, clock};
use replenish_plan::span::Exact;
use sporadic::Budget;
use std::time::Duration;

/// Threads that share one budget at most.
const CAPACITY: usize = 512;
/// The longest distance between two looks of the enforcer at a thread that does not run.
const LONGEST_CHECK: Nanos = 5 * MS;

/// An enforcer, and the terms of each budget.
#[derive(Debug)]
pub(super) struct Budgets {
    pub(super) enforcer: Enforcer,
    budgets: Vec<Held>,
}

/// A budget and its terms.
#[derive(Debug)]
struct Held {
    terms: Terms,
    id: BudgetId,
    /// When its first thread came.
    began: Option<Nanos>,
}

impl Budgets {
    /// Starts an enforcer on `cpu` with these budgets.
    pub(super) fn start(terms: Vec<Terms>, cpu: usize) -> Result<Self, Failure> {
        let mut config = EnforcerConfig::on_cpu(cpu);
        config.capacity = CAPACITY;
        config.tuning.max_backoff = LONGEST_CHECK;
        let enforcer = Enforcer::start(config).map_err(|e| match e {
            SpawnError::Cpu { .. } => Failure::Usage(format!("--cpu {cpu}: {e}")),
            e => Failure::refused(e),
        })?;
        if let Some(e) = enforcer.memory_refused() {
            eprintln!("replenish: budgets end late when memory runs short: {e}");
        }
        let mut budgets = Vec::new();
        for terms in terms {
            let budget = Budget::of(Duration::from_nanos(terms.amount));
            let budget = budget.every(Duration::from_nanos(terms.period));
            let id = enforcer
                .budget(terms.priority, budget, terms.background.class())
                .map_err(|e| Failure::Usage(format!("--thread {}: {e}", terms.pattern)))?;
            budgets.push(Held {
                terms,
                id,
                began: None,
            });
        }
        Ok(Self { enforcer, budgets })
    }

    /// Has the threads of every budget that is to be suspended stopped in `cgroup`.
    pub(super) fn suspend_in(&self, cgroup: &Cgroup) -> Result<(), Failure> {
        for (place, held) in self.budgets.iter().enumerate() {
            if held.terms.background == Background::Suspend {
                let file = cgroup.budget(place)?;
                self.enforcer
                    .suspend_by(held.id, file)
                    .map_err(Failure::refused)?;
            }
        }
        Ok(())
    }

    /// Whether the threads of a budget are stopped without budget.
    pub(super) fn suspends(&self, rule: usize) -> bool {
        let held = self.budgets.get(rule);
        held.is_some_and(|held| held.terms.background == Background::Suspend)
    }

    /// The first rule that is about a thread.
    pub(super) fn rule(&self, tid: Tid, name: &str) -> Option<usize> {
        let mut budgets = self.budgets.iter();
        budgets.position(|held| held.terms.is_about(tid, name))
    }

    /// Gives a thread the budget of a rule; `false` if the thread has ended.
    pub(super) fn enroll(&mut self, rule: usize, thread: ForeignThread) -> Result<bool, Failure> {
        let Some(held) = self.budgets.get_mut(rule) else {
            return Ok(false);
        };
        // Before: this process may be kept waiting between the two, and the share be too high.
        let now = clock::monotonic();
        match self.enforcer.enroll(held.id, thread) {
            Ok(()) => {
                held.began.get_or_insert(now);
                Ok(true)
            }
            Err(e) if e.is_gone() => Ok(false),
            Err(e) => Err(Failure::refused(e)),
        }
    }

    /// The figures of a thread.
    pub(super) fn row(&self, usage: &ThreadUsage) -> ThreadRow {
        let held = self.budgets.iter().find(|held| held.id == usage.budget);
        let terms = held.map(|held| &held.terms);
        let policy = |terms: &Terms| format!("FIFO {}, then {}", terms.priority, terms.background);
        let budget = self.enforcer.usage(usage.budget);
        ThreadRow {
            name: usage.name.clone(),
            pid: usage.pid.get(),
            tid: usage.tid.get(),
            count: 1,
            policy: terms.map(policy).unwrap_or_default(),
            budget_ns: terms.map_or(0, |terms| terms.amount),
            period_ns: terms.map_or(0, |terms| terms.period),
            high_ns: usage.high,
            background_ns: usage.background,
            exhaustions: budget.map_or(0, |budget| budget.exhaustions),
        }
    }

    /// The figures of every budget that has had a thread.
    pub(super) fn shares(&self, now: Nanos) -> Vec<Share> {
        let share = |held: &Held| {
            let usage = self.enforcer.usage(held.id)?;
            let elapsed = now.saturating_sub(held.began?).max(1);
            let percent = |ns: Nanos| ns as f64 * 100.0 / elapsed as f64;
            let terms = &held.terms;
            let allowed = terms.amount as f64 * 100.0 / terms.period as f64;
            Some(Share {
                name: terms.pattern.clone(),
                percent: percent(usage.high),
                error_percent: percent(usage.high) - allowed,
                budget_percent: allowed,
                background_percent: percent(usage.background),
                elapsed_ns: elapsed,
                exhaustions: usage.exhaustions,
                sees_blocking: usage.sees_blocking,
            })
        };
        self.budgets.iter().filter_map(share).collect()
    }

    /// The patterns that no thread has fitted.
    pub(super) fn unused(&self) -> impl Iterator<Item = &str> {
        let unused = self.budgets.iter().filter(|held| held.began.is_none());
        unused.map(|held| held.terms.pattern.as_str())
    }
}

impl std::fmt::Display for Budgets {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (i, held) in self.budgets.iter().enumerate() {
            let terms = &held.terms;
            write!(
                f,
                "{}{}={}/{}@{}",
                if i == 0 { "" } else { ", " },
                terms.pattern,
                Exact(terms.amount),
                Exact(terms.period),
                terms.priority
            )?;
        }
        Ok(())
    }
}
