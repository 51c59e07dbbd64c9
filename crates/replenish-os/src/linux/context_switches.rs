//! A thread's context switches, as the kernel records them: when it left the CPU, when it came
//! back, and whether it was preempted or blocked.
//!
//! `perf_event_open(2)` with a dummy software event and `context_switch` writes one
//! `PERF_RECORD_SWITCH` per switch into a ring shared with the kernel. Reading it takes no system
//! call and no allocation. A full ring drops records. The kernel says so with the next record that
//! fits, which may be much later; so a ring that is found full counts as one that has lost some.
//!
//! ```text
//!   data_tail (ours)            data_head (the kernel's)
//!       ▼  ┌──────────┬──────────┬──────────┐ ▼
//!          │ SWITCH 24│ SWITCH 24│ LOST …   │      word i at (tail + 8 i) mod size
//!          └──────────┴──────────┴──────────┘
//! ```
#![expect(
    unsafe_code,
    reason = "perf_event_open, mmap, and a ring shared with the kernel"
)]

use super::sys;
use crate::Nanos;
use crate::Tid;
use std::io;
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};
use std::ptr;
use std::sync::atomic::{AtomicU64, Ordering};

/// One switch of the thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ContextSwitch {
    /// Time of the switch, on `CLOCK_MONOTONIC`, in nanoseconds.
    pub time: Nanos,
    /// Direction of the switch.
    pub kind: SwitchDirection,
}

impl ContextSwitch {
    /// The same, but a block that began at such a time is a preemption.
    pub(crate) fn unless(mut self, excused: impl FnOnce(Nanos) -> bool) -> Self {
        if let SwitchDirection::Out { preempted } = &mut self.kind {
            *preempted = *preempted || excused(self.time);
        }
        self
    }
}

/// Direction of a switch: off the CPU, or onto it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SwitchDirection {
    /// The thread left the CPU.
    Out {
        /// The thread was still runnable (preempted, or it yielded); otherwise it blocked.
        preempted: bool,
    },
    /// The thread got the CPU.
    In,
}

/// The records that a [`ContextSwitchLog::drain`] missed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Drained {
    /// Switches may be missing since the last drain: the ring was full, or so nearly full that
    /// the next record would not have fitted.
    pub lost: bool,
}

/// Pages of a ring at most: 32 KiB hold some 1300 switches between two readings.
const MOST_PAGES: usize = 8;

/// Locked memory that the rings of one enforcer share, in pages. `kernel.perf_event_mlock_kb`
/// gives every user 516 KiB per CPU; a ring that does not fit any more is refused.
const PAGES_TOGETHER: usize = 128;

/// The free room that the kernel asks for at most before it writes a switch: the record itself
/// (24 bytes) behind the announcement of an earlier loss (40 bytes).
const LARGEST_WRITE: u64 = 64;

/// Offsets of `data_head` and `data_tail` in `struct perf_event_mmap_page`.
const HEAD: usize = 1024;
const TAIL: usize = 1032;

/// `PERF_FLAG_FD_CLOEXEC`.
pub(super) const FLAG_FD_CLOEXEC: libc::c_ulong = 1 << 3;

const RECORD_LOST: u32 = 2;
const RECORD_SWITCH: u32 = 14;
const MISC_SWITCH_OUT: u16 = 1 << 13;
const MISC_SWITCH_OUT_PREEMPT: u16 = 1 << 14;

/// The record of one thread's context switches. It may be read from any thread, one at a time.
#[derive(Debug)]
pub struct ContextSwitchLog {
    map: *mut u8,
    page: usize,
    /// Bytes of the ring, a power of two.
    ring: usize,
    event: OwnedFd,
}

// SAFETY: the mapping is owned by this value and not tied to a thread.
unsafe impl Send for ContextSwitchLog {}

impl ContextSwitchLog {
    /// Starts to record the switches of thread `tid` of this process.
    ///
    /// # Errors
    /// `EACCES` or `EPERM` where `kernel.perf_event_paranoid` or a container forbids it, `ENOSYS`
    /// without perf in the kernel, `ESRCH` if the thread has ended, `EPERM` or `ENOMEM` when the
    /// memory that may be locked is used up.
    pub fn open(tid: Tid) -> io::Result<Self> {
        Self::open_one_of(tid, 1)
    }

