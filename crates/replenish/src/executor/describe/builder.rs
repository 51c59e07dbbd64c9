//! Describing a worker: its scheduling and its rules. `add` adds its handles.

use super::add::{AddHandles, Numbering, Target};
use super::executor::Executor;
use super::factory::HandleFactory;
use crate::error::Error;
use crate::executor::handles::entry::HandleEntry;
use crate::executor::handles::options::HandleOptions;
use crate::executor::run::request::WorkerRequest;
use crate::executor::run::rounds::BY_RULES;
use crate::executor::run::rules::{Semantics, Trigger};
use crate::executor::run::state::{Rules, WorkerSpec, one_more};
use crate::executor::wake::schedule::Every;
use crate::handoff::Inbox;
use crate::middleware::ReaderId;
use crate::sync::Arc;
use replenish_os::Policy;
use sporadic::Budget;

impl Executor {
    /// Starts to describe a worker. Its name, 1 to 63 bytes without `/` and control characters, is
    /// unique in this executor and the thread's name, of which the kernel shows 15 bytes.
    pub fn worker(&mut self, name: &str) -> WorkerBuilder<'_> {
        one_more(&mut self.workers);
        self.workers.push(WorkerSpec::new(name));
        let index = self.workers.len() - 1;
        let executor = self;
        AddHandles(Description { executor, index })
    }
}

/// Describes one worker: its scheduling first, then its handles, which run in the order they are
/// added.
///
/// The executor checks scheduling parameters when it starts, and handles at once.
pub type WorkerBuilder<'e> = AddHandles<Description<'e>>;

/// One worker of an executor that is described.
pub struct Description<'e> {
    executor: &'e mut Executor,
    index: usize,
}

impl WorkerBuilder<'_> {
    /// The scheduling policy. Without one, and without a budget, the worker is time-shared.
    ///
    /// The start refuses one beside a [`guarantee`](Self::guarantee); any but FIFO beside a
    /// [`budget`](Self::budget); [`Policy::KernelSporadic`] on any system but NuttX; a sporadic
    /// server with fewer than two pending replenishments, a microcontroller's excepted; and
    /// [`Policy::Deadline`] beside a [`cpu`](Self::cpu).
    pub fn policy(self, policy: Policy) -> Self {
        self.request(|r| r.policy = Some(policy))
    }

    /// The CPU budget. Alone, it is a [`guarantee`](Self::guarantee) of this amount. Beside a FIFO
    /// policy, it bounds that priority.
    pub fn budget(self, budget: Budget) -> Self {
        self.request(|r| r.budget = Some(budget))
    }

    /// Pins the worker to one CPU, counted from 0 as the kernel does. Budgets are exact to
    /// microseconds only on pinned workers: their enforcer then lives on the same CPU.
    pub fn cpu(self, cpu: usize) -> Self {
        self.request(|r| r.cpu = Some(cpu))
    }

    /// Stack size in bytes, at least 16 KiB; 1 MiB if not given. On a microcontroller at least 512
    /// bytes; 4 KiB if not given.
    pub fn stack_size(self, bytes: usize) -> Self {
        self.request(|r| r.stack_size = Some(bytes))
    }

    /// The condition for a round to begin. Default: [`Trigger::Any`].
    pub fn trigger(self, trigger: Trigger) -> Self {
        self.ruled(|r| r.trigger = trigger)
    }

    /// Sets the time at which callbacks get their input. Default: each just before it runs.
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
            r.count.enable();
        })
    }

    /// Sets the most callbacks of one handle per round, before the next handle's turn, 1 or more.
    /// Default 1.
    pub fn messages_per_round(self, messages: u32) -> Self {
        self.ruled(|r| r.batch = Some(messages))
    }

    /// Samples that callbacks publish through
    /// [`CallbackContext::publish`](crate::CallbackContext::publish) go out when the round ends: up
    /// to `samples` per round, 1..=4096, of up to `bytes` bytes each, 1..=268435456, and
    /// 1 GiB together.
    pub fn output_barrier(self, samples: usize, bytes: usize) -> Self {
        self.ruled(|r| r.barrier = Some((samples, bytes)))
    }

    /// The most handles the worker can have, those added while it runs included; at most 4096.
    /// Default: those described. A worker with a capacity may begin without any.
    pub fn capacity(mut self, handles: usize) -> Self {
        self.0.spec(|spec| spec.rules.capacity = Some(handles));
        self
    }

    /// Options of the handle that was added last. (A [`WorkerHandle`](crate::WorkerHandle) takes
    /// them before it adds one.) Where several handles were added together (actions, parameters,
    /// managed nodes), priority, group and error hook apply to all of them. Without a handle before
    /// it, it is an [`Error::Parameter`] when the executor starts.
    pub fn options(mut self, options: HandleOptions) -> Self {
        self.0.configure(options);
        self
    }

    /// The ids of the handle that was added last, or of those that were added together (actions,
    /// parameters, managed nodes), in their order: for
    /// [`ExecutorHandle::remove`](crate::ExecutorHandle::remove), triggers and statistics. Empty
    /// before the first handle.
    ///
    /// ```
    /// # use replenish::{Context, Error, Executor};
    /// # use std::time::Duration;
    /// # fn main() -> Result<(), Error> {
    /// # let ctx = Context::in_process();
    /// # let mut exec = Executor::new(&ctx);
    /// let worker = exec.worker("w").timer(Duration::from_millis(1), |_| ())?;
    /// assert!(worker.added().eq(["w/timer:0"]));
    /// # Ok(())
    /// # }
    /// ```
    pub fn added(&self) -> impl Iterator<Item = &str> {
        let spec = self.0.executor.workers.get(self.0.index);
        let entries = spec.map_or(&[][..], |spec| &spec.entries);
        let count = entries
            .last()
            .map_or(0, |last| 1 + usize::from(last.others));
        let first = entries.len().saturating_sub(count);
        entries.iter().skip(first).map(|entry| &*entry.shared.id)
    }

    pub(crate) fn request(mut self, change: impl FnOnce(&mut WorkerRequest)) -> Self {
        self.0.spec(|spec| change(&mut spec.request));
        self
    }

    /// Gives the rounds a rule.
    fn ruled(mut self, change: impl FnOnce(&mut Rules)) -> Self {
        self.0.every_round();
        self.0.spec(|spec| change(&mut spec.rules));
        self
    }
}

