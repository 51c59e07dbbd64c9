//! The content of a deployment file, and the planner's request for it.

use super::error::{FileError, Source};
use super::program::Program;
use crate::{
    ExecutorRequest, Machine, Nanos, Overheads, Plan, Promise, Refusal, Request, Requirement,
};
use replenish_sim::analysis::Demand;
use replenish_sim::{Overflow, Releases, Span};
use std::ops::Range;

/// The most rounds through the chains; each round adds the lateness of a stage.
const MAX_ROUNDS: usize = 32;

/// A deployment file that was read and makes sense by itself.
#[derive(Debug, Clone)]
pub struct Deployment {
    /// The CPUs and costs to plan with.
    pub machine: Machine,
    /// The executor's own thread.
    pub executor: ExecutorRequest,
    /// The workers, in the order of the file.
    pub workers: Vec<Described>,
    /// Chains of workers.
    pub chains: Vec<Chain>,
    /// Programs of others whose threads have budgets.
    pub programs: Vec<Program>,
    /// The names of locks.
    pub locks: Vec<String>,
    /// Whether the file states the machine's CPUs.
    pub machine_given: bool,
    /// Overheads that the machine section states, in their order.
    pub(super) overheads_given: [bool; 9],
    pub(super) source: Source,
}

/// One worker of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Described {
    /// Its name.
    pub name: String,
    /// The ids of its handles.
    pub handles: Vec<String>,
    /// Its CPU.
    pub cpu: Option<usize>,
    /// Its requested scheduling; `None`: the file does not say (time-shared, or as the program
    /// says).
    pub scheduling: Option<Requirement>,
    /// The worker's load.
    pub load: Load,
    pub(super) place: Range<usize>,
    pub(super) handle_places: Vec<Range<usize>>,
}

/// A worker's load, for the simulator and for bounds.
#[derive(Debug, Clone, PartialEq)]
pub struct Load {
    /// CPU time of one callback; `None`: not stated.
    pub runs: Option<Span>,
    /// Time that each callback blocks, before it runs.
    pub blocks: Option<Span>,
    /// Releases of callbacks; `None`: not stated.
    pub releases: Option<Releases>,
    /// The most releases that wait.
    pub queue: usize,
    /// The release that is lost when too many wait.
    pub overflow: Overflow,
    /// Workers that each callback releases at its end.
    pub sends: Vec<usize>,
    /// Locks that each callback takes, one after another, and for how long it holds them: places in
    /// [`Deployment::locks`]. `None`: not stated; it holds the lock while it runs.
    pub locks: Vec<(usize, Option<Nanos>)>,
    /// Time after the release by which its callbacks must end, if it has no guarantee.
    pub deadline: Option<Nanos>,
}

/// Workers that hand on a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Chain {
    /// Its name.
    pub name: String,
    /// The workers, first to last, by their place in [`Deployment::workers`].
    pub workers: Vec<usize>,
    /// Deadline from the first release to the end of the last callback.
    pub deadline: Option<Nanos>,
}

impl Deployment {
    /// The request for [`plan`](crate::plan()): the workers, and behind them the budgets of
    /// programs.
    #[must_use]
    pub fn request(&self) -> Request {
        let worker = |described: &Described| crate::Worker {
            name: described.name.clone(),
            scheduling: described
                .scheduling
                .clone()
                .unwrap_or(Requirement::Policy(sporadic::Policy::Other)),
            cpu: described.cpu,
            demand: self.demand(described),
            holds: described.holds(),
            deadline: described.load.deadline,
            late: 0,
        };
        let cpus = &self.machine.cpus;
        let foreign = self.programs.iter().flat_map(|p| p.workers(p.place(cpus)));
        Request {
            machine: self.machine.clone(),
            workers: self.workers.iter().map(worker).chain(foreign).collect(),
            executor: self.executor.clone(),
            promised: Vec::new(),
            locks: self.locks.clone(),
        }
    }

