//! An executor without threads: the thread that spins it runs its callbacks, one after another.
//!
//! ```text
//!   ┌─► take what has come (the middleware's wait ends at once)
//!   │   workers in the order they were described: a round each, by its own rules; between two
//!   │   callbacks what came meanwhile is taken, but for Logical Execution Time
//!   │   nothing ran? wait for data, a release, a guard condition, a change, the limit
//!   └───┘
//! ```
//!
//! All waiting is one wait on the middleware with an absolute time of the monotonic clock in
//! nanoseconds: a limit of 200 us is 200 us, and no limit, however short, becomes a busy loop.

use super::assembly::{Assembly, assemble};
use super::report::{DispatcherReport, HandleReport, Report};
use super::{launch, planning};
use crate::Nanos;
use crate::context::Claim;
use crate::error::Error;
use crate::executor::change::live::Live;
use crate::executor::describe::executor::Executor;
use crate::executor::run::accounting::CpuAccounting;
use crate::executor::run::dispatcher::{Dispatcher, Watch};
use crate::executor::run::request::WorkerRequest;
use crate::executor::run::round_stats::{RoundStats, WorkerRounds};
use crate::executor::run::state::Worker;
use crate::executor::wake::schedule::{Every, Schedule, nanos};
use crate::executor::wake::stop::StopHandle;
use crate::platform::Static;
use crate::process::{Chains, follow_clock, start_chains};
use crate::stats::HandleStats;
use crate::sync::Arc;
use alloc::boxed::Box;
use alloc::vec::Vec;
use core::fmt;
use core::marker::PhantomData;
use core::time::Duration;
use replenish_os::{Account, clock};

impl Executor {
    /// Without threads: the handles run on the calling thread whenever it spins the result, in a
    /// fixed order. Workers are then groups of handles with rules of their own.
    ///
    /// # Errors
    /// As [`start`](Self::start); [`Error::Parameter`] for a worker that was given a policy, a
    /// budget, a guarantee, a CPU or a stack, and for an executor that was given a dispatcher's
    /// policy or CPU, or memory to lock. Workers without handles are all right.
    pub fn local(self) -> Result<LocalExecutor, Error> {
        let options = &self.options;
        let asked = [
            ("dispatcher", options.dispatcher.is_some()),
            ("dispatcher_cpu", options.dispatcher_cpu.is_some()),
            ("lock_memory", options.lock_memory == Some(true)),
        ];
        if let Some((field, _)) = asked.iter().find(|(_, asked)| *asked) {
            let allowed = "none in Executor::local: the thread that spins is yours";
            return Err(Error::parameter("executor", field, &"set", allowed));
        }
        local(self)
    }
}

/// Reason why a spin returned.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum SpinEnd {
    /// The spin has done its work: a round, a period.
    Worked,
    /// The time was over.
    TimedOut,
    /// A stop was requested.
    Stopped,
}

/// The result of a spin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct SpinResult {
    /// Callbacks that ran.
    pub callbacks: u64,
    /// Releases of [`spin_period`](LocalExecutor::spin_period) that were left out because they were
    /// overrun.
    pub skipped: u64,
    /// The reason why it returned.
    pub end: SpinEnd,
}

