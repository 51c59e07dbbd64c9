//! Threads that others have started in this process: found by their names, held to shared budgets.
//!
//! ```text
//!   adopt("dds.*", …) ─► admission ─► start ─► watch: an ordinary thread, every 100 ms
//!                                                │ threads of the process whose name fits
//!                                                ▼
//!                                     foreign::Enforcer, one for each CPU with such budgets
//! ```

use alloc::string::{String, ToString};
use alloc::vec::Vec;
use core::fmt;
use core::time::Duration;
use replenish_os::foreign::{self, BudgetId, Enforcer, ForeignError, ForeignThread};
use replenish_os::{
    EnforcerConfig, Nanos, PiMutex, SchedClass, SpawnError, Tid, affinity, current_tid,
};
use sporadic::Budget;
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread::JoinHandle;

/// Time between two looks for new threads.
const LOOK: Duration = Duration::from_millis(100);

/// The priority where no plan was made: below every planned one.
const UNPLANNED: u8 = 19;

/// A request: threads with such names share this budget.
#[derive(Debug)]
pub(crate) struct Adopted {
    pub(crate) pattern: String,
    pub(crate) budget: Budget,
    /// Priority and CPU, by the plan.
    pub(crate) place: Option<(u8, Option<usize>)>,
}

impl Adopted {
    pub(crate) fn new(pattern: String, budget: Budget) -> Self {
        Self {
            pattern,
            budget,
            place: None,
        }
    }
}

/// The threads of one pattern, which share a budget. Times in nanoseconds of CPU time.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub struct AdoptedReport {
    /// The pattern of their names.
    pub pattern: String,
    /// The budget.
    pub budget: Budget,
    /// Their CPU.
    pub cpu: usize,
    /// Their FIFO priority while there is budget.
    pub priority: u8,
    /// Names and thread ids of the adopted threads that run now.
    pub threads: Vec<(String, Tid)>,
    /// Number of threads adopted so far.
    pub adopted: u64,
    /// CPU time used at the FIFO priority.
    pub cpu_high: Nanos,
    /// CPU time used in the background.
    pub cpu_low: Nanos,
    /// Number of times that the budget ran out.
    pub exhaustions: u64,
    /// The reason why the last matching thread that was refused was not adopted.
    pub refused: Option<String>,
}

/// Holds the budgets; gives everything back when it is dropped.
#[derive(Debug)]
pub(crate) struct Adoption {
    watch: Arc<Watch>,
    /// Dropped, it ends the thread.
    stop: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Watch {
    rules: Vec<Rule>,
    enforcers: Vec<Arc<Enforcer>>,
    process: Tid,
    /// Threads of the executor.
    own: Vec<Tid>,
}

#[derive(Debug)]
struct Rule {
    pattern: String,
    budget: Budget,
    priority: u8,
    id: BudgetId,
    enforcer: Arc<Enforcer>,
    found: PiMutex<Found>,
}

#[derive(Debug, Default)]
struct Found {
    adopted: u64,
    refused: Option<String>,
}

/// The reason why no thread can be adopted.
#[derive(Debug)]
pub(crate) enum Refused {
    Enforcer(SpawnError),
    Budget(ForeignError),
    Thread(std::io::Error),
}

impl fmt::Display for Refused {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Enforcer(e) => e.fmt(f),
            Self::Budget(e) => e.fmt(f),
            Self::Thread(e) => write!(f, "the thread that looks for them: {e}"),
        }
    }
}

