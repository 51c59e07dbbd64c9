//! The kernel's hook at every switch of tasks.
#![expect(unsafe_code, reason = "the kernel hands slots over as pointers")]

use super::alarm;
use super::ffi;
use super::task_slot::{self, NEVER};
use crate::rtos::cs_token::CsToken;
use core::ffi::c_void;

/// The kernel is about to run the task of `slot` instead of the one that ran, which was `preempted`
/// or has blocked.
#[unsafe(no_mangle)]
extern "C" fn rp_switched(slot: *const c_void, preempted: u32) {
    // SAFETY: the kernel switches masked.
    let cs = unsafe { CsToken::assume() };
    let out = task_slot::current();
    task_slot::set_current(slot.cast());
    let now = ffi::board_now();
    if let Some(out) = out {
        out.state
            .within(cs, |s| s.switched_out(now, preempted != 0));
    }
    let limit =
        task_slot::current().map_or(NEVER, |slot| slot.state.within(cs, |s| s.switched_in(now)));
    alarm::program_limit(limit, cs);
}
