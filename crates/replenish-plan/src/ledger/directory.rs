//! The directory of a host, and admission beside what is reserved in it.

use super::entry::LedgerEntry;
use super::error::{Denied, LedgerError};
use super::file::{self, Reservation, VARIABLE};
use crate::{Plan, Request, plan};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The directory if no other is named.
pub const DEFAULT: &str = "/run/replenish";

/// How long admission waits for others to finish theirs.
const PATIENCE: Duration = Duration::from_secs(10);

/// A directory with reservations.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ledger {
    pub(super) directory: PathBuf,
    strict: bool,
}

/// What is reserved at a moment.
#[derive(Debug, Clone, PartialEq)]
pub struct LedgerView {
    /// The entries of programs that live.
    pub entries: Vec<LedgerEntry>,
    /// Files that were left out, and why.
    pub warnings: Vec<String>,
}

/// A program that was admitted.
#[derive(Debug)]
pub struct Admitted {
    /// What it shall run with.
    pub plan: Plan,
    /// Its place in the ledger, until dropped.
    pub reservation: Reservation,
    /// Files that were left out, and why.
    pub warnings: Vec<String>,
}

/// The ledger that programs use if they are not told otherwise.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Found {
    /// This one.
    Here(Ledger),
    /// None is wanted.
    Off,
    /// None can be had, and why.
    Nowhere(String),
}

impl Ledger {
    /// The ledger in `directory`, which is created if it does not exist.
    ///
    /// # Errors
    /// If it can neither be found nor created, or is no directory.
    pub fn open(directory: impl Into<PathBuf>) -> Result<Self, LedgerError> {
        let directory = directory.into();
        let wrong = |e: &dyn std::fmt::Display| LedgerError::new(&directory, e.to_string());
        match std::fs::create_dir(&directory) {
            Ok(()) => {}
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => {
                let facts = std::fs::metadata(&directory).map_err(|e| wrong(&e))?;
                if !facts.is_dir() {
                    return Err(wrong(&"it is not a directory"));
                }
            }
            Err(e) => return Err(wrong(&e)),
        }
        Ok(Self {
            directory,
            strict: false,
        })
    }

    /// The ledger of this host and user: the directory that [`VARIABLE`] names, else
    /// [`DEFAULT`], else `replenish` in `$XDG_RUNTIME_DIR`.
    ///
    /// # Errors
    /// If the directory that is named cannot be used.
    pub fn find() -> Result<Found, LedgerError> {
        if let Some(named) = std::env::var_os(VARIABLE).filter(|v| !v.is_empty()) {
            if named == "off" {
                return Ok(Found::Off);
            }
            return Self::open(PathBuf::from(named)).map(Found::Here);
        }
        let mut why = match Self::open(DEFAULT) {
            Ok(ledger) => return Ok(Found::Here(ledger)),
            Err(e) => e.to_string(),
        };
        if let Some(own) = std::env::var_os("XDG_RUNTIME_DIR").filter(|v| !v.is_empty()) {
            match Self::open(Path::new(&own).join("replenish")) {
                Ok(ledger) => return Ok(Found::Here(ledger)),
                Err(e) => why = format!("{why}; {e}"),
            }
        }
        Ok(Found::Nowhere(why))
    }

    /// As [`find`](Self::find), for those who only look: creates nothing. Where there is no
    /// directory yet, nothing is reserved.
    ///
    /// # Errors
    /// If the directory that is named is none.
    pub fn look() -> Result<Found, LedgerError> {
        let at = |directory: PathBuf| Self {
            directory,
            strict: false,
        };
        if let Some(named) = std::env::var_os(VARIABLE).filter(|v| !v.is_empty()) {
            let named = PathBuf::from(named);
            return match named.exists() {
                _ if named == Path::new("off") => Ok(Found::Off),
                true => Self::open(named).map(Found::Here),
                false => Ok(Found::Here(at(named))),
            };
        }
        let usual = PathBuf::from(DEFAULT);
        let own = std::env::var_os("XDG_RUNTIME_DIR").filter(|v| !v.is_empty());
        let own = own.map(|own| Path::new(&own).join("replenish"));
        let there = if usual.is_dir() {
            None
        } else {
            own.filter(|own| own.is_dir())
        };
        Ok(Found::Here(at(there.unwrap_or(usual))))
    }

    /// `true`: an entry that makes no sense is an error. Default: a warning.
    #[must_use]
    pub fn strict(mut self, strict: bool) -> Self {
        self.strict = strict;
        self
    }

    /// Where it is.
    #[must_use]
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// What is reserved now; nothing where there is no directory.
    ///
    /// # Errors
    /// If the directory cannot be read, or somebody keeps it locked; with
    /// [`strict`](Self::strict) if an entry makes no sense.
    pub fn view(&self) -> Result<LedgerView, LedgerError> {
        if !self.directory.exists() {
            return Ok(LedgerView {
                entries: Vec::new(),
                warnings: Vec::new(),
            });
        }
        let _lock = self.lock()?;
        self.read()
    }

    /// Plans `request` beside everything that is reserved and, if it holds, reserves it for as long
    /// as the result lives. `program` names the owner for others; the first 200 bytes are kept.
    ///
    /// # Errors
    /// [`Denied::Refused`] if it does not fit; [`Denied::Ledger`] as [`view`](Self::view), and if
    /// nothing can be written.
    pub fn admit(&self, request: &Request, program: &str) -> Result<Admitted, Denied> {
        let _lock = self.lock()?;
        let view = self.read()?;
        let mut request = request.clone();
        for entry in &view.entries {
            request.promised.extend(entry.promises());
            let overheads = &mut request.machine.overheads;
            *overheads = overheads.worst(&entry.overheads);
        }
        let plan = plan(&request)?;
        let entry = LedgerEntry::of(&request, &plan, program);
        let reservation = file::add(&self.directory, &entry)?;
        Ok(Admitted {
            plan,
            reservation,
            warnings: view.warnings,
        })
    }

    pub(super) fn lock(&self) -> Result<File, LedgerError> {
        let path = self.directory.join("lock");
        let wrong = |e: &std::io::Error| LedgerError::new(&path, e.to_string());
        let file = file::open_lock(&path).map_err(|e| wrong(&e))?;
        let start = Instant::now();
        loop {
            match file.try_lock() {
                Ok(()) => return Ok(file),
                Err(std::fs::TryLockError::Error(e)) => return Err(wrong(&e)),
                Err(std::fs::TryLockError::WouldBlock) if start.elapsed() > PATIENCE => {
                    let seconds = PATIENCE.as_secs();
                    let why = format!("somebody has kept it locked for {seconds} s");
                    return Err(LedgerError::new(&path, why));
                }
                Err(std::fs::TryLockError::WouldBlock) => {
                    std::thread::sleep(Duration::from_millis(2));
                }
            }
        }
    }

    fn read(&self) -> Result<LedgerView, LedgerError> {
        let (entries, wrong) = file::read_all(&self.directory)?;
        if self.strict
            && let Some(first) = wrong.first()
        {
            return Err(first.clone());
        }
        let warnings = wrong.iter().map(|e| format!("left out: {e}")).collect();
        Ok(LedgerView { entries, warnings })
    }
}
