//! The budgets of this process: made, joined, left, read, ended.
//!
//! Two locks, both with priority inheritance. `changing` is held while anything is set up, files of
//! the ledger included. `table` is held for moments, so that a reader never waits for a set-up.

use crate::admission::{self, ENFORCER};
use crate::asked::Asked;
use crate::failure::{Failure, Why};
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
    name: String,
    amount: Nanos,
    period: Nanos,
    priority: u8,
    worst_response: Option<Nanos>,
    enforcer: Arc<Enforcer>,
    id: BudgetId,
    displaced: AtomicU64,
    promises: Vec<Promise>,
    _place: Option<Reservation>,
}

/// A budget so far; times in nanoseconds.
#[derive(Debug, Clone)]
pub struct Report {
    /// Its name.
    pub name: String,
    /// CPU time in every period.
    pub amount: Nanos,
    /// The period.
    pub period: Nanos,
    /// FIFO priority while there is budget.
    pub priority: u8,
    /// The CPU of its threads.
    pub cpu: usize,
    /// The longest time until budget that is due is delivered, by the plan; `None`: no bound.
    pub worst_response: Option<Nanos>,
    /// Times that one of its threads had changed its policy or CPU by itself.
    pub displaced: u64,
    /// CPU time that its threads have used.
    pub usage: BudgetUsage,
}

fn budgets() -> Result<&'static Budgets, Failure> {
    if BUDGETS.process == std::process::id() {
        return Ok(&BUDGETS);
    }
    let text = "this process is a fork of the one that made the budgets: start a program (exec), or \
                make budgets in the first process";
    Err(Failure::new(Why::Forked, text))
}

/// Whether this process may have budgets, and its deployment file, if there is one, can be read.
///
/// # Errors
/// The sentence that says what is missing.
pub fn check() -> Result<(), Failure> {
    budgets()?;
    admission::check()
}

/// Makes a budget if it fits; its number, which is never 0 and never used again. Waits for other
/// programs that are being admitted.
///
/// # Errors
/// It does not fit, is out of range, or a privilege is missing. [`Why::NotFound`]: nobody says how
/// large it is.
pub fn new(asked: Asked) -> Result<u64, Failure> {
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
    let name = asked.name.clone();
    let admitted = admission::admit(asked, own)?;
    let enforcer = all.enforcer(admitted.cpu)?;
    let span = Duration::from_nanos;
    let budget = Budget::of(span(admitted.amount)).every(span(admitted.period));
    let id = enforcer.budget(admitted.priority, budget, admitted.background)?;
    let held = Arc::new(Held {
        name,
        amount: admitted.amount,
        period: admitted.period,
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
///
/// # Errors
/// There is no such budget or thread, or the thread has a budget already.
pub fn attach(number: u64, tid: Option<Tid>) -> Result<(), Failure> {
    let all = budgets()?;
    let _alone = all.changing.lock();
    let held = all.held(number)?;
    held.look_after();
    let tid = tid.unwrap_or_else(current_tid);
    if all.enforcers().iter().any(|enforcer| has(enforcer, tid)) {
        let text = format!("thread {tid} has a budget already: detach it first");
        return Err(Failure::new(Why::Busy, text));
    }
    let thread = ForeignThread::open_own(tid)?;
    Ok(held.enforcer.enroll(held.id, thread)?)
}

/// Gives a thread of the budget, the calling one for `None`, back what it had.
///
/// # Errors
/// The thread does not have the budget.
pub fn detach(number: u64, tid: Option<Tid>) -> Result<(), Failure> {
    let all = budgets()?;
    let _alone = all.changing.lock();
    let held = all.held(number)?;
    let tid = tid.unwrap_or_else(current_tid);
    let mut threads = held.enforcer.threads().into_iter();
    if !threads.any(|thread| thread.tid == tid && thread.budget == held.id) {
        let text = format!("thread {tid} does not have budget {number}");
        return Err(Failure::new(Why::NotFound, text));
    }
    held.enforcer.release(tid);
    Ok(())
}

/// Ends a budget: all of its threads get back what they had.
///
/// # Errors
/// It has ended already.
pub fn release(number: u64) -> Result<(), Failure> {
    let all = budgets()?;
    let _alone = all.changing.lock();
    let held = all.held(number)?;
    // First the number, then the place, which the next budget takes.
    all.table.lock().budgets.remove(&number);
    held.enforcer.retire(held.id);
    Ok(())
}

/// The budget so far.
///
/// # Errors
/// It has ended.
pub fn report(number: u64) -> Result<Report, Failure> {
    let all = budgets()?;
    let held = all.held(number)?;
    held.look_after();
    let usage = held.enforcer.usage(held.id);
    all.held(number)?; // ended meanwhile: the figures can be another one's
    let ended = || Failure::new(Why::NotFound, format!("budget {number} has ended"));
    Ok(Report {
        name: held.name.clone(),
        amount: held.amount,
        period: held.period,
        priority: held.priority,
        cpu: held.enforcer.cpu(),
        worst_response: held.worst_response,
        displaced: held.displaced.load(Ordering::Relaxed),
        usage: usage.ok_or_else(ended)?,
    })
}

/// The numbers of all budgets, in the order in which they were made.
///
/// # Errors
/// The process is a fork of the one that made them.
pub fn list() -> Result<Vec<u64>, Failure> {
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
            Failure::new(Why::NotFound, text)
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
        let started = Enforcer::start(config).map_err(|e| Failure::new(Why::System, e))?;
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
