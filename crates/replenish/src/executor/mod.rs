//! The executor: workers, each a thread with a policy, behind one dispatcher.
//!
//! ```text
//!   middleware ──► dispatcher ──► inbox ──► worker: decode, callback   (one thread, one policy)
//!       ▲                                     │
//!       └────────────── publish ──────────────┘      enforcers hold the budgets from below
//! ```
//!
//! - `mod.rs`: options, and the way in.
//! - [`builder`], `builder_handles`: describing workers and handles. [`plan`]: from wishes to policies.
//!   [`planned`], or `unplanned` without feature `plan`: `overlay`, scheduling from a file;
//!   `admission`, does it fit on this host?
//! - [`start`]: threads, enforcers, the declared fallbacks. [`threads`]: one thread's life.
//! - [`dispatcher`], [`worker`]: the two loops; [`rounds`]: by other rules than the usual one, `beat`: counted; [`doorbell`]: what the second sleeps on. [`handle`], [`subscription`], [`timer`]: what
//!   workers run. [`callback`]: what callbacks see.
//! - [`assembly`]: the parts put together. [`local`]: without threads, on the caller's.
//! - [`live`], `live_handles`, [`mailbox`], [`desk`]: handles that come and go; `fixed` without feature `live`.
//! - [`running`], [`stop`]: watching and ending it. [`report`]: the numbers; `table`: lined up.

#[cfg(feature = "live")]
mod added;
#[cfg(feature = "plan")]
mod admission;
mod agenda;
mod assembly;
#[cfg(feature = "texts")]
mod beat;
mod builder;
mod builder_handles;
mod callback;
mod client;
#[cfg(feature = "live")]
mod desk;
mod dispatcher;
mod doorbell;
mod entry;
#[cfg(not(feature = "live"))]
mod fixed;
mod forge;
mod group;
mod guard;
mod handle;
#[cfg(feature = "live")]
mod live;
#[cfg(feature = "live")]
mod live_handles;
mod local;
#[cfg(feature = "live")]
mod mailbox;
mod moment;
mod outbox;
#[cfg(feature = "plan")]
mod overlay;
mod plan;
#[cfg_attr(feature = "plan", path = "planned.rs")]
#[cfg_attr(not(feature = "plan"), path = "unplanned.rs")]
pub(crate) mod planning;
mod report;
mod rounds;
mod routes;
mod rules;
mod running;
mod schedule;
mod service;
mod start;
mod stop;
mod subscription;
mod table;
mod tally;
mod threads;
mod timer;
mod topic;
mod worker;

#[cfg(feature = "live")]
pub(crate) use added::Added;
#[cfg(feature = "texts")]
pub use beat::RoundStats;
pub use builder::WorkerBuilder;
pub use callback::{CallbackContext, CallbackResult};
pub use client::{CallError, Client, NoReply};
#[cfg(not(feature = "live"))]
use fixed::{self as live, self as mailbox, self as desk};
pub use forge::RawType;
pub(crate) use forge::{largest, sized};
pub use group::Group;
pub use guard::GuardCondition;
#[cfg(feature = "live")]
pub use live::{ExecutorHandle, LiveWorker, Removal};
pub use local::{LocalExecutor, SpinEnd, Spun};
pub use planning::AdmissionReport;
#[cfg(feature = "texts")]
pub use report::RoundReport;
pub use report::{DispatcherReport, HandleReport, Report, ThreadReport};
pub use rules::{DeadlineMiss, HandleStates, Handling, OnMiss, Semantics, Trigger};
pub use running::RunningExecutor;
pub(crate) use schedule::nanos;
pub use schedule::{Every, Overrun};
pub use service::Responder;
pub use stop::StopHandle;
pub use timer::TimerHandle;
pub use topic::Topic;

use crate::context::Context;
use crate::error::Error;
use crate::event::{Event, Events};
use crate::handoff::Stop;
use crate::platform::Kept;
use crate::sync::Arc;
use crate::text::{joined, numbered};
use alloc::string::String;
use alloc::vec::Vec;
use builder::WorkerSpec;
use core::fmt;
use core::time::Duration;
use planning::Planning;
use replenish_os::Policy;
use sporadic::Kind;

