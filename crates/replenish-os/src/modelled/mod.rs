//! The operating system inside a `loom` model (`--cfg loom`): a model's threads share one thread
//! of the test, so time, thread ids and locks have to be the model's.
//!
//! ```text
//!   modelled/ ─┬─ clock      time that stands still unless a wait has to reach its deadline
//!              ├─ pi_mutex   loom's mutex with the interface of PiMutex
//!              ├─ tid        one id for each of the model's threads
//!              ├─ loom_alarm   the models of an enforcer's timer: set, read, set again, stop
//!              ├─ loom_signal   the models of the hand-off cell
//!              ├─ loom_pi_lock   those of the lock, over a model of the kernel's part
//!              └─ loom_suspension   those of stopping, going on and inheriting
//! ```
//!
//! The crate's other items are those of Linux. The hand-off cell, the lock's protocol and that of
//! suspension are the real ones; only the futex below them is modelled.

pub mod clock;
#[cfg(test)]
mod loom_alarm;
#[cfg(test)]
mod loom_pi_lock;
#[cfg(test)]
mod loom_signal;
#[cfg(test)]
mod loom_suspension;
mod pi_mutex;
mod tid;

pub use pi_mutex::{PiMutex, PiMutexGuard};
pub use tid::current_tid;