impl Adoption {
    /// Starts enforcers and the watch, which has looked once when this returns.
    pub(crate) fn start(adopted: &[Adopted], enforcer: u8, own: Vec<Tid>) -> Result<Self, Refused> {
        let mut enforcers: Vec<Arc<Enforcer>> = Vec::new();
        let mut rules = Vec::with_capacity(adopted.len());
        for asked in adopted {
            let (priority, cpu) = asked.place.unwrap_or((UNPLANNED, None));
            let cpu = cpu.unwrap_or_else(last_cpu);
            let enforcer = match enforcers.iter().find(|known| known.cpu() == cpu) {
                Some(known) => Arc::clone(known),
                None => {
                    let config = EnforcerConfig {
                        priority: enforcer,
                        ..EnforcerConfig::on_cpu(cpu)
                    };
                    let started = Enforcer::start(config).map_err(Refused::Enforcer)?;
                    let started = Arc::new(started);
                    enforcers.push(Arc::clone(&started));
                    started
                }
            };
            let id = enforcer.budget(priority, asked.budget, SchedClass::Other);
            rules.push(Rule {
                pattern: asked.pattern.clone(),
                budget: asked.budget,
                priority,
                id: id.map_err(Refused::Budget)?,
                enforcer,
                found: PiMutex::new(Found::default()),
            });
        }
        let pid = i32::try_from(std::process::id()).ok();
        let watch = Arc::new(Watch {
            rules,
            enforcers,
            process: pid.and_then(Tid::new).unwrap_or_else(current_tid),
            own,
        });
        let theirs = Arc::clone(&watch);
        let (stop, stopped) = mpsc::channel();
        let (tell, looked) = mpsc::channel();
        let run = move || {
            theirs.look();
            tell.send(()).ok(); // the starter waits
            while stopped.recv_timeout(LOOK) == Err(RecvTimeoutError::Timeout) {
                theirs.look();
            }
        };
        let thread = std::thread::Builder::new().name("replenish-adopt".into());
        let thread = thread.spawn(run).map_err(Refused::Thread)?;
        looked.recv().ok(); // ended: the next lines say so by what they report
        Ok(Self {
            watch,
            stop: Some(stop),
            thread: Some(thread),
        })
    }

    /// Every pattern up to this moment.
    pub(crate) fn report(&self) -> Vec<AdoptedReport> {
        self.watch.rules.iter().map(Rule::report).collect()
    }
}

impl Drop for Adoption {
    fn drop(&mut self) {
        self.stop = None;
        if let Some(thread) = self.thread.take() {
            thread.join().ok(); // it gives nothing back
        }
        for rule in &self.watch.rules {
            rule.enforcer.retire(rule.id);
        }
    }
}

impl Watch {
    /// Adopts threads whose name fits, and looks after those that were adopted.
    fn look(&self) {
        let mut known = self.own.clone();
        known.push(current_tid());
        for enforcer in &self.enforcers {
            enforcer.inspect();
            known.extend(enforcer.threads().iter().map(|thread| thread.tid));
        }
        for tid in foreign::tasks(self.process).unwrap_or_default() {
            if known.contains(&tid) {
                continue;
            }
            let Some(name) = foreign::name(tid) else {
                continue; // it has ended
            };
            let mut rules = self.rules.iter();
            if let Some(rule) = rules.find(|rule| foreign::fits(&rule.pattern, &name)) {
                rule.adopt(tid);
            }
        }
    }
}

impl Rule {
    fn adopt(&self, tid: Tid) {
        let thread = match ForeignThread::open_own(tid) {
            // The thread has a priority that the program chose.
            Ok(thread) if thread.original().priority() > 0 => return,
            Ok(thread) => thread,
            Err(_) => return, // it has ended, or has a reservation of the kernel's
        };
        let enrolled = self.enforcer.enroll(self.id, thread);
        let mut found = self.found.lock();
        match enrolled {
            Ok(()) => found.adopted += 1,
            Err(e) if e.is_gone() => {}
            Err(e) => found.refused = Some(e.to_string()),
        }
    }

    fn report(&self) -> AdoptedReport {
        let usage = self.enforcer.usage(self.id);
        let threads = self.enforcer.threads().into_iter();
        let of_it = threads.filter(|thread| thread.budget == self.id);
        let found = self.found.lock();
        AdoptedReport {
            pattern: self.pattern.clone(),
            budget: self.budget,
            cpu: self.enforcer.cpu(),
            priority: self.priority,
            threads: of_it.map(|thread| (thread.name, thread.tid)).collect(),
            adopted: found.adopted,
            cpu_high: usage.map_or(0, |usage| usage.high),
            cpu_low: usage.map_or(0, |usage| usage.background),
            exhaustions: usage.map_or(0, |usage| usage.exhaustions),
            refused: found.refused.clone(),
        }
    }
}

fn last_cpu() -> usize {
    let cpus = affinity(current_tid());
    cpus.ok().and_then(|cpus| cpus.iter().last()).unwrap_or(0)
}
