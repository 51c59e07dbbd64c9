//! Helpers that the tests of replenish share.
//!
//! - [`rt`]: is real-time priority to be had here, the machine-wide lock that keeps two
//!   real-time tests from running side by side, and the rule for skipping.
//! - [`harness`]: trials that count as *ignored* (skipped) at run time, through `libtest-mimic`,
//!   because the standard harness can only pass or fail.
//! - [`domain`]: DDS domains that no other test on this machine uses.
//! - [`alloc`]: a global allocator that counts, to prove that the hot path does not allocate.
//! - [`peer`]: a foreign ROS 2 program in Python.
//! - [`program`]: a built command, run to its end or beside the test.
//! - [`progress`]: waiting for an event, and lower bounds on progress.
//! - [`sets`]: properties over random sets, on all CPUs.
//! - [`signal`]: a real signal handler.
//! - [`steal`]: a trial that failed while the machine did not do its part runs again.
//! - [`tids`]: a thread with the kernel id of one that has ended.
//! - [`wall_clock`]: a wall clock that a test may set.
//! - [`watchdog`]: ends a test process that hangs, naming what hung.
//! - [`witness`]: sees how long the machine stood still.
//!
//! Never a dependency of shipped code.

pub mod alloc;
pub mod domain;
pub mod harness;
pub mod peer;
pub mod program;
pub mod progress;
pub mod rt;
pub mod sets;
pub mod signal;
mod skip;
pub mod steal;
pub mod tids;
pub mod wall_clock;
pub mod watchdog;
pub mod witness;

#[doc(hidden)]
pub use libc; // for the macro
