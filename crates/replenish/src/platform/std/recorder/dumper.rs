//! The thread that writes dumps.
//!
//! ```text
//!   asleep ── fired ──► recording goes on: half a ring, or a second, or the end
//!     ▲                            │ within the limits          │ beyond them
//!     │                            ▼                            ▼
//!     │             copied, at the lowest real-time priority  counted
//!     │                            │
//!     └──── written, in the idle class, under its final name at last
//! ```
//!
//! Copying must not wait until nobody else wants a CPU: busy rings would be overwritten meanwhile.
//! It takes memory that is there from the start on, and as long as the recording is large, at most
//! as often as the dump's limits say. Nothing of the executor has a lower priority than its
//! workers' background, but for this copy and the file, which may take as long as it likes.

use super::dump::Dump;
use super::trigger::{Armed, Cause, Fired};
use replenish_os::live::{self, SharedMemory};
use replenish_os::{SchedClass, ThreadSpec, clock, current_tid, set_priority, spawn};
use replenish_recorder::{copy, write_dumps};
use std::collections::VecDeque;
use std::fs::{File, Permissions};
use std::io;
use std::os::unix::fs::{FileExt, PermissionsExt};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// The longest time that recording goes on after the cause, in ns.
const AFTER: u64 = 1_000_000_000;
/// The priority of a copy.
const COPYING: SchedClass = SchedClass::Fifo(1);
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
    /// The copy.
    image: std::vec::Vec<u8>,
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
    ) -> io::Result<Self> {
        if !std::fs::metadata(&dump.directory)?.is_dir() {
            return Err(io::ErrorKind::NotADirectory.into());
        }
        let mut writer = Writer {
            dump,
            armed: Arc::clone(&armed),
            memory: Arc::clone(memory),
            image: std::vec![0; memory.len() * 8],
            recent: VecDeque::new(),
            bytes: 0,
            written: 0,
            suppressed: 0,
        };
        let thread = spawn(ThreadSpec::new("dumps"), move || {
            writer.copy().ok(); // so that no page is missing when time matters
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
        // The caller waits for the thread now, so it delays nothing. It makes itself idle for the
        // file, so the call is repeated.
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
            if let Some(fired) = self.armed.fired() {
                self.go_on(fired);
                let is_allowed = self.is_allowed();
                let copied = is_allowed && self.copy().is_ok();
                self.armed.copied(fired);
                set_priority(current_tid(), SchedClass::Idle).ok(); // time sharing does as well
                self.write(fired.cause().filter(|_| copied));
                self.armed.rearm(fired);
            } else if ended {
                if self.dump.stop {
                    let copied = self.is_allowed() && self.copy().is_ok();
                    self.write(Some(Cause::Stop).filter(|_| copied));
                }
                return;
            } else {
                // Without the privilege it has its share of the CPU as everybody.
                set_priority(current_tid(), COPYING)
                    .or_else(|_| set_priority(current_tid(), SchedClass::Other))
                    .ok();
                self.armed.notify.wait();
            }
        }
    }

    /// Half of the ring is to show what came after.
    fn go_on(&self, fired: Fired) {
        let end = clock::monotonic().saturating_add(AFTER);
        while clock::monotonic() < end
            && !self.armed.is_full(fired)
            && !self.armed.ended.load(Ordering::Acquire)
        {
            self.armed.notify.wait_until(end);
        }
    }

    /// Whether the limits leave room for one more.
    fn is_allowed(&mut self) -> bool {
        let now = Instant::now();
        while self.recent.front().is_some_and(|at| now - *at >= MINUTE) {
            self.recent.pop_front();
        }
        let length = self.memory.len() as u64 * 8;
        let rate = self.recent.len() as u64 >= u64::from(self.dump.per_minute);
        let size = self.bytes.saturating_add(length) > self.dump.bytes;
        !rate && !size
    }

    /// Copies the recording as it is now.
    fn copy(&mut self) -> io::Result<()> {
        let memory: &[_] = &self.memory;
        let image = &mut self.image;
        let copied = copy(memory, |at, bytes| {
            let at = usize::try_from(at).unwrap_or(usize::MAX);
            let place = image.get_mut(at..at.saturating_add(bytes.len()));
            place.map(|place| place.copy_from_slice(bytes)).is_some()
        });
        copied.map_err(io::Error::other)
    }

    /// Writes the copy to a file; without a cause there is none. The counts stand in the recording.
    fn write(&mut self, cause: Option<Cause>) {
        if cause.is_some_and(|cause| self.file(cause).is_ok()) {
            self.recent.push_back(Instant::now());
            self.bytes += self.image.len() as u64;
            self.written += 1;
        } else {
            self.suppressed += 1;
        }
        write_dumps(&self.memory, self.written, self.suppressed);
    }

    fn file(&self, cause: Cause) -> io::Result<()> {
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
        file.write_all_at(&self.image, 0)?;
        file.set_permissions(Permissions::from_mode(0o640))
    }
}
