//! The data of a worker: its description, its rules, its state on its thread.
//!
//! ```text
//!   WorkerSpec: request, policy, handles
//!       └─ Rules ──► Rounds: the table of functions that carry them out (`rounds`)
//!   Worker: a WorkerSpec on its thread, with doorbell, run queue and mailbox (`worker`)
//! ```

use super::accounting::CpuAccounting;
use super::mailbox::Mailbox;
use super::request::WorkerRequest;
use super::round_stats::{RoundCount, WorkerRounds};
use super::rules::{Semantics, Trigger};
use crate::Nanos;
use crate::error::Error;
use crate::event::Events;
use crate::executor::change::live::Live;
use crate::executor::handles::entry::HandleEntry;
use crate::executor::handles::outbox::Outbox;
use crate::executor::wake::doorbell::Doorbell;
use crate::executor::wake::run_queue::RunQueue;
use crate::executor::wake::schedule::{Every, Schedule};
use crate::executor::wake::stop::StopHandle;
use crate::middleware::{Middleware, SourceSet};
use crate::platform::{self, STD, Static, make_static, text};
use crate::sync::Arc;
use alloc::vec::Vec;
use core::cell::RefCell;
use replenish_os::{Account, Policy};

/// The description of a worker.
pub(crate) struct WorkerSpec {
    pub(crate) request: WorkerRequest,
    /// The policy that the plan chose when the executor started.
    pub(crate) policy: Policy,
    pub(crate) rules: Rules,
    /// Its guarantee was admitted.
    pub(crate) promised: bool,
    /// In the order they were added.
    pub(crate) entries: Vec<HandleEntry>,
    /// Timers and guard conditions, by number.
    pub(crate) timers: usize,
    pub(crate) guards: usize,
}

impl WorkerSpec {
    pub(crate) fn new(name: &str) -> Static<Self> {
        make_static(Self {
            request: WorkerRequest::named(name),
            policy: Policy::Other,
            rules: Rules::default(),
            promised: false,
            entries: Vec::new(),
            timers: 0,
            guards: 0,
        })
    }

    /// The handles in the order in which they run, and room for as many as there may be.
    pub(crate) fn order(&mut self, limit: usize) {
        let entries = &mut self.entries;
        entries.reserve_exact(limit.saturating_sub(entries.len()));
        for at in 0..entries.len() {
            if let Some(entry) = entries.get_mut(at) {
                entry.slot = at;
            }
            // Moves the entry to its place among those before it. (Sorting brings kilobytes of
            // code.)
            let earlier = entries.get_mut(..=at).unwrap_or_default();
            let mut end = earlier.len();
            while let Some([before, entry]) = earlier.get_mut(..end).and_then(<[_]>::last_chunk_mut)
                && before.handling.priority < entry.handling.priority
            {
                core::mem::swap(before, entry);
                end -= 1;
            }
        }
    }

    /// Adds one more handle. (One body for all kinds.)
    #[inline(never)]
    pub(crate) fn add(&mut self, entry: HandleEntry) {
        one_more(&mut self.entries);
        self.entries.push(entry);
    }

    /// The most handles this worker can have.
    pub(crate) fn limit(&self) -> usize {
        let described = self.entries.len();
        self.rules.capacity.unwrap_or(described).max(described)
    }

    /// Number of timers or of guard conditions, whichever is larger. The next one gets this number.
    pub(crate) fn numbers(&self) -> u64 {
        self.timers.max(self.guards) as u64
    }

    /// The counters of its rounds, if they go by the clock.
    pub(crate) fn counted_rounds(&self) -> Option<WorkerRounds> {
        self.rules.count.of(&self.request.name)
    }

    /// Checks that no rule contradicts another.
    pub(crate) fn check_rules(&self) -> Result<(), Error> {
        if let Some(rounds) = self.rules.rounds {
            (rounds.check)(self)?;
        }
        if self.rules.early {
            let allowed = "only after the handle it configures";
            return Err(Error::parameter(
                self.request.owner(),
                "options",
                &"set",
                allowed,
            ));
        }
        let described = self.entries.len();
        match self.rules.capacity {
            Some(capacity) if !(described..=4096).contains(&capacity) => {
                let allowed = text!("{described}..=4096: those described");
                let owner = self.request.owner();
                Err(Error::parameter(owner, "capacity", &capacity, allowed))
            }
            _ => Ok(()),
        }
    }
}

