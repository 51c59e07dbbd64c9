//! This machine's properties and the rights it grants: read from `/proc` and `/sys`, without
//! privilege.

pub mod cpus;
pub mod facts;
pub mod stats;

use replenish_os::Policy;
use replenish_os::privilege::{Privilege, probe};
use std::sync::OnceLock;

/// The real-time rights that the kernel grants this process; found out once.
pub fn privilege() -> &'static Privilege {
    static PRIVILEGE: OnceLock<Privilege> = OnceLock::new();
    PRIVILEGE.get_or_init(probe)
}

/// FIFO at `priority` where it is granted, else the ordinary policy.
pub fn fifo_or_other(priority: u8) -> Policy {
    match Policy::fifo(priority) {
        Ok(fifo) if privilege().real_time() => fifo,
        _ => Policy::Other,
    }
}
