//! One part as a child process: our own executable with `--supervised`.
//!
//! The child reads its grid from standard input and stops at end of file; it reports events as
//! JSON lines. Dropping a [`Child`] ends the process, whatever state it is in.

use crate::load::grid::Grid;
use crate::roles::protocol::Event;
use replenish_cli::outcome::Failure;
use std::io::{BufRead, BufReader, Write};
use std::process::{ChildStdin, Command, ExitStatus, Stdio};
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

/// A message of a child's reader thread to the orchestrator.
#[derive(Debug)]
pub(crate) enum News {
    /// The part said something.
    Event(&'static str, Event),
    /// The part's output ended: the part has exited, or is about to.
    Ended(&'static str),
}

/// A running part.
#[derive(Debug)]
pub(crate) struct Child {
    name: &'static str,
    process: std::process::Child,
    stdin: Option<ChildStdin>,
}

impl Child {
    /// Starts part `name` with `args`; its events go to `news`.
    pub(crate) fn spawn(
        name: &'static str,
        args: &[String],
        news: Sender<News>,
    ) -> Result<Self, Failure> {
        let program = std::env::current_exe()
            .map_err(|e| Failure::refused(format!("cannot find this program's own file: {e}")))?;
        let mut process = Command::new(program)
            .arg(name)
            .args(args)
            .arg("--supervised")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .map_err(|e| Failure::refused(format!("cannot start {name}: {e}")))?;
        let stdin = process.stdin.take();
        if let Some(stdout) = process.stdout.take() {
            std::thread::spawn(move || {
                for line in BufReader::new(stdout).lines().map_while(Result::ok) {
                    let event = serde_json::from_str(&line)
                        .unwrap_or_else(|_| Event::Note { text: line.clone() });
                    if news.send(News::Event(name, event)).is_err() {
                        return;
                    }
                }
                // The orchestrator may have left already.
                news.send(News::Ended(name)).ok();
            });
        }
        Ok(Self {
            name,
            process,
            stdin,
        })
    }

    /// Its name: `agent`, `ping` or `pong`.
    pub(crate) fn name(&self) -> &'static str {
        self.name
    }

    /// Its process id.
    pub(crate) fn id(&self) -> u32 {
        self.process.id()
    }

    /// Hands it the grid: load starts at the epoch.
    pub(crate) fn start(&mut self, grid: &Grid) -> Result<(), Failure> {
        let line = serde_json::to_string(grid)
            .map_err(|e| Failure::refused(format!("cannot write the grid: {e}")))?;
        let gone = || Failure::refused(format!("{} is gone", self.name));
        let stdin = self.stdin.as_mut().ok_or_else(gone)?;
        writeln!(stdin, "{line}")
            .and_then(|()| stdin.flush())
            .map_err(|_| gone())
    }

    /// Tells it to stop. It may still report events.
    pub(crate) fn stop(&mut self) {
        self.stdin = None;
    }

    /// Waits until it has ended, at most `limit`; then ends it by force.
    pub(crate) fn wait(&mut self, limit: Duration) -> Result<ExitStatus, Failure> {
        self.stop();
        let until = Instant::now() + limit;
        loop {
            match self.process.try_wait() {
                Ok(Some(status)) => return Ok(status),
                Ok(None) if Instant::now() < until => std::thread::sleep(Duration::from_millis(5)),
                Ok(None) => {
                    return Err(Failure::refused(format!(
                        "{} did not stop within {} ms",
                        self.name,
                        limit.as_millis()
                    )));
                }
                Err(e) => return Err(Failure::refused(format!("{}: {e}", self.name))),
            }
        }
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        self.stop();
        if self.wait(Duration::from_millis(300)).is_err() {
            // Nothing more can be done about a process that survives this.
            self.process.kill().ok();
            self.process.wait().ok();
        }
    }
}