    /// The same with a ring that is one of `rings` under one limit of locked memory: the more
    /// there are, the smaller each is.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub(crate) fn open_one_of(tid: Tid, rings: usize) -> io::Result<Self> {
        Self::open_with(&Attr::switches(Attr::DUMMY), tid, rings)
    }

    /// The same, and [`cpu`](Self::cpu) counts.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub(super) fn open_counting(tid: Tid, rings: usize) -> io::Result<Self> {
        Self::open_with(&Attr::switches(Attr::TASK_CLOCK), tid, rings)
    }

    fn open_with(attr: &Attr, tid: Tid, rings: usize) -> io::Result<Self> {
        let share = (PAGES_TOGETHER / rings.max(1)).saturating_sub(1); // less its control page
        let pages = 1 << share.clamp(1, MOST_PAGES).ilog2();
        let (any_cpu, no_group) = (-1, -1);
        let (attr, cloexec) = (&raw const *attr, FLAG_FD_CLOEXEC);
        // SAFETY: `attr` lives across the call and states its own size.
        let fd = sys::check(unsafe {
            libc::syscall(
                libc::SYS_perf_event_open,
                attr,
                tid.get(),
                any_cpu,
                no_group,
                cloexec,
            )
        })?;
        let fd = i32::try_from(fd).map_err(io::Error::other)?;
        // SAFETY: the descriptor is new, open and not owned elsewhere.
        let event = unsafe { OwnedFd::from_raw_fd(fd) };
        // SAFETY: sysconf takes a number and touches no memory.
        let page = usize::try_from(unsafe { libc::sysconf(libc::_SC_PAGESIZE) }).unwrap_or(4096);
        let length = page * (1 + pages);
        let (rw, shared) = (libc::PROT_READ | libc::PROT_WRITE, libc::MAP_SHARED);
        // SAFETY: a new shared mapping at an address of the kernel's choice.
        let map = unsafe { libc::mmap(ptr::null_mut(), length, rw, shared, event.as_raw_fd(), 0) };
        if map == libc::MAP_FAILED {
            return Err(io::Error::last_os_error());
        }
        Ok(Self {
            map: map.cast(),
            page,
            ring: page * pages,
            event,
        })
    }

    /// Hands every switch since the last drain to `each`, oldest first.
    pub fn drain(&mut self, each: &mut dyn FnMut(ContextSwitch)) -> Drained {
        let head = self.counter(HEAD).load(Ordering::Acquire);
        let mut tail = self.counter(TAIL).load(Ordering::Relaxed);
        let mut lost = head.wrapping_sub(tail) + LARGEST_WRITE > self.ring as u64;
        while tail < head {
            // The record's header: type u32, misc u16, size u16.
            let header = self.word(tail);
            let kind = (header & 0xffff_ffff) as u32;
            let misc = (header >> 32 & 0xffff) as u16;
            let size = header >> 48;
            if kind == RECORD_SWITCH {
                // Behind the header: pid and tid (u32 each), then the time.
                let time = self.word(tail + 16);
                let preempted = misc & MISC_SWITCH_OUT_PREEMPT != 0;
                let out = misc & MISC_SWITCH_OUT != 0;
                let kind = if out {
                    SwitchDirection::Out { preempted }
                } else {
                    SwitchDirection::In
                };
                each(ContextSwitch { time, kind });
            } else if kind == RECORD_LOST {
                lost = true;
            }
            if size < 8 {
                // Never written by the kernel; do not loop over it.
                tail = head;
                lost = true;
            } else {
                tail += size;
            }
        }
        self.counter(TAIL).store(tail, Ordering::Release);
        Drained { lost }
    }

    /// Whether there is nothing to drain: the thread has not been switched since the last time.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.counter(HEAD).load(Ordering::Acquire) == self.counter(TAIL).load(Ordering::Relaxed)
    }

    /// The time for which the thread has had a CPU since the record began, as far as that is
    /// counted; also once the thread has ended, which its clock in `/proc` does not outlive.
    pub(super) fn cpu(&self) -> Option<Nanos> {
        let mut count = [0; 8];
        let read = rustix::io::read(&self.event, &mut count).ok()?;
        (read == count.len()).then(|| Nanos::from_ne_bytes(count))
    }

    /// A counter of the control page.
    fn counter(&self, offset: usize) -> &AtomicU64 {
        // SAFETY: within the control page, which is mapped for as long as `self` lives.
        let counter = unsafe { self.map.add(offset) };
        // SAFETY: aligned to 8; the kernel and we access it as one word.
        unsafe { AtomicU64::from_ptr(counter.cast()) }
    }

    /// The word of the data ring at stream position `at`, a multiple of 8.
    fn word(&self, at: u64) -> u64 {
        let offset = usize::try_from(at % self.ring as u64).unwrap_or(0) & !7;
        // SAFETY: within the data pages: a page plus less than the ring's size, aligned to 8.
        let word = unsafe { self.map.add(self.page + offset) };
        // SAFETY: mapped, aligned; volatile because the kernel writes there.
        unsafe { ptr::read_volatile(word.cast()) }
    }
}

