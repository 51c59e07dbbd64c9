//! The budgets of this process: made, joined, left, read, ended.
//!
//! Two locks, both with priority inheritance. `changing` is held while anything is set up, files of
//! the ledger included. `table` is held for moments, so that a reader never waits for a set-up.

use crate::admission::{self, Asked, ENFORCER};
use crate::status::{
    Failure, REPLENISH_BUSY, REPLENISH_FORKED, REPLENISH_NOT_FOUND, REPLENISH_SYSTEM,
};
use replenish_os::foreign::{BudgetId, BudgetUsage, Enforcer, ForeignThread};
use replenish_os::{EnforcerConfig, Nanos, PiMutex, Tid, current_tid};
use replenish_plan::Promise;
use replenish_plan::ledger::Reservation;
use sporadic::Budget;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock};
use std::time::Duration;

static BUDGETS: LazyLock<Budgets> = LazyLock::new(|| Budgets {
    process: std::process::id(),
    changing: PiMutex::new(()),
    table: PiMutex::new(Table::default()),
});

struct Budgets {
    /// Enforcers are threads, and a fork has none of them.
    process: u32,
    changing: PiMutex<()>,
    table: PiMutex<Table>,
}

#[derive(Default)]
struct Table {
    budgets: BTreeMap<u64, Arc<Held>>,
    enforcers: Vec<Arc<Enforcer>>,
    /// The last number; none is used twice, so that an old one finds nothing.
    last: u64,
}

/// One budget.
struct Held {
    asked: Asked,
    amount: Nanos,
    priority: u8,
    worst_response: Option<Nanos>,
    enforcer: Arc<Enforcer>,
    id: BudgetId,
    displaced: AtomicU64,
    promises: Vec<Promise>,
    _place: Option<Reservation>,
}

/// A budget so far.
pub(crate) struct Report {
    pub(crate) name: String,
    pub(crate) amount: Nanos,
    pub(crate) period: Nanos,
    pub(crate) priority: u8,
    pub(crate) cpu: usize,
    pub(crate) worst_response: Option<Nanos>,
    pub(crate) displaced: u64,
    pub(crate) usage: BudgetUsage,
}

fn budgets() -> Result<&'static Budgets, Failure> {
    if BUDGETS.process == std::process::id() {
        return Ok(&BUDGETS);
    }
    let text = "this process is a fork of the one that uses libreplenish: start a program (exec), or \
                make budgets in the first process";
    Err(Failure::new(REPLENISH_FORKED, text))
}

/// Makes a budget if it fits; its number.
pub(crate) fn new(asked: Asked) -> Result<u64, Failure> {
    let all = budgets()?;
    let _alone = all.changing.lock();
    let promises = |held: &Arc<Held>| held.promises.clone();
    let own: Vec<Promise> = all
        .table
        .lock()
        .budgets
        .values()
        .flat_map(promises)
        .collect();
    let admitted = admission::admit(&asked, own)?;
    let enforcer = all.enforcer(admitted.cpu)?;
    let span = Duration::from_nanos;
    let budget = Budget::of(span(admitted.amount)).every(span(asked.period));
    let id = enforcer.budget(admitted.priority, budget, asked.background)?;
    let held = Arc::new(Held {
        asked,
        amount: admitted.amount,
        priority: admitted.priority,
        worst_response: admitted.worst_response,
        enforcer,
        id,
        displaced: AtomicU64::new(0),
        promises: admitted.promises,
        _place: admitted.place,
    });
    let mut table = all.table.lock();
    table.last += 1;
    let number = table.last;
    table.budgets.insert(number, held);
    Ok(number)
}

/// Gives a thread of this process, the calling one for `None`, the budget.
pub(crate) fn attach(number: u64, tid: Option<Tid>) -> Result<(), Failure> {
    let all = budgets()?;
    let _alone = all.changing.lock();
    let held = all.held(number)?;
    held.look_after();
    let tid = tid.unwrap_or_else(current_tid);
    if all.enforcers().iter().any(|enforcer| has(enforcer, tid)) {
        let text = format!("thread {tid} has a budget already: detach it first");
        return Err(Failure::new(REPLENISH_BUSY, text));
    }
    let thread = ForeignThread::open_own(tid)?;
    Ok(held.enforcer.enroll(held.id, thread)?)
}