    /// Plans for these CPUs if the file does not say which there are.
    ///
    /// # Errors
    /// The first worker that is pinned to another one.
    pub fn on_host(&mut self, cpus: Vec<usize>) -> Result<(), FileError> {
        if self.machine_given {
            return Ok(());
        }
        let elsewhere = |w: &Described| w.cpu.is_some_and(|cpu| !cpus.contains(&cpu));
        if let Some(worker) = self.workers.iter().position(elsewhere) {
            let message = format!("its cpu: allowed {cpus:?}, the CPUs of this host");
            return Err(self.error_at_worker(worker, &message));
        }
        let elsewhere = |p: &&Program| p.cpu.is_some_and(|cpu| !cpus.contains(&cpu));
        if let Some(program) = self.programs.iter().find(elsewhere) {
            let message = format!("its cpu: allowed {cpus:?}, the CPUs of this host");
            return Err(self.source.error(&program.place, message));
        }
        self.machine.cpus = cpus;
        Ok(())
    }

    /// Counts with these overheads where the file does not say others.
    pub fn measured(&mut self, overheads: &Overheads) {
        let own = self.machine.overheads.all_mut().into_iter();
        for ((own, measured), given) in own.zip(overheads.all()).zip(self.overheads_given) {
            if !given {
                *own = measured;
            }
        }
    }

    /// Makes the plan.
    ///
    /// # Errors
    /// As [`plan`](crate::plan()), and if a chain takes longer than its deadline.
    pub fn plan(&self) -> Result<Plan, Refusal> {
        self.plan_beside(&[])
    }

    /// Makes the plan beside what other programs have been promised.
    ///
    /// # Errors
    /// As [`plan`](Self::plan).
    pub fn plan_beside(&self, promised: &[Promise]) -> Result<Plan, Refusal> {
        let mut request = self.request();
        request.promised = promised.to_vec();
        let mut plan = crate::plan(&request)?;
        // The delay of a stage's release depends on the stages before it, which may depend on it:
        // until nothing changes (TC94). Never back, so that it comes to an end.
        let mut changed = !self.chains.is_empty();
        for _ in 0..MAX_ROUNDS {
            changed = false;
            for (worker, late) in request.workers.iter_mut().zip(self.lateness(&plan)) {
                changed |= late > worker.late;
                worker.late = late.max(worker.late);
            }
            if !changed {
                break;
            }
            plan = crate::plan(&request)?;
        }
        if changed {
            return Err(Refusal::unsettled());
        }
        plan.chains = self.chains(&plan);
        match self.late_chain(&plan) {
            Some(refusal) => Err(refusal),
            None => Ok(plan),
        }
    }

    /// A worker's known demand.
    fn demand(&self, described: &Described) -> Option<Demand> {
        let load = &described.load;
        let (period, jitter) = match &load.releases {
            Some(Releases::Periodic { period, jitter, .. }) => (*period, *jitter),
            Some(Releases::Sporadic { gap, .. }) => (gap.min().max(1), 0),
            _ => match &described.scheduling {
                Some(Requirement::Guarantee(g)) if g.is_rate() => (g.period(), 0),
                _ => return None,
            },
        };
        let held: Nanos = load.locks.iter().filter_map(|(_, holds)| *holds).sum();
        let cost = match (&load.runs, &described.scheduling) {
            (Some(runs), _) => runs.max(),
            (None, Some(Requirement::Guarantee(g))) => g.amount(),
            (None, _) => return None,
        };
        Some(Demand {
            cost: cost.saturating_add(held).max(1),
            period,
            jitter,
            suspensions: u32::from(load.blocks.is_some()),
            suspended: load.blocks.as_ref().map_or(0, Span::max),
        })
    }

    /// An error at the place of a worker.
    #[must_use]
    pub fn error_at_worker(&self, worker: usize, message: &str) -> FileError {
        let place = self.workers.get(worker).map_or(0..0, |w| w.place.clone());
        self.source.error(&place, message)
    }

    /// An error at the place of a handle's id.
    #[must_use]
    pub fn error_at_handle(&self, worker: usize, handle: usize, message: &str) -> FileError {
        let places = self.workers.get(worker).map(|w| w.handle_places.as_slice());
        let place = places.and_then(|p| p.get(handle)).cloned();
        self.source.error(&place.unwrap_or(0..0), message)
    }
}
