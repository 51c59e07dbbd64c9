//! NuttX as the paper's authors had it, and as it is today: what its `SCHED_SPORADIC` delivers.
//!
//! The policy of one thread is [`policy::Nuttx`]. Here is the kernel around it
//! ([`Kernel`]): timer tick, watchdog list, and the ready list with the historic bug that lives in
//! it. That bug is no matter of the policy, hence it is switched here and not there.
//!
//! [`history`] replays the measurements of the paper's authors, [`emulated`] those of NuttX under
//! QEMU. `docs/nuttx-history.md` has the figures and what they mean.

pub mod emulated;
pub mod history;
mod kernel;
pub mod policy;

pub use kernel::{Kernel, NuttxPolicy, NuttxThread, Program};
