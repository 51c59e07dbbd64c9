//! A file for each board that sends its recording.

use crate::live::Recorded;
use crate::time::Nanos;
use replenish_agent::{RecordedSample, Snapshot};
use replenish_os::live::{LiveFile, SharedMemory, clocks};
use replenish_recorder::Clocks;
use replenish_recorder::board::{Image, Piece, Relay};
use std::collections::HashMap;
use std::io;
use std::path::PathBuf;

/// Bytes of each thread's ring: 8192 events.
const RING: usize = 256 << 10;
/// More boards get no file.
const MAX_BOARDS: usize = 64;
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
    /// Samples that found no room between two looks.
    pub(super) dropped: u64,
}

impl Recordings {
    pub(super) fn new(directory: PathBuf) -> Self {
        Self {
            directory,
            boards: HashMap::new(),
            started: 0,
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
            let wrong = self.piece(sample, &piece);
            outcome = outcome.and(wrong);
        }
        outcome
    }

    fn piece(&mut self, sample: &RecordedSample, piece: &Piece<'_>) -> io::Result<()> {
        if !self.boards.contains_key(&sample.key) {
            if self.boards.len() >= MAX_BOARDS {
                return Ok(());
            }
            let board = Board {
                relay: Relay::new(),
                starts: 0,
                file: None,
                pid: 0,
            };
            self.boards.insert(sample.key, board);
        }
        let Some(board) = self.boards.get_mut(&sample.key) else {
            return Ok(());
        };
        let arrival = Clocks {
            monotonic: sample.at,
            boottime: sample.at,
            realtime: u64::try_from(sample.unix).unwrap_or(0),
        };
        let Board { relay, file, .. } = board;
        relay.take(piece, arrival, |event| {
            if let Some((_, image)) = file {
                image.write(&event);
            }
        });
        if board.starts != board.relay.starts() {
            board.starts = board.relay.starts();
            board.leave();
        }
        match &board.file {
            Some((_, image)) if !matches!(piece, Piece::Events { .. }) => {
                image.refresh(&board.relay);
                Ok(())
            }
            None if board.relay.is_complete() => {
                self.started = self.started.wrapping_add(1) & 0xffff;
                board.begin(&self.directory, FIRST_PID + self.started * 64)
            }
            _ => Ok(()),
        }
    }

    /// Boards that have gone leave their file.
    pub(super) fn retain(&mut self, snapshot: &Snapshot) {
        let here: Vec<String> = snapshot.clients.iter().map(|c| c.key.clone()).collect();
        self.boards.retain(|key, board| {
            let stays = here.contains(&hex(*key));
            if !stays {
                board.leave();
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
    fn begin(&mut self, directory: &std::path::Path, pid: u32) -> io::Result<()> {
        let other = |e: replenish_recorder::LayoutError| io::Error::other(e.to_string());
        let bytes = Image::<SharedMemory>::bytes(&self.relay, RING).map_err(other)?;
        let (file, memory) = LiveFile::create(directory, bytes)?;
        let image = Image::new(&self.relay, RING, pid, clocks(), memory).map_err(other)?;
        self.pid = pid;
        self.file = Some((file, image));
        Ok(())
    }

    fn leave(&mut self) {
        if let Some((file, _)) = self.file.take() {
            file.leave();
        }
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
