//! A panic halts its thread and is reported; the others go on.

use super::ffi;
use super::slot;
use crate::Tid;
use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

static COUNT: AtomicU32 = AtomicU32::new(0);
static LAST: AtomicU32 = AtomicU32::new(0);

/// Panics so far.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Panicked {
    /// How many threads were halted.
    pub count: u32,
    /// The last of them.
    pub last: Option<Tid>,
}

/// How many threads panicked, and which one last.
#[must_use]
pub fn panicked() -> Panicked {
    Panicked {
        count: COUNT.load(Ordering::Acquire),
        last: Tid::new(LAST.load(Ordering::Acquire).cast_signed()),
    }
}

/// For the library's `#[panic_handler]`: reports on standard error and halts the thread. Locks it
/// holds stay locked.
pub fn halt(info: &PanicInfo<'_>) -> ! {
    let slot = slot::current();
    let id = slot.map_or(0, |slot| slot.id);
    ffi::complain(format_args!("thread {id} halted: {info}"));
    COUNT.fetch_add(1, Ordering::AcqRel);
    LAST.store(id.cast_unsigned(), Ordering::Release);
    loop {
        match slot {
            Some(slot) => slot.thread.park(slot::NEVER),
            None => core::hint::spin_loop(),
        }
    }
}
