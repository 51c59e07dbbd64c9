//! The figures of a supervisor: threads that have ended, notes, and the report over all.

use super::budgets::Budgets;
use super::report::{Report, ThreadRow};
use crate::time::Nanos;
use replenish_os::clock;
use replenish_os::foreign::{BudgetId, ThreadUsage};
use std::collections::BTreeMap;

/// Names of threads that have ended; more share one row.
const MOST_NAMES: usize = 256;
/// Notes that are kept.
const MOST_NOTES: usize = 16;

/// Figures since the start: ended threads, notes, and threads that were displaced.
#[derive(Debug)]
pub(super) struct Figures {
    ended: BTreeMap<(String, BudgetId), ThreadRow>,
    notes: Vec<String>,
    /// Threads that had changed their policy or CPU.
    pub(super) displaced: u64,
    began: Nanos,
}

impl Figures {
    /// Begins now.
    pub(super) fn start() -> Self {
        Self {
            ended: BTreeMap::new(),
            notes: Vec::new(),
            displaced: 0,
            began: clock::monotonic(),
        }
    }

    /// Adds a thread that has ended, or has its budget no more.
    pub(super) fn keep(&mut self, usage: ThreadUsage, budgets: &Budgets) {
        let row = budgets.row(&usage);
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

    /// Keeps a sentence about what did not hold, once.
    pub(super) fn note(&mut self, why: String) {
        if self.notes.len() < MOST_NOTES && !self.notes.contains(&why) {
            self.notes.push(why);
        }
    }

    /// The figures up to now. `name` is the name that a living thread has by now.
    pub(super) fn report<'a>(
        &self,
        budgets: &Budgets,
        guardians_replaced: u64,
        name: impl Fn(i32) -> Option<&'a str>,
    ) -> Report {
        let now = clock::monotonic();
        let shares = budgets.shares(now);
        let live = budgets.enforcer.threads();
        let mut threads: Vec<_> = live.iter().map(|usage| budgets.row(usage)).collect();
        threads.extend(self.ended.values().cloned());
        for row in &mut threads {
            if let Some(name) = name(row.tid) {
                row.name = name.to_string();
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
        let unused = budgets.unused();
        notes.extend(unused.map(|pattern| format!("no thread fitted '{pattern}'")));
        let stats = budgets.enforcer.stats();
        Report {
            elapsed_ns: now.saturating_sub(self.began),
            cpu: budgets.enforcer.cpu(),
            enforcer_ns: stats.cpu,
            enforcer_wakes: stats.wakes,
            threads,
            shares,
            displaced: self.displaced,
            guardians_replaced,
            notes,
        }
    }
}
