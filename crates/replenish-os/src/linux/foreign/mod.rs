//! Budgets for threads that other code has started and that need not know of them.
//!
//! An [`Enforcer`] gives budgets to threads of other processes, and to threads that a library or a
//! middleware has started in this one ([`ForeignThread::open_own`]). It reads their CPU time as the
//! scheduler accounts it, and raises and lowers them by system calls. Several threads can share one
//! budget.
//!
//! ```text
//!   thread ─ one foreign thread: who it is, its CPU time   original ─ what it had, and gets back
//!      │                                                        │
//!      └──────────────► member ─ an enrolled thread ◄───────────┘
//!                          ▼
//!                 groups ► group ─ one budget and its threads, their switches in one order
//!                          ▼
//!                       state ─ the thread that judges
//!                          ▼
//!                      enforcer ─ what others ask it          error, usage ─ what it answers
//!                          └► freezer ─ stops threads altogether, where that is asked for
//!   processes ─ threads and children of a process, in /proc    signal ─ to one process
//!   pattern ─ names that a rule is for
//! ```
//!
//! # Identity of a thread
//! The kernel uses thread ids again. A [`ForeignThread`] holds an open file of its thread in
//! `/proc`, which belongs to that thread and not to the number. It is read before every change, so
//! a thread that has ended is found before its number can belong to another thread: the kernel
//! gives numbers in turn, and would have to go once through all of them between two system calls.
//!
//! # What is different from a worker of ours
//! Foreign threads do not report when they begin and end their work. The enforcer sees it in the
//! kernel's records of context switches where it may read them (`CAP_PERFMON`, or
//! `kernel.perf_event_paranoid` of at most 2 and the same user). Without the records every reading
//! counts as if the thread had used all of its time at the end: budgets hold, and come back later
//! than they could.
//!
//! Every thread under one enforcer runs on the enforcer's CPU. So the thread that is judged never
//! runs at that moment, its account is exact, and threads that share a budget use no more of it
//! than time passes.

mod enforcer;
mod error;
mod freezer;
mod group;
mod groups;
mod member;
mod original;
mod pattern;
mod processes;
mod signal;
mod state;
mod thread;
mod usage;

pub use enforcer::Enforcer;
pub use error::ForeignError;
pub use original::{Original, restore};
pub use pattern::fits;
pub use processes::{children, command_line, family, name, processes, start_of, tasks};
pub use signal::{Process, peer_user, user};
pub use thread::ForeignThread;
pub use usage::{BudgetId, BudgetUsage, Inspection, ThreadUsage};