impl Drop for ContextSwitchLog {
    fn drop(&mut self) {
        // SAFETY: exactly the mapping made by `open`; nothing refers into it any more.
        unsafe { libc::munmap(self.map.cast(), self.page + self.ring) };
    }
}

/// `struct perf_event_attr`, version 5 (112 bytes): the part this needs.
#[repr(C)]
#[derive(Default)]
pub(super) struct Attr {
    kind: u32,
    size: u32,
    config: u64,
    sample_period: u64,
    sample_type: u64,
    read_format: u64,
    flags: u64,
    wakeup_watermark: u32,
    bp_type: u32,
    config1: u64,
    config2: u64,
    branch_sample_type: u64,
    sample_regs_user: u64,
    sample_stack_user: u32,
    clockid: i32,
    sample_regs_intr: u64,
    aux_watermark: u32,
    sample_max_stack: u16,
    reserved: u16,
}

const TYPE_SOFTWARE: u32 = 1;

impl Attr {
    /// The CPU's clock, that rings each `period` ns.
    #[cfg(feature = "baseline")]
    pub(super) fn ticks(period: Nanos) -> Self {
        const SW_CPU_CLOCK: u64 = 0;
        Self {
            kind: TYPE_SOFTWARE,
            size: size_of::<Self>() as u32,
            config: SW_CPU_CLOCK,
            sample_period: period,
            ..Self::default()
        }
    }

    /// A software event that never happens.
    const DUMMY: u64 = 9;
    /// The thread's time on CPUs.
    const TASK_CLOCK: u64 = 1;

    fn switches(config: u64) -> Self {
        const SAMPLE_TID_TIME: u64 = 1 << 1 | 1 << 2;
        const EXCLUDE_KERNEL: u64 = 1 << 5; // allowed to ordinary users
        const EXCLUDE_HV: u64 = 1 << 6;
        const WATERMARK: u64 = 1 << 14;
        const SAMPLE_ID_ALL: u64 = 1 << 18;
        const USE_CLOCKID: u64 = 1 << 25;
        const CONTEXT_SWITCH: u64 = 1 << 26;
        Self {
            kind: TYPE_SOFTWARE,
            size: size_of::<Self>() as u32,
            config,
            sample_type: SAMPLE_TID_TIME,
            flags: EXCLUDE_KERNEL
                | EXCLUDE_HV
                | WATERMARK
                | SAMPLE_ID_ALL
                | USE_CLOCKID
                | CONTEXT_SWITCH,
            wakeup_watermark: u32::MAX, // nobody waits for it
            clockid: libc::CLOCK_MONOTONIC,
            ..Self::default()
        }
    }
}

/// Number of times that the calling thread has blocked so far (`ru_nvcsw`): the cheap detector.
#[must_use]
pub fn voluntary_switches() -> u64 {
    // SAFETY: an all-zero rusage is a valid value to be filled in.
    let mut usage: libc::rusage = unsafe { std::mem::zeroed() };
    // SAFETY: `usage` is writable for the call.
    let rc = unsafe { libc::getrusage(libc::RUSAGE_THREAD, &raw mut usage) };
    if rc == 0 {
        u64::try_from(usage.ru_nvcsw).unwrap_or(0)
    } else {
        0
    }
}
