//! Describing a worker and adding handles to it.

use super::Executor;
use super::callback::{CallbackContext, CallbackResult};
use super::handle::{Handle, Shared};
use super::plan::Request;
use super::subscription::{Subscription, Topic};
use super::timer::{Every, Timer};
use super::worker::Entry;
use crate::budget::Budget;
use crate::context::{Node, check_depth};
use crate::error::Error;
use crate::handoff::Inbox;
use crate::middleware::EndpointSpec;
use crate::qos::{History, Qos};
use crate::sync::Arc;
use alloc::boxed::Box;
use alloc::string::String;
use alloc::vec::Vec;
use core::time::Duration;
use replenish_msg::Message;
use replenish_os::Policy;
use replenish_plan::Guarantee;

/// A worker that is described so far.
pub(crate) struct WorkerSpec {
    pub(crate) request: Request,
    pub(crate) entries: Vec<Entry>,
    pub(crate) timers: usize,
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

    /// What the worker is guaranteed: CPU time per period, or callbacks at a rate; with a deadline,
    /// an importance, a minimum and a desired amount, as you like. The executor chooses priority,
    /// background, CPU and number of replenishments, and does not start where it cannot keep the
    /// promise.
    pub fn guarantee(self, guarantee: impl Into<Guarantee>) -> Self {
        self.request(|r| r.guarantee = Some(guarantee.into()))
    }

    /// Pins the worker to one CPU. Budgets are exact to microseconds only on pinned workers: their
    /// enforcer then lives on the same CPU.
    pub fn cpu(self, cpu: usize) -> Self {
        self.request(|r| r.cpu = Some(cpu))
    }

    /// Stack size in bytes, at least 16 KiB; 1 MiB if not given.
    pub fn stack_size(self, bytes: usize) -> Self {
        self.request(|r| r.stack_size = Some(bytes))
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
        callback: F,
    ) -> Result<Self, Error>
    where
        M: Message,
        F: FnMut(&M, &CallbackContext<'_>) -> R + Send + 'static,
        R: CallbackResult + 'static,
    {
        let topic = topic.into();
        if !node.context().is(&self.executor.context) {
            return Err(Error::ForeignNode(node.name().into()));
        }
        let name = node.resolve(topic.name)?;
        check_depth(&name, qos)?;
        let size = topic.max_size.unwrap_or(M::MAX_SIZE);
        if topic.max_size.is_some() && !(1..=M::MAX_SIZE).contains(&size) {
            let allowed = alloc::format!("1..={} bytes", M::MAX_SIZE);
            let owner = alloc::format!("topic {name}");
            return Err(Error::parameter(owner, "max_size", &size, allowed));
        }
        if let Some((field, value, allowed)) = topic.ingress.violation() {
            let owner = alloc::format!("topic {name}");
            return Err(Error::parameter(owner, field, &value, allowed));
        }
        let spec = EndpointSpec {
            ingress: topic.ingress,
            ..node.endpoint::<M>(&name, qos, size)
        };
        let reader = node
            .context()
            .middleware()
            .create_reader(&spec)
            .map_err(|e| Error::endpoint("subscription", &name, e))?;
        let keep_all = qos.history == History::KeepAll;
        let inbox = Arc::new(Inbox::new(qos.depth.into(), size, keep_all));
        let id = self
            .executor
            .unique(alloc::format!("{}/sub:{name}", node.name()));
        let shared = Shared::new(id, Some((reader, Arc::clone(&inbox))));
        let handle = Subscription::<M, F>::new(Arc::clone(&shared), inbox, callback);
        Ok(self.entry(shared, Box::new(handle)))
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
        let Some(spec) = self.executor.workers.get_mut(self.index) else {
            return Ok(self);
        };
        let name = &spec.request.name;
        if every.period == Duration::ZERO {
            let owner = alloc::format!("timer of worker {name:?}");
            return Err(Error::parameter(owner, "period", &0, "1 ns or more"));
        }
        let id: String = alloc::format!("{name}/timer:{}", spec.timers);
        spec.timers += 1;
        let shared = Shared::new(id, None);
        let handle = Timer::new(Arc::clone(&shared), every, callback);
        Ok(self.entry(shared, Box::new(handle)))
    }

    fn request(self, change: impl FnOnce(&mut Request)) -> Self {
        if let Some(spec) = self.executor.workers.get_mut(self.index) {
            change(&mut spec.request);
        }
        self
    }

    fn entry(self, shared: Arc<Shared>, handle: Box<dyn Handle>) -> Self {
        if let Some(spec) = self.executor.workers.get_mut(self.index) {
            spec.entries.push(Entry {
                shared,
                handle,
                stopped: false,
            });
        }
        self
    }
}
