//! Foreign programs: compiled or interpreted from their sources, asked by lines of text, and their
//! CPU time by `/proc`.

use crate::load::Nanos;
use replenish_cli::outcome::Failure;
use replenish_os::foreign::{Process, name, tasks};
use replenish_os::{CpuSet, SchedClass, Tid, affinity, current_tid, set_affinity, set_priority};
use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// A directory for the programs, removed when this is dropped.
#[derive(Debug)]
pub(super) struct Workshop(PathBuf);

impl Workshop {
    pub(super) fn new() -> Result<Self, Failure> {
        let name = format!("replenish-foreign-{}", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::create_dir(&path).map_err(Failure::refused)?;
        Ok(Self(path))
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// Compiles a C program.
    pub(super) fn c(&self, name: &str, source: &str) -> Result<PathBuf, Failure> {
        let (file, program) = (self.path(&format!("{name}.c")), self.path(name));
        std::fs::write(&file, source).map_err(Failure::refused)?;
        let mut compiler = Command::new("cc");
        compiler
            .args(["-O1", "-pthread", "-o"])
            .args([&program, &file]);
        match compiler.status() {
            Ok(status) if status.success() => Ok(program),
            Ok(status) => Err(Failure::refused(format!("cc {name}.c: {status}"))),
            Err(e) => Err(Failure::refused(format!(
                "a C compiler (cc) is needed: {e}"
            ))),
        }
    }

    /// Writes down a script.
    pub(super) fn script(&self, name: &str, source: &str) -> Result<PathBuf, Failure> {
        let file = self.path(name);
        std::fs::write(&file, source).map_err(Failure::refused)?;
        Ok(file)
    }
}

impl Drop for Workshop {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.0).ok(); // a temporary directory
    }
}

/// A running program; killed when this is dropped.
#[derive(Debug)]
pub(super) struct Program {
    child: Child,
    stdin: Option<ChildStdin>,
    lines: BufReader<ChildStdout>,
    pub(super) pid: Tid,
    process: Process,
    /// The words behind "ready".
    pub(super) greeting: String,
}

impl Program {
    /// Starts it on `cpu` in `class`, and waits until it says that it is ready.
    pub(super) fn start(
        command: &mut Command,
        cpu: usize,
        class: SchedClass,
    ) -> Result<Self, Failure> {
        let me = current_tid();
        let here = affinity(me).map_err(Failure::refused)?;
        // The program inherits both from this thread.
        set_affinity(me, &CpuSet::one(cpu)).map_err(Failure::refused)?;
        let classed = set_priority(me, class);
        let started = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn();
        set_priority(me, SchedClass::Other).map_err(Failure::refused)?;
        set_affinity(me, &here).map_err(Failure::refused)?;
        classed.map_err(Failure::refused)?;
        let mut child = started
            .map_err(|e| Failure::refused(format!("{}: {e}", command.get_program().display())))?;
        let none = || Failure::refused("a program has no pipe");
        let lines = BufReader::new(child.stdout.take().ok_or_else(none)?);
        let pid = Tid::new(child.id().cast_signed()).ok_or_else(none)?;
        let mut program = Self {
            stdin: child.stdin.take(),
            child,
            lines,
            pid,
            process: Process::open(pid).map_err(Failure::refused)?,
            greeting: String::new(),
        };
        program.greeting = program.line()?;
        match program.greeting.strip_prefix("ready") {
            Some(rest) => program.greeting = rest.trim().to_owned(),
            None => return Err(Failure::refused(format!("it said {:?}", program.greeting))),
        }
        Ok(program)
    }

    /// The next line.
    pub(super) fn line(&mut self) -> Result<String, Failure> {
        let mut line = String::new();
        match self.lines.read_line(&mut line) {
            Ok(0) => Err(Failure::refused("a foreign program has ended early")),
            Ok(_) => Ok(line.trim().to_owned()),
            Err(e) => Err(Failure::refused(e)),
        }
    }

    pub(super) fn say(&mut self, line: &str) -> Result<(), Failure> {
        let stdin = self.stdin.as_mut();
        let stdin = stdin.ok_or_else(|| Failure::refused("a program has no pipe"))?;
        writeln!(stdin, "{line}").map_err(Failure::refused)
    }

    /// The numbers of the next line.
    pub(super) fn numbers(&mut self) -> Result<Vec<i64>, Failure> {
        let line = self.line()?;
        let numbers = line.split_whitespace().map(str::parse);
        numbers.collect::<Result<_, _>>().map_err(Failure::refused)
    }

    /// Asks for `count` samples.
    pub(super) fn ask(&mut self, count: u32) -> Result<Vec<i64>, Failure> {
        self.say(&count.to_string())?;
        self.numbers()
    }

    pub(super) fn signal(&self, signal: i32) {
        self.process.signal(signal).ok(); // it has ended: seen at the next line
    }

    /// Gives all of its threads a class.
    pub(super) fn set_class(&self, class: SchedClass) -> Result<(), Failure> {
        for tid in tasks(self.pid).map_err(Failure::refused)? {
            set_priority(tid, class).map_err(Failure::refused)?;
        }
        Ok(())
    }

    /// CPU time of the threads whose name begins like this, by `/proc`.
    pub(super) fn cpu(&self, prefix: &str) -> Nanos {
        let tids = tasks(self.pid).unwrap_or_default().into_iter();
        tids.filter(|tid| name(*tid).is_some_and(|name| name.starts_with(prefix)))
            .map(|tid| {
                schedstat(Path::new(&format!(
                    "/proc/{}/task/{tid}/schedstat",
                    self.pid
                )))
            })
            .sum()
    }
}

fn schedstat(path: &Path) -> Nanos {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let first = text.split_whitespace().next();
    first.and_then(|word| word.parse().ok()).unwrap_or(0)
}

impl Drop for Program {
    fn drop(&mut self) {
        self.child.kill().ok();
        self.child.wait().ok();
    }
}

/// A Python program.
pub(super) fn python(interpreter: impl AsRef<OsStr>, script: &Path) -> Command {
    let mut command = Command::new(interpreter);
    command.arg(script);
    command
}
