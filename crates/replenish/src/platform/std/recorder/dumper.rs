//! The thread that writes dumps, in the idle class: it runs when no other thread wants the CPU.
//!
//! ```text
//!   asleep ── fired ──► recording goes on: half a ring, or a second, or the end
//!     ▲                            │ within the limits          │ beyond them
//!     │                            ▼                            ▼
//!     └──────────── written, under its final name at last    counted
//! ```

use super::dump::Dump;
use super::trigger::{Armed, Cause};
use replenish_os::live::{self, SharedMemory};
use replenish_os::{SchedClass, ThreadSpec, clock, current_tid, set_priority, spawn};
use replenish_recorder::{ThreadSpan, copy, write_dumps};
use std::collections::VecDeque;
use std::fs::{File, Permissions};
use std::io;
use std::os::unix::fs::{FileExt, PermissionsExt};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// The longest time that recording goes on after the cause.
const AFTER: Duration = Duration::from_secs(1);
/// The ring is looked at this often meanwhile.
const LOOK: Duration = Duration::from_millis(5);
/// Time in ns between two settings of the thread's class while the thread ends.
const AGAIN: u64 = 20_000_000;
const MINUTE: Duration = Duration::from_secs(60);

/// The thread, ended when dropped.
#[derive(Debug)]
pub(super) struct Dumper {
    armed: Arc<Armed>,
    thread: Option<replenish_os::Thread<()>>,
}

/// The state of the thread.
struct Writer {
    dump: Dump,
    armed: Arc<Armed>,
    memory: Arc<SharedMemory>,
    /// First word and records of each ring.
    rings: std::vec::Vec<(u64, u64)>,
    /// Times at which the last dumps were written.
    recent: VecDeque<Instant>,
    bytes: u64,
    written: u64,
    suppressed: u64,
}

impl Dumper {
    /// Starts it. The error says why no dump can be written.
    pub(super) fn start(
        dump: Dump,
        armed: Arc<Armed>,
        memory: &Arc<SharedMemory>,
        threads: &[ThreadSpan],
    ) -> io::Result<Self> {
        if !std::fs::metadata(&dump.directory)?.is_dir() {
            return Err(io::ErrorKind::NotADirectory.into());
        }
        let slot = 4; // words of a record
        let rings = threads.iter().map(|t| {
            let [start, words] = [t.ring.start, t.ring.words].map(|n| n as u64);
            (start, words / slot)
        });
        let mut writer = Writer {
            dump,
            armed: Arc::clone(&armed),
            memory: Arc::clone(memory),
            rings: rings.collect(),
            recent: VecDeque::new(),
            bytes: 0,
            written: 0,
            suppressed: 0,
        };
        let thread = spawn(ThreadSpec::new("dumps"), move || {
            set_priority(current_tid(), SchedClass::Idle).ok(); // time sharing does as well
            writer.run();
        });
        Ok(Self {
            armed,
            thread: Some(thread.map_err(|e| io::Error::other(std::format!("{e}")))?),
        })
    }
}

impl Drop for Dumper {
    fn drop(&mut self) {
        self.armed.ended.store(true, Ordering::Release);
        self.armed.notify.set();
        let Some(mut thread) = self.thread.take() else {
            return;
        };
        // The caller waits for the thread now, so it delays nothing. A thread that has only just
        // begun makes itself idle after this, so the call is repeated.
        set_priority(thread.tid(), SchedClass::Other).ok();
        while let Err(same) = thread.join_until(clock::monotonic().saturating_add(AGAIN)) {
            set_priority(same.tid(), SchedClass::Other).ok();
            thread = same;
        }
    }
}

impl Writer {
    fn run(&mut self) {
        loop {
            let ended = self.armed.ended.load(Ordering::Acquire);
            if let Some(cause) = self.armed.fired() {
                self.go_on();
                self.dump(cause);
                self.armed.rearm();
            } else if ended {
                if self.dump.stop {
                    self.dump(Cause::Stop);
                }
                return;
            } else {
                self.armed.notify.wait();
            }
        }
    }

    /// Half of the ring is to show what came after.
    fn go_on(&self) {
        let end = Instant::now() + AFTER;
        while Instant::now() < end && !self.armed.ended.load(Ordering::Acquire) {
            let (ring, then) = self.armed.at();
            let slots = self.rings.iter().find(|(start, _)| *start == ring);
            let done = usize::try_from(ring)
                .ok()
                .and_then(|at| self.memory.get(at + 1));
            let now = done.map_or(0, |done| u64::from_le(done.load(Ordering::Relaxed)));
            if slots.is_some_and(|(_, slots)| now.saturating_sub(then) >= slots / 2) {
                return;
            }
            std::thread::sleep(LOOK);
        }
    }

    /// Writes a file within the limits; the counts stand in the recording.
    fn dump(&mut self, cause: Cause) {
        let now = Instant::now();
        while self.recent.front().is_some_and(|at| now - *at >= MINUTE) {
            self.recent.pop_front();
        }
        let length = self.memory.len() as u64 * 8;
        let rate = self.recent.len() as u64 >= u64::from(self.dump.per_minute);
        let size = self.bytes.saturating_add(length) > self.dump.bytes;
        if !rate && !size && self.write(cause).is_ok() {
            self.recent.push_back(now);
            self.bytes += length;
            self.written += 1;
        } else {
            self.suppressed += 1;
        }
        write_dumps(&self.memory, self.written, self.suppressed);
    }

    fn write(&self, cause: Cause) -> io::Result<()> {
        let (pid, number) = (std::process::id(), self.written + 1);
        let name = std::format!("{pid}-{number}-{}.dump", cause.name());
        let path = self.dump.directory.join(&name);
        let part = path.with_extension("part");
        let file = live::create(&part)?;
        let done = self
            .fill(&file)
            .and_then(|()| std::fs::rename(&part, &path));
        if done.is_err() {
            std::fs::remove_file(&part).ok(); // half a dump helps nobody
        }
        done
    }

    fn fill(&self, file: &File) -> io::Result<()> {
        file.set_len(self.memory.len() as u64 * 8)?;
        let mut done = Ok(());
        let memory: &[_] = &self.memory;
        let copied = copy(memory, |at, bytes| {
            done = file.write_all_at(bytes, at);
            done.is_ok()
        });
        done?;
        copied.map_err(io::Error::other)?;
        file.set_permissions(Permissions::from_mode(0o640))
    }
}
