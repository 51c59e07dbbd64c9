//! Budgeted threads in virtual time: what would happen, and what can happen at worst.
//!
//! - **Simulation** ([`System`], [`simulate`]): a multi-core, fixed-priority, preemptive scheduler
//!   over `u64` nanoseconds that drives the very budget servers of the `sporadic` crate.
//!   Periodic, sporadic and bursty releases, blocking, priority-inheriting locks, messages between
//!   threads, overheads, late enforcement, `SCHED_DEADLINE`. The same seed gives the same run.
//! - **Analysis** ([`analysis`]): bounds on response times that no run exceeds, for the same
//!   systems.
//!
//! No I/O, no clock, no thread, no `unsafe`. Nothing panics on any input: [`System::check`] names
//! what is wrong with a system, and [`simulate`] calls it first.
//!
//! ```
//! use replenish_sim::{Nanos, Options, Policy, Releases, Step, System, Thread, simulate};
//! use sporadic::{Low, Params};
//!
//! const MS: Nanos = 1_000_000;
//! // The paper's experiment: a thread with 30 ms per 100 ms above a FIFO thread, both always busy.
//! let budget = Params::new(60, Low::Background(6), 30 * MS, 100 * MS, 16)?;
//! let system = System::on_one_cpu(vec![
//!     Thread::new("high", Policy::Sporadic(budget))
//!         .released(Releases::periodic(10 * MS))
//!         .runs(10 * MS),
//!     Thread::new("low", Policy::Fifo { priority: 50 })
//!         .released(Releases::periodic(10 * MS))
//!         .runs(10 * MS),
//! ]);
//! let outcome = simulate(&system, &Options::until(10_000 * MS))?;
//! assert_eq!(outcome.threads[0].cpu_high, 3_000 * MS);
//! assert_eq!(outcome.threads[1].completed, 700);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]

pub mod analysis;
mod check;
mod engine;
mod outcome;
mod platform;
mod random;
mod spec;

pub use check::{MAX_RELEASES, SpecError};
pub use engine::{Options, SimError, simulate};
pub use outcome::{Event, Outcome, ThreadOutcome, What};
pub use platform::{End, Enforcement, Platform};
pub use random::{Random, Span};
pub use spec::{LockId, Overflow, Releases, Step, System, Thread, ThreadId};
pub use sporadic::{Nanos, Policy};
