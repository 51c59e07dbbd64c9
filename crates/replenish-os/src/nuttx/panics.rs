//! A panic halts its thread and is reported; the others go on.

use super::console::complain;
use super::task_slot;
use crate::rtos::panicked;
use core::panic::PanicInfo;

/// Handles panics, in the library's `#[panic_handler]`: reports on standard error and halts the
/// thread. Locks it holds stay locked.
pub fn halt(info: &PanicInfo<'_>) -> ! {
    let slot = task_slot::current();
    let id = slot.map_or(0, |slot| slot.id);
    complain(format_args!("thread {id} halted: {info}"));
    panicked::count(id);
    loop {
        match slot {
            Some(slot) => slot.thread.park(task_slot::NEVER),
            None => core::hint::spin_loop(),
        }
    }
}
