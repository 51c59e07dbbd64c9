//! Every interleaving of the hand-off's protocols, by `loom`, over this crate as it is.
//!
//! ```text
//!   models/ ─┬─ loom_handoff   dispatcher and worker around one inbox
//!            ├─ loom_lines     writers of log lines, and the reader
//!            ├─ loom_pool      messages that are lent, published, read and lent again
//!            ├─ loom_ready     threads that mark input, and the worker that looks only there
//!            ├─ loom_guard     triggers of a guard condition, and the worker that serves them
//!            └─ loom_stop      a stop request against threads that join late, work or sleep
//! ```
//!
//! `RUSTFLAGS="--cfg loom" cargo test --profile loom -p replenish-handoff --lib loom_`, in CI with
//! `LOOM_MAX_PREEMPTIONS=2`, and every night with 3.
#![allow(clippy::unwrap_used, reason = "a model may panic")]

mod loom_guard;
mod loom_handoff;
mod loom_lines;
mod loom_pool;
mod loom_ready;
mod loom_stop;
