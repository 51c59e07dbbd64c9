//! Keeping page faults out of real-time code: lock what is mapped, touch stacks beforehand.
#![expect(unsafe_code, reason = "pthread_getattr_np")]

use super::privilege::{Limit, probes};
use rustix::mm::{MlockAllFlags, mlockall, munlockall};
use rustix::process::Resource;
use std::fmt;
use std::hint::black_box;
use std::io;

/// Without `CAP_IPC_LOCK`, how much a limit must leave for what is mapped later. When locked
/// memory reaches the limit, allocations fail; a program that runs is better off unlocked.
const HEADROOM: u64 = 64 << 20;

/// Locks all memory of the process, now and in future (`mlockall(2)`).
///
/// No page of it is swapped out, and new mappings get their pages at once. That holds for the
/// whole stacks of threads started later, too: give them a
/// [stack size](crate::ThreadSpec::stack_size).
///
/// # Errors
/// If `RLIMIT_MEMLOCK` is too small: below what is mapped plus 64 MiB to grow into, without
/// `CAP_IPC_LOCK`. Nothing is locked then.
pub fn lock_all() -> Result<(), LockError> {
    let limit = probes::limit(Resource::Memlock);
    let mapped = probes::mapped_bytes();
    let refused = |source| LockError {
        source,
        limit,
        mapped,
    };
    let capable = probes::effective_capabilities().contains(probes::CAP_IPC_LOCK);
    if !capable
        && limit
            .soft
            .is_some_and(|limit| limit < mapped.saturating_add(HEADROOM))
    {
        return Err(refused(io::Error::from_raw_os_error(libc::ENOMEM)));
    }
    mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(|e| refused(e.into()))
}

/// Takes [`lock_all`] back (`munlockall(2)`).
///
/// # Errors
/// None that the kernel documents.
pub fn unlock_all() -> io::Result<()> {
    Ok(munlockall()?)
}

/// Why memory was not locked.
#[derive(Debug)]
pub struct LockError {
    source: io::Error,
    limit: Limit,
    mapped: u64,
}

impl fmt::Display for LockError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            source,
            limit,
            mapped,
        } = self;
        let (mapped, room) = (mapped >> 10, HEADROOM >> 10);
        write!(f, "memory was not locked: {source}; RLIMIT_MEMLOCK is ")?;
        match limit.soft {
            Some(bytes) => write!(f, "{} KiB", bytes >> 10)?,
            None => f.write_str("unlimited")?,
        }
        write!(
            f,
            ", this process has {mapped} KiB mapped and needs {room} KiB to grow into: raise the \
             limit (ulimit -l unlimited, docker --ulimit memlock=-1) or grant CAP_IPC_LOCK"
        )
    }
}

impl std::error::Error for LockError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        Some(&self.source)
    }
}

/// Touches the next `bytes` of the calling thread's stack, so that using them later causes no
/// page fault. Stops 32 KiB before the end of the stack if `bytes` reach beyond it.
///
/// # Errors
/// When the bounds of the stack cannot be read; nothing is touched then.
pub fn prefault_stack(bytes: usize) -> io::Result<()> {
    const RESERVE: usize = 32 << 10;
    let here = (&raw const *black_box(&bytes)).addr();
    let end = stack_end()?.saturating_add(RESERVE);
    touch_down_to(here.saturating_sub(bytes).max(end));
    Ok(())
}

/// Writes to a page of stack per call until the frame lies below `target`.
#[inline(never)]
fn touch_down_to(target: usize) {
    let mut page = [0_u8; 2048];
    black_box(&mut page);
    if (&raw const page).addr() > target {
        touch_down_to(target);
    }
    black_box(&mut page); // used after the call: the frame cannot be reused for it
}

/// The lowest address of the calling thread's stack.
fn stack_end() -> io::Result<usize> {
    // SAFETY: all-zero is a valid value to be initialised by the next call.
    let mut attr: libc::pthread_attr_t = unsafe { std::mem::zeroed() };
    // SAFETY: pthread_self has no arguments and cannot fail.
    let me = unsafe { libc::pthread_self() };
    // SAFETY: initialises `attr` from the running thread `me`.
    let rc = unsafe { libc::pthread_getattr_np(me, &raw mut attr) };
    if rc != 0 {
        return Err(io::Error::from_raw_os_error(rc));
    }
    let (mut low, mut size) = (std::ptr::null_mut(), 0);
    // SAFETY: `attr` was initialised; both results are writable.
    let rc = unsafe { libc::pthread_attr_getstack(&raw const attr, &raw mut low, &raw mut size) };
    // SAFETY: `attr` was initialised and is not used again.
    unsafe { libc::pthread_attr_destroy(&raw mut attr) };
    if rc == 0 {
        Ok(low.addr())
    } else {
        Err(io::Error::from_raw_os_error(rc))
    }
}
