//! The executor's planning: guarantees, admission, deployment files, the host's ledger. Feature
//! `plan`; `planning_disabled` replaces it.

pub(crate) use super::admission::admit;
use super::overlay;
use crate::error::Error;
use crate::executor::describe::builder::WorkerBuilder;
use crate::executor::describe::executor::Executor;
use crate::executor::describe::planning::LedgerUse;
use crate::executor::run::request::WorkerRequest;
use alloc::string::String;
use replenish_plan::{Guarantee, Machine};
use std::path::PathBuf;

impl WorkerRequest {
    /// What is to be planned for it; `None`: it has a policy, or nothing.
    pub(crate) fn wants(&self) -> Option<Guarantee> {
        match self.policy {
            Some(_) => None,
            None => self.guarantee.or(self.budget.map(Guarantee::from)),
        }
    }
}

/// Applies the deployment files; the file that describes what came of it.
pub(crate) fn prepare(executor: &mut Executor) -> Result<String, Error> {
    overlay::apply_all(executor)?;
    Ok(executor.template())
}

impl Executor {
    /// Whether guarantees are planned and tested before anything starts (default), together with
    /// what other programs on this host were promised. `false`: budgets get priorities by their
    /// periods, and nobody checks whether they fit.
    pub fn admission(&mut self, on: bool) -> &mut Self {
        self.options.planning.admission = on;
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

    /// What the plan may use, and the overheads it counts with. Default: the CPUs this process may
    /// use, what the kernel says about them, and the overheads that `replenish doctor --save` has
    /// measured on this host, or [`Overheads::LINUX`](replenish_plan::Overheads).
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
    /// What the worker is guaranteed: CPU time per period, or callbacks at a rate; with a deadline,
    /// an importance, a minimum and a desired amount, as you like. The executor chooses priority,
    /// background, CPU and number of replenishments, and does not start where it cannot keep the
    /// promise.
    pub fn guarantee(self, guarantee: impl Into<Guarantee>) -> Self {
        self.request(|r| r.guarantee = Some(guarantee.into()))
    }
}
