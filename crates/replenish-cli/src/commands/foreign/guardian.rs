//! The guardian: a process of its own that gives threads back what they had when the process that
//! gives them budgets is killed, or stands still for a second.
//!
//! ```text
//!   supervisor ── stdin of the guardian ──────────────────────────► guardian
//!     hold TID START ORIGINAL       before the thread is changed      keeps it
//!     alone TID START               for one without a budget          leaves it alone
//!     drop TID                      after it was given back           forgets it
//!     process PID START ORIGINAL    before its first thread           looks for newborn threads
//!     leave PID                     after all of them                 does not any more
//!     cgroup DIRECTORY              threads are stopped there         empties it
//!     home PID DIRECTORY            before a process goes there       sends it back
//!     beat                          four times a second
//!     done                          everything was given back         ends
//!   (end of file: killed)                                             gives back, ends
//!   (silence for 1 s: stopped)                                        gives back, waits
//! ```
//!
//! A line is shorter than `PIPE_BUF`, so none is read by half. Where the guardian itself is killed,
//! the supervisor starts another one and repeats everything.

use super::give_back::Charge;
use crate::outcome::{Failure, Outcome};
use crate::time::{Nanos, SEC};
use replenish_os::foreign::Original;
use replenish_os::{PollFd, SchedClass, Tid, clock, current_tid, poll, set_priority};
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use std::fs::File;
use std::io::{Read, Write};
use std::os::fd::AsFd;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Silence after which the supervisor counts as standing still, in nanoseconds.
const SILENCE: Nanos = SEC;
/// Between two beats.
const BEAT: Nanos = SEC / 4;
/// The guardian's FIFO priority: below the enforcer's, above all that it may have to stop.
const PRIORITY: u8 = 98;

/// The supervisor's side.
#[derive(Debug)]
pub(super) struct Guardian {
    child: Child,
    pipe: Option<ChildStdin>,
    charge: Charge,
    cpu: usize,
    last_beat: Nanos,
    /// Times that one was killed and another took its place.
    pub(super) replaced: u64,
}

impl Guardian {
    /// Starts it, for threads that get budgets on `cpu`.
    pub(super) fn start(cpu: usize) -> Result<Self, Failure> {
        let (child, pipe) = spawn(cpu)?;
        Ok(Self {
            child,
            pipe: Some(pipe),
            charge: Charge::default(),
            cpu,
            last_beat: 0,
            replaced: 0,
        })
    }

    /// Its process.
    pub(super) fn pid(&self) -> u32 {
        self.child.id()
    }

    /// A thread is about to be changed.
    pub(super) fn hold(
        &mut self,
        tid: Tid,
        start: u64,
        original: &Original,
    ) -> Result<(), Failure> {
        self.charge.threads.insert(tid, (start, *original));
        self.say(&format!("hold {tid} {start} {original}\n"))
    }

    /// A thread has no budget and what it wants to have.
    pub(super) fn leave_alone(&mut self, tid: Tid, start: u64) -> Result<(), Failure> {
        self.charge.alone.insert(tid, start);
        self.say(&format!("alone {tid} {start}\n"))
    }

    /// A thread has what it had, or has ended.
    pub(super) fn forget(&mut self, tid: Tid) -> Result<(), Failure> {
        self.charge.threads.remove(&tid);
        self.charge.alone.remove(&tid);
        self.say(&format!("drop {tid}\n"))
    }

    /// Threads of this process are about to be changed.
    pub(super) fn process(
        &mut self,
        pid: Tid,
        start: u64,
        first: &Original,
    ) -> Result<(), Failure> {
        self.charge.processes.insert(pid, (start, *first));
        self.say(&format!("process {pid} {start} {first}\n"))
    }

    /// No thread of this process has a budget any more.
    pub(super) fn leave(&mut self, pid: Tid) -> Result<(), Failure> {
        self.charge.processes.remove(&pid);
        self.charge.homes.homes.remove(&pid);
        self.say(&format!("leave {pid}\n"))
    }

