//! `replenish bench …`: costs of the mechanisms, beside a baseline measured in the same run.
//!
//! ```text
//!   command ─► dispatch      a message's way to its callback     a raw UDP loop
//!           ─► enforcement   how far budgets are overrun         a POSIX CPU timer
//!           ─► foreign       programs that know nothing    the same without budgets
//!           ─► handoff       waking a worker                     a bare futex
//!           ─► in_process    a message to several workers       the same, encoded; bare futexes (wake_floor)
//!           ─► ros2          ROS 2 without an agent              raw UDP, Cyclone DDS, Fast DDS
//!           ─► round_trip    client to agent to client           a raw UDP echo   } agent_cpus
//!           ─► secure        the same over DTLS and TLS       UDP and TCP in the clear   }
//!           ─► load          many clients through one agent
//!           ─► recorder      one event, a message with it       the same without
//!           ─► soak          processes killed over a bad link     the promises of docs/acknowledged.md
//!           ─► xrce          reliable streams over a bad link    sending everything again
//!           ─► torture       random executors                    the bounds of budgets
//! ```

mod agent_cpus;
mod command;
mod dispatch;
mod enforcement;
mod foreign;
mod handoff;
mod in_process;
mod load;
mod lttng;
mod recorder;
mod ros2;
mod round_trip;
#[cfg_attr(not(feature = "secure"), path = "secure_disabled.rs")]
mod secure;
mod soak;
mod torture;
mod wake_floor;
mod xrce;

pub(crate) use command::{Bench, run};
