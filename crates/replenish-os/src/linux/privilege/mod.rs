//! The privileges of this process, the missing ones, and the commands that grant them.
//!
//! ```text
//!   process ─ asks the kernel (on a thread of its own, with tiny requests) ─► probes ─ /proc, limits
//!      ▲
//!   advice ── the one message that says what is missing and how to grant it
//! ```
//!
//! [`Privilege`] prints as that message; `replenish doctor` reads its fields.

mod advice;
pub(super) mod probes;
mod process;

pub(super) use advice::setcap_line;
pub use probes::{CgroupRt, Limit};
pub(crate) use process::keep_priorities;
pub use process::{Privilege, may_be_real_time, probe};
