//! The simulation: a discrete-event loop over exact integer time.
//!
//! ```text
//!   options ──► simulation ◄── impl Sim, by subject:
//!   errors  ◄── the loop       jobs       releases, and the steps of a job
//!                 │            schedule   which thread has which CPU
//!                 ▼            locks      priority inheritance
//!               state          budget     the servers of `sporadic` and their enforcement
//!        one thread, lock,     deadline   `SCHED_DEADLINE`, throttled by the rules of cbs
//!        CPU: phase, ready,
//!        cbs
//! ```

mod budget;
mod cbs;
mod deadline;
mod errors;
mod jobs;
mod locks;
mod options;
mod phase;
mod ready;
mod schedule;
mod simulation;
mod state;

pub use errors::SimError;
pub use options::Options;
pub use simulation::simulate;
pub(crate) use state::CAPACITY;
