//! The functions that the shim and the system's hooks call.
#![expect(unsafe_code, reason = "C hands slots over as pointers")]

use super::ffi;
use super::task_slot::{TaskSlot, release};
use core::ffi::c_void;

/// The shim's: a thread that this crate did not make is about to end.
#[unsafe(no_mangle)]
extern "C" fn rp_thread_gone(slot: *const c_void) {
    // SAFETY: what `adopt` was given: a leaked box.
    if let Some(slot) = unsafe { slot.cast::<TaskSlot>().as_ref() } {
        release(slot);
    }
}

/// The system's hook: the running thread is about to lose the CPU.
#[unsafe(no_mangle)]
extern "C" fn rp_switched_out(slot: *const c_void, preempted: u32) {
    // SAFETY: what `adopt` was given: a leaked box, or null.
    let Some(slot) = (unsafe { slot.cast::<TaskSlot>().as_ref() }) else {
        return;
    };
    let now = ffi::board_now();
    slot.state.with(|s| s.switched_out(now, preempted != 0));
}

/// The system's hook: the chosen thread is about to run.
#[unsafe(no_mangle)]
extern "C" fn rp_switched_in(slot: *const c_void) {
    // SAFETY: what `adopt` was given: a leaked box, or null.
    let Some(slot) = (unsafe { slot.cast::<TaskSlot>().as_ref() }) else {
        return;
    };
    let now = ffi::board_now();
    slot.state.with(|s| s.switched_in(now));
}