/// An executor whose callbacks run on the thread that spins it, which is the one that made it.
/// That thread keeps the scheduling it has.
///
/// Triggers, order, semantics, output barriers, deadlines and counters are those of a
/// [worker](Executor::worker); several workers take turns in the order they were described. A
/// handle that is due in a round gets what came while earlier callbacks of the round ran, unless
/// its worker has Logical Execution Time. With [`Trigger::Always`](crate::Trigger::Always)
/// each spin begins a round, and so does all that comes while it spins: no clock is needed. After
/// it is made nothing allocates. Timers count from when it is made. Between two spins nothing
/// happens: samples wait in the middleware.
///
/// ```
/// use replenish::{Context, Every, Executor, SpinEnd};
/// use std::time::Duration;
/// let ctx = Context::in_process();
/// let mut exec = Executor::new(&ctx);
/// let once = Every::once(Duration::from_millis(2));
/// exec.worker("all").timer(once, |_| println!("tick"))?;
/// let mut local = exec.local()?;
/// let first = local.spin_some(Duration::from_secs(1));
/// assert_eq!((first.callbacks, first.end), (1, SpinEnd::Worked));
/// let nothing = local.spin_some(Duration::from_micros(100));
/// assert_eq!((nothing.callbacks, nothing.end), (0, SpinEnd::TimedOut));
/// # Ok::<(), replenish::Error>(())
/// ```
pub struct LocalExecutor {
    account: Account,
    dispatcher: Dispatcher,
    watch: Watch,
    workers: Vec<Static<Box<Worker>>>,
    pub(super) live: Arc<Live>,
    chains: Chains,
    stop: StopHandle,
    period: Option<(Every, Schedule)>,
    start: Nanos,
    _claim: Claim,
    /// Its account is that of one thread.
    _here: PhantomData<*const ()>,
}

fn local(mut executor: Executor) -> Result<LocalExecutor, Error> {
    follow_clock(&mut executor)?;
    planning::prepare(&mut executor)?;
    let Executor {
        context,
        mut workers,
        stop,
        options,
    } = executor;
    launch::check_names(&workers)?;
    for spec in workers.iter_mut() {
        threadless(&spec.request)?;
        spec.rules.spun = true;
        spec.check_rules()?;
    }
    let chains = start_chains(&options.chains, &mut workers)?;
    let claim = context.claim(&stop).ok_or(Error::ContextBusy)?;
    // The dispatcher has no bells: no thread sleeps on them while samples are taken, and ringing
    // would end the next wait for nothing.
    let Assembly {
        dispatcher,
        mut workers,
        live,
    } = assemble(&context, workers.begin(), &stop, &options.events);
    let start = clock::monotonic();
    for worker in &mut workers {
        worker.bell.forward_to(context.middleware());
        worker.begin(start);
    }
    Ok(LocalExecutor {
        account: Account::unbudgeted(),
        watch: dispatcher.watch(),
        dispatcher,
        workers,
        live,
        chains,
        stop,
        period: None,
        start,
        _claim: claim,
        _here: PhantomData,
    })
}

/// Refuses requests that only a thread of the worker's own could fulfil.
fn threadless(request: &WorkerRequest) -> Result<(), Error> {
    let asked = [
        ("policy", request.policy.is_some()),
        ("budget", request.budget.is_some()),
        ("guarantee", request.guarantee.is_some()),
        ("cpu", request.cpu.is_some()),
        ("stack_size", request.stack_size.is_some()),
    ];
    match asked.iter().find(|(_, asked)| *asked) {
        None => Ok(()),
        Some((field, _)) => {
            let allowed = "none in Executor::local: the thread that spins keeps its own scheduling";
            Err(Error::parameter(request.owner(), field, &"set", allowed))
        }
    }
}

impl LocalExecutor {
    /// Runs callbacks until the executor is stopped. Each spin after that returns `Stopped` at
    /// once, until [`restart`](Self::restart).
    pub fn spin(&mut self) -> SpinResult {
        self.turn(Nanos::MAX, &mut || true, false)
    }

    /// Waits up to `limit` until there is something to do, and does one round of it: each handle's
    /// callback runs at most once (or as often as
    /// [`messages_per_round`](crate::WorkerBuilder::messages_per_round) says). With a limit of 0 it
    /// does what is there and does not wait.
    pub fn spin_some(&mut self, limit: Duration) -> SpinResult {
        let deadline = clock::monotonic().saturating_add(nanos(limit));
        self.turn(deadline, &mut || true, true)
    }

