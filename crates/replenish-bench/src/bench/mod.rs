//! `replenish bench …`: costs of the mechanisms, beside a baseline measured in the same run.
//!
//! ```text
//!   command ─► dispatch      a message's way to its callback     a raw UDP loop
//!           ─► enforcement   how far budgets are overrun         a POSIX CPU timer
//!           ─► handoff       waking a worker                     a bare futex
//!           ─► round_trip    client to agent to client           a raw UDP echo
//!           ─► load          many clients through one agent
//!           ─► xrce          reliable streams over a bad link    sending everything again
//! ```

mod command;
mod dispatch;
mod enforcement;
mod handoff;
mod load;
mod round_trip;
mod xrce;

pub(crate) use command::{Bench, run};
