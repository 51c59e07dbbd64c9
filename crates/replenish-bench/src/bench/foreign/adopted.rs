//! `replenish adopt` as a user calls it, and its JSON.

use super::program::{Program, Workshop};
use replenish_cli::outcome::Failure;
use replenish_os::Tid;
use replenish_os::foreign::Process;
use std::io::{BufRead, BufReader};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};

/// A supervisor; ended when this is dropped.
#[derive(Debug)]
pub(super) struct Adopted {
    child: Child,
    json: PathBuf,
}

impl Adopted {
    /// Gives programs budgets; returns when they have them.
    pub(super) fn start(
        workshop: &Workshop,
        programs: &[&Program],
        cpu: usize,
        options: &[&str],
    ) -> Result<Self, Failure> {
        static NUMBER: AtomicU32 = AtomicU32::new(0);
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let json = workshop.path(&format!("adopted-{number}.json"));
        let mut command = Command::new("/proc/self/exe");
        command.arg("adopt");
        command.args(programs.iter().map(|program| program.pid.to_string()));
        command.args(options).args(["--cpu", &cpu.to_string()]);
        command.arg("--json").arg(&json);
        // Other programs of this host are not measured here.
        command.env("REPLENISH_LEDGER", workshop.path("ledger"));
        command.stderr(Stdio::piped());
        let mut child = command.spawn().map_err(Failure::refused)?;
        let Some(stderr) = child.stderr.take() else {
            return Err(Failure::refused("a supervisor has no pipe"));
        };
        let mut lines = BufReader::new(stderr).lines().map_while(Result::ok);
        let adopted = Self { child, json };
        let mut said = String::new();
        if !lines.by_ref().any(|line| {
            said = line;
            said.starts_with("adopted on CPU")
        }) {
            return Err(Failure::refused(said));
        }
        std::thread::spawn(move || lines.for_each(drop)); // its table
        Ok(adopted)
    }

    /// Takes the budgets away; the report.
    pub(super) fn finish(mut self) -> Result<serde_json::Value, Failure> {
        self.end()?;
        let text = std::fs::read_to_string(&self.json).map_err(Failure::refused)?;
        serde_json::from_str(&text).map_err(Failure::refused)
    }

    fn end(&mut self) -> Result<(), Failure> {
        const TERM: i32 = 15;
        if let Some(pid) = Tid::new(self.child.id().cast_signed()) {
            let process = Process::open(pid).map_err(Failure::refused)?;
            process.signal(TERM).map_err(Failure::refused)?;
        }
        self.child.wait().map_err(Failure::refused)?;
        Ok(())
    }
}

impl Drop for Adopted {
    fn drop(&mut self) {
        if matches!(self.child.try_wait(), Ok(None)) {
            self.end().ok(); // on the way out of an error
        }
    }
}