    /// Runs callbacks for this long. The callback that runs at the end is finished, so what it
    /// takes comes on top.
    pub fn spin_for(&mut self, time: Duration) -> SpinResult {
        self.spin_until(clock::monotonic().saturating_add(nanos(time)))
    }

    /// Runs callbacks until this instant of `CLOCK_MONOTONIC`, as
    /// [`spin_for`](Self::spin_for) does.
    pub fn spin_until(&mut self, instant: Nanos) -> SpinResult {
        self.turn(instant, &mut || true, false)
    }

    /// Runs callbacks while `condition` holds, for up to `limit`. The condition is looked at after
    /// each round and whenever a wait has ended. `Worked`: it does not hold any more.
    pub fn spin_while(
        &mut self,
        limit: Duration,
        mut condition: impl FnMut() -> bool,
    ) -> SpinResult {
        let deadline = clock::monotonic().saturating_add(nanos(limit));
        self.turn(deadline, &mut condition, false)
    }

    /// Runs one round per period, on an absolute grid that begins with the first call, until the
    /// executor is stopped. Rounds that are overrun follow the rule of `every`: skipped (default),
    /// caught up one after another, or delayed, which moves the grid. With [`Every::once`] it runs
    /// one round; a period of 0 counts as 1 ns.
    pub fn spin_period(&mut self, every: impl Into<Every>) -> SpinResult {
        let every = every.into();
        let mut total = self.spin_one_period(every);
        while total.end == SpinEnd::Worked && !every.once {
            let one = self.spin_one_period(every);
            total = SpinResult {
                callbacks: total.callbacks + one.callbacks,
                skipped: total.skipped + one.skipped,
                end: one.end,
            };
        }
        total
    }

    /// Waits for the next release of the grid that [`spin_period`](Self::spin_period) describes,
    /// and does one round over what has come. Another `every` begins another grid.
    pub fn spin_one_period(&mut self, every: impl Into<Every>) -> SpinResult {
        let every = every.into();
        let began = clock::monotonic();
        let mut grid = match self.period {
            Some((known, grid)) if known == every => grid,
            _ => {
                let first = began.saturating_add(nanos(every.first_after));
                Schedule::new(first, nanos(every.period), every.overrun)
            }
        };
        self.account.activate(began);
        let accounting = CpuAccounting::new(self.account.meter());
        let before = self.ran();
        self.bring(0);
        let mut released = None;
        while released.is_none() && !self.stop.is_stopping() {
            released = grid.serve(clock::monotonic());
            match released {
                Some(_) => drop(self.pass(&accounting)),
                None => self.bring(grid.next()),
            }
        }
        self.account.block();
        self.period = Some((every, grid));
        SpinResult {
            callbacks: self.ran() - before,
            skipped: released.map_or(0, |r| r.skipped),
            end: if self.stop.is_stopping() {
                SpinEnd::Stopped
            } else {
                SpinEnd::Worked
            },
        }
    }

    /// Takes back all stops so far, so that it can be spun again: handles, counters and what waits
    /// are as the last spin left them, and the [`StopHandle`]s stop it as before. Of timers and
    /// [`spin_period`](Self::spin_period) what was due meanwhile is overrun, and follows their
    /// rule.
    pub fn restart(&mut self) {
        self.stop.stop.withdraw();
    }

    /// Stops this executor from anywhere.
    #[must_use]
    pub fn stop_handle(&self) -> StopHandle {
        self.stop.clone()
    }

    /// The counters of one handle. Does not allocate.
    #[must_use]
    pub fn stats(&self, id: &str) -> Option<HandleStats> {
        let (_, handle) = self.live.registry.find(id)?;
        Some(handle.stats(&*self.dispatcher.middleware))
    }

    /// The rounds of a worker that begin by the clock
    /// ([`WorkerBuilder::every`](crate::WorkerBuilder::every)). Does not allocate.
    #[must_use]
    pub fn rounds(&self, worker: &str) -> Option<RoundStats> {
        self.counted().find_map(|r| r.stats_of(worker))
    }

