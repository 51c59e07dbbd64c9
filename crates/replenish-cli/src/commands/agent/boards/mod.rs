//! The agent's clients for `replenish top`, and the recordings of those that send one.
//!
//! ```text
//!   agent ── samples of /replenish/recorder ──► recorded: a file of each board, as programs have
//!         └─ a snapshot each second ──────────► list: PID.boards
//! ```
//!
//! An ordinary thread does this; the agent waits for it nowhere.

mod list;
mod recorded;

use crate::time::{MS, Nanos, SEC};
use list::List;
use recorded::Recordings;
use replenish_agent::Inspector;
use replenish_os::clock;
use replenish_os::live::account;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Time between two looks at the samples.
const EVERY: Nanos = 50 * MS;
/// The longest wait for the agent's snapshot.
const PATIENCE: Duration = Duration::from_secs(2);

/// The thread; dropping it ends it, and removes its files.
#[derive(Debug)]
pub(super) struct BoardWatch {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Drop for BoardWatch {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.take().map(JoinHandle::join);
    }
}

/// The directory of recordings, if there are to be any.
fn directory() -> Option<PathBuf> {
    match std::env::var_os("REPLENISH_LIVE").filter(|v| !v.is_empty()) {
        None => Some(format!("/dev/shm/replenish-{}", account()).into()),
        Some(off) if off == "off" => None,
        Some(directory) => Some(directory.into()),
    }
}

/// Starts the thread for an agent at `address`; `say` gets what goes wrong, once each.
pub(super) fn watch(
    inspector: Inspector,
    address: String,
    say: impl Fn(&str) + Send + 'static,
) -> BoardWatch {
    let stop = Arc::new(AtomicBool::new(false));
    let ended = Arc::clone(&stop);
    let body = move || {
        let Some(directory) = directory() else { return };
        let mut recordings = Recordings::new(directory.clone());
        let mut list = match List::new(&directory, address) {
            Ok(list) => list,
            Err(e) => {
                return say(&format!(
                    "`replenish top` does not see its clients: {}: {e}",
                    directory.display()
                ));
            }
        };
        let mut samples = Vec::new();
        let mut list_at = 0;
        let mut said = false;
        while !ended.load(Ordering::Relaxed) {
            samples.clear();
            let dropped = inspector.recordings(&mut samples);
            let mut wrong = recordings.take(&samples, dropped);
            let now = clock::monotonic();
            if now >= list_at {
                list_at = now + SEC;
                if let Some(snapshot) = inspector.snapshot(PATIENCE) {
                    recordings.retain(&snapshot);
                    wrong = wrong.and(list.write(&snapshot, &recordings));
                }
            }
            if let (Err(e), false) = (wrong, said) {
                said = true;
                say(&format!(
                    "a board's recording: {}: {e}",
                    directory.display()
                ));
            }
            std::thread::sleep(Duration::from_nanos(EVERY));
        }
    };
    let thread = std::thread::Builder::new()
        .name("boards".into())
        .spawn(body);
    BoardWatch {
        stop,
        thread: thread.ok(), // without it nobody sees the boards, and the agent works
    }
}
