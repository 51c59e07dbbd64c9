//! The operating system inside a `loom` model (`--cfg loom`): a model's threads share one thread
//! of the test, so time, thread ids and locks have to be the model's.
//!
//! ```text
//!   modelled/ ─┬─ clock      time that stands still unless a wait has to reach its deadline
//!              ├─ pi_mutex   loom's mutex with the interface of PiMutex
//!              ├─ tid        one id for each of the model's threads
//!              └─ loom_signal   the models of the hand-off cell
//! ```
//!
//! The crate's other items are those of Linux. The hand-off cell is the real one; only the futex
//! below it is modelled (`sync_shim`).

pub mod clock;
#[cfg(test)]
mod loom_signal;
mod pi_mutex;
mod tid;

pub use pi_mutex::{PiMutex, PiMutexGuard};
pub use tid::current_tid;
