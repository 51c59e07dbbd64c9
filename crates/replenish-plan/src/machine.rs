//! Resources to plan with: CPUs, priorities, and the costs of enforcement.

use crate::Nanos;
use replenish_sim::analysis::Costs;
use replenish_sim::{End, Enforcement, Platform, Span};
use sporadic::Tuning;
use std::ops::RangeInclusive;

/// The resources that a plan may use.
#[derive(Debug, Clone, PartialEq)]
pub struct Machine {
    /// The CPUs that workers may be put on, by their numbers, at least one.
    pub cpus: Vec<usize>,
    /// Priorities for guaranteed workers, low to high; within 2..=97.
    pub priorities: RangeInclusive<u8>,
    /// The enforcers' priority, above all others.
    pub enforcer_priority: u8,
    /// The share of each CPU that real-time threads may take, above 0 up to 1. Linux stops them for
    /// the rest of every second (`kernel.sched_rt_runtime_us`).
    pub real_time_share: f64,
    /// The costs of scheduling and enforcement.
    pub overheads: Overheads,
}

impl Machine {
    /// CPUs 0 to `count` - 1 (at least CPU 0), Linux's defaults.
    #[must_use]
    pub fn with_cpus(count: usize) -> Self {
        Self::on_cpus((0..count.max(1)).collect())
    }

    /// A machine with these CPUs and Linux's defaults: workers between 20 and 89, enforcers at 99,
    /// 95 % of each CPU.
    #[must_use]
    pub fn on_cpus(cpus: Vec<usize>) -> Self {
        Self {
            cpus,
            priorities: 20..=89,
            enforcer_priority: 99,
            real_time_share: 0.95,
            overheads: Overheads::LINUX,
        }
    }

    /// Whether the kernel stops real-time threads that take a whole CPU.
    pub(crate) fn is_throttled(&self) -> bool {
        self.real_time_share < 1.0
    }
}

/// The costs of scheduling and the lateness of enforcement, in ns. Conservative: a bound that is
/// computed with them is as good as they are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Overheads {
    /// Cost of turning a CPU to another thread.
    pub context_switch: Nanos,
    /// Per callback, in the worker: waking up, taking the message, decoding it.
    pub callback: Nanos,
    /// Per message, in the executor's thread.
    pub dispatch: Nanos,
    /// Cost per timed release, taken from the thread that runs.
    pub release_interrupt: Nanos,
    /// The longest time from the enforcer's timer to its reading of the CPU clock.
    pub latency: Nanos,
    /// CPU time of the enforcer per budget and period.
    pub enforcement: Nanos,
    /// The enforcer's constants.
    pub tuning: Tuning,
}

impl Overheads {
    /// The largest value of each overhead, in ns.
    pub const MOST: Nanos = 1_000_000_000;

    /// Their names in files.
    pub(crate) const NAMES: [&str; 9] = [
        "context_switch",
        "callback",
        "dispatch",
        "release_interrupt",
        "latency",
        "enforcement",
        "slack",
        "min_rearm",
        "max_backoff",
    ];

    /// All of them, in the order of their names.
    pub(crate) fn all(&self) -> [Nanos; 9] {
        [
            self.context_switch,
            self.callback,
            self.dispatch,
            self.release_interrupt,
            self.latency,
            self.enforcement,
            self.tuning.slack,
            self.tuning.min_rearm,
            self.tuning.max_backoff,
        ]
    }

    /// All of them, to be changed.
    pub(crate) fn all_mut(&mut self) -> [&mut Nanos; 9] {
        [
            &mut self.context_switch,
            &mut self.callback,
            &mut self.dispatch,
            &mut self.release_interrupt,
            &mut self.latency,
            &mut self.enforcement,
            &mut self.tuning.slack,
            &mut self.tuning.min_rearm,
            &mut self.tuning.max_backoff,
        ]
    }

    /// Used where nothing was measured. Several times what `replenish bench enforcement` and
    /// `replenish bench handoff` measured on a virtual machine with 2 CPUs (Linux 6.18, HZ=250, not
    /// `PREEMPT_RT`; `docs/enforcement.md`): overruns of 5 to 7 us (99 %), 30 to 80 us of the
    /// enforcer per budget and 100 ms. Interruptions of a virtual machine by its host are not
    /// covered.
    pub const LINUX: Self = Self {
        context_switch: 3_000,
        callback: 10_000,
        dispatch: 25_000,
        release_interrupt: 5_000,
        latency: 50_000,
        enforcement: 40_000,
        tuning: Tuning::LINUX,
    };

    /// No overheads: for studying a schedule in theory.
    pub const NONE: Self = Self {
        context_switch: 0,
        callback: 0,
        dispatch: 0,
        release_interrupt: 0,
        latency: 0,
        enforcement: 0,
        tuning: Tuning {
            slack: 0,
            min_rearm: 0,
            max_backoff: 0,
        },
    };

    /// The larger of both, field by field.
    pub(crate) fn worst(&self, other: &Self) -> Self {
        Self {
            context_switch: self.context_switch.max(other.context_switch),
            callback: self.callback.max(other.callback),
            dispatch: self.dispatch.max(other.dispatch),
            release_interrupt: self.release_interrupt.max(other.release_interrupt),
            latency: self.latency.max(other.latency),
            enforcement: self.enforcement.max(other.enforcement),
            tuning: Tuning {
                slack: self.tuning.slack.max(other.tuning.slack),
                min_rearm: self.tuning.min_rearm.max(other.tuning.min_rearm),
                max_backoff: self.tuning.max_backoff.max(other.tuning.max_backoff),
            },
        }
    }

    /// Costs for the analysis. `seen`: whenever a budgeted worker on this CPU gets it back, the
    /// enforcer knows and looks at the worker again in time. Otherwise its check can be put off by
    /// [`Tuning::backoff`].
    pub(crate) fn costs(&self, seen: bool) -> Costs {
        let max_backoff = if seen { 0 } else { self.tuning.max_backoff };
        Costs {
            context_switch: self.context_switch,
            job: self.callback,
            release_interrupt: self.release_interrupt,
            tick: 0,
            latency: self.latency,
            tuning: Tuning {
                max_backoff,
                ..self.tuning
            },
            enforcement: self.enforcement,
        }
    }

    /// Platform for the simulation: costs always as here, latency drawn between none and the whole.
    #[must_use]
    pub fn platform(&self) -> Platform {
        Platform {
            context_switch: self.context_switch,
            job: self.callback,
            release_interrupt: self.release_interrupt,
            tick: None,
            blocking_seen: true,
            demote_to: End::Tail,
            enforcement: if *self == Self::NONE {
                Enforcement::Kernel
            } else {
                Enforcement::Timer {
                    tuning: self.tuning,
                    latency: Span::Uniform {
                        min: 0,
                        max: self.latency,
                    },
                    cost: 3_000.min(self.enforcement),
                }
            },
        }
    }
}
