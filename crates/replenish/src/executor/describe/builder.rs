//! Describing a worker: its scheduling and its rules. Adding handles to it is in `builder_handles`.

use super::executor::Executor;
use super::factory::HandleFactory;
use crate::error::Error;
use crate::executor::handles::client::Client;
use crate::executor::handles::entry::HandleEntry;
use crate::executor::handles::options::HandleOptions;
use crate::executor::run::request::WorkerRequest;
use crate::executor::run::rounds::BY_RULES;
use crate::executor::run::rules::{Semantics, Trigger};
use crate::executor::run::state::{Rules, WorkerSpec, one_more};
use crate::executor::wake::schedule::Every;
use crate::platform::Static;
use replenish_msg::Service;
use replenish_os::Policy;
use sporadic::Budget;

impl Executor {
    /// Starts to describe a worker. Its name must be unique in this executor; it becomes the
    /// thread's name.
    pub fn worker(&mut self, name: &str) -> WorkerBuilder<'_> {
        one_more(&mut self.workers);
        self.workers.push(WorkerSpec::new(name));
        let index = self.workers.len() - 1;
        WorkerBuilder {
            executor: self,
            index,
        }
    }
}

/// Describes one worker: its scheduling first, then its handles, which run in the order they are
/// added. Scheduling parameters are checked when the executor starts, handles at once.
pub struct WorkerBuilder<'e> {
    pub(crate) executor: &'e mut Executor,
    pub(crate) index: usize,
}

impl WorkerBuilder<'_> {
    /// The scheduling policy. Without one, and without a budget, the worker is time-shared.
    pub fn policy(self, policy: Policy) -> Self {
        self.request(|r| r.policy = Some(policy))
    }

    /// The CPU budget. Alone, it is a [`guarantee`](Self::guarantee) of this amount. Beside a FIFO
    /// policy, it bounds that priority.
    pub fn budget(self, budget: Budget) -> Self {
        self.request(|r| r.budget = Some(budget))
    }

    /// Pins the worker to one CPU. Budgets are exact to microseconds only on pinned workers: their
    /// enforcer then lives on the same CPU.
    pub fn cpu(self, cpu: usize) -> Self {
        self.request(|r| r.cpu = Some(cpu))
    }

    /// Stack size in bytes, at least 16 KiB; 1 MiB if not given. On a microcontroller at least 512
    /// bytes; 4 KiB if not given.
    pub fn stack_size(self, bytes: usize) -> Self {
        self.request(|r| r.stack_size = Some(bytes))
    }

    /// What must be there for a round to begin. Default: [`Trigger::Any`].
    pub fn trigger(self, trigger: Trigger) -> Self {
        self.ruled(|r| r.trigger = trigger)
    }

    /// When callbacks get their input. Default: each just before it runs.
    pub fn semantics(self, semantics: Semantics) -> Self {
        self.ruled(|r| r.semantics = semantics)
    }

    /// Rounds begin by the clock alone: once per period, on an absolute grid; what has come
    /// meanwhile is served then. A round that is overrun follows the rule of `every`, which is a
    /// period that begins with the executor: [`Every::once`] and [`Every::not_started`] are for
    /// timers. The [report](crate::Report) counts rounds that are left out.
    pub fn every(self, every: impl Into<Every>) -> Self {
        let every = every.into();
        self.ruled(|r| {
            r.every = Some(every);
            #[cfg(feature = "texts")]
            r.counters.get_or_insert_default();
        })
    }

    /// Up to so many callbacks of one handle per round, before the next handle's turn, 1 or more.
    /// Default 1.
    pub fn messages_per_round(self, messages: u32) -> Self {
        self.ruled(|r| r.batch = Some(messages))
    }

    /// What callbacks publish through
    /// [`CallbackContext::publish`](crate::CallbackContext::publish) goes out when the round ends:
    /// up to so many samples per round, 1..=4096, of up to so many bytes, 1..=65528.
    pub fn output_barrier(self, samples: usize, bytes: usize) -> Self {
        self.ruled(|r| r.barrier = Some((samples, bytes)))
    }

    /// The most handles the worker can have, those added while it runs included; at most 4096.
    /// Default: those described. A worker with a capacity may begin without any.
    pub fn capacity(self, handles: usize) -> Self {
        self.rules(|r| r.capacity = Some(handles))
    }

    /// How the handle that was added last is treated. (A [`WorkerHandle`](crate::WorkerHandle) says
    /// it before it adds one.) Where several handles were added together (actions, parameters,
    /// managed nodes), priority, group and error hook are those of all of them. Without a handle
    /// before it, it is an [`Error::Parameter`] when the executor starts.
    pub fn options(mut self, handling: HandleOptions) -> Self {
        let Some(spec) = self.spec() else {
            return self;
        };
        let spec: &mut WorkerSpec = &mut *spec;
        let Some((entry, before)) = spec.entries.split_last_mut() else {
            spec.rules.early = true;
            return self;
        };
        for other in before.iter_mut().rev().take(entry.others.into()) {
            other.treat(handling.shared());
        }
        entry.treat(handling);
        self
    }

    /// Samples of the handle that was added last come before replies of `client` that arrive later.
    pub(crate) fn ahead_of<S: Service>(mut self, client: &Client<S>) -> Self {
        if let Some(entry) = self.spec().and_then(|s| s.entries.last()) {
            client.lets_ahead(&entry.shared);
        }
        self
    }

    /// So many handles before the last one belong to it.
    pub(crate) fn together(mut self, others: u8) -> Self {
        if let Some(entry) = self.spec().and_then(|s| s.entries.last_mut()) {
            entry.others = others;
        }
        self
    }

    pub(crate) fn spec(&mut self) -> Option<&mut Static<WorkerSpec>> {
        self.executor.workers.get_mut(self.index)
    }

    pub(crate) fn request(mut self, change: impl FnOnce(&mut WorkerRequest)) -> Self {
        if let Some(spec) = self.spec() {
            change(&mut spec.request);
        }
        self
    }

    /// A rule that [`rounds`](crate::executor::run::rounds) are for.
    pub(crate) fn ruled(self, change: impl FnOnce(&mut Rules)) -> Self {
        self.rules(|r| {
            r.rounds = Some(&BY_RULES);
            change(r);
        })
    }

    fn rules(mut self, change: impl FnOnce(&mut Rules)) -> Self {
        if let Some(spec) = self.spec() {
            change(&mut spec.rules);
        }
        self
    }

    pub(crate) fn add(
        self,
        make: impl FnOnce(&HandleFactory<'_>) -> Result<HandleEntry, Error>,
    ) -> Result<Self, Error> {
        self.add_numbered(0, make)
    }

    pub(crate) fn add_numbered(
        mut self,
        number: usize,
        make: impl FnOnce(&HandleFactory<'_>) -> Result<HandleEntry, Error>,
    ) -> Result<Self, Error> {
        let Some(spec) = self.executor.workers.get(self.index) else {
            return Ok(self);
        };
        let entry = make(&HandleFactory {
            context: &self.executor.context,
            worker: &spec.request.name,
            unique: &|id| self.executor.unique(id),
            number,
        })?;
        if let Some(spec) = self.spec() {
            spec.add(entry);
        }
        Ok(self)
    }
}
