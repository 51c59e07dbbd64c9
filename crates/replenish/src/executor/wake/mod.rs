//! Wakes workers, and selects the handles that a woken worker looks at.
//!
//! ```text
//!   doorbell ──► run_queue: handles to look at     schedule: releases of timers and rounds
//!   stop: the end, from anywhere                   lazy_now: the clock, read at most once
//! ```

pub(crate) mod doorbell;
pub(crate) mod lazy_now;
pub(crate) mod run_queue;
pub(crate) mod schedule;
pub(crate) mod stop;