    /// Threads are stopped in this control group.
    pub(super) fn cgroup(&mut self, base: &Path) -> Result<(), Failure> {
        self.charge.homes.base = base.to_path_buf();
        self.say(&format!("cgroup {}\n", base.display()))
    }

    /// A process is about to be moved there.
    pub(super) fn home(&mut self, pid: Tid, home: &Path) -> Result<(), Failure> {
        self.charge.homes.homes.insert(pid, home.to_path_buf());
        self.say(&format!("home {pid} {}\n", home.display()))
    }

    /// This process is alive; to be called more often than four times a second.
    pub(super) fn beat(&mut self) -> Result<(), Failure> {
        let now = clock::monotonic();
        if now.saturating_sub(self.last_beat) < BEAT {
            return Ok(());
        }
        self.last_beat = now;
        self.say("beat\n")
    }

    fn say(&mut self, line: &str) -> Result<(), Failure> {
        let alive = matches!(self.child.try_wait(), Ok(None));
        let written = |pipe: &mut ChildStdin| pipe.write_all(line.as_bytes());
        if alive && self.pipe.as_mut().is_some_and(|pipe| written(pipe).is_ok()) {
            return Ok(());
        }
        // Killed, or its pipe is closed.
        self.child.kill().ok();
        self.child.wait().ok();
        let (child, mut pipe) = spawn(self.cpu)?;
        let mut all = String::new();
        for (word, held) in [
            ("hold", &self.charge.threads),
            ("process", &self.charge.processes),
        ] {
            for (tid, (start, original)) in held {
                all.push_str(&format!("{word} {tid} {start} {original}\n"));
            }
        }
        for (tid, start) in &self.charge.alone {
            all.push_str(&format!("alone {tid} {start}\n"));
        }
        let homes = &self.charge.homes;
        if !homes.base.as_os_str().is_empty() {
            all.push_str(&format!("cgroup {}\n", homes.base.display()));
        }
        for (pid, home) in &homes.homes {
            all.push_str(&format!("home {pid} {}\n", home.display()));
        }
        let told = pipe.write_all(all.as_bytes());
        (self.child, self.pipe) = (child, Some(pipe));
        self.replaced += 1;
        told.map_err(|e| Failure::refused(format!("the guardian does not listen: {e}")))
    }

    /// Everything was given back.
    pub(super) fn dismiss(mut self) {
        if let Some(mut pipe) = self.pipe.take() {
            pipe.write_all(b"done\n").ok(); // end of file comes next, and gives back twice
        }
        self.child.wait().ok();
    }
}

fn spawn(cpu: usize) -> Result<(Child, ChildStdin), Failure> {
    let refused = |e| Failure::refused(format!("cannot start the guardian: {e}"));
    let mut child = Command::new("/proc/self/exe")
        .args(["guardian", &cpu.to_string()])
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .process_group(0) // signals of the terminal are not for it
        .spawn()
        .map_err(refused)?;
    let pipe = child.stdin.take();
    let pipe = pipe.ok_or_else(|| Failure::refused("the guardian has no standard input"))?;
    Ok((child, pipe))
}

/// Options of `guardian`.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// The CPU of the threads that get budgets.
    cpu: usize,
}

