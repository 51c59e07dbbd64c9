//! `replenish bench dispatch`: what it costs to bring a message to its callback, for one handle and
//! for a thousand, next to a raw UDP loop.
//!
//! ```text
//!   sender ── WRITE_DATA ─► agent ── DATA ─► one thread: take, callback          (ours)
//!   sender ── WRITE_DATA ─► agent ── DATA ─► dispatcher ─► worker: callback      (threads)
//!   sender ── a datagram of that size ─────► one thread: epoll, recv, count        (waiting)
//!   sender ── a datagram of that size ─────► one thread: recv, count              (baseline)
//!   └───── one CPU ──────────────┘           └───── the measured CPU ──────┘
//! ```
//!
//! Ours is compared with what has as many threads as it has: an executor that the thread spins
//! which waits, as rclc's. A dispatcher and a worker are two threads, with a switch more per
//! message for what a thread of its own gives: policy, priority, budget.
//!
//! The baseline can be woken by datagrams alone. A loop that has timers, too, or that others can
//! stop, needs a second system call per message: that one is *waiting*, the least that an executor
//! can cost.
//!
//! Messages come at a steady rate, to one topic after another. Windows of all take turns, short
//! ones, so that they see the same machine even where that changes from one moment to the next. CPU
//! time and context switches are those of the threads on the measured CPU, as the kernel counts
//! them; the time of a message is from before its sending to the callback (ours passes the agent on
//! the way) or to the end of `recv`. The measured CPU is kept awake, unless that is declined.
//!
//! ```text
//!   command ─► window ─► receiver ◄── ours, raw    one window of a receiver; the receivers
//!     │                     └──► threads           their CPU time and switches
//!     ├─► report                                   table and JSON
//!     └─► awake                                    a thread that keeps the CPU busy
//!   paired ─► window                               of `bench recorder`: recorder on and off
//! ```

mod awake;
mod command;
mod ours;
mod paired;
mod raw;
mod receiver;
mod report;
mod threads;
mod window;

pub(crate) use command::{Args, run};
pub(crate) use paired::{chain_ratio, recorder_ratio};
