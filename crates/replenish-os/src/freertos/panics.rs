//! A panic halts its task and is reported; the others go on.

#![expect(unsafe_code, reason = "functions the kernel calls, with C strings")]

use super::ffi;
use super::slot;
use super::tid::Tid;
use core::ffi::{CStr, c_char, c_void};
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

static COUNT: AtomicU32 = AtomicU32::new(0);
static LAST: AtomicU32 = AtomicU32::new(0);

/// Panics so far.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Panicked {
    /// How many tasks were halted.
    pub count: u32,
    /// The last of them.
    pub last: Option<Tid>,
}

/// How many tasks panicked, and which one last.
#[must_use]
pub fn panicked() -> Panicked {
    Panicked {
        count: COUNT.load(Ordering::Acquire),
        last: Tid::new(LAST.load(Ordering::Acquire).cast_signed()),
    }
}

/// For the image's `#[panic_handler]`: reports on the console and halts the task. Locks it holds
/// stay locked. Outside of tasks the board stops.
pub fn halt(info: &PanicInfo<'_>) -> ! {
    let id = slot::current().map_or(0, |slot| slot.id);
    ffi::complain(format_args!("task {id} halted: {info}"));
    stop(id)
}

fn stop(id: i32) -> ! {
    COUNT.fetch_add(1, Ordering::AcqRel);
    LAST.store(id.cast_unsigned(), Ordering::Release);
    if id == 0 {
        ffi::mask();
        loop {
            core::hint::spin_loop();
        }
    }
    ffi::halt()
}

/// The kernel found a contradiction: nothing it says can be relied on any more.
#[unsafe(no_mangle)]
extern "C" fn rp_assert_failed(file: *const c_char, line: u32) -> ! {
    // SAFETY: `__FILE__` of the kernel's sources.
    let file = unsafe { CStr::from_ptr(file) };
    ffi::complain(format_args!(
        "assertion of the kernel failed: {file:?}:{line}"
    ));
    stop(0)
}

/// A task ran over the end of its stack: what it overwrote is unknown.
#[unsafe(no_mangle)]
extern "C" fn rp_stack_overflow(slot: *const c_void) -> ! {
    // SAFETY: what `rp_task_create` was given: a leaked box, or null.
    let slot = unsafe { slot.cast::<slot::Slot>().as_ref() };
    let (id, bytes) = slot.map_or((0, 0), |s| (s.id, s.stack_bytes));
    ffi::complain(format_args!(
        "task {id} needs more than its {bytes} bytes of stack"
    ));
    stop(0)
}