/// Room for one more, where memory is short: as many as there are, and not as many again.
pub(crate) fn one_more<T>(list: &mut Vec<T>) {
    if !STD {
        list.reserve_exact(1);
    }
}

/// The rules of a worker's rounds.
#[derive(Default)]
pub(crate) struct Rules {
    pub(crate) trigger: Trigger,
    pub(crate) semantics: Semantics,
    /// Callbacks of one handle per round, at least 1; 1 if not said.
    pub(crate) batch: Option<u32>,
    /// Rounds come by the clock alone.
    pub(crate) every: Option<Every>,
    /// Counts those rounds.
    pub(crate) count: RoundCount,
    /// Samples and bytes of the output barrier.
    pub(crate) barrier: Option<(usize, usize)>,
    /// Rounds begin when the program spins: the worker has no thread.
    pub(crate) spun: bool,
    /// The most handles, those added later included.
    pub(crate) capacity: Option<usize>,
    /// Options were given before there was a handle.
    pub(crate) early: bool,
    /// The table that carries these rules out, if there are any.
    pub(crate) rounds: Option<&'static Rounds>,
}

/// Guards the drop of a trigger, whose closure may panic, in an executor that never ran.
impl Drop for Rules {
    fn drop(&mut self) {
        if STD {
            platform::guard(self, |rules| rules.trigger = Trigger::Any, |_, _| ());
        }
    }
}

impl Rules {
    /// All input is taken when the round begins.
    pub(crate) fn takes_first(&self) -> bool {
        self.semantics == Semantics::LogicalExecutionTime
    }

    /// A round begins whenever the program spins, with or without input.
    pub(crate) const fn is_unconditional(&self) -> bool {
        matches!(self.trigger, Trigger::Always) && self.every.is_none()
    }
}

/// Takes what has come meanwhile, between two callbacks: for workers without a thread, whose thread
/// is the dispatcher's as well.
pub(crate) type Intake<'i> = &'i mut dyn FnMut(&mut Account);

/// The functions that carry out rules other than the usual one. A worker reaches them through this
/// table alone, so that programs without such rules do not carry the code.
pub(crate) struct Rounds {
    /// Checks that no rule contradicts another.
    pub(crate) check: fn(&WorkerSpec) -> Result<(), Error>,
    /// Room for publications that wait for the end of a round.
    pub(crate) outbox: fn(&Rules) -> Option<RefCell<Outbox>>,
    pub(crate) begin: fn(&mut Worker, Nanos),
    /// Whether each round must look at every handle.
    pub(crate) want_all: fn(&Worker) -> bool,
    pub(crate) step: fn(&mut Worker, &mut Account, &CpuAccounting, Intake<'_>) -> bool,
    pub(crate) next_wake: fn(&mut Worker) -> Option<Nanos>,
    pub(crate) end: fn(&mut Worker),
}

/// The state of a worker on its thread.
pub(crate) struct Worker {
    /// The worker's description.
    pub(crate) spec: Static<WorkerSpec>,
    pub(crate) bell: Arc<Doorbell>,
    pub(crate) stop: StopHandle,
    pub(crate) events: Arc<Events>,
    pub(crate) middleware: Arc<dyn Middleware>,
    pub(crate) run_queue: RunQueue,
    /// The descriptors that it waits for, if the middleware hands it samples.
    pub(crate) sources: Option<Arc<SourceSet>>,
    /// Each round looks at every handle, since the rules want to know of all.
    pub(crate) looks_at_all: bool,
    pub(crate) mailbox: Arc<Mailbox>,
    pub(crate) live: Option<Arc<Live>>,
    pub(crate) outbox: Option<RefCell<Outbox>>,
    /// Begins of the rounds, if by the clock alone.
    pub(crate) grid: Option<Schedule>,
    /// Callbacks that ran so far.
    pub(crate) ran: u64,
}
