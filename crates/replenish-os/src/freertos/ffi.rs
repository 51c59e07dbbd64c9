//! The shim's functions (`freertos/shim.c`) and the image's, each behind a safe name.
#![expect(
    unsafe_code,
    reason = "C functions of the kernel's shim and of the image"
)]

use crate::Nanos;
use crate::rtos::cs_token::CsToken;
use crate::rtos::error::OsError;
use crate::rtos::name::Name;
use crate::rtos::ready_position::ReadyPosition;
use core::ffi::{CStr, c_void};
use core::ptr::NonNull;

mod c {
    use core::ffi::{c_char, c_void};
    unsafe extern "C" {
        pub(super) fn rp_tcb_bytes() -> u32;
        pub(super) fn rp_task_create(
            entry: unsafe extern "C" fn(*mut c_void),
            name: *const c_char,
            stack: *mut u32,
            words: u32,
            argument: *mut c_void,
            priority: u32,
            tcb: *mut c_void,
            slot: *const c_void,
            id: u32,
        ) -> *mut c_void;
        pub(super) fn rp_start();
        pub(super) fn rp_current_task() -> *mut c_void;
        #[cfg(not(target_arch = "arm"))]
        pub(super) fn rp_mask() -> u32;
        #[cfg(not(target_arch = "arm"))]
        pub(super) fn rp_unmask(before: u32);
        pub(super) fn rp_block();
        pub(super) fn rp_wake(task: *mut c_void);
        pub(super) fn rp_place(task: *mut c_void, priority: u32, head: u32);
        pub(super) fn rp_halt() -> !;
        pub(super) fn rp_stack_unused(task: *mut c_void) -> u32;
        pub(super) fn rp_priority(task: *mut c_void) -> u32;
        pub(super) fn rp_name(task: *mut c_void) -> *const c_char;
        pub(super) fn rp_running(
            name: *mut *const c_char,
            stack: *mut *const u8,
            bytes: *mut u32,
        ) -> u32;
        pub(super) static rp_idle_waits: u32;
        pub(super) fn rp_board_now() -> u64;
        pub(super) fn rp_board_arm(at: u64);
        pub(super) fn rp_board_print(text: *const u8, bytes: usize);
    }
}

/// A task of the kernel. Tasks are never deleted, so a handle stays good.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Task(NonNull<c_void>);

// SAFETY: the kernel takes handles from any task and from interrupts.
unsafe impl Send for Task {}

/// The parts of a task that [`create`] gives to the kernel for good. Of the name it makes a copy.
pub(crate) struct Creation<'a> {
    pub(crate) entry: unsafe extern "C" fn(*mut c_void),
    pub(crate) name: &'a Name,
    pub(crate) stack: &'static mut [u64],
    pub(crate) argument: *mut c_void,
    pub(crate) priority: u8,
    pub(crate) tcb: &'static mut [u64],
    pub(crate) slot: *const c_void,
    pub(crate) id: i32,
}

/// The size of a task's control block.
pub(crate) fn tcb_bytes() -> usize {
    // SAFETY: no arguments, no state.
    unsafe { c::rp_tcb_bytes() as usize }
}

/// Makes a task; it runs as soon as its priority lets it.
pub(crate) fn create(what: &mut Creation<'_>) -> Option<Task> {
    let words = u32::try_from(what.stack.len() * 2).ok()?;
    if size_of_val(what.tcb) < tcb_bytes() {
        return None;
    }
    // SAFETY: stack and control block are large enough, aligned to 8 and given away for good.
    let task = unsafe {
        c::rp_task_create(
            what.entry,
            what.name.as_ptr(),
            what.stack.as_mut_ptr().cast(),
            words,
            what.argument,
            what.priority.into(),
            what.tcb.as_mut_ptr().cast(),
            what.slot,
            what.id.cast_unsigned(),
        )
    };
    NonNull::new(task).map(Task)
}

/// Starts the kernel; returns only if it could not.
pub(crate) fn run_kernel() {
    // SAFETY: called once, from `main`, with tasks made.
    unsafe { c::rp_start() };
}

/// The running task.
pub(crate) fn current_task() -> Option<Task> {
    // SAFETY: reads the kernel's current task.
    NonNull::new(unsafe { c::rp_current_task() }).map(Task)
}

/// `configMAX_SYSCALL_INTERRUPT_PRIORITY`; the shim checks that it is.
#[cfg(target_arch = "arm")]
const MASKED: u32 = 0x50;

