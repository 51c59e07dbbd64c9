//! The enforcer: the thread that lowers a worker whose budget is used up and raises it again when
//! a replenishment is due.
//!
//! Linux has no sporadic scheduling policy. Workers run under `SCHED_FIFO`; one enforcer per CPU,
//! above them and on the same CPU, drives a [`sporadic::Reservation`] per worker:
//!
//! ```text
//!   worker (FIFO P)                     enforcer (FIFO 99, same CPU)
//!   activate ── set timer if none ───►  timerfd
//!   run callback …                        │ fires at now + available
//!        ◄── preempted ─────────────── judge by the worker's CPU clock
//!   (FIFO L)  ◄── demote to the tail ──   │ exhausted
//!        ◄── promote ──────────────────── │ replenishment due
//!   block: charge, leave the timer alone
//! ```
//!
//! Because the enforcer preempts the worker it judges, the clock it reads is exact and the level
//! changes before the worker can run again. The timer is lazy (see [`sporadic::Reservation`]):
//! callbacks that stay within their budget cost one lock and one clock reading at each end.
//!
//! # The states of an enforced thread
//! ```text
//!  enroll() ──────────────────────────────────────────────┐
//!                                                         ▼
//!   ┌──────────────┐  activate(): the worker woke   ┌──────────────┐
//!   │ WAITING high │ ─────────────────────────────► │ RUNNABLE high│
//!   │              │ ◄───────────────────────────── │              │
//!   └──────────────┘  block(): charge               └──────────────┘
//!          ▲                                          │         ▲
//!          │ judge(): replenished        exhausted:   │         │ judge(): replenished:
//!          │                    demote, suspend, defer│         │ promote, resume, go on
//!          │                                          ▼         │
//!   ┌──────────────┐  activate()                    ┌──────────────┐
//!   │ WAITING low  │ ─────────────────────────────► │ RUNNABLE low │
//!   │              │ ◄───────────────────────────── │              │
//!   └──────────────┘  block(): charge               └──────────────┘
//!
//!   from each: the thread has ended, or abandon() ──► ENDED: never judged, readings are the last
//! ```
//!
//! `observe()` and `blocked_inside()` charge CPU time in any state and change none of them. The
//! enforcer alone changes a priority; the worker's own thread only charges. In the mode `Deferred`
//! there is no enforcer thread: a worker judges itself before each callback, and waits while low.
//!
//! # The files
//! ```text
//!   enforcer ─ start, stop, enroll          account ─ the worker's side
//!       │                                      │        meter ─ the reader's side
//!       │                                      ▼          ▼
//!       │                                   budgeted ─ a step under the lock, then the timer
//!       ▼                                      ▼
//!   state ─ the lock, the thread's loop: sweep, rearm ─► alarm: when the timer is set to fire
//!       ▼
//!   enforced_thread ─ the reservation, and a verdict's way to the kernel ─► overruns, supervised
//!   config ─ modes, sizes, refusals, counters, faults  usage ─ a reader's figures
//!
//!   budget_record ─ what a recorder sees of a budget (Linux; below supervised) ◄─ recorded
//!   supervision ─ a look of the watchdog at an enforcer (over state and enforced_thread)
//!       ├─► views ─ what it reads without the lock ◄─ state, supervised
//!       └─► change_user ─ threads that do not get the CPU for a change of user (Linux)
//! ```
//!
//! The same code runs on every back end. `crate::backend` brings the differences: the timer, CPU
//! clocks, changes of priority, `BlockingDetector` (which stretches of a callback were blocked?)
//! and `SuspendCell` (the low mode that stops a thread altogether).
//!
//! `docs/enforcement.md` gives the reasons for this design, with figures.

mod account;
pub(crate) mod alarm;
#[cfg(all(target_os = "linux", not(nuttx_host)))]
mod budget_record;
mod budgeted;
#[cfg(all(target_os = "linux", not(nuttx_host)))]
mod change_user;
mod config;
mod enforced_thread;
#[expect(clippy::module_inception, reason = "the folder is named after it")]
mod enforcer;
mod meter;
mod overruns;
#[cfg_attr(
    not(all(target_os = "linux", not(nuttx_host))),
    path = "recorded_board.rs"
)]
mod recorded;
mod state;
#[cfg_attr(
    all(
        not(all(target_os = "linux", not(nuttx_host))),
        not(feature = "recorder")
    ),
    path = "supervised_disabled.rs"
)]
#[cfg_attr(
    all(not(all(target_os = "linux", not(nuttx_host))), feature = "recorder"),
    path = "supervised_board.rs"
)]
mod supervised;
#[cfg_attr(
    not(all(target_os = "linux", not(nuttx_host))),
    path = "supervision_disabled.rs"
)]
mod supervision;
mod usage;
#[cfg_attr(
    not(all(target_os = "linux", not(nuttx_host))),
    path = "views_disabled.rs"
)]
mod views;

pub use account::Account;
#[cfg(all(target_os = "linux", not(nuttx_host)))]
pub use budget_record::BudgetRecord;
pub use budgeted::Stopped;
#[cfg(all(target_os = "linux", not(nuttx_host)))]
pub use change_user::change_user;
pub use config::{Enforcement, EnforcerConfig, EnforcerStats, EnrollError, Fault, MAX_REPL};
pub use enforcer::Enforcer;
pub use meter::Meter;
pub use overruns::{OverrunSamples, OverrunSummary, STALL, Stall};
pub use usage::Usage;
