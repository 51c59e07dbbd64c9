//! CPU budget servers as pure state machines over `u64` nanoseconds.
//!
//! A *budget server* (a reservation) lets a thread run at priority P for a budget B in every
//! period T, and at a background priority (or not at all) once the budget is spent. This crate
//! says **when** the thread must have which priority and when its budget comes back. It reads no
//! clock, starts no thread and sets no priority: the caller reports what happened to the thread
//! and applies the answer.
//!
//! Two servers implement [`BudgetServer`]:
//! - [`Corrected`]: the sporadic server with the corrections of Stanovich et al. (RTAS 2010).
//!   The amounts always sum to B and an overrun is a debt. Use this one.
//! - `Posix`: the rules of POSIX (XSH 2.8.4, `SCHED_SPORADIC`) to the letter, defects included,
//!   for conformance and for explaining what another system does.
//!
//! `Posix` comes with feature `posix` (default).
//!
//! [`Reservation`] adds to a server what supervising a real thread takes: charging CPU-clock
//! readings to the level in force, and the lazy check timer. [`Server`] is one or the other, chosen
//! at run time. All are `Send + Sync` plain data without interior mutability: the caller serialises
//! access.
//!
//! ```text
//!   stated                      checked                 held
//!   budget ── priority ──────►  params ─► policy        reservation: charging, the check timer
//!   B every T  its level        P, L, B, T, N  │             │
//!                                              └──────► choice: corrected or posix ─► ring
//!   units: nanoseconds, and how people read them        server: what both of them do
//! ```
//!
//! ```
//! use sporadic::{BudgetServer, Corrected, Level, Low, Params};
//!
//! const MS: u64 = 1_000_000;
//! // Priority 60 for 30 ms in every 100 ms, else priority 6; up to 16 pending replenishments.
//! let params = Params::new(60, Low::Background(6), 30 * MS, 100 * MS, 16)?;
//! let mut server = Corrected::<16>::new(params, 0)?;
//!
//! server.activate(5 * MS); // work arrives, the thread runs
//! assert_eq!(server.available(5 * MS), 30 * MS);
//! server.charge(31 * MS, 36 * MS); // it ran 31 ms: 1 ms too long
//! assert_eq!(server.update(36 * MS), Level::Low);
//! assert_eq!(server.next_replenishment(), Some(105 * MS)); // activation + period
//! assert_eq!(server.update(105 * MS), Level::High);
//! assert_eq!(server.available(105 * MS), 29 * MS); // the overrun is paid back
//! # Ok::<(), sporadic::ParamError>(())
//! ```
#![no_std]
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

mod budget;
mod choice;
mod corrected;
mod params;
mod policy;
#[cfg(feature = "posix")]
mod posix;
pub mod priority;
mod reservation;
mod ring;
mod server;
mod units;

pub use budget::{Amount, Budget};
pub use choice::{Kind, Server};
pub use corrected::{Consumed, Corrected};
pub use params::{Low, ParamError, Params};
pub use policy::{MAX_PRIORITY, MIN_RUNTIME, Policy, PolicyError};
#[cfg(feature = "posix")]
pub use posix::Posix;
pub use reservation::{BlockedInterval, Counters, Readings, Reservation, Tuning, Verdict};
pub use ring::Chunk;
pub use server::{BudgetServer, Level};
pub use units::{Nanos, WholeUnits, earliest, later, latest, since};
