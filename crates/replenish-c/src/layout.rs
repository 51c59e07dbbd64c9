//! Structs that C programs see. Their first field is the size that the caller was compiled with: an
//! older program has a shorter one, and newer fields have their defaults.
#![allow(
    clippy::doc_markdown,
    reason = "documentation here is that of the C header"
)]

use std::ffi::c_char;

/// As the plan chooses; a value of `replenish_options.cpu`.
pub const REPLENISH_ANY_CPU: i32 = -1;
/// Without budget an ordinary thread; a value of `replenish_options.background`.
pub const REPLENISH_OTHER: i32 = 0;
/// Without budget only when nothing else wants the CPU; a value of `replenish_options.background`.
pub const REPLENISH_IDLE: i32 = -1;
/// Without budget not at all; a value of `replenish_options.background`. Not to be had yet:
/// REPLENISH_UNSUPPORTED.
pub const REPLENISH_SUSPEND: i32 = -2;
/// Bytes of a budget's name, with the 0 at its end.
pub const REPLENISH_NAME: usize = 32;

/// A budget to be made. Set by replenish_options_init, then changed.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// sizeof(replenish_options), set by replenish_options_init.
    pub size: usize,
    /// Names the budget in reports, refusals and the deployment file: 1 to 31 bytes of UTF-8.
    /// Copied. A worker of this name in the file that REPLENISH_OVERLAY names overrides the rest.
    pub name: *const c_char,
    /// CPU time in every period, in nanoseconds; 1 to the deadline. 0, with a period of 0: only the
    /// deployment file says.
    pub amount_ns: u64,
    /// The period in nanoseconds; 1 to a day.
    pub period_ns: u64,
    /// By when after a release the time must have been given, in nanoseconds; 1 to the period.
    /// 0: the period.
    pub deadline_ns: u64,
    /// The CPU of the budget's threads. REPLENISH_ANY_CPU: the plan chooses.
    pub cpu: i32,
    /// FIFO priority while there is budget, 1 to 98. 0: the plan chooses, and guarantees the
    /// amount. Another value is an expert's: no guarantee, but those of others still hold.
    pub priority: u32,
    /// Without budget: REPLENISH_OTHER, REPLENISH_IDLE, or a FIFO priority from 1 on below the
    /// budget's.
    pub background: i32,
    /// 0. Keeps the size the same everywhere.
    pub reserved: u32,
}

/// A budget so far.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Usage {
    /// sizeof(replenish_usage), set by the caller.
    pub size: usize,
    /// Its name, ends with 0.
    pub name: [c_char; REPLENISH_NAME],
    /// CPU time in every period, in nanoseconds.
    pub amount_ns: u64,
    /// The period in nanoseconds.
    pub period_ns: u64,
    /// CPU time that its threads have used at its priority, in nanoseconds.
    pub at_priority_ns: u64,
    /// CPU time that they have used in the background, in nanoseconds.
    pub background_ns: u64,
    /// Times that it ran out.
    pub exhaustions: u64,
    /// Times that a replenishment raised its threads.
    pub replenishments: u64,
    /// The longest time until budget that is due is delivered, by the plan, in nanoseconds. 0: no
    /// bound, or none that was asked for.
    pub worst_response_ns: u64,
    /// Threads that changed their policy or CPU by themselves, and were given theirs again.
    pub displaced: u64,
    /// Threads that have it now.
    pub threads: u32,
    /// Their CPU.
    pub cpu: i32,
    /// FIFO priority while there is budget.
    pub priority: u32,
    /// 1 while its threads have that priority, otherwise 0.
    pub at_priority: u32,
    /// 1 if the kernel's switch records show when its threads wait, otherwise 0: then budget comes
    /// back later than it could.
    pub sees_blocking: u32,
    /// 0. Keeps the size the same everywhere.
    pub reserved: u32,
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::mem::{offset_of, size_of};

    /// No gap that would be left unwritten, and no field that moves between compilers.
    #[test]
    fn structs_have_no_padding() {
        let word = size_of::<usize>();
        assert_eq!(size_of::<Options>(), 2 * word + 3 * 8 + 4 * 4);
        assert_eq!(size_of::<Usage>(), word + REPLENISH_NAME + 8 * 8 + 6 * 4);
        assert_eq!(offset_of!(Options, size), 0);
        assert_eq!(offset_of!(Usage, size), 0);
    }
}
