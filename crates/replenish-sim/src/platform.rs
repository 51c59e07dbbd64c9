//! The costs of scheduling on the simulated machine, and its lateness.

use crate::{Nanos, Span};
use sporadic::Tuning;

/// Costs and delays. All times in ns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Platform {
    /// Each time a CPU turns to another thread, that thread first consumes this much.
    pub context_switch: Nanos,
    /// Each job first consumes this much: taking the message, decoding it, the wake-up.
    pub job: Nanos,
    /// Each release by a timer takes this much of the CPU from the thread that runs (on the
    /// released thread's CPU, or CPU 0), charged to no thread.
    pub release_interrupt: Nanos,
    /// Timers (releases, enforcement, the end of [`Step::Block`](crate::Step::Block), throttling)
    /// act at multiples of this only; `None`: at once.
    pub tick: Option<Nanos>,
    /// Whether blocking inside a job is seen and accounted as POSIX says. If not, the server takes
    /// the thread for runnable meanwhile.
    pub blocking_seen: bool,
    /// The end of its background priority's list at which a thread without budget joins. A plain
    /// `sched_setattr` of Linux puts it at the head, our enforcer makes it the tail (POSIX).
    pub demote_to: End,
    /// The enforcement of budgets.
    pub enforcement: Enforcement,
}

impl Platform {
    /// A platform without costs and delays, with POSIX's rules.
    pub const IDEAL: Self = Self {
        context_switch: 0,
        job: 0,
        release_interrupt: 0,
        tick: None,
        blocking_seen: true,
        demote_to: End::Tail,
        enforcement: Enforcement::Kernel,
    };
}

impl Default for Platform {
    fn default() -> Self {
        Self::IDEAL
    }
}

/// An end of the list of ready threads of one priority; the thread at the head runs first.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// Before its equals.
    Head,
    /// Behind its equals.
    Tail,
}

/// The enforcer of budgets.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Enforcement {
    /// The kernel, which knows what the running thread has consumed and acts at once (with a
    /// [tick](Platform::tick): at the next one).
    Kernel,
    /// An enforcer with a lazy timer per thread, as `replenish-os` has it on Linux: it acts on
    /// [`sporadic::Reservation`] and may be late.
    Timer {
        /// Its constants.
        tuning: Tuning,
        /// From the expiry of the timer to the reading of the CPU clock; the thread runs on.
        latency: Span,
        /// CPU time of each expiry, charged to no thread.
        cost: Nanos,
    },
}