/// Runs callbacks on workers, each with its own scheduling policy and budget.
///
/// ```
/// use replenish::{Context, Executor, Qos};
/// use replenish::msg::std_msgs::Int32;
/// use std::time::Duration;
///
/// let ctx = Context::in_process();
/// let node = ctx.node("counter")?;
/// let out = node.publisher::<Int32>("count", Qos::reliable())?;
/// let mut n = 0;
///
/// let mut exec = Executor::new(&ctx);
/// exec.worker("count").timer(Duration::from_millis(1), move |_| {
///     n += 1;
///     out.publish(&Int32 { data: n })
/// })?;
/// exec.worker("print").subscribe(&node, "count", Qos::reliable(), |count: &Int32, cx| {
///     println!("{}", count.data);
///     if count.data == 3 {
///         cx.stop();
///     }
/// })?;
/// let report = exec.spin()?;
/// assert!(report.handles.iter().all(|h| h.stats.executed >= 3));
/// # Ok::<(), replenish::Error>(())
/// ```
#[must_use = "an executor does nothing until it spins"]
pub struct Executor {
    context: Context,
    workers: Vec<Kept<WorkerSpec>>,
    stop: StopHandle,
    options: Options,
}

/// Everything that can be set besides workers.
pub(crate) struct Options {
    dispatcher: Option<Policy>,
    dispatcher_cpu: Option<usize>,
    enforcer_priority: u8,
    server: Kind,
    strict: bool,
    #[cfg_attr(not(feature = "plan"), expect(dead_code, reason = "nothing is in it"))]
    planning: Planning,
    lock_memory: bool,
    switch_log: bool,
    stop_grace: Duration,
    events: Arc<Events>,
}

impl Executor {
    /// An executor without workers over `context`.
    pub fn new(context: &Context) -> Self {
        let stop = StopHandle {
            stop: Arc::new(Stop::new()),
            middleware: Arc::clone(context.middleware()),
        };
        Self {
            context: context.clone(),
            workers: Vec::new(),
            stop,
            options: Options {
                dispatcher: None,
                dispatcher_cpu: None,
                enforcer_priority: 99,
                server: Kind::Corrected,
                strict: false,
                planning: Planning::default(),
                lock_memory: false,
                switch_log: true,
                stop_grace: Duration::from_millis(120),
                events: Arc::new(Events::default()),
            },
        }
    }

