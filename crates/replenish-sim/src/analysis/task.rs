//! A system as the analysis sees it.

use crate::Nanos;
use sporadic::{Low, Params, Tuning};

/// One thread on the CPU that is analysed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Task {
    /// Its scheduling.
    pub scheduling: Scheduling,
    /// The demand of its jobs; `None`: unknown, so a reservation may use all of its budget, and
    /// nothing below an unlimited thread has a bound.
    pub demand: Option<Demand>,
    /// The locks each of its jobs takes.
    pub sections: Vec<Section>,
}

/// Scheduling of a thread. Larger priorities are more urgent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scheduling {
    /// At one priority for ever.
    Fifo(u8),
    /// In a reservation with the corrected sporadic server.
    Reserved(Params),
}

/// Jobs with a least distance from each other and a largest length.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Demand {
    /// The largest CPU time of one job.
    pub cost: Nanos,
    /// The smallest distance of two arrivals, at least 1.
    pub period: Nanos,
    /// The largest delay from arrival to release. Responses count from the arrival.
    pub jitter: Nanos,
    /// The most times that one job blocks (sleeps, service calls), locks not counted.
    pub suspensions: u32,
    /// The longest time that one job blocks in all, in ns.
    pub suspended: Nanos,
}

impl Demand {
    /// Jobs without jitter that never block.
    pub const fn new(cost: Nanos, period: Nanos) -> Self {
        Self {
            cost,
            period,
            jitter: 0,
            suspensions: 0,
            suspended: 0,
        }
    }
}

/// A stretch during which a job holds a lock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Section {
    /// Number of the lock. All users of a lock must be on the CPU that is analysed.
    pub lock: usize,
    /// CPU time, that of locks taken inside included. Blocking inside is not covered.
    pub length: Nanos,
}

/// Overheads and delays of the platform, the counterpart of [`Platform`](crate::Platform).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Costs {
    /// Cost of turning the CPU to another thread, paid by that thread.
    pub context_switch: Nanos,
    /// Per job: taking the message, decoding it, waking up.
    pub job: Nanos,
    /// Per timed release, taken from the thread that runs. Releases of threads whose demand is
    /// unknown are not counted.
    pub release_interrupt: Nanos,
    /// Timers act this much late at most: the period of the tick.
    pub tick: Nanos,
    /// From the timer of the enforcer to its reading of the CPU clock, at most.
    pub latency: Nanos,
    /// The longest postponement of a check ([`Tuning::min_rearm`] and [`Tuning::backoff`], whose
    /// `max_backoff` is 0 where no check is put off), and the rest of a budget that counts as used
    /// up ([`Tuning::for_budget`]).
    pub tuning: Tuning,
    /// CPU time the enforcer takes per period of a reservation. An estimate, unlike the rest: the
    /// number of checks per period depends on who preempts whom.
    pub enforcement: Nanos,
}

impl Costs {
    /// The largest overrun of this budget, in ns; [`Nanos::MAX`]: any budget.
    pub fn overrun(&self, budget: Nanos) -> Nanos {
        self.tick + self.latency + self.tuning.min_rearm + self.tuning.backoff(budget)
    }

    /// With how much left this budget counts as used up; [`Nanos::MAX`]: any budget.
    pub fn slack(&self, budget: Nanos) -> Nanos {
        self.tuning.for_budget(budget).slack
    }

    /// The largest delay of a replenishment, in ns.
    pub const fn raise_delay(&self) -> Nanos {
        self.tick + self.latency
    }
}

impl Task {
    /// A FIFO thread.
    pub const fn fifo(priority: u8, demand: Demand) -> Self {
        Self {
            scheduling: Scheduling::Fifo(priority),
            demand: Some(demand),
            sections: Vec::new(),
        }
    }

    /// A thread in a reservation.
    pub const fn reserved(params: Params, demand: Option<Demand>) -> Self {
        Self {
            scheduling: Scheduling::Reserved(params),
            demand,
            sections: Vec::new(),
        }
    }

    /// A time-shared thread: it delays others by the locks it holds alone, and has no bound.
    pub const fn background(sections: Vec<Section>) -> Self {
        Self {
            scheduling: Scheduling::Fifo(0),
            demand: None,
            sections,
        }
    }

    /// Its priority, with budget if it has one.
    pub const fn priority(&self) -> u8 {
        match &self.scheduling {
            Scheduling::Fifo(priority) => *priority,
            Scheduling::Reserved(params) => params.priority(),
        }
    }

    /// Its priority without budget; `None`: it does not run then.
    pub const fn low_priority(&self) -> Option<u8> {
        match &self.scheduling {
            Scheduling::Fifo(priority) => Some(*priority),
            Scheduling::Reserved(params) => match params.low() {
                Low::Background(low) => Some(low),
                Low::Suspend => None,
            },
        }
    }

    /// Whether a job can wait while no thread works for it.
    pub(super) fn suspends(&self) -> bool {
        self.demand.is_some_and(|d| d.suspensions > 0)
    }
}
