//! The functions of `nuttx/shim.c`, each behind a safe name.
#![expect(unsafe_code, reason = "C functions of the shim")]

use crate::Nanos;
use crate::rtos::error::OsError;
use crate::rtos::name::Name;
use core::cell::UnsafeCell;
use core::ffi::{c_char, c_void};
use core::fmt;

type Entry = unsafe extern "C" fn(*mut c_void) -> *mut c_void;

unsafe extern "C" {
    fn rp_start_up(report: *mut ShimReport);
    fn rp_current() -> *const c_void;
    fn rp_mask() -> u32;
    fn rp_unmask(before: u32);
    fn rp_thread_init(thread: *mut c_void) -> i32;
    fn rp_adopt(thread: *mut c_void, slot: *const c_void) -> i32;
    fn rp_forget();
    fn rp_thread_create(
        entry: Entry,
        argument: *mut c_void,
        stack: usize,
        how: *const ShimPolicy,
        id: *mut u64,
    ) -> i32;
    fn rp_thread_note(thread: *mut c_void, id: u64, priority: i32);
    fn rp_name(name: *const c_char);
    fn rp_park(thread: *mut c_void, until: u64);
    fn rp_unpark(thread: *mut c_void);
    fn rp_set_priority(thread: *mut c_void, priority: i32) -> i32;
    fn rp_set_round_robin(thread: *mut c_void, priority: i32) -> i32;
    fn rp_policy_of(thread: *mut c_void, how: *mut ShimPolicy) -> i32;
    fn rp_yield();
    fn rp_board_now() -> u64;
    fn rp_cpu_time(thread: *mut c_void) -> u64;
    fn rp_blocks() -> u64;
    fn rp_malloc(align: usize, bytes: usize) -> *mut u8;
    fn rp_free(block: *mut u8);
    fn rp_print(text: *const u8, bytes: usize);
}

/// `struct rp_report` of the shim.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(super) struct ShimReport {
    pub(super) bytes: u32,
    pub(super) version: u32,
    pub(super) thread_bytes: u32,
    pub(super) thread_align: u32,
    pub(super) attr_bytes: u32,
    pub(super) param_bytes: u32,
    pub(super) mutex_bytes: u32,
    pub(super) time_bytes: u32,
    pub(super) misfits: u32,
    pub(super) features: u32,
    pub(super) max_repl: u32,
    pub(super) lowest: i32,
    pub(super) started: i32,
    pub(super) unused: u32,
    pub(super) resolution: u64,
    pub(super) step: u64,
}

/// A policy in the shim's words.
#[repr(C)]
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub(crate) struct ShimPolicy {
    /// 0 the lowest, 1 FIFO, 2 round-robin, 3 `SCHED_SPORADIC`.
    pub(crate) kind: i32,
    pub(crate) priority: i32,
    pub(crate) low: i32,
    pub(crate) max_repl: i32,
    pub(crate) budget: u64,
    pub(crate) period: u64,
}

/// Memory for the shim's `struct rp_thread`, whose size is checked at start.
#[repr(C, align(8))]
pub(crate) struct ThreadMemory(UnsafeCell<[u8; Self::BYTES]>);

// SAFETY: the shim's functions may be called from any thread; what they reach is the system's.
unsafe impl Sync for ThreadMemory {}

impl ThreadMemory {
    pub(crate) const BYTES: usize = 64;

    pub(crate) const fn new() -> Self {
        Self(UnsafeCell::new([0; Self::BYTES]))
    }

    const fn get(&self) -> *mut c_void {
        self.0.get().cast()
    }

    /// Once per memory, before everything else.
    pub(crate) fn init(&self) -> Result<(), OsError> {
        // SAFETY: large enough and aligned, as checked at start, and never moved (slots are
        // leaked).
        done("sem_init", unsafe { rp_thread_init(self.get()) })
    }

    /// Notes the id and priority from [`create`], before the thread reports them itself.
    pub(crate) fn note(&self, id: u64, priority: u8) {
        // SAFETY: initialised; masked by the caller.
        unsafe { rp_thread_note(self.get(), id, priority.into()) };
    }

    pub(crate) fn park(&self, until: Nanos) {
        // SAFETY: initialised; the calling thread's own.
        unsafe { rp_park(self.get(), until) };
    }

    pub(crate) fn unpark(&self) {
        // SAFETY: initialised and never freed.
        unsafe { rp_unpark(self.get()) };
    }

    /// The thread has not ended: the caller is masked and has looked.
    pub(crate) fn set_priority(&self, priority: u8) -> Result<(), OsError> {
        // SAFETY: a thread that has not ended.
        let answer = unsafe { rp_set_priority(self.get(), priority.into()) };
        done("pthread_setschedprio", answer)
    }

