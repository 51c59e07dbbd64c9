//! `replenish bench soak`: reliable keep-all samples between processes, through a bad link, while
//! processes are stopped and killed.
//!
//! ```text
//!   publisher ──┐                  ┌── reader, which is stopped for seconds
//!               ├── proxy ── agent ┤
//!   (processes) └──────────────────┴── other reader, which is killed
//! ```
//!
//! ```text
//!   command ─► world ─► process    children, signals
//!      │         └────► proxy      loss, repeats, reordering, damage
//!      ├─► ledger                  what was acknowledged, what has arrived
//!      └─► part                    the children: a publisher, a reader
//! ```

mod command;
mod ledger;
mod options;
mod part;
mod process;
mod proxy;
mod world;

pub(crate) use command::run;
pub(crate) use options::Args;
