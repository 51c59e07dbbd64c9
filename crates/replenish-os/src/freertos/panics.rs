//! A panic halts its task and is reported; the others go on.

#![expect(unsafe_code, reason = "functions the kernel calls, with C strings")]

use super::{console, ffi};
use crate::rtos::panicked;
use core::ffi::{CStr, c_char};
use core::fmt;
use core::panic::PanicInfo;
use core::ptr;
use core::sync::atomic::{AtomicPtr, Ordering};

/// The running task, for a report: `task 3 (high)`.
pub(super) struct Who(Option<ffi::Running>);

impl Who {
    pub(super) fn running() -> Self {
        Self(ffi::running())
    }
}

impl Who {
    /// Reports what it did or met, with a number: a line without formatting, which takes kilobytes.
    pub(super) fn says(&self, what: &[u8], number: usize, of: &[u8]) {
        ffi::print(console::PREFIX);
        match &self.0 {
            Some(task) => {
                ffi::print(b"task ");
                console::print_decimal(usize::try_from(task.id).unwrap_or(0));
                ffi::print(b" (");
                ffi::print(task.name.to_bytes()); // as it is: checking it takes room
                ffi::print(b")");
            }
            None => ffi::print(b"outside of tasks"),
        }
        ffi::print(what);
        console::print_decimal(number);
        ffi::print(of);
    }
}

impl fmt::Display for Who {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.0 {
            Some(task) => {
                let name = task.name.to_str().unwrap_or("?");
                write!(f, "task {} ({name})", task.id)
            }
            None => f.write_str("outside of tasks"),
        }
    }
}

/// The board's function for a program that cannot go on; see [`on_stop`].
static ON_STOP: AtomicPtr<()> = AtomicPtr::new(ptr::null_mut());

/// Sets the function that the image runs when the board cannot go on.
///
/// The reasons are a stack overflow, a contradiction in the kernel, or a panic outside of tasks;
/// the function brings outputs to rest, or resets. It is called once with all of the kernel's
/// interrupts masked, after the report. If it returns, the board stands still.
pub fn on_stop(hook: fn()) {
    ON_STOP.store(hook as *mut (), Ordering::Release);
}

/// Handles the image's panics, in its `#[panic_handler]`: reports on the console and halts the
/// task. Locks it holds stay locked. Outside of tasks the board stops.
pub fn halt(info: &PanicInfo<'_>) -> ! {
    console::print_formatted(format_args!("{} halted: {info}", Who::running()));
    let id = ffi::running().map_or(0, |task| task.id);
    panicked::count(id);
    if id == 0 {
        stop();
    }
    ffi::halt()
}

/// Handles the image's faults: prints the running task on the console, and whether it is over the
/// end of its stack; then the board stops. `what` names the fault.
pub fn fault(what: fmt::Arguments<'_>) -> ! {
    match ffi::running().filter(is_over) {
        Some(_) => rp_stack_overflow(),
        None => {
            console::print_formatted(format_args!("{}: {what}", Who::running()));
            stop()
        }
    }
}

/// The kernel fills stacks with this; the last bytes stay, or something has been there.
fn is_over(task: &ffi::Running) -> bool {
    const FILL: [u8; 16] = [0xA5; 16];
    // SAFETY: the lowest bytes of a stack that is the task's for good.
    !task.stack.is_null() && unsafe { task.stack.cast::<[u8; 16]>().read_volatile() } != FILL
}

fn stop() -> ! {
    ffi::mask();
    let hook = ON_STOP.swap(ptr::null_mut(), Ordering::AcqRel);
    // SAFETY: null or what `on_stop` stored, a function.
    if let Some(hook) = unsafe { core::mem::transmute::<*mut (), Option<fn()>>(hook) } {
        hook();
    }
    loop {
        core::hint::spin_loop();
    }
}

/// The kernel found a contradiction: nothing it says can be relied on any more.
#[unsafe(no_mangle)]
extern "C" fn rp_assert_failed(file: *const c_char, line: u32) -> ! {
    // SAFETY: `__FILE__` of the kernel's sources.
    let file = unsafe { CStr::from_ptr(file) };
    for part in [
        console::PREFIX,
        b"assertion of the kernel failed: ",
        file.to_bytes(),
        b":",
    ] {
        ffi::print(part);
    }
    console::print_decimal(usize::try_from(line).unwrap_or(0));
    ffi::print(b"\n");
    stop()
}

/// The running task ran over the end of its stack: what it overwrote is unknown, and so nothing of
/// ours is asked, only the kernel.
#[unsafe(no_mangle)]
extern "C" fn rp_stack_overflow() -> ! {
    let bytes = ffi::running().map_or(0, |task| task.stack_bytes);
    Who::running().says(b" needs more than its ", bytes, b" bytes of stack\n");
    stop()
}