impl Description<'_> {
    fn spec<T>(&mut self, change: impl FnOnce(&mut WorkerSpec) -> T) -> Option<T> {
        let spec = self.executor.workers.get_mut(self.index)?;
        Some(change(spec))
    }

    fn configure(&mut self, options: HandleOptions) {
        self.spec(|spec| {
            let Some((entry, before)) = spec.entries.split_last_mut() else {
                spec.rules.early = true;
                return;
            };
            for other in before.iter_mut().rev().take(entry.others.into()) {
                other.treat(options.shared());
            }
            entry.treat(options);
        });
    }
}

impl Target for Description<'_> {
    type Added = AddHandles<Self>;
    type AllAdded = AddHandles<Self>;
    type Together = Self;

    fn add(
        mut self,
        numbering: Numbering,
        make: impl FnOnce(&HandleFactory<'_>) -> Result<HandleEntry, Error>,
    ) -> Result<Self::Added, Error> {
        let number = self.spec(|spec| {
            let next = match numbering {
                Numbering::None => return 0,
                Numbering::Timers => &mut spec.timers,
                Numbering::Guards => &mut spec.guards,
            };
            *next += 1;
            *next - 1
        });
        let executor = &*self.executor;
        let Some(spec) = executor.workers.get(self.index) else {
            return Ok(AddHandles(self));
        };
        let entry = make(&HandleFactory {
            context: &executor.context,
            worker: &spec.request.name,
            unique: &|id| executor.unique(id),
            number: number.unwrap_or(0),
        })?;
        self.spec(|spec| spec.add(entry));
        Ok(AddHandles(self))
    }

    fn every_round(&mut self) {
        self.spec(|spec| spec.rules.rounds = Some(&BY_RULES));
    }

    fn together(self) -> Self {
        self
    }

    fn all_added(mut self, others: u8) -> AddHandles<Self> {
        self.spec(|spec| {
            if let Some(entry) = spec.entries.last_mut() {
                entry.others = others;
            }
        });
        AddHandles(self)
    }

    fn last_inbox(&mut self) -> Option<Arc<Inbox>> {
        self.spec(|spec| {
            let (_, inbox) = spec.entries.last()?.shared.input.as_ref()?;
            Some(Arc::clone(inbox))
        })?
    }

    fn reader_of(&mut self, id: &str) -> Option<ReaderId> {
        let mut entries = self.executor.workers.iter().flat_map(|spec| &spec.entries);
        let entry = entries.find(|entry| entry.shared.id == id)?;
        entry.shared.input.as_ref().map(|(reader, _)| *reader)
    }
}
