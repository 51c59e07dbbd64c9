//! One foreign thread: its identity, and the CPU time that it has used.

use super::error::ForeignError;
use super::original::Original;
use super::processes::{Stat, name, read};
use crate::linux::supervised;
use crate::{Nanos, Tid};
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::sync::Arc;

/// `PF_KTHREAD` of the kernel's `sched.h`, in the flags of `/proc/PID/stat`.
const KERNEL_THREAD: u64 = 0x0020_0000;

/// A thread that other code has started, in another process or in this one. It is held by an open
/// file, which stays that thread's when its number is used again.
#[derive(Debug)]
pub struct ForeignThread {
    pid: Tid,
    tid: Tid,
    start: u64,
    name: Arc<str>,
    schedstat: File,
    original: Original,
}

impl ForeignThread {
    /// The thread of that number at this moment, with the scheduling that it has.
    ///
    /// # Errors
    /// [`ForeignError`] for a thread that has ended, one of this process, one of the kernel's, and
    /// one with a reservation of the kernel's.
    pub fn open(tid: Tid) -> Result<Self, ForeignError> {
        let thread = Self::find(tid)?;
        if thread.is_own() {
            return Err(ForeignError::Own { tid });
        }
        Ok(thread)
    }

    /// The same for a thread of this process that other code has started: a middleware, a library,
    /// a C program.
    ///
    /// # Errors
    /// [`ForeignError`] as [`open`](Self::open), but for a thread of another process; for a worker
    /// with a budget of its own.
    pub fn open_own(tid: Tid) -> Result<Self, ForeignError> {
        if supervised::find(tid.get()).is_some() {
            return Err(ForeignError::Worker { tid });
        }
        let thread = Self::find(tid)?;
        if !thread.is_own() {
            return Err(ForeignError::NotOwn { tid });
        }
        Ok(thread)
    }

    /// Whether it belongs to this process.
    pub(super) fn is_own(&self) -> bool {
        self.pid.get().cast_unsigned() == std::process::id()
    }

    fn find(tid: Tid) -> Result<Self, ForeignError> {
        let gone = ForeignError::Gone { tid };
        // First the file: all the rest is asked by the number, and believed if the thread of the
        // file is still there at the end.
        let Ok(schedstat) = File::open(format!("/proc/{tid}/task/{tid}/schedstat")) else {
            return Err(gone);
        };
        let (Some(stat), Some(pid)) = (Stat::of(tid), process_of(tid)) else {
            return Err(gone);
        };
        if stat.flags & KERNEL_THREAD != 0 {
            return Err(ForeignError::Kernel { tid });
        }
        let (Ok(original), Some(name)) = (Original::of(tid), name(tid)) else {
            return Err(gone);
        };
        if original.is_deadline() {
            return Err(ForeignError::Deadline { tid });
        }
        let thread = Self {
            pid,
            tid,
            start: stat.start,
            name: name.into(),
            schedstat,
            original,
        };
        if thread.cpu().is_none() {
            return Err(gone);
        }
        Ok(thread)
    }

    /// The same, for a thread that began under an enforcer: what it inherited is not its own.
    #[must_use]
    pub fn with_original(self, original: Original) -> Self {
        Self { original, ..self }
    }

    /// Its process.
    #[must_use]
    pub fn pid(&self) -> Tid {
        self.pid
    }

    /// Its number, which is the kernel's to use again once the thread has ended.
    #[must_use]
    pub fn tid(&self) -> Tid {
        self.tid
    }

    /// The same; a copy takes no memory.
    pub(super) fn shared_name(&self) -> Arc<str> {
        Arc::clone(&self.name)
    }

    /// Time at which it began, in clock ticks since the machine's start. With the number it names
    /// one thread.
    #[must_use]
    pub fn start(&self) -> u64 {
        self.start
    }

    /// Its name when it was opened.
    #[must_use]
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The policy and CPUs that the thread had when it was opened, and gets back.
    #[must_use]
    pub fn original(&self) -> &Original {
        &self.original
    }

    /// CPU time that it has used, in nanoseconds; `None` once it has ended. Exact while it does not
    /// run, otherwise as of the last timer tick. One system call, no allocation.
    #[must_use]
    pub fn cpu(&self) -> Option<Nanos> {
        let mut text = [0; 64];
        let length = self.schedstat.read_at(&mut text, 0).ok()?;
        number(text.get(..length)?)
    }

    /// Gives it back what it had. Nothing happens to another thread of the same number.
    ///
    /// # Errors
    /// `EPERM` if a privilege was given up meanwhile. A thread that has ended is no error.
    pub fn restore(&self) -> io::Result<()> {
        if self.cpu().is_none() {
            return Ok(());
        }
        match self.original.apply(self.tid) {
            Err(e) if e.raw_os_error() == Some(libc::ESRCH) => Ok(()),
            done => done,
        }
    }

    /// Whether it waits for something, as the kernel says at this moment.
    pub(super) fn is_blocked(&self) -> bool {
        Stat::of(self.tid).is_some_and(|stat| stat.state != 'R')
    }
}

/// The process of thread `tid`.
fn process_of(tid: Tid) -> Option<Tid> {
    let status = read(&format!("/proc/{tid}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("Tgid:"))?;
    Tid::new(line.trim().parse().ok()?)
}

/// The decimal number at the beginning of a text.
fn number(text: &[u8]) -> Option<u64> {
    let mut value = None;
    for digit in text.iter().take_while(|byte| byte.is_ascii_digit()) {
        let digit = u64::from(digit - b'0');
        value = Some(value.unwrap_or(0_u64).checked_mul(10)?.checked_add(digit)?);
    }
    value
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::current_tid;

    #[test]
    fn cpu_time_is_the_first_number() {
        assert_eq!(number(b"123456 789 3\n"), Some(123_456));
        assert_eq!(number(b"99999999999999999999"), None);
        assert_eq!(number(b""), None);
    }

    #[test]
    fn threads_of_this_process_and_none_are_refused() {
        let own = ForeignThread::open(current_tid()).unwrap_err();
        assert!(matches!(own, ForeignError::Own { .. }), "{own}");
        assert!(ForeignThread::open_own(current_tid()).unwrap().is_own());
        let parent = Tid::new(std::os::unix::process::parent_id().cast_signed()).unwrap();
        let other = ForeignThread::open_own(parent).unwrap_err();
        assert!(matches!(other, ForeignError::NotOwn { .. }), "{other}");
        let none = ForeignThread::open(Tid::new(i32::MAX).unwrap()).unwrap_err();
        assert!(none.is_gone(), "{none}");
    }
}
