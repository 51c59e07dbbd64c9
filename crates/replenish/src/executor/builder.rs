//! Describing a worker and adding handles to it.

use super::Executor;
use super::callback::{CallbackContext, CallbackResult};
use super::client::{Client, NoReply};
use super::doorbell::Doorbell;
use super::entry::Entry;
use super::forge::{Forge, RawType};
use super::guard::GuardCondition;
use super::plan::Request;
use super::rounds::BY_RULES;
use super::rules::{Handling, Rules, Semantics, Trigger};
use super::schedule::Every;
use super::service::Responder;
use super::timer::TimerHandle;
use super::topic::Topic;
use crate::budget::Budget;
use crate::context::Node;
use crate::error::Error;
use crate::qos::Qos;
use crate::sync::Arc;
use crate::text::text;
use alloc::vec::Vec;
use replenish_msg::{Message, Service, Viewed};
use replenish_os::Policy;

/// A worker that is described so far.
pub(crate) struct WorkerSpec {
    pub(crate) request: Request,
    pub(crate) bell: Arc<Doorbell>,
    pub(crate) rules: Rules,
    /// In the order they were added.
    pub(crate) entries: Vec<Entry>,
    /// Timers and guard conditions, by number.
    pub(crate) timers: usize,
    pub(crate) guards: usize,
}

impl WorkerSpec {
    pub(crate) fn new(name: &str) -> Self {
        Self {
            request: Request {
                name: name.into(),
                ..Request::default()
            },
            bell: Arc::default(),
            rules: Rules::default(),
            entries: Vec::new(),
            timers: 0,
            guards: 0,
        }
    }

    /// The handles in the order in which they run, and room for as many as there may be.
    pub(crate) fn ordered(mut entries: Vec<Entry>, limit: usize) -> Vec<Entry> {
        entries.reserve_exact(limit.saturating_sub(entries.len()));
        for at in 0..entries.len() {
            if let Some(entry) = entries.get_mut(at) {
                entry.slot = at;
            }
            // To its place among those before it. (Sorting brings kilobytes of code.)
            let earlier = entries.get_mut(..=at).unwrap_or_default();
            let mut end = earlier.len();
            while let Some([before, entry]) = earlier.get_mut(..end).and_then(<[_]>::last_chunk_mut)
                && before.handling.priority < entry.handling.priority
            {
                core::mem::swap(before, entry);
                end -= 1;
            }
        }
        entries
    }

    /// The most handles this worker can have.
    pub(crate) fn limit(&self) -> usize {
        let described = self.entries.len();
        self.rules.capacity.unwrap_or(described).max(described)
    }

    /// How many timers and guard conditions it has: later ones count on.
    pub(crate) fn numbers(&self) -> u64 {
        self.timers.max(self.guards) as u64
    }

    /// The first rule that contradicts another.
    pub(crate) fn violation(&self) -> Option<Error> {
        if let Some(error) = self
            .rules
            .rounds
            .and_then(|rounds| (rounds.violation)(self))
        {
            return Some(error);
        }
        let rules = &self.rules;
        let capacity = rules.capacity?;
        let allowed = text!("{}..=4096: those described", self.entries.len());
        let fits = (self.entries.len()..=4096).contains(&capacity);
        let owner = self.request.owner();
        (!fits).then(|| Error::parameter(owner, "capacity", &capacity, allowed))
    }
}

