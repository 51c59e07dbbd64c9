//! `replenish experiment isolation`: what others do to a control loop, without and with budgets.
//!
//! ```text
//!   command ─► scenario              one window: the loop, its neighbours
//!           ─► report ───► figure    table, JSON, CSV, page; the drawing
//!   case     the windows of one disturbance, of all
//! ```

mod case;
mod command;
mod figure;
mod report;
mod scenario;

pub(super) use command::{Args, run};
