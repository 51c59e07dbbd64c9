//! The budgets of one enforcer: a rule says which threads share one, and how much it is.

use super::options::Options;
use super::report::{Share, ThreadRow};
use super::rules::{Background, Rule};
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
    terms: Vec<Terms>,
    background: Background,
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

impl Budgets {
    /// Starts an enforcer on `cpu` with one budget a rule.
    pub(super) fn start(options: &Options, rules: Vec<Rule>, cpu: usize) -> Result<Self, Failure> {
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
        let background = options.background;
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
            enforcer,
            terms,
            background,
        })
    }

    /// The first rule that is about a thread.
    pub(super) fn rule(&self, tid: Tid, name: &str) -> Option<usize> {
        self.terms
            .iter()
            .position(|terms| terms.rule.is_about(tid, name))
    }

    /// Gives a thread the budget of a rule; `false` if the thread has ended.
    pub(super) fn enroll(&mut self, rule: usize, thread: ForeignThread) -> Result<bool, Failure> {
        let Some(terms) = self.terms.get_mut(rule) else {
            return Ok(false);
        };
        // Before: this process may be kept waiting between the two, and the share be too high.
        let now = clock::monotonic();
        match self.enforcer.enroll(terms.id, thread) {
            Ok(()) => {
                terms.began.get_or_insert(now);
                Ok(true)
            }
            Err(e) if e.is_gone() => Ok(false),
            Err(e) => Err(Failure::refused(e)),
        }
    }

    /// The figures of a thread.
    pub(super) fn row(&self, usage: &ThreadUsage) -> ThreadRow {
        let terms = self.terms.iter().find(|terms| terms.id == usage.budget);
        let amount = terms.map(|terms| terms.rule.amount);
        let priority = terms.map_or(0, |terms| terms.priority);
        let budget = self.enforcer.usage(usage.budget);
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
            exhaustions: budget.map_or(0, |budget| budget.exhaustions),
        }
    }

    /// The figures of every budget that has had a thread.
    pub(super) fn shares(&self, now: Nanos) -> Vec<Share> {
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
        self.terms.iter().filter_map(share).collect()
    }

    /// The patterns that no thread has fitted.
    pub(super) fn unused(&self) -> impl Iterator<Item = &str> {
        let unused = self.terms.iter().filter(|terms| terms.began.is_none());
        unused.map(|terms| terms.rule.pattern.as_str())
    }
}

impl std::fmt::Display for Budgets {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (i, terms) in self.terms.iter().enumerate() {
            let amount = terms.rule.amount;
            write!(
                f,
                "{}{}={}/{}@{}",
                if i == 0 { "" } else { ", " },
                terms.rule.pattern,
                Exact(amount.amount),
                Exact(amount.period),
                terms.priority
            )?;
        }
        Ok(())
    }
}
