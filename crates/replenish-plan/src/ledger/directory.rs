//! The directory of a host, and admission beside what is reserved in it.

use super::entry::LedgerEntry;
use super::error::{Denied, LedgerError};
use super::file::{self, Reservation, VARIABLE};
use super::lock;
use crate::{Plan, Promise, Request, plan};
use std::fs::{DirBuilder, File};
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

/// The directory if no other is named.
pub const DEFAULT: &str = "/run/replenish";

/// A directory with reservations.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Ledger {
    pub(super) directory: PathBuf,
    strict: bool,
}

/// The reservations at a moment.
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
    /// The plan that it runs with.
    pub plan: Plan,
    /// Its place in the ledger, until dropped.
    pub reservation: Reservation,
    /// Files that were left out, and why.
    pub warnings: Vec<String>,
}

/// The ledger that programs use by default.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Found {
    /// The ledger that was found.
    Here(Ledger),
    /// The user wants no ledger.
    Off,
    /// No ledger is available, and the reason.
    Nowhere(String),
}

impl Ledger {
    /// The ledger in `directory`, which is created if it does not exist; then only its owner may
    /// reserve in it, whatever the umask.
    ///
    /// # Errors
    /// If it can neither be found nor created, or is no directory.
    pub fn open(directory: impl Into<PathBuf>) -> Result<Self, LedgerError> {
        let directory = directory.into();
        let wrong = |e: &dyn std::fmt::Display| LedgerError::new(&directory, e.to_string());
        match DirBuilder::new().mode(0o755).create(&directory) {
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

    /// As [`find`](Self::find), for programs that only look: creates nothing. Where there is no
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

    /// Path of the directory.
    #[must_use]
    pub fn directory(&self) -> &Path {
        &self.directory
    }

    /// The reservations now; none where there is no directory. An account that may not reserve
    /// here looks without the lock, and may miss a program that is just being admitted.
    ///
    /// # Errors
    /// If the directory cannot be read, or another account that may reserve keeps it locked; with
    /// [`strict`](Self::strict) if an entry makes no sense.
    pub fn view(&self) -> Result<LedgerView, LedgerError> {
        if !self.directory.exists() {
            return Ok(LedgerView {
                entries: Vec::new(),
                warnings: Vec::new(),
            });
        }
        let lock = lock::take(&self.directory)?;
        self.read(lock.is_some())
    }

    /// Plans `request` beside everything that is reserved and, if it holds, reserves it for as long
    /// as the result lives. `program` names the owner for others; the first 200 bytes are kept.
    ///
    /// # Errors
    /// [`Denied::Refused`] if it does not fit; [`Denied::Ledger`] as [`view`](Self::view), and if
    /// nothing can be written.
    pub fn admit(&self, request: &Request, program: &str) -> Result<Admitted, Denied> {
        let _lock = self.lock()?;
        let view = self.read(true)?;
        let mut request = request.clone();
        for entry in &view.entries {
            let first = Promise::next_lock(request.locks.len(), &request.promised);
            request.promised.extend(entry.promises(first));
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
        lock::take(&self.directory)?.ok_or_else(|| {
            let reason = format!(
                "this account may not reserve here (who may write to it may; {VARIABLE} names another directory, or is off)"
            );
            LedgerError::new(&self.directory, reason)
        })
    }

    fn read(&self, tidy: bool) -> Result<LedgerView, LedgerError> {
        let (entries, wrong) = file::read_all(&self.directory, tidy)?;
        if self.strict
            && let Some(first) = wrong.first()
        {
            return Err(first.clone());
        }
        let warnings = wrong.iter().map(|e| format!("left out: {e}")).collect();
        Ok(LedgerView { entries, warnings })
    }
}
