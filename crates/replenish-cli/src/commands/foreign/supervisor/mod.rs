//! Looks for the threads of programs, gives them their budgets, and takes the budgets away again.
//!
//! ```text
//!   adopt(pid) ─► look(), every 20 ms ─► … ─► finish(): everybody has what he had
//!                  │ a new thread: what it had to the guardian, then its budget
//!                  │ a new name: another budget, if another rule fits
//!                  │ an end: its figures are kept by name
//!                  └ another policy or CPU: changed back
//!
//!   looks ─ all programs in turn ─► threads ─ those of one process ─► state ─ what is known
//! ```

mod looks;
mod state;
mod threads;

pub(crate) use state::{PAUSE, Supervisor};
