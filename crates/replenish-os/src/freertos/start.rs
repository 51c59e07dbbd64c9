//! Starts the kernel and the first task, from `main`.

use super::alarm;
use super::ffi;
use super::launch;
use crate::rtos::name::Name;
use crate::rtos::spawn_error::SpawnError;
use alloc::boxed::Box;
use core::sync::atomic::{AtomicU32, Ordering};

static ALARMS: AtomicU32 = AtomicU32::new(0);

/// Makes the first task and starts the kernel; returns only if it could not.
///
/// # Errors
/// If the memory for the task or the kernel is missing, or the priority is not 1 to 99.
pub fn start(
    priority: u8,
    stack_bytes: usize,
    main: impl FnOnce() + Send + 'static,
) -> Result<(), SpawnError> {
    crate::Policy::fifo(priority)?;
    launch::start(
        priority,
        &Name::new("main").ok_or(SpawnError::Name)?,
        stack_bytes,
        Box::new(move |_| main()),
    )?;
    alarm::begin();
    ffi::run_kernel();
    Ok(())
}

/// Notes that the time of `rp_board_arm` has come. The image calls this from the
/// interrupt of its timer, at a priority that may call the kernel. Too early does no harm.
pub fn on_timer() {
    ALARMS.fetch_add(1, Ordering::Relaxed);
    alarm::on_timer();
}

/// Number of times that the board's timer has rung.
pub(super) fn alarms() -> u32 {
    ALARMS.load(Ordering::Relaxed)
}