/// Masks the interrupts that may call the kernel, and thereby switches too. Raising the priority
/// takes effect with the next instruction (Armv7-M, B5.2.3): no barrier.
#[inline(always)]
pub(crate) fn mask() -> u32 {
    #[cfg(target_arch = "arm")]
    {
        let before: u32;
        // SAFETY: sets BASEPRI; allowed in tasks and interrupts.
        unsafe {
            core::arch::asm!(
                "mrs {before}, BASEPRI",
                "msr BASEPRI, {masked}",
                before = out(reg) before,
                masked = in(reg) MASKED,
                options(nostack, preserves_flags)
            );
        }
        before
    }
    #[cfg(not(target_arch = "arm"))]
    // SAFETY: as above.
    unsafe {
        c::rp_mask()
    }
}

/// Undoes [`mask`].
#[inline(always)]
pub(crate) fn unmask(before: u32) {
    #[cfg(target_arch = "arm")]
    // SAFETY: `before` came from `mask`.
    unsafe {
        core::arch::asm!("msr BASEPRI, {}", in(reg) before, options(nostack, preserves_flags));
    }
    #[cfg(not(target_arch = "arm"))]
    // SAFETY: as above.
    unsafe {
        c::rp_unmask(before);
    }
}

/// The running task waits until it is woken; not while masked.
pub(crate) fn block() {
    // SAFETY: called from tasks only (callers have a slot).
    unsafe { c::rp_block() };
}

/// Wakes a task, from tasks and interrupts.
pub(crate) fn wake(task: Task) {
    // SAFETY: the handle is good for ever.
    unsafe { c::rp_wake(task.0.as_ptr()) };
}

/// Gives a task another priority.
#[expect(
    clippy::unnecessary_wraps,
    reason = "the other back end's kernel may refuse"
)]
pub(crate) fn place(
    task: Task,
    priority: u8,
    place: ReadyPosition,
    _: CsToken<'_>,
) -> Result<(), OsError> {
    // At priority 0 the idle task stays first: a suspended task is not to run.
    let head = place == ReadyPosition::Head && priority > 0;
    // SAFETY: the handle is good, the priority is below configMAX_PRIORITIES, and the mask protects
    // the kernel's lists.
    unsafe { c::rp_place(task.0.as_ptr(), priority.into(), head.into()) };
    Ok(())
}

/// Stops the running task for good.
pub(crate) fn halt() -> ! {
    // SAFETY: suspends the running task and never resumes it.
    unsafe { c::rp_halt() }
}

/// Bytes of the task's stack that were never used.
pub(crate) fn stack_unused(task: Task) -> usize {
    // SAFETY: the handle is good; reads its stack.
    unsafe { c::rp_stack_unused(task.0.as_ptr()) as usize }
}

/// The priority a task has at this moment, an inherited one included.
pub(crate) fn priority(task: Task) -> u8 {
    // SAFETY: the handle is good; reads its control block.
    u8::try_from(unsafe { c::rp_priority(task.0.as_ptr()) }).unwrap_or(u8::MAX)
}

/// The first 15 bytes of a task's name.
pub(crate) fn name(task: Task) -> &'static str {
    // SAFETY: the handle is good for ever, and with it its control block.
    let raw = unsafe { c::rp_name(task.0.as_ptr()) };
    // SAFETY: the kernel ends names with a zero.
    let name = unsafe { CStr::from_ptr(raw) };
    name.to_str().unwrap_or("?")
}

/// The running task as the kernel has it, even if our own data is damaged.
pub(crate) struct Running {
    pub(crate) id: i32,
    pub(crate) name: &'static CStr,
    pub(crate) stack: *const u8,
    pub(crate) stack_bytes: usize,
}

/// The running task; `None` before the kernel runs and in the idle task.
pub(crate) fn running() -> Option<Running> {
    let (mut name, mut stack, mut bytes) = (core::ptr::null(), core::ptr::null(), 0);
    // SAFETY: three places to write to.
    let id = unsafe { c::rp_running(&raw mut name, &raw mut stack, &raw mut bytes) };
    let id = i32::try_from(id).ok().filter(|&id| id > 0)?;
    // SAFETY: a number says that there is a task, and so its name.
    let name = unsafe { CStr::from_ptr(name) };
    Some(Running {
        id,
        name,
        stack,
        stack_bytes: bytes as usize,
    })
}

/// Number of times that the idle task has waited for an interrupt.
pub(crate) fn idle_waits() -> u32 {
    // SAFETY: a counter that the idle task alone writes, in one piece.
    unsafe { (&raw const c::rp_idle_waits).read_volatile() }
}

/// The image's clock.
pub(crate) fn board_now() -> Nanos {
    // SAFETY: the image's function; callable anywhere by contract.
    unsafe { c::rp_board_now() }
}

/// The image's one-shot timer.
pub(crate) fn board_arm(at: Nanos, _: CsToken<'_>) {
    // SAFETY: the image's function; called masked.
    unsafe { c::rp_board_arm(at) };
}

/// Bytes to the image's console.
pub(crate) fn print(bytes: &[u8]) {
    // SAFETY: the bytes are readable for the call.
    unsafe { c::rp_board_print(bytes.as_ptr(), bytes.len()) };
}