    /// As [`set_priority`](Self::set_priority).
    pub(crate) fn set_round_robin(&self, priority: u8) -> Result<(), OsError> {
        // SAFETY: a thread that has not ended.
        let answer = unsafe { rp_set_round_robin(self.get(), priority.into()) };
        done("pthread_setschedparam", answer)
    }

    /// As [`set_priority`](Self::set_priority).
    pub(crate) fn policy(&self) -> Result<ShimPolicy, OsError> {
        let mut how = ShimPolicy::default();
        // SAFETY: a thread that has not ended, and memory for the answer.
        let answer = unsafe { rp_policy_of(self.get(), &raw mut how) };
        done("pthread_getschedparam", answer).map(|()| how)
    }

    /// CPU time where there are no switch hooks; as [`set_priority`](Self::set_priority).
    pub(crate) fn cpu_time(&self) -> Nanos {
        // SAFETY: a thread that has not ended.
        unsafe { rp_cpu_time(self.get()) }
    }
}

impl fmt::Debug for ThreadMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ThreadMemory")
    }
}

fn done(what: &'static str, answer: i32) -> Result<(), OsError> {
    match answer {
        0 => Ok(()),
        errno => Err(OsError::call(what, errno)),
    }
}

/// Sets the shim up, once, and asks what it knows.
pub(crate) fn start_up() -> ShimReport {
    let mut report = ShimReport::default();
    // SAFETY: writes a report; its size is the first thing that is compared.
    unsafe { rp_start_up(&raw mut report) };
    report
}

/// The slot pointer of the calling thread; null if it has none.
pub(crate) fn current() -> *const c_void {
    // SAFETY: reads a value of the calling thread.
    unsafe { rp_current() }
}

/// The calling thread is the one with this memory and slot.
pub(crate) fn adopt(thread: &ThreadMemory, slot: *const c_void) -> Result<(), OsError> {
    // SAFETY: initialised memory; the slot is a leaked box.
    done("pthread_setspecific", unsafe {
        rp_adopt(thread.get(), slot)
    })
}

/// The calling thread has no slot any more.
pub(crate) fn forget() {
    // SAFETY: sets a value of the calling thread.
    unsafe { rp_forget() };
}

/// Makes a thread; it runs as soon as its priority lets it. The system's number for it.
pub(crate) fn create(
    entry: Entry,
    argument: *mut c_void,
    stack: usize,
    how: &ShimPolicy,
) -> Result<u64, OsError> {
    let mut id = 0;
    // SAFETY: the entry takes the argument back; policy and number are used during the call.
    let answer = unsafe { rp_thread_create(entry, argument, stack, how, &raw mut id) };
    done("pthread_create", answer).map(|()| id)
}

/// Names the calling thread.
pub(crate) fn set_name(name: &Name) {
    // SAFETY: a C string that lives across the call.
    unsafe { rp_name(name.as_ptr()) };
}

/// Keeps every thread and interrupt away that could see masked data.
pub(crate) fn mask() -> u32 {
    // SAFETY: paired with `unmask`.
    unsafe { rp_mask() }
}

/// Undoes [`mask`].
pub(crate) fn unmask(before: u32) {
    // SAFETY: `before` came from `mask`.
    unsafe { rp_unmask(before) };
}

/// Puts the calling thread at the end of the list of its priority.
pub(crate) fn yield_cpu() {
    // SAFETY: no arguments, no memory.
    unsafe { rp_yield() };
}

/// The clock: the system's monotonic one or the image's.
pub(crate) fn board_now() -> Nanos {
    // SAFETY: reads a clock.
    unsafe { rp_board_now() }
}

/// Number of times that the calling thread blocked, for systems without switch hooks.
pub(crate) fn blocks() -> u64 {
    // SAFETY: reads a counter.
    unsafe { rp_blocks() }
}

/// Memory of the system's heap; null if there is none.
pub(crate) fn malloc(align: usize, bytes: usize) -> *mut u8 {
    // SAFETY: plain numbers.
    unsafe { rp_malloc(align, bytes) }
}

/// Gives it back.
///
/// # Safety
/// `block` came from [`malloc`] and is not used again.
pub(crate) unsafe fn free(block: *mut u8) {
    // SAFETY: the caller's word.
    unsafe { rp_free(block) };
}

/// Writes to standard error.
pub(crate) fn print(text: &str) {
    // SAFETY: the text is readable for the call.
    unsafe { rp_print(text.as_ptr(), text.len()) };
}
