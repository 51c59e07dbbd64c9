//! One program's recording.

use super::directories::directories;
use crate::outcome::Failure;
use replenish_os::live::open_plain;
use replenish_recorder::{Source, View};
use std::ffi::OsStr;
use std::fs::{File, TryLockError};
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::{Path, PathBuf};

/// More files of one directory are not looked at.
const MAX_FILES: usize = 4096;

/// A file that is read by position. Nothing of it is mapped, so truncating it does not end this
/// program.
pub(crate) struct ByPlace {
    file: File,
    bytes: u64,
}

impl Source for ByPlace {
    fn bytes(&self) -> u64 {
        self.bytes
    }

    fn fill(&self, offset: u64, buffer: &mut [u8]) -> bool {
        self.file.read_exact_at(buffer, offset).is_ok()
    }
}

/// A program and its recording.
pub(crate) struct Program {
    pub(crate) path: PathBuf,
    pub(crate) view: View,
    pub(crate) source: ByPlace,
    /// The program runs: it holds its file's lock.
    pub(crate) alive: bool,
}

impl Program {
    /// Whether `path` leads to the file that is read.
    pub(crate) fn is_at(&self, path: &Path) -> bool {
        let number = |file: &std::fs::Metadata| (file.dev(), file.ino());
        match (self.source.file.metadata(), std::fs::metadata(path)) {
            (Ok(read), Ok(there)) => number(&read) == number(&there),
            _ => false,
        }
    }

    /// Opens a recording; the error says why it is left out.
    pub(crate) fn open(path: &Path) -> Result<Self, String> {
        let file = open_plain(path).map_err(|e| e.to_string())?;
        let bytes = file.metadata().map_err(|e| e.to_string())?.len();
        let alive = matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock));
        if !alive {
            file.unlock().ok(); // it is given back at the end otherwise
        }
        let source = ByPlace { file, bytes };
        let view = View::read(&source).map_err(|e| e.to_string())?;
        Ok(Self {
            path: path.into(),
            view,
            source,
            alive,
        })
    }
}

/// The programs of this host.
#[derive(Default)]
pub(crate) struct Found {
    /// Programs by name and process id.
    pub(crate) programs: Vec<Program>,
    /// Files that were left out, and why.
    pub(crate) warnings: Vec<String>,
}

/// Every program whose recording can be read.
pub(crate) fn all() -> Found {
    let mut found = Found::default();
    for directory in directories() {
        detail!("looking for recordings in {}", directory.display());
        let entries = std::fs::read_dir(&directory).into_iter().flatten();
        for path in entries.take(MAX_FILES).flatten().map(|entry| entry.path()) {
            if path.extension() != Some(OsStr::new("live")) {
                continue;
            }
            match Program::open(&path) {
                Ok(program) => found.programs.push(program),
                Err(why) if path.exists() => {
                    // The name is a stranger's, too.
                    found.warnings.push(format!("left out: {path:?}: {why}"));
                }
                Err(_) => {} // it has just ended
            }
        }
    }
    let key = |p: &Program| (p.view.program.clone(), p.view.pid, p.path.clone());
    found.programs.sort_by_cached_key(key);
    found
}

/// The program that is meant by a file, a process id or a name: one that runs before those that
/// have ended, and of these the newest.
pub(crate) fn select(what: &str) -> Result<Program, Failure> {
    let path = Path::new(what);
    if path.components().count() > 1 || path.extension() == Some(OsStr::new("live")) {
        return Program::open(path).map_err(|e| Failure::refused(e).context(what));
    }
    let Found { programs, warnings } = all();
    let names = |p: &Program| p.view.program == what || p.view.pid.to_string() == what;
    let mut meant: Vec<Program> = programs.into_iter().filter(names).collect();
    meant.sort_by_key(|p| (p.alive, p.view.clocks.monotonic));
    let running: Vec<String> = meant.iter().filter(|p| p.alive).map(number).collect();
    if running.len() > 1 {
        let running = running.join(", ");
        let why = format!("{what}: several run, name one by its process id: {running}");
        return Err(Failure::refused(why));
    }
    meant.pop().ok_or_else(|| {
        let mut why =
            format!("{what}: no recording of such a program; `replenish top --once` lists them");
        warnings
            .iter()
            .for_each(|w| why.push_str(&format!("; {w}")));
        Failure::refused(why)
    })
}

fn number(program: &Program) -> String {
    program.view.pid.to_string()
}
