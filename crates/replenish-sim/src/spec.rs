//! The simulated system: CPUs, threads with their policies, releases and jobs.
//!
//! Plain data with public fields, so that a deployment file can be read into it.

use crate::{Nanos, Platform, Span};
use sporadic::{Kind, Policy};

/// The index of a thread in [`System::threads`].
pub type ThreadId = usize;
/// A lock, from 0 to [`System::locks`] exclusive.
pub type LockId = usize;

/// A whole machine with its load.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct System {
    /// Number of CPUs, at least 1.
    pub cpus: usize,
    /// Number of priority-inheriting locks.
    pub locks: usize,
    /// The costs and the lateness of scheduling and enforcement.
    pub platform: Platform,
    /// The threads. At equal times an earlier thread's events are handled first.
    pub threads: Vec<Thread>,
}

impl System {
    /// A system of these threads on one CPU, without locks, on an ideal platform.
    pub fn on_one_cpu(threads: Vec<Thread>) -> Self {
        Self {
            cpus: 1,
            locks: 0,
            platform: Platform::IDEAL,
            threads,
        }
    }
}

/// One thread: a worker, an executor, or anything else that takes CPU time.
///
/// A thread waits until it is released, does the steps of its [`body`](Self::body) once (a *job*,
/// in ROS terms one callback), and waits again or goes on with the next job in its queue.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Thread {
    /// A name for reports.
    pub name: String,
    /// The only CPU it may use; `None`: any.
    pub cpu: Option<usize>,
    /// Its policy; priorities up to 255. Simplified: threads of [`Policy::Other`] run first-in,
    /// first-out among themselves, and so do equals of [`Policy::RoundRobin`]. Of
    /// [`Policy::Deadline`], `0 < runtime <= deadline <= period`; nothing is reclaimed.
    pub policy: Policy,
    /// The server that holds its budget, if it has one; `max_repl` up to 128.
    pub server: Kind,
    /// Its releases, apart from [`Step::Send`] by others.
    pub releases: Releases,
    /// The most releases that wait while a job runs (the depth of the subscription's slots). 0: a
    /// release while a job is under way is lost.
    pub queue: usize,
    /// The release that is lost when the queue is full.
    pub overflow: Overflow,
    /// The steps of one job. Every lock must be released again.
    pub body: Vec<Step>,
    /// Jobs that take longer from release to end count as misses.
    pub deadline: Option<Nanos>,
}

impl Thread {
    /// A thread that is never released, does nothing, and may run on CPU 0 only.
    pub fn new(name: impl Into<String>, policy: Policy) -> Self {
        Self {
            name: name.into(),
            cpu: Some(0),
            policy,
            server: Kind::Corrected,
            releases: Releases::Never,
            queue: 1,
            overflow: Overflow::DropOldest,
            body: Vec::new(),
            deadline: None,
        }
    }

    /// Sets the CPU.
    #[must_use]
    pub fn on(mut self, cpu: Option<usize>) -> Self {
        self.cpu = cpu;
        self
    }

    /// Sets the releases.
    #[must_use]
    pub fn released(mut self, releases: Releases) -> Self {
        self.releases = releases;
        self
    }

    /// Appends a step that consumes CPU time.
    #[must_use]
    pub fn runs(self, time: impl Into<Span>) -> Self {
        self.then(Step::Run(time.into()))
    }

    /// Appends a step.
    #[must_use]
    pub fn then(mut self, step: Step) -> Self {
        self.body.push(step);
        self
    }

    /// Sets the depth of the queue.
    #[must_use]
    pub fn queue(mut self, depth: usize) -> Self {
        self.queue = depth;
        self
    }

    /// Sets the deadline, relative to the release, in ns.
    #[must_use]
    pub fn due_within(mut self, deadline: Nanos) -> Self {
        self.deadline = Some(deadline);
        self
    }
}

/// Releases of a thread. Times in ns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Releases {
    /// Only by [`Step::Send`].
    Never,
    /// At `offset + k * period`, each delayed by up to `jitter` (uniformly). Response times count
    /// from the undelayed time.
    Periodic {
        /// The first release.
        offset: Nanos,
        /// The distance, at least 1.
        period: Nanos,
        /// The longest delay.
        jitter: Nanos,
    },
    /// At `offset`, then each `gap` after the one before.
    Sporadic {
        /// The first release.
        offset: Nanos,
        /// The distance, drawn anew each time. A distance of 0 counts as 1 ns.
        gap: Span,
    },
    /// `burst` releases `spacing` apart, at `offset + k * period`.
    Bursty {
        /// The first release.
        offset: Nanos,
        /// From the start of a burst to the start of the next, at least 1 and at least
        /// `spacing * burst`.
        period: Nanos,
        /// Releases in a burst, at least 1.
        burst: u32,
        /// From release to release in a burst, may be 0.
        spacing: Nanos,
    },
    /// At these times, in ascending order: a recorded trace.
    At(Vec<Nanos>),
}

impl Releases {
    /// Strictly periodic from 0 on.
    pub fn periodic(period: Nanos) -> Self {
        Self::Periodic {
            offset: 0,
            period,
            jitter: 0,
        }
    }
}

/// The release that is lost when the queue is full.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Overflow {
    /// The oldest that waits (DDS `KEEP_LAST`).
    #[default]
    DropOldest,
    /// The new one.
    DropNewest,
}

/// A step of a job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Step {
    /// Consumes CPU time.
    Run(Span),
    /// Blocks: a sleep, a service call, I/O.
    Block(Span),
    /// Takes a priority-inheriting lock, waiting for it if it is held. Locks are not recursive.
    Lock(LockId),
    /// Releases a lock this job has taken. The most urgent waiter gets it.
    Unlock(LockId),
    /// Releases another thread now: a message, or a dispatcher's hand-off.
    Send(ThreadId),
}