/// Gives a thread of the budget back what it had.
pub(crate) fn detach(number: u64, tid: Option<Tid>) -> Result<(), Failure> {
    let all = budgets()?;
    let _alone = all.changing.lock();
    let held = all.held(number)?;
    let tid = tid.unwrap_or_else(current_tid);
    let mut threads = held.enforcer.threads().into_iter();
    if !threads.any(|thread| thread.tid == tid && thread.budget == held.id) {
        let text = format!("thread {tid} does not have budget {number}");
        return Err(Failure::new(REPLENISH_NOT_FOUND, text));
    }
    held.enforcer.release(tid);
    Ok(())
}

/// Ends a budget: all of its threads get back what they had.
pub(crate) fn release(number: u64) -> Result<(), Failure> {
    let all = budgets()?;
    let _alone = all.changing.lock();
    let held = all.held(number)?;
    // First the number, then the place, which the next budget takes.
    all.table.lock().budgets.remove(&number);
    held.enforcer.retire(held.id);
    Ok(())
}

/// The budget so far.
pub(crate) fn report(number: u64) -> Result<Report, Failure> {
    let all = budgets()?;
    let held = all.held(number)?;
    held.look_after();
    let usage = held.enforcer.usage(held.id);
    all.held(number)?; // ended meanwhile: the figures can be another one's
    let ended = || Failure::new(REPLENISH_NOT_FOUND, format!("budget {number} has ended"));
    Ok(Report {
        name: held.asked.name.clone(),
        amount: held.amount,
        period: held.asked.period,
        priority: held.priority,
        cpu: held.enforcer.cpu(),
        worst_response: held.worst_response,
        displaced: held.displaced.load(Ordering::Relaxed),
        usage: usage.ok_or_else(ended)?,
    })
}

/// The numbers of all budgets, in the order in which they were made.
pub(crate) fn list() -> Result<Vec<u64>, Failure> {
    Ok(budgets()?.table.lock().budgets.keys().copied().collect())
}

fn has(enforcer: &Arc<Enforcer>, tid: Tid) -> bool {
    enforcer.threads().iter().any(|thread| thread.tid == tid)
}

impl Budgets {
    fn held(&self, number: u64) -> Result<Arc<Held>, Failure> {
        let held = self.table.lock().budgets.get(&number).cloned();
        held.ok_or_else(|| {
            let text = format!("there is no budget {number}: it was released, or never made");
            Failure::new(REPLENISH_NOT_FOUND, text)
        })
    }

    fn enforcers(&self) -> Vec<Arc<Enforcer>> {
        self.table.lock().enforcers.clone()
    }

    /// The enforcer of a CPU, started for its first budget.
    fn enforcer(&self, cpu: usize) -> Result<Arc<Enforcer>, Failure> {
        let mut enforcers = self.enforcers().into_iter();
        if let Some(enforcer) = enforcers.find(|enforcer| enforcer.cpu() == cpu) {
            return Ok(enforcer);
        }
        let config = EnforcerConfig {
            priority: ENFORCER,
            ..EnforcerConfig::on_cpu(cpu)
        };
        let started = Enforcer::start(config).map_err(|e| Failure::new(REPLENISH_SYSTEM, e))?;
        let enforcer = Arc::new(started);
        self.table.lock().enforcers.push(Arc::clone(&enforcer));
        Ok(enforcer)
    }
}

impl Held {
    /// Threads that have ended leave. Threads that changed their policy or CPU get theirs again,
    /// and are counted.
    fn look_after(&self) {
        let found = self.enforcer.inspect();
        self.displaced.fetch_add(found.displaced, Ordering::Relaxed);
    }
}
