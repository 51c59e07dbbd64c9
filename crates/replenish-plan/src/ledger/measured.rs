//! The costs of enforcement on this host: measured once (`replenish doctor --save`), used by all
//! programs.
//!
//! A file beside the entries, in the words of a deployment file, so that it can be read and changed
//! by hand. An account that may reserve may write it.

use super::directory::Ledger;
use super::error::LedgerError;
use super::file;
use super::open::open_plain;
use crate::span::Exact;
use crate::{Deployment, Overheads};
use std::io::{self, Read};

/// Name of the file.
const FILE: &str = "overheads.toml";
/// Longer files are refused, in bytes.
const MOST: u64 = 4096;

impl Ledger {
    /// The overheads measured here; `None`: none were. A value that the file leaves out is
    /// [`Overheads::LINUX`]'s.
    ///
    /// # Errors
    /// If the file cannot be read or makes no sense, with the place in it.
    pub fn overheads(&self) -> Result<Option<Overheads>, LedgerError> {
        let path = self.directory.join(FILE);
        let wrong = |e: &dyn std::fmt::Display| LedgerError::new(&path, e.to_string());
        let file = match open_plain(&path) {
            Ok(file) => file,
            Err(e) if e.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(wrong(&e)),
        };
        let mut text = String::new();
        let mut limited = file.take(MOST + 1);
        limited.read_to_string(&mut text).map_err(|e| wrong(&e))?;
        if text.len() as u64 > MOST {
            return Err(wrong(&format!("it is longer than {MOST} bytes")));
        }
        let read = Deployment::parse(&text, &path.display().to_string());
        read.map(|read| Some(read.machine.overheads))
            .map_err(|e| wrong(&e))
    }

    /// Keeps what was measured, with a line that says how; programs that start from now on count
    /// with it.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn set_overheads(&self, overheads: &Overheads, how: &str) -> Result<(), LedgerError> {
        let path = self.directory.join(FILE);
        let names = Overheads::NAMES.iter().zip(overheads.all());
        let lines = names.map(|(name, value)| format!("{name} = \"{}\"\n", Exact(value)));
        let how = how.replace(char::is_control, " ");
        let text = format!(
            "# {how}\n[machine.overheads]\n{}",
            lines.collect::<String>()
        );
        let _lock = self.lock()?;
        file::put(&self.directory, FILE, "", text.as_bytes())
            .map(drop)
            .map_err(|e| LedgerError::new(&path, e.to_string()))
    }
}
