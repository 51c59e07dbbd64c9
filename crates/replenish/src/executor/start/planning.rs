//! The executor's planning: guarantees, admission, deployment files, the host's ledger. Feature
//! `plan`; `planning_disabled` replaces it.

pub(crate) use super::admission::admit;
use super::overlay;
use super::running::StartedThread;
use crate::error::Error;
use crate::executor::describe::builder::WorkerBuilder;
use crate::executor::describe::executor::{Executor, Options};
use crate::executor::describe::planning::{Admission, LedgerUse};
use crate::executor::run::guarantee::adoption::{Adopted, Adoption};
use crate::executor::run::request::WorkerRequest;
use alloc::string::{String, ToString};
use core::time::Duration;
use replenish_plan::ledger::{Found, Ledger};
use replenish_plan::{Guarantee, Machine};
use sporadic::Budget;
use std::path::PathBuf;

impl WorkerRequest {
    /// The guarantee to plan for it; `None`: it has a policy, or nothing.
    pub(crate) fn wants(&self) -> Option<Guarantee> {
        match self.policy {
            Some(_) => None,
            None => self.guarantee.or(self.budget.map(Guarantee::from)),
        }
    }
}

impl LedgerUse {
    /// The directory for reservations, whether it holds any or not.
    fn directory(&self) -> Option<PathBuf> {
        match self {
            Self::At(directory) => Some(directory.clone()),
            Self::Off => None,
            Self::Default => match Ledger::look() {
                Ok(Found::Here(ledger)) => Some(ledger.directory().into()),
                _ => None,
            },
        }
    }
}

/// Applies the deployment files; the file that describes what came of it.
pub(crate) fn prepare(executor: &mut Executor) -> Result<String, Error> {
    overlay::apply_all(executor)?;
    let options = &mut executor.options;
    options.recorder.ledger = options.planning.ledger.directory();
    let template = executor.template();
    overlay::hand_out(&template)?;
    Ok(template)
}

/// Starts to hold the budgets of threads that others have started, and finds those that run
/// already.
pub(crate) fn adopt(
    admission: &mut Admission,
    options: &Options,
    threads: &[StartedThread],
) -> Result<(), Error> {
    let adopted = &options.planning.adopted;
    if adopted.is_empty() {
        return Ok(());
    }
    let own = threads.iter().map(StartedThread::tid).collect();
    let refused = match Adoption::start(adopted, options.enforcer_priority, own) {
        Ok(adoption) => {
            admission.adoption = Some(adoption);
            return Ok(());
        }
        Err(reason) => reason,
    };
    let patterns: Vec<&str> = adopted.iter().map(|a| a.pattern.as_str()).collect();
    let what = alloc::format!("budgets for threads {}", patterns.join(", "));
    if options.strict {
        let reason = refused.to_string();
        return Err(Error::NotGranted { what, reason });
    }
    let mut fallback = admission.fallback.take().unwrap_or_default();
    if !fallback.is_empty() {
        fallback.push_str("; ");
    }
    fallback.push_str(&alloc::format!("no {what}: {refused}"));
    admission.fallback = Some(fallback);
    Ok(())
}

impl Executor {
    /// Gives one shared budget to threads of this process that other code has started, a middleware
    /// or a library. `pattern` is for their names: `*` stands for any characters, `?` for one. The
    /// first of several patterns that fits counts.
    ///
    /// The budget is admitted like a guarantee. The threads run on one CPU, and without budget in
    /// the time-sharing class. An ordinary thread looks for new ones every 100 ms. Threads of this
    /// executor and threads with a real-time priority of their own are left as they are. When the
    /// executor ends, the threads get back what they had before. Linux; a
    /// [`LocalExecutor`](crate::LocalExecutor) adopts no threads.
    ///
    /// ```
    /// # use replenish::{Budget, Context, Executor};
    /// # use std::time::Duration;
    /// # let mut exec = Executor::new(&Context::in_process());
    /// let ms = Duration::from_millis;
    /// exec.adopt("dds.*", Budget::of(ms(2)).every(ms(10)));
    /// ```
    pub fn adopt(&mut self, pattern: impl Into<String>, budget: Budget) -> &mut Self {
        let pattern = pattern.into();
        self.options
            .planning
            .adopted
            .push(Adopted::new(pattern, budget));
        self
    }

