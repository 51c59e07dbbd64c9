//! A rover of three nodes, as a program of one process.
//!
//! ```text
//!   sensors ─ imu ──► control ─ cmd_vel ─┐
//!      │              (a guarantee)      ├─► diagnostics ─ health, self_test, drive
//!      └─ image ────► camera ── frames ──┘
//!                     (a budget)
//! ```

include!(concat!(env!("OUT_DIR"), "/interfaces.rs"));

pub mod camera;
pub mod control;
pub mod diagnostics;
pub mod sensors;

use replenish::{Context, Error, Executor};

/// Adds all nodes to an executor.
///
/// # Errors
/// A name or a setting that is refused.
pub fn rover(ctx: &Context, exec: &mut Executor) -> Result<(), Error> {
    control::add(ctx, exec)?;
    camera::add(ctx, exec)?;
    diagnostics::add(ctx, exec)?;
    sensors::simulate(ctx, exec)
}
