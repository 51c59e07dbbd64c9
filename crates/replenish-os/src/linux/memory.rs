//! Keeping page faults out of real-time code: lock what is mapped, touch stacks beforehand.
//!
//! When memory runs short, the kernel takes pages of a program's file back, and reads them from the
//! disk again when the program gets there. An enforcer that waits for its own instructions lowers
//! no thread: with [`keep_program`] budgets hold beside a compiler that fills the memory.
#![expect(unsafe_code, reason = "pthread_getattr_np, mlock")]

use super::privilege::{Limit, probes};
use rustix::mm::{MlockAllFlags, mlock, mlockall, munlockall};
use rustix::process::Resource;
use std::collections::HashSet;
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
        needs: Needs::Everything(mapped),
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

/// Keeps the program and its libraries in memory (`mlock(2)` of their mappings): all of them that
/// are loaded now, read in whole.
///
/// Other memory is not locked, unlike with [`lock_all`]: a process that gives up its privileges
/// later may go on to allocate, and without swap the kernel cannot take that memory anyway. May be
/// called again and from any thread; [`unlock_all`] takes it back. Set-up only: it allocates.
///
/// # Errors
/// If `RLIMIT_MEMLOCK` is too small, without `CAP_IPC_LOCK`. A part may be locked then.
pub fn keep_program() -> Result<(), LockError> {
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let mappings = program_mappings(&maps);
    for &(from, to) in &mappings {
        // SAFETY: locking changes no byte; a range that was unmapped meanwhile is an error.
        let locked = unsafe {
            mlock(
                std::ptr::without_provenance_mut(from),
                to.saturating_sub(from),
            )
        };
        locked.map_err(|e| {
            let sizes = mappings.iter().map(|(from, to)| to.saturating_sub(*from));
            LockError {
                source: e.into(),
                limit: probes::limit(Resource::Memlock),
                needs: Needs::Program(sizes.sum::<usize>() as u64),
            }
        })?;
    }
    Ok(())
}

/// Address ranges of files that hold instructions, their constants included.
fn program_mappings(maps: &str) -> Vec<(usize, usize)> {
    let mappings: Vec<_> = maps.lines().filter_map(mapping).collect();
    let programs: HashSet<&str> = mappings
        .iter()
        .filter(|m| m.executable)
        .map(|m| m.file)
        .collect();
    let theirs = mappings.iter().filter(|m| programs.contains(m.file));
    theirs.map(|m| m.range).collect()
}

/// A private, readable mapping of a file.
#[derive(Debug, PartialEq, Eq)]
struct Mapping<'a> {
    range: (usize, usize),
    executable: bool,
    file: &'a str,
}

/// A line of `/proc/self/maps`: `from-to rwxp offset device inode path`.
fn mapping(line: &str) -> Option<Mapping<'_>> {
    let (range, rest) = line.split_once(' ')?;
    let (from, to) = range.split_once('-')?;
    let address = |hex| usize::from_str_radix(hex, 16).ok();
    let rights = rest.get(..4)?.as_bytes();
    let file = rest.get(rest.find('/')?..)?;
    let readable = rights.first() == Some(&b'r') && rights.get(3) == Some(&b'p');
    readable.then_some(Mapping {
        range: (address(from)?, address(to)?),
        executable: rights.get(2) == Some(&b'x'),
        file,
    })
}

/// Takes [`lock_all`] and [`keep_program`] back (`munlockall(2)`).
///
/// # Errors
/// None that the kernel documents.
pub fn unlock_all() -> io::Result<()> {
    Ok(munlockall()?)
}

/// Reason why memory was not locked.
#[derive(Debug)]
pub struct LockError {
    source: io::Error,
    limit: Limit,
    needs: Needs,
}

/// Bytes that were to be locked.
#[derive(Debug)]
enum Needs {
    /// All that the process has mapped, and [`HEADROOM`].
    Everything(u64),
    /// The program and its libraries.
    Program(u64),
}

impl fmt::Display for LockError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "memory was not locked: {}; RLIMIT_MEMLOCK is ",
            self.source
        )?;
        match self.limit.soft {
            Some(bytes) => write!(f, "{} KiB", bytes >> 10)?,
            None => f.write_str("unlimited")?,
        }
        match self.needs {
            Needs::Everything(bytes) => write!(
                f,
                ", this process has {} KiB mapped and needs {} KiB to grow into",
                bytes >> 10,
                HEADROOM >> 10
            ),
            Needs::Program(bytes) => {
                write!(
                    f,
                    ", the program and its libraries have {} KiB",
                    bytes >> 10
                )
            }
        }?;
        f.write_str(
            ": raise the limit (ulimit -l unlimited, docker --ulimit memlock=-1) or grant \
             CAP_IPC_LOCK",
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_is_what_has_instructions() {
        let maps = "\
55d0a000-55d0b000 r--p 00000000 fe:00 42                         /opt/my robot/talker
55d0b000-55d0f000 r-xp 00001000 fe:00 42                         /opt/my robot/talker
55d0f000-55d10000 rw-p 00005000 fe:00 42                         /opt/my robot/talker
55d20000-55d30000 rw-p 00000000 00:00 0                          [heap]
7f000000-7f800000 r--p 00000000 fe:00 43                         /opt/weights.bin
7f900000-7f910000 rw-s 00000000 00:19 7                          /dev/shm/replenish-0/1-0.live
7fa00000-7fa01000 ---p 00000000 fe:00 42                         /opt/my robot/talker
7ffc0000-7ffd0000 r-xp 00000000 00:00 0                          [vdso]
";
        let program = [
            (0x55d0_a000, 0x55d0_b000),
            (0x55d0_b000, 0x55d0_f000),
            (0x55d0_f000, 0x55d1_0000),
        ];
        assert_eq!(program_mappings(maps), program);
        assert_eq!(program_mappings("\n-\nxyz r-xp 0 0 0 /a\n5-6 r"), []);
    }
}
