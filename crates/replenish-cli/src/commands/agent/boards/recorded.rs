//! A file for each board that sends its recording.

use crate::live::Recorded;
use crate::time::Nanos;
use replenish_agent::{RecordedSample, Snapshot};
use replenish_os::live::{LiveFile, SharedMemory, clocks};
use replenish_recorder::Clocks;
use replenish_recorder::board::{Image, Piece, Relay};
use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};

/// Bytes of each thread's ring: 8192 events.
const RING: usize = 256 << 10;
/// More boards get no file.
const MAX_BOARDS: usize = 64;
/// Files of boards that have gone or started again that stay. The directory keeps eight files of
/// the dead, those of programs among them: a board that starts again and again leaves them places.
const MAX_LEFT: usize = 4;
/// Numbers that stand for process ids begin here, above all that the kernel gives.
const FIRST_PID: u32 = 1 << 24;

/// A board that records.
struct Board {
    relay: Relay,
    /// Number of the board's starts when its file was made.
    starts: u64,
    file: Option<(LiveFile, Image<SharedMemory>)>,
    pid: u32,
}

/// The boards by key.
pub(super) struct Recordings {
    directory: PathBuf,
    boards: HashMap<[u8; 4], Board>,
    started: u32,
    left: Left,
    /// Samples that found no room between two looks.
    pub(super) dropped: u64,
}

impl Recordings {
    pub(super) fn new(directory: PathBuf) -> Self {
        Self {
            directory,
            boards: HashMap::new(),
            started: 0,
            left: Left::default(),
            dropped: 0,
        }
    }

    /// Writes what has come into the boards' files.
    pub(super) fn take(&mut self, samples: &[RecordedSample], dropped: u64) -> io::Result<()> {
        self.dropped += dropped;
        let mut outcome = Ok(());
        for sample in samples {
            let Ok(piece) = Piece::in_sample(sample.payload()) else {
                continue; // not a board's: the topic is open to all
            };
            let arrival = Clocks {
                monotonic: sample.at,
                boottime: sample.at,
                realtime: u64::try_from(sample.unix).unwrap_or(0),
            };
            let wrong = self.piece(sample.key, arrival, &piece);
            outcome = outcome.and(wrong);
        }
        outcome
    }

    fn piece(&mut self, key: [u8; 4], arrival: Clocks, piece: &Piece<'_>) -> io::Result<()> {
        if !self.boards.contains_key(&key) {
            if self.boards.len() >= MAX_BOARDS {
                return Ok(());
            }
            let board = Board {
                relay: Relay::new(),
                starts: 0,
                file: None,
                pid: 0,
            };
            self.boards.insert(key, board);
        }
        let Some(board) = self.boards.get_mut(&key) else {
            return Ok(());
        };
        let Board { relay, file, .. } = board;
        relay.take(piece, arrival, |event| {
            if let Some((_, image)) = file {
                image.write(&event);
            }
        });
        if board.starts != board.relay.starts() {
            board.starts = board.relay.starts();
            board.leave(&mut self.left, key);
        }
        match &board.file {
            Some((_, image)) if !matches!(piece, Piece::Events { .. }) => {
                image.refresh(&board.relay);
                Ok(())
            }
            None if board.relay.is_complete() => {
                self.started = self.started.wrapping_add(1) & 0xffff;
                let begun = board.begin(&self.directory, FIRST_PID + self.started * 64);
                if let Some((file, _)) = &board.file {
                    self.left.forget(file.path());
                }
                begun
            }
            _ => Ok(()),
        }
    }

    /// Boards that have gone leave their file.
    pub(super) fn retain(&mut self, snapshot: &Snapshot) {
        let here: Vec<String> = snapshot.clients.iter().map(|c| c.key.clone()).collect();
        let left = &mut self.left;
        self.boards.retain(|key, board| {
            let stays = here.contains(&hex(*key));
            if !stays {
                board.leave(left, *key);
            }
            stays
        });
    }

