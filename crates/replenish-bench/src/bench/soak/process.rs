//! A child process of the soak: started, stopped, killed.

use replenish_cli::outcome::Failure;
use rustix::process::{Pid, Signal, kill_process};
use std::io::Write;
use std::process::{Child, ChildStdout, Command, Stdio};

/// A running child. Dropping it kills it (SIGKILL).
#[derive(Debug)]
pub(super) struct Process(Child);

impl Process {
    /// Our own executable with other words.
    pub(super) fn start(words: &[String]) -> Result<Self, Failure> {
        let wrong = |e| Failure::refused(format!("cannot start {}: {e}", words.join(" ")));
        let program = std::env::current_exe().map_err(wrong)?;
        let mut command = Command::new(program);
        command.args(words).stdin(Stdio::piped());
        let child = command.stdout(Stdio::piped()).spawn();
        child.map(Self).map_err(wrong)
    }

    /// Its standard output, once.
    pub(super) fn output(&mut self) -> Result<ChildStdout, Failure> {
        let output = self.0.stdout.take();
        output.ok_or_else(|| Failure::refused("a part has no output"))
    }

    /// Writes a line to it.
    pub(super) fn tell(&mut self, line: &str) -> Result<(), Failure> {
        let gone = || Failure::refused("a part of the soak has ended by itself");
        let input = self.0.stdin.as_mut().ok_or_else(gone)?;
        writeln!(input, "{line}").map_err(|_| gone())
    }

    /// Stops it, or lets it go on.
    pub(super) fn stop(&self, stopped: bool) -> Result<(), Failure> {
        let pid = i32::try_from(self.0.id()).ok().and_then(Pid::from_raw);
        let pid = pid.ok_or_else(|| Failure::refused("a part has no process id"))?;
        let signal = if stopped { Signal::STOP } else { Signal::CONT };
        kill_process(pid, signal).map_err(|e| Failure::refused(format!("a signal: {e}")))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // Nothing more can be done about a process that survives this.
        self.0.kill().ok();
        self.0.wait().ok();
    }
}
