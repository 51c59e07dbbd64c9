//! Every interleaving of the executor's protocols, by `loom`, over this crate as it is.
//!
//! ```text
//!   models/ ─┬─ loom_executor   dispatcher and interest set, routes and handles that come and go
//!            ├─ loom_local      an executor without threads falls asleep while input comes
//!            ├─ loom_group      callbacks of one group on two workers
//!            ├─ loom_bus       places of the in-process bus that are given out again
//!            ├─ loom_timer      a timer's handle against the worker that serves the timer
//!            ├─ loom_trigger    a guard condition's first trigger against the worker that begins
//!            └─ fake            the middleware below them
//! ```
//!
//! `RUSTFLAGS="--cfg loom" cargo test --profile loom -p replenish --lib loom_` runs them;
//! `LOOM_MAX_PREEMPTIONS` bounds them, in CI by 2, every night by 3. Only the futex, the lock with
//! priority inheritance, thread ids and the clock are modelled (`replenish-os`). Statistics and
//! reference counts are no part of a protocol, so a model does not explore them.
#![allow(clippy::unwrap_used, reason = "a model may panic")]

mod fake;
mod loom_bus;
mod loom_executor;
mod loom_group;
mod loom_local;
mod loom_timer;
mod loom_trigger;