/// The guardian's side: waits, gives back, ends.
pub(crate) fn run(args: &Args) -> Outcome {
    // Ends with its supervisor and not before.
    for signal in [SIGHUP, SIGINT, SIGQUIT, SIGTERM] {
        let ignored = Arc::new(AtomicBool::new(false));
        signal_hook::flag::register(signal, ignored).map_err(Failure::refused)?;
    }
    // Where a thread with a budget keeps the only CPU busy, it has to come first.
    set_priority(current_tid(), SchedClass::Fifo(PRIORITY)).ok();
    let stdin = std::io::stdin();
    let fd = stdin.as_fd().try_clone_to_owned();
    let mut input = File::from(fd.map_err(Failure::refused)?);
    let mut charge = Charge::default();
    let mut text = Vec::new();
    loop {
        let deadline = clock::monotonic() + SILENCE;
        match poll(&mut [PollFd::readable(&input)], Some(deadline)) {
            Ok(0) => {
                charge.give_back(args.cpu);
                continue;
            }
            Ok(_) => {}
            Err(_) => break,
        }
        let mut bytes = [0; 4096];
        match input.read(&mut bytes) {
            Ok(0) => break,
            Ok(length) => text.extend_from_slice(bytes.get(..length).unwrap_or_default()),
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(_) => break,
        }
        while let Some(end) = text.iter().position(|byte| *byte == b'\n') {
            let line: Vec<u8> = text.drain(..=end).collect();
            if !charge.obey(String::from_utf8_lossy(&line).trim_end()) {
                return Ok(());
            }
        }
    }
    charge.give_back(args.cpu);
    charge.homes.remove();
    Ok(())
}

impl Charge {
    /// Carries out a line; `false` if it was the last one.
    fn obey(&mut self, line: &str) -> bool {
        let (word, rest) = line.split_once(' ').unwrap_or((line, ""));
        let held = || {
            let (tid, rest) = rest.split_once(' ')?;
            let (start, original) = rest.split_once(' ')?;
            let tid = Tid::new(tid.parse().ok()?)?;
            Some((tid, (start.parse().ok()?, original.parse().ok()?)))
        };
        let number = rest.parse().ok().and_then(Tid::new);
        match word {
            "hold" => self.threads.extend(held()),
            "process" => self.processes.extend(held()),
            "alone" => {
                let (tid, start) = rest.split_once(' ').unwrap_or_default();
                let tid = tid.parse().ok().and_then(Tid::new);
                self.alone.extend(tid.zip(start.parse().ok()));
            }
            "drop" => {
                number.and_then(|tid| self.threads.remove(&tid));
                number.and_then(|tid| self.alone.remove(&tid));
            }
            "leave" => {
                number.and_then(|pid| self.processes.remove(&pid));
                number.and_then(|pid| self.homes.homes.remove(&pid));
            }
            "cgroup" => self.homes.base = PathBuf::from(rest),
            "home" => {
                let (pid, home) = rest.split_once(' ').unwrap_or_default();
                let pid = pid.parse().ok().and_then(Tid::new);
                self.homes
                    .homes
                    .extend(pid.map(|pid| (pid, PathBuf::from(home))));
            }
            _ => {}
        }
        word != "done"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_kept_and_dropped() {
        let mut charge = Charge::default();
        assert!(charge.obey("hold 7 11 0 0 5 0 0 0 0 0-1"));
        assert!(charge.obey("process 7 11 0 0 5 0 0 0 0 0-1"));
        assert!(charge.obey("beat") && charge.obey("alone 9 11"));
        assert_eq!(charge.alone.len(), 1);
        assert!(charge.obey("drop 9"));
        assert_eq!(charge.alone.len(), 0);
        for damaged in [
            "hold",
            "hold 7",
            "hold -1 11 0 0 0 0 0 0 0 0",
            "hold 8 11 x",
            "drop x",
            "",
        ] {
            assert!(charge.obey(damaged));
        }
        assert_eq!(charge.threads.len(), 1);
        assert_eq!(charge.processes.len(), 1);
        assert!(charge.obey("cgroup /a b") && charge.obey("home 7 /c d") && charge.obey("home"));
        assert_eq!(charge.homes.homes.len(), 1);
        assert!(charge.obey("drop 7"));
        assert!(charge.obey("leave 7"));
        assert_eq!(charge.homes.homes.len(), 0);
        charge.homes.base = PathBuf::new();
        assert_eq!((charge.threads.len(), charge.processes.len()), (0, 0));
        assert!(!charge.obey("done"));
    }
}
