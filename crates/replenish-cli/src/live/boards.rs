//! The clients of this host's agents, as each agent writes them once a second beside its boards'
//! recordings: `PID.boards`, JSON. It is another program's file, and is not believed.

use super::directories::directories;
use crate::time::Nanos;
use replenish_os::clock;
use replenish_os::live::open_plain;
use std::ffi::OsStr;
use std::fs::{File, TryLockError};
use std::io::{self, Read};
use std::os::unix::fs::MetadataExt;
use std::path::Path;

/// Bytes of a file that are read; an agent has at most some thousand clients.
const MAX_BYTES: u64 = 4 << 20;
/// More files of one directory are not looked at.
const MAX_FILES: usize = 4096;
/// Characters of a text that are shown.
const MAX_TEXT: usize = 120;

/// The pieces of a board's recording that came, and its file.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Recorded {
    /// The file, which `trace` and `why` read.
    pub(crate) file: String,
    /// The process id that stands for the board there.
    pub(crate) pid: u32,
    /// Events that came, and those that did not.
    pub(crate) events: u64,
    pub(crate) missed: u64,
    /// `exchange` if the agent's time exchange relates the clocks, otherwise `arrival`.
    pub(crate) clock: String,
}

/// A client of an agent.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Board {
    /// Its key, eight hexadecimal digits.
    pub(crate) key: String,
    /// Its name in its recording, or its first node's.
    pub(crate) name: String,
    pub(crate) peer: String,
    /// Since it logged in, and since it was heard last, ns.
    pub(crate) age_ns: Nanos,
    pub(crate) silent_ns: Nanos,
    /// Datagrams from it and to it in a second.
    pub(crate) in_per_s: f64,
    pub(crate) out_per_s: f64,
    /// Samples for it that found no room, and datagrams from it that came too fast.
    pub(crate) drops: u64,
    /// `null`: it sends no recording.
    pub(crate) recording: Option<Recorded>,
}

/// An agent's file.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize)]
pub(crate) struct Boards {
    /// The agent's process id, in its own pid namespace.
    pub(crate) agent_pid: u32,
    /// The address that the agent listens at.
    pub(crate) agent: String,
    /// Time at which it was written: `CLOCK_MONOTONIC`.
    pub(crate) at: Nanos,
    pub(crate) boards: Vec<Board>,
}

/// The agents that run here, and warnings about files that were left out.
pub(crate) fn boards() -> (Vec<Boards>, Vec<String>) {
    let (mut all, mut warnings) = (Vec::new(), Vec::new());
    for directory in directories() {
        let entries = std::fs::read_dir(&directory).into_iter().flatten();
        for path in entries.take(MAX_FILES).flatten().map(|entry| entry.path()) {
            if path.extension() != Some(OsStr::new("boards")) {
                continue;
            }
            match open(&path) {
                Ok(found) => all.extend(found),
                Err(why) if path.exists() => {
                    warnings.push(format!("left out: {path:?}: {why}"));
                }
                Err(_) => {} // the agent has just ended
            }
        }
    }
    all.sort_by_key(|boards| boards.agent_pid);
    (all, warnings)
}

/// `None` if its agent has ended.
fn open(path: &Path) -> Result<Option<Boards>, String> {
    let Some(file) = open_held(path).map_err(|e| e.to_string())? else {
        return Ok(None);
    };
    let mut text = String::new();
    let mut part = file.take(MAX_BYTES);
    part.read_to_string(&mut text).map_err(|e| e.to_string())?;
    let mut found: Boards = serde_json::from_str(&text).map_err(|e| e.to_string())?;
    let passed = clock::monotonic().saturating_sub(found.at);
    clean(&mut found.agent);
    for board in &mut found.boards {
        for text in [&mut board.key, &mut board.name, &mut board.peer] {
            clean(text);
        }
        board.silent_ns = board.silent_ns.saturating_add(passed);
        board.age_ns = board.age_ns.saturating_add(passed);
        if let Some(recording) = &mut board.recording {
            clean(&mut recording.file);
            clean(&mut recording.clock);
        }
    }
    Ok(Some(found))
}

/// The file with its agent's lock on it, or `None` if its agent has ended.
fn open_held(path: &Path) -> io::Result<Option<File>> {
    loop {
        let file = open_plain(path)?;
        if matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)) {
            return Ok(Some(file));
        }
        // An agent that writes its list anew gives up the lock of the list before. Only the file
        // that stands at the path says that its agent has ended.
        let (opened, there) = (file.metadata()?, path.symlink_metadata()?);
        if (opened.dev(), opened.ino()) == (there.dev(), there.ino()) {
            return Ok(None);
        }
    }
}

/// Removes control characters, and cuts to the length of a line.
fn clean(text: &mut String) {
    let clean = |c: char| {
        if c.is_control()
            || matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
        {
            char::REPLACEMENT_CHARACTER
        } else {
            c
        }
    };
    *text = text.chars().take(MAX_TEXT).map(clean).collect();
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicBool, Ordering};

    #[test]
    fn a_list_that_is_written_anew_is_never_an_ended_agents() {
        let name = format!("replenish-boards-{}", std::process::id());
        let directory = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&directory).unwrap();
        let (path, next) = (directory.join("1.boards"), directory.join("1.next"));
        let write = || {
            let file = File::create(&next).unwrap();
            file.try_lock().unwrap();
            std::fs::rename(&next, &path).unwrap();
            file
        };
        let mut held = write();
        let done = AtomicBool::new(false);
        let (read, ended) = std::thread::scope(|threads| {
            let reader = threads.spawn(|| {
                let (mut read, mut ended) = (0, 0);
                while !done.load(Ordering::Relaxed) {
                    read += 1;
                    ended += u32::from(open_held(&path).unwrap().is_none());
                }
                (read, ended)
            });
            for _ in 0..20_000 {
                held = write();
            }
            done.store(true, Ordering::Relaxed);
            reader.join().unwrap()
        });
        assert!(read > 0);
        assert_eq!(ended, 0, "of {read}");
        drop(held);
        assert!(open_held(&path).unwrap().is_none(), "its agent has ended");
        std::fs::remove_dir_all(&directory).unwrap();
    }
}