    fn counted(&self) -> impl Iterator<Item = WorkerRounds> {
        self.workers.iter().filter_map(|w| w.spec.counted_rounds())
    }

    /// The numbers at this moment; there are no threads among them. Allocates.
    #[must_use]
    pub fn report(&self) -> Report {
        let handles = self.live.registry.all();
        let handles = handles.iter();
        let Dispatcher {
            counters,
            middleware,
            ..
        } = &self.dispatcher;
        Report {
            elapsed: clock::monotonic().saturating_sub(self.start),
            threads: Vec::new(),
            handles: handles
                .map(|(w, h)| HandleReport::of(w, h, &**middleware))
                .collect(),
            rounds: self.counted().map(|rounds| rounds.report()).collect(),
            dispatcher: DispatcherReport::of(counters),
            enforcers: Vec::new(),
            fallbacks: Vec::new(),
            chains: self.chains.report(),
            admission: crate::executor::describe::planning::AdmissionReport::default(),
            stuck: Vec::new(),
        }
    }

    /// Callbacks that ran so far.
    fn ran(&self) -> u64 {
        self.workers.iter().map(|w| w.ran).sum()
    }

    /// Takes what has come, and waits for it up to `until`.
    fn bring(&mut self, until: Nanos) {
        let Self {
            dispatcher,
            watch,
            account,
            ..
        } = self;
        let until = (until != Nanos::MAX).then_some(until);
        dispatcher.round(watch, account, until);
    }

    /// Every worker in its turn; whether there may be more to do without new input.
    fn pass(&mut self, accounting: &CpuAccounting) -> bool {
        let Self {
            dispatcher,
            watch,
            workers,
            account,
            stop,
            ..
        } = self;
        let (mut any, mut taken) = (false, false);
        let mut intake = |account: &mut Account| {
            taken = true;
            dispatcher.round(watch, account, Some(0));
        };
        for worker in workers.iter_mut() {
            if stop.is_stopping() {
                break;
            }
            worker.empty_mailbox(account, accounting);
            any |= worker.step_with(account, accounting, &mut intake) && worker.may_go_on();
        }
        // Taking the samples may have rung a worker after its turn.
        any || taken && workers.iter_mut().any(|worker| worker.may_have_been_rung())
    }

    fn turn(
        &mut self,
        deadline: Nanos,
        condition: &mut dyn FnMut() -> bool,
        one: bool,
    ) -> SpinResult {
        self.account.activate(clock::monotonic());
        let accounting = CpuAccounting::new(self.account.meter());
        let before = self.ran();
        self.bring(0);
        let end = loop {
            if self.stop.is_stopping() {
                break SpinEnd::Stopped;
            }
            let any = self.pass(&accounting);
            if self.stop.is_stopping() {
                break SpinEnd::Stopped;
            }
            if (one && self.ran() > before) || !condition() {
                break SpinEnd::Worked;
            }
            if deadline != Nanos::MAX && clock::monotonic() >= deadline {
                break SpinEnd::TimedOut;
            }
            let wake = if any {
                0
            } else {
                let releases = self.workers.iter_mut().filter_map(|w| w.next_wake());
                releases.min().unwrap_or(Nanos::MAX).min(deadline)
            };
            self.bring(wake);
        };
        self.account.block();
        SpinResult {
            callbacks: self.ran() - before,
            skipped: 0,
            end,
        }
    }
}

impl Drop for LocalExecutor {
    fn drop(&mut self) {
        self.stop.stop(); // what is asked of it from now on is declined
        let accounting = CpuAccounting::new(self.account.meter());
        for worker in &mut self.workers {
            worker.end(&mut self.account, &accounting);
        }
        self.dispatcher.update(&mut self.watch);
        self.live.end(false);
    }
}

impl fmt::Debug for LocalExecutor {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LocalExecutor")
            .field("stop", &self.stop)
            .finish_non_exhaustive()
    }
}