    /// The board with this key: its name, and its recording if it has one.
    pub(super) fn of(&self, key: &str) -> Option<(String, Option<Recorded>)> {
        let (_, board) = self.boards.iter().find(|(k, _)| hex(**k) == key)?;
        let (events, missed) = board.relay.counts();
        let clock = match board.relay.exchanged() {
            Some(_) => "exchange",
            None => "arrival",
        };
        let recorded = board.file.as_ref().map(|(file, _)| Recorded {
            file: file.path().display().to_string(),
            pid: board.pid,
            events,
            missed,
            clock: clock.into(),
        });
        Some((board.relay.board().into(), recorded))
    }
}

impl Board {
    fn begin(&mut self, directory: &Path, pid: u32) -> io::Result<()> {
        let other = |e: replenish_recorder::LayoutError| io::Error::other(e.to_string());
        let bytes = Image::<SharedMemory>::bytes(&self.relay, RING).map_err(other)?;
        let (file, memory) = LiveFile::create(directory, bytes)?;
        let image = Image::new(&self.relay, RING, pid, clocks(), memory).map_err(other)?;
        self.pid = pid;
        self.file = Some((file, image));
        Ok(())
    }

    fn leave(&mut self, left: &mut Left, key: [u8; 4]) {
        if let Some((file, _)) = self.file.take() {
            let path = file.path().to_path_buf();
            file.leave();
            left.add(key, path);
        }
    }
}

/// The files that boards have left, oldest first: the last one of each, and the newest.
#[derive(Default)]
struct Left(Vec<([u8; 4], PathBuf)>);

impl Left {
    fn add(&mut self, key: [u8; 4], path: PathBuf) {
        let before = self.0.iter().position(|(k, _)| *k == key);
        let full = (self.0.len() >= MAX_LEFT).then_some(0);
        if let Some(at) = before.or(full) {
            let (_, old) = self.0.remove(at);
            std::fs::remove_file(old).ok(); // another program's sweep was faster
        }
        self.0.push((key, path));
    }

    /// The file at `path` is a new one: it was swept, and its name is used again.
    fn forget(&mut self, path: &Path) {
        self.0.retain(|(_, left)| left != path);
    }
}

/// A key in the form in which the agent writes keys.
fn hex(key: [u8; 4]) -> String {
    key.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Rates need two snapshots.
pub(super) fn per_second(now: u64, before: Option<u64>, passed: Nanos) -> f64 {
    match before {
        Some(before) if passed > 0 => now.saturating_sub(before) as f64 * 1e9 / passed as f64,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use replenish_recorder::board::BoardThread;
    use replenish_recorder::{NameKind, Role, RunningTotals};

    /// One thread, one name, and no event, at the board's time.
    fn start(recordings: &mut Recordings, key: [u8; 4], now: u64) {
        let thread = BoardThread {
            index: 0,
            threads: 1,
            task: 1,
            role: Role::Worker,
            budget: None,
            totals: RunningTotals::default(),
            name: "w",
            policy: "",
        };
        let pieces = [
            Piece::Events {
                first: 0,
                now,
                ahead: None,
                events: &[],
            },
            Piece::Thread(thread),
            Piece::Name {
                id: 0,
                kind: NameKind::Mark,
                text: "arm",
            },
        ];
        for piece in pieces {
            recordings.piece(key, clocks(), &piece).unwrap();
        }
    }

    #[test]
    fn boards_that_start_again_and_again_leave_the_files_of_programs() {
        let name = format!("/dev/shm/replenish-left-{}", std::process::id());
        let directory = PathBuf::from(name);
        let ended: Vec<PathBuf> = (0..4)
            .map(|_| {
                let (file, _) = LiveFile::create(&directory, 4096).unwrap();
                let path = file.path().to_path_buf();
                file.leave();
                path
            })
            .collect();
        let mut recordings = Recordings::new(directory.clone());
        for now in (1..=20).rev() {
            start(&mut recordings, *b"arm0", now);
        }
        let files = || std::fs::read_dir(&directory).unwrap().count();
        assert_eq!(files(), ended.len() + 2, "its last one, and the one before");
        for key in 0..6 {
            start(&mut recordings, [key; 4], 2);
            start(&mut recordings, [key; 4], 1);
        }
        assert!(ended.iter().all(|path| path.exists()));
        assert_eq!(files(), ended.len() + 7 + MAX_LEFT);
        drop(recordings);
        std::fs::remove_dir_all(&directory).unwrap();
    }
}