    /// Sets whether guarantees are planned and tested before anything starts (default), together
    /// with the promises to other programs on this host. `false`: budgets get priorities by their
    /// periods, and nothing checks whether they fit.
    pub fn admission(&mut self, on: bool) -> &mut Self {
        self.options.planning.admission = on;
        self
    }

    /// Guarantees that a chain takes no longer than `limit`, and measures it as
    /// [`chain`](Self::chain) does.
    ///
    /// The bound is the sum of its workers' worst responses in the plan. Each has a
    /// [`Guarantee`] with a rate and an execution time, [`Guarantee::at`], at least as often as the
    /// stage before it publishes. A later stage without a subscription takes up its input by the
    /// clock: a period of its guarantee is added. The executor does not start where the bound is
    /// longer than `limit`: [`Error::NotAdmitted`] says which worker takes most of it.
    /// [`ChainReport::bound`](crate::ChainReport::bound) has the bound beside what was measured.
    ///
    /// ```
    /// # use replenish::{Context, Executor};
    /// # use std::time::Duration;
    /// # let mut exec = Executor::new(&Context::in_process());
    /// let limit = Duration::from_millis(20);
    /// exec.guarantee_chain("brake", ["camera/timer:0", "/detect/sub:/image", "brakes"], limit);
    /// ```
    pub fn guarantee_chain<S: Into<String>>(
        &mut self,
        name: impl AsRef<str>,
        stages: impl IntoIterator<Item = S>,
        limit: Duration,
    ) -> &mut Self {
        self.chain(name, stages, limit);
        self.options.chains.promise();
        self
    }

    /// The directory in which programs on this host reserve CPU time, instead of the default:
    /// what `REPLENISH_LEDGER` names, else `/run/replenish`, else `$XDG_RUNTIME_DIR/replenish`.
    pub fn ledger(&mut self, directory: impl Into<PathBuf>) -> &mut Self {
        self.options.planning.ledger = LedgerUse::At(directory.into());
        self
    }

    /// Neither sees what other programs have reserved nor tells them.
    pub fn no_ledger(&mut self) -> &mut Self {
        self.options.planning.ledger = LedgerUse::Off;
        self
    }

    /// The CPUs that the plan may use, and the overheads it counts with. Default: the CPUs this
    /// process may use, the kernel's facts about them, and the overheads that
    /// `replenish doctor --save` has measured on this host, or
    /// [`Overheads::LINUX`](replenish_plan::Overheads).
    pub fn machine(&mut self, machine: Machine) -> &mut Self {
        self.options.planning.machine = Some(machine);
        self
    }

    /// A deployment file that sets or overrides the scheduling of workers and handles when the
    /// executor starts. Several are applied in order, and the one that the environment variable
    /// `REPLENISH_OVERLAY` names comes last.
    pub fn overlay(&mut self, file: impl Into<PathBuf>) -> &mut Self {
        self.options.planning.overlays.push(file.into());
        self
    }

    /// The deployment file that describes this executor as it is so far.
    #[must_use]
    pub fn template(&self) -> String {
        overlay::template(&self.workers)
    }
}

impl WorkerBuilder<'_> {
    /// The worker's guarantee: CPU time per period, or callbacks at a rate; with a deadline, an
    /// importance, a minimum and a desired amount, as you like. The executor chooses priority,
    /// background, CPU and number of replenishments, and does not start where it cannot keep the
    /// promise.
    pub fn guarantee(self, guarantee: impl Into<Guarantee>) -> Self {
        self.request(|r| r.guarantee = Some(guarantee.into()))
    }
}