/// Room for one more, where memory is short: as many as there are, and not as many again.
pub(super) fn one_more<T>(list: &mut Vec<T>) {
    if cfg!(not(feature = "std")) {
        list.reserve_exact(1);
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
    /// meanwhile is served then. A round that is overrun follows the rule of `every`.
    pub fn every(self, every: impl Into<Every>) -> Self {
        let every = every.into();
        self.ruled(|r| r.every = Some(every))
    }

    /// Up to so many callbacks of one handle per round, before the next handle's turn. Default 1.
    pub fn messages_per_round(self, messages: u32) -> Self {
        self.ruled(|r| r.batch = messages)
    }

    /// What callbacks publish through [`CallbackContext::publish`] goes out when the round ends: up
    /// to so many samples per round, of up to so many bytes.
    pub fn output_barrier(self, samples: usize, bytes: usize) -> Self {
        self.ruled(|r| r.barrier = Some((samples, bytes)))
    }

    /// The most handles the worker can have, those added while it runs included; at most 4096.
    /// Default: those described. A worker with a capacity may begin without any.
    pub fn capacity(self, handles: usize) -> Self {
        self.rules(|r| r.capacity = Some(handles))
    }

    /// How the handle that was added last is treated.
    pub fn with(mut self, handling: Handling) -> Self {
        if let Some(entry) = self.spec().and_then(|s| s.entries.last_mut()) {
            entry.treat(handling);
        }
        self
    }

    /// Calls `callback` for every message on `topic`, which is a name or a [`Topic`].
    ///
    /// Messages are decoded on this worker, into one message that is reused.
    ///
    /// # Errors
    /// [`Error::Name`], [`Error::ForeignNode`], [`Error::Parameter`] for a depth, size or limit out
    /// of range, [`Error::Middleware`] when the reader cannot be created.
    pub fn subscribe<'t, M, F, R>(
        self,
        node: &Node,
        topic: impl Into<Topic<'t>>,
        qos: Qos,
        mut callback: F,
    ) -> Result<Self, Error>
    where
        M: Message,
        F: FnMut(&M, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        let called = move |message: Option<&M>, cx: &CallbackContext<'_>| {
            message.map(|message| callback(message, cx))
        };
        self.add(|forge| forge.subscription(node, topic, qos, called))
    }

    /// Calls `callback` in every round of this worker: with a new message on `topic`, or with
    /// `None`. What starts a round is up to the other handles, the [trigger](Self::trigger) and
    /// [`every`](Self::every).
    ///
    /// # Errors
    /// As [`subscribe`](Self::subscribe).
    pub fn subscribe_always<'t, M, F, R>(
        self,
        node: &Node,
        topic: impl Into<Topic<'t>>,
        qos: Qos,
        callback: F,
    ) -> Result<Self, Error>
    where
        M: Message,
        F: FnMut(Option<&M>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        self.ruled(|_| {}).add(|forge| {
            let mut entry = forge.subscription(node, topic, qos, callback)?;
            entry.handling = Handling::new().always();
            Ok(entry)
        })
    }

    /// Calls `callback` with a view of every message on `topic`: strings and sequences stay in the
    /// bytes that came, so nothing is copied and nothing allocates, whatever the size. All bytes are
    /// checked before the callback runs.
    ///
    /// ```
    /// # use replenish::{Context, Error, Executor, Qos, Topic};
    /// # use replenish_interfaces::sensor_msgs::msg::{Image, ImageView};
    /// # fn main() -> Result<(), Error> {
    /// # let ctx = Context::in_process();
    /// # let node = ctx.node("n")?;
    /// # let mut exec = Executor::new(&ctx);
    /// let topic = Topic::named("image").max_size(40_000);
    /// exec.worker("w").subscribe_view::<Image, _, _>(
    ///     &node, topic, Qos::sensor_data(), |image: &ImageView<'_>, _| {
    ///         println!("{} bytes of {}", image.data.len(), image.encoding);
    ///     },
    /// )?;
    /// # Ok(())
    /// # }
    /// ```
    ///
    /// # Errors
    /// As [`subscribe`](Self::subscribe).
    pub fn subscribe_view<'t, M, F, R>(
        self,
        node: &Node,
        topic: impl Into<Topic<'t>>,
        qos: Qos,
        callback: F,
    ) -> Result<Self, Error>
    where
        M: Viewed,
        F: FnMut(&M::View<'_>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        self.add(|forge| forge.view::<M, _, _>(node, topic, qos, callback))
    }

    /// Calls `callback` with the bytes of every sample on `topic`: CDR without encapsulation header,
    /// in the slot they arrived in. The type is given by its names.
    ///
    /// # Errors
    /// As [`subscribe`](Self::subscribe).
    pub fn subscribe_raw<'t, F, R>(
        self,
        node: &Node,
        topic: impl Into<Topic<'t>>,
        ty: RawType<'_>,
        qos: Qos,
        callback: F,
    ) -> Result<Self, Error>
    where
        F: FnMut(&[u8], &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        self.add(|forge| forge.raw(node, topic, ty, qos, callback))
    }

    /// Calls `callback` at every release of a timer, given as a period or an [`Every`].
    ///
    /// Releases are absolute on the monotonic clock; the worker itself waits for them.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a period of 0.
    pub fn timer<F, R>(self, every: impl Into<Every>, callback: F) -> Result<Self, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let every = every.into();
        self.timed(None, every, callback)
    }

    /// As [`timer`](Self::timer), with a handle that starts it, cancels it or changes its period.
    ///
    /// # Errors
    /// [`Error::Parameter`] for a period of 0, or if `handle` belongs to a timer already.
    pub fn timer_with<F, R>(
        self,
        handle: &TimerHandle,
        every: impl Into<Every>,
        callback: F,
    ) -> Result<Self, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let every = every.into();
        self.timed(Some(handle), every, callback)
    }

    fn timed<F, R>(
        mut self,
        handle: Option<&TimerHandle>,
        every: Every,
        callback: F,
    ) -> Result<Self, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let number = self.spec().map_or(0, |s| {
            s.timers += 1;
            s.timers - 1
        });
        self.add_numbered(number, |forge| forge.timer(handle, every, callback))
    }

    /// Calls `callback` whenever `guard` was triggered.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `guard` belongs to a callback already.
    pub fn guard<F, R>(mut self, guard: &GuardCondition, callback: F) -> Result<Self, Error>
    where
        F: FnMut(&CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let number = self.spec().map_or(0, |s| {
            s.guards += 1;
            s.guards - 1
        });
        self.add_numbered(number, |forge| forge.guard(guard, callback))
    }

    /// Serves `name`: calls `callback` with every request and a response to fill, which is then
    /// sent. A reply that cannot be sent counts as an error of the handle. `name` is a name or a
    /// [`Topic`] with the largest size of requests and responses, for types with unbounded fields.
    ///
    /// # Errors
    /// As [`subscribe`](Self::subscribe).
    pub fn serve<'t, S, F>(
        self,
        node: &Node,
        name: impl Into<Topic<'t>>,
        qos: Qos,
        mut callback: F,
    ) -> Result<Self, Error>
    where
        S: Service,
        F: FnMut(&S::Request, &mut S::Response, &CallbackContext<'_>) + Send + 'static,
    {
        let mut response = S::Response::default();
        let called = move |request: &S::Request, to: Responder<S>, cx: &CallbackContext<'_>| {
            callback(request, &mut response, cx);
            to.reply(&response)
        };
        let name = name.into();
        self.add(|forge| forge.server::<S, _, _>(node, name, qos, called))
    }

    /// Serves `name`: calls `callback` with every request and the right to answer it, now or
    /// later, from any thread.
    ///
    /// # Errors
    /// As [`subscribe`](Self::subscribe).
    pub fn serve_later<'t, S, F, R>(
        self,
        node: &Node,
        name: impl Into<Topic<'t>>,
        qos: Qos,
        callback: F,
    ) -> Result<Self, Error>
    where
        S: Service,
        F: FnMut(&S::Request, Responder<S>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let name = name.into();
        self.add(|forge| forge.server::<S, _, _>(node, name, qos, callback))
    }

    /// Calls `callback` once for every request of `client`: with its reply, or when its time limit
    /// has passed.
    ///
    /// # Errors
    /// [`Error::Parameter`] if `client` belongs to a callback already.
    pub fn replies<S, F, R>(self, client: &Client<S>, callback: F) -> Result<Self, Error>
    where
        S: Service,
        F: FnMut(Result<&S::Response, NoReply>, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        self.add(|forge| forge.replies(client, callback))
    }

    fn spec(&mut self) -> Option<&mut WorkerSpec> {
        self.executor.workers.get_mut(self.index)
    }

    pub(super) fn request(mut self, change: impl FnOnce(&mut Request)) -> Self {
        if let Some(spec) = self.spec() {
            change(&mut spec.request);
        }
        self
    }

    /// A rule that [`rounds`](super::rounds) are for.
    fn ruled(self, change: impl FnOnce(&mut Rules)) -> Self {
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

    fn add(self, make: impl FnOnce(&Forge<'_>) -> Result<Entry, Error>) -> Result<Self, Error> {
        self.add_numbered(0, make)
    }

    fn add_numbered(
        mut self,
        number: usize,
        make: impl FnOnce(&Forge<'_>) -> Result<Entry, Error>,
    ) -> Result<Self, Error> {
        let Some(spec) = self.executor.workers.get(self.index) else {
            return Ok(self);
        };
        let entry = make(&Forge {
            context: &self.executor.context,
            worker: &spec.request.name,
            unique: &|id| self.executor.unique(id),
            number,
        })?;
        if let Some(spec) = self.spec() {
            one_more(&mut spec.entries);
            spec.entries.push(entry);
        }
        Ok(self)
    }
}
