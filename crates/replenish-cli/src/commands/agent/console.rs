//! Text for people, on a thread of its own: a terminal, pipe or journal that takes nothing holds up
//! this thread, and neither the agent, nor its JSON, nor its end.
//!
//! ```text
//!   watcher ──► queue of 64 texts ──► thread ──► standard output, or standard error
//!                 └─ full: dropped and counted; the count is written once there is room
//! ```
//!
//! A reader of standard output that has gone (`| head`) ends the program, as with every command.

use crate::print;
use std::fs::File;
use std::io::{ErrorKind, Write};
use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

/// Texts that wait to be written.
const QUEUE: usize = 64;

/// One of the two outputs.
#[derive(Debug)]
pub(super) struct Console {
    queue: Option<SyncSender<String>>,
    lost: Arc<AtomicU64>,
    /// Closed once everything is written.
    written: Option<Receiver<()>>,
}

impl Console {
    /// Writes to standard output.
    pub(super) fn output() -> Self {
        let ends = |kind| {
            if kind == ErrorKind::BrokenPipe {
                print::reader_gone();
            }
        };
        Self::to(std::io::stdout().as_fd().try_clone_to_owned().ok(), ends)
    }

    /// Writes to standard error.
    pub(super) fn error() -> Self {
        // A closed standard error is possible, too: there is no other place for the line.
        Self::to(std::io::stderr().as_fd().try_clone_to_owned().ok(), |_| ())
    }

    /// Writes to the descriptor itself, without the lock of the standard library's handle: a writer
    /// that is stuck must not hold up a panic's message either.
    fn to(descriptor: Option<OwnedFd>, failed: fn(ErrorKind)) -> Self {
        let (queue, texts) = sync_channel::<String>(QUEUE);
        let (done, written) = sync_channel(1);
        let lost = Arc::new(AtomicU64::new(0));
        let dropped = Arc::clone(&lost);
        let started = descriptor.map(File::from).is_some_and(|mut file| {
            let body = move || {
                let mut told = 0;
                while let Ok(mut text) = texts.recv() {
                    let lost = dropped.load(Ordering::Relaxed);
                    if lost > told {
                        let more = lost - told;
                        text =
                            format!("agent: {more} texts were dropped: nobody read them\n{text}");
                        told = lost;
                    }
                    if let Err(why) = file.write_all(text.as_bytes()) {
                        failed(why.kind());
                    }
                }
                drop(done);
            };
            let thread = std::thread::Builder::new().name("console".into());
            thread.spawn(body).is_ok()
        });
        Self {
            queue: started.then_some(queue),
            lost,
            written: Some(written),
        }
    }

    /// Writes `text` when its turn comes; never waits.
    pub(super) fn write(&self, text: String) {
        let queued = self.queue.as_ref().map(|queue| queue.try_send(text));
        if !matches!(queued, Some(Ok(()))) {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Texts that were dropped.
    pub(super) fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }

    /// Waits until all is written, at most `limit`.
    pub(super) fn finish(&mut self, limit: Duration) {
        self.queue = None;
        if let Some(written) = self.written.take() {
            // The channel never carries a value: it closes when the thread ends, or the time is
            // over.
            written.recv_timeout(limit).ok();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Read;
    use std::time::Instant;

    #[test]
    fn a_reader_that_reads_nothing_is_not_waited_for_and_learns_what_it_missed() {
        let (mut reader, writer) = std::io::pipe().unwrap();
        let mut console = Console::to(Some(writer.into()), |_| ());
        let start = Instant::now();
        for _ in 0..1000 {
            console.write("x".repeat(10_000));
        }
        let lost = console.lost();
        assert!(lost > 0 && start.elapsed() < Duration::from_secs(5));
        let mut rest = Vec::new();
        std::thread::scope(|scope| {
            scope.spawn(|| reader.read_to_end(&mut rest));
            while console
                .queue
                .as_ref()
                .unwrap()
                .try_send(String::new())
                .is_err()
            {
                std::thread::yield_now();
            }
            console.finish(Duration::from_secs(10));
        });
        let text = String::from_utf8(rest).unwrap();
        // A writer that begins late says so in parts.
        let said = text.lines().filter_map(|line| {
            let (count, _) = line.split_once(" texts were dropped")?;
            count
                .rsplit(|c: char| !c.is_ascii_digit())
                .next()?
                .parse::<u64>()
                .ok()
        });
        assert_eq!(said.sum::<u64>(), lost);
        assert_eq!(
            text.matches(&"x".repeat(10_000)).count() as u64,
            1000 - lost
        );
    }

    #[test]
    fn the_end_waits_for_a_stuck_reader_only_as_long_as_it_says() {
        let (_reader, writer) = std::io::pipe().unwrap();
        let mut console = Console::to(Some(writer.into()), |_| ());
        console.write("x".repeat(1 << 20));
        let start = Instant::now();
        console.finish(Duration::from_millis(50));
        assert!(start.elapsed() < Duration::from_secs(5));
    }
}
