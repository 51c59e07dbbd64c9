//! The file `PID.boards`: every client of the agent, once a second. A reader never finds half of
//! it, and sees by its lock that the agent lives.

use super::recorded::{Recordings, per_second};
use crate::live::{Board, Boards};
use replenish_agent::{ClientSnapshot, Snapshot};
use replenish_os::clock;
use replenish_os::live::{create, open_directory};
use std::ffi::OsStr;
use std::fs::{File, Permissions, TryLockError};
use std::io::{self, Write};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

/// The file; removed when dropped.
pub(super) struct List {
    path: PathBuf,
    /// The next content, before it takes the file's place.
    next: PathBuf,
    /// Holds the lock.
    file: Option<File>,
    address: String,
    last: Option<Snapshot>,
}

impl List {
    /// The list of an agent at `address`. Removes the files of agents that were killed.
    pub(super) fn new(directory: &Path, address: String) -> io::Result<Self> {
        open_directory(directory)?;
        sweep(directory);
        let pid = std::process::id();
        Ok(Self {
            path: directory.join(format!("{pid}.boards")),
            next: directory.join(format!("{pid}.boards-next")),
            file: None,
            address,
            last: None,
        })
    }

    pub(super) fn write(&mut self, now: &Snapshot, recordings: &Recordings) -> io::Result<()> {
        let boards = Boards {
            agent_pid: std::process::id(),
            agent: self.address.clone(),
            at: clock::monotonic(),
            boards: now
                .clients
                .iter()
                .map(|client| self.board(client, now, recordings))
                .collect(),
        };
        let text = serde_json::to_vec(&boards).map_err(io::Error::other)?;
        std::fs::remove_file(&self.next).ok();
        let mut file = create(&self.next)?;
        file.try_lock()
            .map_err(|e| io::Error::other(e.to_string()))?;
        file.write_all(&text)?;
        file.set_permissions(Permissions::from_mode(0o640))?;
        std::fs::rename(&self.next, &self.path)?;
        self.file = Some(file);
        self.last = Some(now.clone());
        Ok(())
    }

    fn board(&self, client: &ClientSnapshot, now: &Snapshot, recordings: &Recordings) -> Board {
        let before = self.last.as_ref();
        let passed = before.map_or(0, |before| now.at.saturating_sub(before.at));
        let before = before.and_then(|before| before.client(&client.key));
        let before = before.filter(|before| before.age <= client.age);
        let (name, recording) = recordings.of(&client.key).unwrap_or_default();
        let participants = client.entities.iter();
        let mut participants = participants.filter(|entity| entity.kind == "participant");
        let mut node = || {
            participants
                .next()
                .map_or("", |node| &*node.name)
                .to_owned()
        };
        let readers = client.entities.iter().flat_map(|entity| &entity.reader);
        let dropped: u64 = readers.map(|reader| reader.dropped).sum();
        Board {
            key: client.key.clone(),
            name: if name.is_empty() { node() } else { name },
            peer: client.peer.clone(),
            age_ns: client.age,
            silent_ns: client.silent,
            in_per_s: per_second(client.datagrams_in, before.map(|b| b.datagrams_in), passed),
            out_per_s: per_second(
                client.datagrams_out,
                before.map(|b| b.datagrams_out),
                passed,
            ),
            drops: dropped.saturating_add(client.rate_limited),
            recording,
        }
    }
}

impl Drop for List {
    fn drop(&mut self) {
        std::fs::remove_file(&self.path).ok();
        self.file = None;
    }
}

fn sweep(directory: &Path) {
    let entries = std::fs::read_dir(directory).into_iter().flatten();
    for path in entries.take(4096).flatten().map(|entry| entry.path()) {
        let ours = [Some(OsStr::new("boards")), Some(OsStr::new("boards-next"))];
        if !ours.contains(&path.extension()) {
            continue;
        }
        let Ok(file) = replenish_os::live::open_plain(&path) else {
            continue; // another account's
        };
        if !matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)) {
            std::fs::remove_file(&path).ok();
        }
    }
}
