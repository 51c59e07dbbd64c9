//! The causes for which the recording is written to a file, and the directory.

use std::path::PathBuf;
use std::time::Duration;

/// Writes the recording to a file when something goes wrong.
///
/// It is triggered as an oscilloscope is: recording goes on for half of the ring of the thread
/// with the cause, or for a second. Then a thread copies what all threads have recorded, at
/// real-time priority 1 if the privilege is there, and writes the copy to a file in the idle class.
/// Until the copy is taken, the thread with the cause overwrites nothing: it leaves events out,
/// and counts them in an event `gap`. `replenish trace` and `replenish why` read the file.
///
/// The copy takes as much memory as the recording, from the start on.
///
/// Without one of the `on_…` methods no file is written. Triggers of one dump are one; those beyond
/// the limits are counted: `replenish top --json` shows how many dumps were written, and how many
/// triggers were suppressed.
///
/// ```
/// use replenish::{Context, Dump, Executor};
/// use std::time::Duration;
/// let ctx = Context::in_process();
/// let mut exec = Executor::new(&ctx);
/// let dump = Dump::to("/var/log/robot")
///     .on_miss()
///     .on_overrun(Duration::from_millis(20))
///     .on_panic();
/// exec.dump(dump.per_minute(2).bytes(16 << 20));
/// ```
#[derive(Debug, Clone)]
pub struct Dump {
    pub(super) directory: PathBuf,
    pub(super) miss: bool,
    pub(super) overrun: Option<Duration>,
    pub(super) panic: bool,
    pub(super) stop: bool,
    pub(super) per_minute: u32,
    pub(super) bytes: u64,
}

impl Dump {
    /// Files in this directory, which is there when the executor starts. Their names have the
    /// process id, a number, and the cause: `4711-1-miss.dump`.
    #[must_use]
    pub fn to(directory: impl Into<PathBuf>) -> Self {
        Self {
            directory: directory.into(),
            miss: false,
            overrun: None,
            panic: false,
            stop: false,
            per_minute: 4,
            bytes: 64 << 20,
        }
    }

    /// Writes a file when a callback has ended after its deadline.
    #[must_use]
    pub fn on_miss(self) -> Self {
        Self { miss: true, ..self }
    }

    /// Writes a file when a callback has taken longer than `bound` from its begin to its end.
    #[must_use]
    pub fn on_overrun(self, bound: Duration) -> Self {
        Self {
            overrun: Some(bound),
            ..self
        }
    }

    /// Writes a file when a callback has panicked.
    #[must_use]
    pub fn on_panic(self) -> Self {
        Self {
            panic: true,
            ..self
        }
    }

    /// Writes a file when the executor stops: the stop takes as much longer as the file takes to be
    /// written.
    #[must_use]
    pub fn on_stop(self) -> Self {
        Self { stop: true, ..self }
    }

    /// Allows at most `files` files in a minute. Default: 4.
    #[must_use]
    pub fn per_minute(self, files: u32) -> Self {
        Self {
            per_minute: files,
            ..self
        }
    }

    /// Allows at most `bytes` bytes in all files of the executor together. Default: 64 MiB. A file
    /// is as long as the recording.
    #[must_use]
    pub fn bytes(self, bytes: u64) -> Self {
        Self { bytes, ..self }
    }
}
