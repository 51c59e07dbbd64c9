//! The part that both small systems share: threads, clocks, locks and timers over a few primitives.
//!
//! ```text
//!   thread ─ name, spawn_error        poll ─ notify (crate)     blocking_detector
//!      │                                │                              │
//!      │        pi_lock ─ inherit     futex     timer     clock ─ tid  lock_wait   memory, privilege
//!      ▼            ▼        ▼          ▼         ▼         ▼          ▼   (nothing to do)
//!   ┌─────────── critical_section (over it: atomic) ─ blocked_intervals ──────────────┐
//!   │ backend::port: block wake place │ mask unmask │ board_now │ task_slot           │
//!   │                alarm (deadlines, limits of CPU clocks) │ launch │ POLICIES      │
//!   └─────────── freertos/ or nuttx/: over cs_token, ready_position, error, panicked ─┘
//! ```
//!
//! A back end names what it brings in the module `port` of its `mod.rs`; nothing else of it is used
//! here. One core is assumed: a critical section masks the interrupts that may call the kernel.

pub(crate) mod atomic;
pub(crate) mod blocked_intervals;
pub(crate) mod blocking_detector;
pub mod clock;
pub(crate) mod critical_section;
pub(crate) mod cs_token;
pub(crate) mod error;
pub(crate) mod futex;
pub(crate) mod inherit;
pub(crate) mod lock_wait;
pub mod memory;
pub(crate) mod name;
pub(crate) mod panicked;
pub(crate) mod pi_lock;
pub(crate) mod poll;
pub mod privilege;
pub(crate) mod ready_position;
pub(crate) mod spawn_error;
pub(crate) mod thread;
pub(crate) mod tid;
pub mod timer;