    /// Starts to describe a worker. Its name must be unique in this executor; it becomes the
    /// thread's name.
    pub fn worker(&mut self, name: &str) -> WorkerBuilder<'_> {
        builder::one_more(&mut self.workers);
        self.workers.push(WorkerSpec::new(name));
        let index = self.workers.len() - 1;
        WorkerBuilder {
            executor: self,
            index,
        }
    }

    /// The dispatcher's policy; a sporadic one gives it a budget. Default: FIFO 98 as soon as any
    /// worker is real-time, else time sharing.
    pub fn dispatcher(&mut self, policy: Policy) -> &mut Self {
        self.options.dispatcher = Some(policy);
        self
    }

    /// Pins the dispatcher to one CPU. Default: not pinned.
    pub fn dispatcher_cpu(&mut self, cpu: usize) -> &mut Self {
        self.options.dispatcher_cpu = Some(cpu);
        self
    }

    /// The enforcers' FIFO priority, 2..=99, above all workers' and the dispatcher's. Default 99.
    pub fn enforcer_priority(&mut self, priority: u8) -> &mut Self {
        self.options.enforcer_priority = priority;
        self
    }

    /// Which budget server holds the budgets. Default: the corrected one.
    pub fn server(&mut self, kind: Kind) -> &mut Self {
        self.options.server = kind;
        self
    }

    /// `true`: a policy or a budget that cannot be granted is an error when the executor starts.
    /// `false`, the default: it is a fallback, told once and kept in the report.
    pub fn strict(&mut self, strict: bool) -> &mut Self {
        self.options.strict = strict;
        self
    }

    /// Locks the process's memory and touches the threads' stacks before the first callback, so
    /// that callbacks meet no page fault. Default: no.
    pub fn lock_memory(&mut self, lock: bool) -> &mut Self {
        self.options.lock_memory = lock;
        self
    }

    /// Whether the enforcers read the kernel's context-switch records to see callbacks that block
    /// (exact); otherwise a counter stands in (safe, less exact). Default: yes.
    pub fn switch_log(&mut self, on: bool) -> &mut Self {
        self.options.switch_log = on;
        self
    }

    /// How long callbacks that run have to finish after a stop. A thread that is not back by then
    /// is reported as stuck, demoted to time sharing and left behind. Default: 120 ms, so that
    /// a stop takes less than 200 ms even when the kernel holds up real-time threads meanwhile.
    pub fn stop_grace(&mut self, grace: Duration) -> &mut Self {
        self.options.stop_grace = grace;
        self
    }

    /// Where [`Event`]s go; called on the thread they happen on. Default: with feature `log` the
    /// program's logger (target `replenish`), else one line each on standard error.
    pub fn on_event(&mut self, hook: impl Fn(&Event<'_>) + Send + Sync + 'static) -> &mut Self {
        self.options.events = Arc::new(Events::new(hook));
        self
    }

    /// Stops this executor from anywhere, also before it has started.
    #[must_use]
    pub fn stop_handle(&self) -> StopHandle {
        self.stop.clone()
    }

    /// Starts everything and blocks until somebody stops it.
    ///
    /// # Errors
    /// As [`start`](Self::start).
    pub fn spin(self) -> Result<Report, Error> {
        Ok(self.start()?.wait())
    }

    /// Starts everything and returns: no callback has run before all threads have what was granted.
    ///
    /// # Errors
    /// [`Error::DuplicateWorker`], [`Error::IdleWorker`], [`Error::Name`] and
    /// [`Error::Parameter`] for what was described; [`Error::ContextBusy`];
    /// [`Error::Overlay`] for a deployment file; [`Error::NotAdmitted`] when a guarantee does not
    /// fit, or would break another program's;
    /// [`Error::Thread`] when a thread cannot be started; with [`strict`](Self::strict)
    /// [`Error::NotGranted`]. Nothing runs then.
    pub fn start(self) -> Result<RunningExecutor, Error> {
        start::start(self)
    }

    /// Without threads: the handles run on the calling thread whenever it spins the result, in a
    /// fixed order. Workers are then groups of handles with rules of their own.
    ///
    /// # Errors
    /// As [`start`](Self::start); [`Error::Parameter`] for a worker that was given a policy, a
    /// budget, a guarantee, a CPU or a stack, and for an executor that was given a dispatcher's policy
    /// or CPU, or memory to lock. Workers without handles are all right.
    pub fn local(self) -> Result<LocalExecutor, Error> {
        let options = &self.options;
        let asked = [
            ("dispatcher", options.dispatcher.is_some()),
            ("dispatcher_cpu", options.dispatcher_cpu.is_some()),
            ("lock_memory", options.lock_memory),
        ];
        if let Some((field, _)) = asked.iter().find(|(_, asked)| *asked) {
            let allowed = "none in Executor::local: the thread that spins is yours";
            return Err(Error::parameter("executor", field, &"set", allowed));
        }
        local::local(self)
    }

    /// `id`, or `id#2`, `id#3`, … if it is taken.
    fn unique(&self, id: String) -> String {
        let (mut other, mut number) = (None::<String>, 2);
        while self.is_taken(other.as_deref().unwrap_or(&id)) {
            other = Some(numbered(&joined(&[&id, "#"]), number));
            number += 1;
        }
        other.unwrap_or(id)
    }

    fn is_taken(&self, id: &str) -> bool {
        let mut workers = self.workers.iter();
        workers.any(|w| w.entries.iter().any(|e| e.shared.id == id))
    }
}

impl fmt::Debug for Executor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.workers.iter().map(|w| &w.request.name);
        f.debug_struct("Executor")
            .field("workers", &names.collect::<Vec<_>>())
            .finish_non_exhaustive()
    }
}
