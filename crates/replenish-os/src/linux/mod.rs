//! The Linux back end: one topic per file, each a thin safe wrapper around a few system calls.
//!
//! `rustix` makes the calls, 0.64 to 0.74 of the time that ours through the C library took. By hand
//! are those it has not (scheduling parameters, `perf_event_open`, clocks of other threads), and
//! `epoll_pwait2`, because its `epoll::wait` rounds timeouts up to milliseconds.
//!
//! ```text
//!   threads     thread, tid, affinity, sched, sched_attr, granted, spawn_error
//!   budgets     timer, context_switches ─► blocked_intervals ─► blocking_detector, lock_wait
//!               supervised ◄─ watchdog; foreign: threads of other programs
//!   suspension  suspension ◄─ suspend, retry, c_library; change_of_user
//!   locks       futex ◄─ pi_lock
//!   time        clock, steal_time
//!   waiting     poll, wait_set, socket_set
//!   bytes       datagram, counted_datagram, tcp, tty, terminal, interfaces
//!   memory      memory, segment, live ─► live_file
//!   the host    machine_info, privilege
//!   everywhere  sys, config, console
//!   benchmarks  bare_futex, cpu_ticks, cpu_timer, user
//! ```

pub(crate) mod affinity;
#[cfg(feature = "baseline")]
pub(crate) mod bare_futex;
mod blocked_intervals;
pub(crate) mod blocking_detector;
mod c_library;
pub(crate) mod change_of_user;
pub mod clock;
pub(crate) mod config;
pub(crate) mod console;
pub(crate) mod context_switches;
pub(crate) mod counted_datagram;
#[cfg(feature = "baseline")]
pub(crate) mod cpu_ticks;
#[cfg(feature = "baseline")]
pub(crate) mod cpu_timer;
pub(crate) mod datagram;
pub mod foreign;
pub(crate) mod futex;
pub(crate) mod granted;
pub(crate) mod interfaces;
pub mod live;
mod live_file;
pub(crate) mod lock_wait;
pub(crate) mod machine_info;
pub mod memory;
pub(crate) mod pi_lock;
pub(crate) mod poll;
pub mod privilege;
mod retry;
pub(crate) mod sched;
mod sched_attr;
pub(crate) mod segment;
pub(crate) mod socket_set;
pub(crate) mod spawn_error;
pub(crate) mod steal_time;
mod supervised;
pub(crate) mod suspend;
pub(crate) mod suspension;
mod sys;
pub(crate) mod tcp;
pub(crate) mod terminal;
pub(crate) mod thread;
pub(crate) mod tid;
pub mod timer;
pub mod tty;
#[cfg(feature = "baseline")]
pub(crate) mod user;
pub(crate) mod wait_set;
pub(crate) mod watchdog;

pub(crate) use config::OsError;
pub use context_switches::voluntary_switches;
