//! An executor as it is described: its options and its workers.

use super::planning::Planning;
use super::unstarted::Unstarted;
use crate::context::Context;
use crate::event::{Event, Events};
use crate::executor::wake::stop::StopHandle;
use crate::name::append_number;
use crate::platform::{Dump, chain, recorder};
use crate::process::DiagnosticsChoice;
use crate::sync::Arc;
use alloc::string::String;
use alloc::vec::Vec;
use core::fmt;
use core::time::Duration;
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
    pub(crate) context: Context,
    pub(crate) workers: Unstarted,
    pub(crate) stop: StopHandle,
    pub(crate) options: Options,
}

/// Everything that can be set besides workers.
pub(crate) struct Options {
    pub(crate) dispatcher: Option<Policy>,
    pub(crate) dispatcher_cpu: Option<usize>,
    pub(crate) enforcer_priority: u8,
    pub(crate) server: Kind,
    pub(crate) strict: bool,
    #[allow(dead_code, reason = "there is nothing in it without feature `plan`")]
    pub(crate) planning: Planning,
    /// `None`: the program stays in memory where there is a budget.
    pub(crate) lock_memory: Option<bool>,
    pub(crate) switch_log: bool,
    pub(crate) stop_grace: Duration,
    pub(crate) recorder: recorder::Settings,
    pub(crate) chains: chain::Requested,
    #[allow(dead_code, reason = "nobody reads it without feature `std`")]
    pub(crate) diagnostics: DiagnosticsChoice,
    pub(crate) events: Arc<Events>,
}

impl Executor {
    /// An executor without workers over `context`.
    pub fn new(context: &Context) -> Self {
        let stop = StopHandle::new(context.share_middleware());
        Self {
            context: context.clone(),
            workers: Unstarted::new(context.share_middleware()),
            stop,
            options: Options {
                dispatcher: None,
                dispatcher_cpu: None,
                enforcer_priority: 99,
                server: Kind::Corrected,
                strict: false,
                planning: Planning::default(),
                lock_memory: None,
                switch_log: true,
                stop_grace: Duration::from_millis(120),
                recorder: recorder::Settings::default(),
                chains: chain::Requested::default(),
                diagnostics: Default::default(),
                events: Arc::new(Events::default()),
            },
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

    /// Selects the server that holds the budgets. Default: the corrected sporadic server.
    pub fn server(&mut self, kind: Kind) -> &mut Self {
        self.options.server = kind;
        self
    }

    /// `true`: a policy or a budget that cannot be granted is an error when the executor starts.
    /// `false`, the default: the executor falls back, reports it once and keeps it in the report.
    pub fn strict(&mut self, strict: bool) -> &mut Self {
        self.options.strict = strict;
        self
    }

    /// Whether the process's memory is locked.
    ///
    /// `true`: all of it, and the threads' stacks are touched before the first callback, so that
    /// callbacks meet no page fault. `false`: nothing; a budget may end late while the kernel reads
    /// a page of the program back from the disk.
    ///
    /// Default: in an executor with a budget, the program and its libraries stay in memory, and
    /// nothing else is locked. If the limit of locked memory forbids that, the executor falls back,
    /// also with [`strict`](Self::strict). It reports that once and keeps it in the report.
    pub fn lock_memory(&mut self, lock: bool) -> &mut Self {
        self.options.lock_memory = Some(lock);
        self
    }

    /// Whether the enforcers read the kernel's context-switch records to see callbacks that block.
    /// Without them budgets hold, and come back later. Default: yes.
    pub fn switch_log(&mut self, on: bool) -> &mut Self {
        self.options.switch_log = on;
        self
    }

    /// Bytes of memory in which each thread of this executor records its last events, 4096 to
    /// 64 MiB: an event takes 32 bytes, a message about five events. 0: nothing is recorded.
    /// Default: 256 KiB, on Linux; other systems record nothing.
    ///
    /// `replenish top` and `replenish trace` read it while the program runs, and after it was
    /// killed. It stands in a file of the ledger's directory if that is in memory, else in
    /// `/dev/shm/replenish-UID`; `REPLENISH_LIVE` names another directory, or is `off`. The start
    /// fails with the reason if the memory cannot be had.
    pub fn recorder(&mut self, bytes: usize) -> &mut Self {
        self.options.recorder.bytes = bytes;
        self
    }

    /// Writes the recording to a file when something goes wrong: see [`Dump`]. Default: nothing is
    /// written, and the recording goes with the executor.
    pub fn dump(&mut self, dump: Dump) -> &mut Self {
        self.options.recorder.dump = Some(dump);
        self
    }

    /// Time for callbacks that run at a stop to finish. A thread that runs longer is reported as
    /// stuck, demoted to time sharing and left behind. Default: 120 ms, so that a stop takes less
    /// than 200 ms even when the kernel delays real-time threads meanwhile.
    pub fn stop_grace(&mut self, grace: Duration) -> &mut Self {
        self.options.stop_grace = grace;
        self
    }

    /// Sets the function that gets each [`Event`], on the thread on which it happens. Default: with
    /// feature `log` the program's logger (target `replenish`), else one line each on standard
    /// error.
    pub fn on_event(&mut self, hook: impl Fn(&Event<'_>) + Send + Sync + 'static) -> &mut Self {
        self.options.events = Arc::new(Events::new(hook));
        self
    }

    /// Stops this executor from anywhere, also before it has started.
    #[must_use]
    pub fn stop_handle(&self) -> StopHandle {
        self.stop.clone()
    }

    /// `id`, or `id#2`, `id#3`, … if it is taken.
    pub(crate) fn unique(&self, mut id: String) -> String {
        let (stem, mut number) = (id.len(), 2);
        while self.is_taken(&id) {
            id.truncate(stem);
            id += "#";
            append_number(&mut id, number);
            number += 1;
        }
        id
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
